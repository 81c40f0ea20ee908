"""The schedule alone: scripted candidates, a counted clock, and nothing that is solved."""

import math
from dataclasses import dataclass

from hypothesis import example, given, settings
from hypothesis import strategies as st

from icpmodel.solve.schedule import SHARE, Expected, Schedule, Stage

KAPPA, LOOK, AGAIN = 1 / SHARE, 6, 3.0


@dataclass(frozen=True)
class Script:
    """What a candidate says, and what it does: `steps` of one `cost`, its residual falling by `falls` in turn; of a
    `finite` one nothing is told unless it `tells`."""

    said: float
    setup: float
    cost: float
    steps: int
    falls: tuple[float, ...]
    finite: bool
    weight: float
    tells: bool = False

    @property
    def total(self):
        return self.setup + self.cost * self.steps

    @property
    def to_the_look(self):
        """What it costs up to the look at which, or after which, it is done."""
        look = 1 if self.finite else LOOK
        while look < self.steps:
            look = look + 1 if self.finite else math.ceil(AGAIN * look)
        return self.setup + self.cost * look

    def expected(self):
        return Expected(self.said, self.setup, self.cost, self.finite, self.weight)


costs = st.floats(0.01, 100.0)
scripts = st.builds(
    Script,
    said=st.floats(1e-3, 1e5),
    setup=st.one_of(st.just(0.0), costs),
    cost=costs,
    steps=st.integers(1, 300),
    falls=st.lists(st.floats(-5.0, 5.0), min_size=1, max_size=6).map(tuple),
    finite=st.booleans(),
    weight=st.sampled_from([1 / 1.2, 1.0, 2.0]),
    tells=st.booleans(),
)


def spent_until_one_is_done(candidates, need=18.0):
    """What is counted until the first candidate is through with its script."""
    schedule = Schedule(iter([Stage(0.0, lambda: [(one, one.expected()) for one in candidates])]))
    total = 0.0
    while True:
        turn = schedule.turn()
        script = turn.who
        look = False
        while not look:
            cost = script.cost + (0.0 if turn.steps else script.setup)
            total += cost
            fallen = turn.fallen[-1] + script.falls[turn.steps % len(script.falls)]
            look = turn.stepped(cost, (fallen, need) if script.tells or not script.finite else None)
            if turn.steps == script.steps:
                return total


class TestBound:
    @given(st.lists(scripts, min_size=1, max_size=6))
    @settings(max_examples=150, deadline=None)
    @example(  # says that one more step will do, for ever
        [Script(1e-3, 0.0, 1.0, 300, (17.9, 0.0, 0.0), False, 1.0), Script(1e5, 0.0, 0.05, 3, (0.0,), True, 2.0)]
    )
    def test_the_total_is_a_fixed_multiple_of_the_best_in_hindsight_whatever_was_expected(self, candidates):
        best = min(one.to_the_look for one in candidates)
        one_look_each = sum(one.setup + one.cost for one in candidates)
        bound = (4.8 * KAPPA * (len(candidates) - 1) + 1.0) * best + one_look_each
        assert spent_until_one_is_done(candidates) <= bound * (1 + 1e-9)

    @given(st.lists(scripts, min_size=1, max_size=6))
    @settings(max_examples=100, deadline=None)
    def test_where_all_cost_what_they_expect_the_best_is_paid_and_little_for_shows(self, candidates):
        honest = [Script(one.total, one.setup, one.cost, one.steps, one.falls, True, 1.0) for one in candidates]
        best = min(one.total for one in honest)
        assert spent_until_one_is_done(honest) <= best * (1.0 + (len(honest) - 1) / KAPPA) * (1 + 1e-9)


def turn_of(*candidates):
    return Schedule(iter([Stage(0.0, lambda: list(candidates))])).turn()


def test_the_least_expected_cost_has_the_first_turn():
    assert turn_of(("slow", Expected(90.0, 1.0, 9.0, True)), ("quick", Expected(30.0, 1.0, 9.0, True))).who == "quick"


def test_a_method_of_the_paper_is_preferred_up_to_a_fifth_and_a_shortcut_must_cost_half():
    ours, paper = ("ours", Expected(50.0, 9.0, 9.0, True)), Expected(59.0, 9.0, 9.0, True, 1 / 1.2)
    assert turn_of(ours, ("paper", paper)).who == "paper"
    assert turn_of(ours, ("paper", paper._replace(cost=61.0))).who == "ours"
    assert turn_of(ours, ("short", Expected(26.0, 9.0, 9.0, True, 2.0))).who == "ours"
    assert turn_of(ours, ("short", Expected(24.0, 9.0, 9.0, True, 2.0))).who == "short"
