"""Whose turn it is: the one principle by which `solve` goes from one method to another.

All costs are in products with A, counted and not clocked. Every candidate i says what it expects to cost, E_i, and what
its next look costs, a few steps, with its set-up if that is still to be made. What it has left, l_i, is E_i less what
was spent on it, s_i, until there is a rate; from then on what `forecast` makes of the rate, and where it ends after
some steps, those that it expected and has not made, each at the cost of those that it has. A candidate that has spent
twice what it said counts as one with at least s_i left, and says so anew when it is its turn again. Nobody is thrown
away; who waits goes on where it was. At every look the turn is with the least of

    π_i = min(w_i l_i, κ(s_i + the cost up to its next look)),        κ = 8,

w_i ≤ 2 being what the choice makes of the kind of the method. The second term lets each candidate show what it can do
for 1/κ of what the best one has left, whatever was expected of it.

**Bound.** Let T be what the best candidate, *, costs in hindsight from where it begins, up to the look that would
follow (twice as much more, or a first look), and let nobody's look cost more than it said. While * is not done, π_* ≤
κT. So a candidate i has its turn only with π_i ≤ κT. Where that is the second term, s_i ≤ T after the look. Where it is
the first, l_i ≤ κT/w_i, and it is overdue when it has spent 2(s + l_i), s what it had spent when it said so: at most T
if it had its turns by the second term before, at most l_i if it was overdue. So it spends no more than 4κT/w_i, as then
s_i ≤ l_i ends its turns. With w_i ≥ 1/1.2 that is 4.8κT, and m candidates cost at most (4.8κ(m − 1) + 1)T and a look
each, whatever was expected.
Where they cost what they expect to, the least expected cost is paid, and at most (m − 1)/κ of it for shows.
Facts that further candidates need have a turn as well, when twelve times their cost is least, and what these candidates
cost at the least is not more either: while * is not done each look at facts costs no more than κT/12.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from typing import Generic, NamedTuple, TypeVar

#: the share of what the best one has left that others may cost to show what they can do, and facts
SHARE, FACT_SHARE = 1 / 8, 1 / 12
#: a further look comes whenever the number of steps has grown by this factor
_AGAIN = 3.0
#: the least share of the mean speed so far that is expected of steps that creep and of others, a residual that has not
#: fallen counting as fallen by e
_SLOWER, _STEADY = 1 / 8, 1 / 2

T = TypeVar("T")


class Expected(NamedTuple):
    """What a candidate says: its whole `cost`, and that of its set-up and of a step, 0 where its steps are not alike.

    `finite`: it ends after some steps, each of which is looked at, and of which the rate of the residual says nothing;
    else the rate is looked at after `look` steps. `weight`: what its cost is multiplied by. `creeps`: its steps are
    expected to gain less and less, as those of sweeps do.
    """

    cost: float
    setup: float
    step: float
    finite: bool = False
    weight: float = 1.0
    look: int = 6
    creeps: bool = True


class Turn(Generic[T]):
    """A candidate in the schedule: `who`, what it expected, and what it did."""

    def __init__(self, who: T, expected: Expected) -> None:
        self.who, self.expected = who, expected
        self.steps, self.spent, self.fallen = 0, 0.0, [0.0]
        #: what a step costs, by those that were made; but for the first one, where it had the set-up with it
        self.step_cost, self._first = expected.step, 0.0
        self.due, self._whole = 2.0 * expected.cost, expected.cost
        self._look = 1 if expected.finite else expected.look
        # the steps to come, and how many were made when that was said
        self._forecast: tuple[float, int] | None = None

    def stepped(self, cost: float, fallen: tuple[float, float] | None) -> bool:
        """Count a step; whether it is time for a look. `fallen`: by how much a logarithm has fallen, as a rule that of
        the residual, and by how much it has to; None where nothing tells how many steps are left."""
        said = self.expected
        if not self.steps:
            self._first = cost if said.setup > 0.0 else 0.0
            if said.finite and said.step > 0.0:
                self._forecast = (said.cost - said.setup) / said.step, 0
        self.steps += 1
        self.spent += cost
        if alike := self.steps - (said.setup > 0.0):
            self.step_cost = (self.spent - self._first) / alike
        if fallen is not None:
            self.fallen.append(fallen[0])
        if self.steps < self._look and self.spent < self.due:
            return False
        # a first step of a finite one tells something, of sweeps two do
        if fallen is not None and (said.finite or self.steps > 1):
            self._forecast = forecast(self.fallen, fallen[1], said.creeps), self.steps
        if self._forecast is not None:
            self.due = min(self.due, 2.0 * (self.spent + self.left))
        self._look = self.steps + 1 if said.finite else math.ceil(_AGAIN * self.steps)
        return True

    @property
    def left(self) -> float:
        """What it has left to cost."""
        if self._forecast is None:
            left = max(self._whole - self.spent, self.step_cost)
        else:
            steps, at = self._forecast
            left = max(steps - (self.steps - at), 1.0) * self.step_cost
        return max(left, self.spent) if self.spent >= self.due else left

    @property
    def priority(self) -> float:
        """π: the least has the turn."""
        look = (self._look - self.steps) * self.step_cost + (0.0 if self.steps else self.expected.setup)
        return min(self.expected.weight * self.left, (self.spent + look) / SHARE)

    def begin(self) -> None:
        """Its turn begins: where it is overdue it says anew when it will be done."""
        if self.spent >= self.due:
            self._whole = self.spent + self.left
            if self.expected.finite and self._forecast is not None:
                self._forecast = self.left / self.step_cost, self.steps
            self.due = 2.0 * self._whole


class Stage(NamedTuple, Generic[T]):
    """Candidates that are `made` only where the facts that they need, at this `cost`, are worth asking for.

    `least`: what each of them costs at least, whatever the facts are.
    """

    cost: float
    made: Callable[[], list[tuple[T, Expected]]]
    least: float = 0.0

    @property
    def priority(self) -> float:
        """As that of a candidate."""
        return max(self.cost / FACT_SHARE, self.least)


def in_turn(*order: T) -> Iterator[Stage[T]]:
    """Stages of one candidate each, of which nothing is expected: the next one comes where those before have ended."""
    for place, one in enumerate(order):
        yield Stage(math.inf if place else 0.0, lambda one=one: [(one, Expected(1.0, 0.0, 1.0))])  # type: ignore[misc]


class Schedule(Generic[T]):
    """Who is waiting, and what could still be asked for."""

    def __init__(self, stages: Iterator[Stage[T]]) -> None:
        self._stages, self._next = stages, next(stages, None)
        self.waiting: list[Turn[T]] = []

    def turn(self) -> Turn[T] | None:
        """Whose turn it is, None where nobody is left."""
        while True:
            priorities = [one.priority for one in self.waiting]
            least = min(priorities, default=math.inf)
            if self._next is None or least < self._next.priority:
                break
            self.waiting += [Turn(who, expected) for who, expected in self._next.made()]
            self._next = next(self._stages, None)
        if not priorities:
            return None
        turn = self.waiting[priorities.index(least)]
        turn.begin()
        return turn

    def end(self, turn: Turn[T]) -> None:
        """`turn` is over for good."""
        self.waiting.remove(turn)


def forecast(fallen: list[float], need: float, creeps: bool = True) -> float:
    """How many more steps it takes until what has `fallen`, logarithms that begin with 0, has done so by `need`.

    What counts is the best of each window: the last half of the steps, the quarter before it, the eighth before that;
    between them are two speeds. Sweeps first smooth and then creep, and some slow down for good and some no more: what
    is expected is the geometric mean of two ends, that the speed changes by as much whenever the number of steps
    doubles, and that it stays; but not that it comes to less than `_SLOWER` of the mean speed so far, as a halt need
    not be the end. In the median that was neither too much nor too little, and wrong by a factor of 2.5 in the root
    mean square, for 450 runs of sweeps, relaxed and accelerated or not, on random problems of 80 families. Where
    nothing `creeps`, as in Newton's steps and what is accelerated, the speed stays, at `_STEADY` of the mean at the
    least: the other way said that ten of Newton's steps were three times as far from the end as they were, in the
    median of 364 runs, and was wrong by 7.5; this one says 1.4 and is wrong by 4.6.
    """
    k = len(fallen) - 1
    half, quarter = k // 2, k // 4
    windows = (fallen[half + 1 :], fallen[quarter + 1 : half + 1] or fallen[:1], fallen[k // 8 : quarter + 1])
    best, between, early = map(max, windows)
    left, steps = need - best, 0.0
    if not 0.0 < left < math.inf:
        return max(left, 1.0)
    most = left * k / ((_SLOWER if creeps else _STEADY) * max(*fallen, 1.0))
    now, before = (best - between) / (k - half), (between - early) / max(half - quarter, 1)
    if not now > 0.0:
        return max(most, 1.0)
    change = math.sqrt(min(now / before, 1.0)) if creeps and before > 0.0 else 1.0
    now *= change
    while left > now * k and steps < most and change < 1.0:
        left, steps, k, now = left - now * k, steps + k, 2 * k, now * change
    return max(min(steps + left / now, most), 1.0)
