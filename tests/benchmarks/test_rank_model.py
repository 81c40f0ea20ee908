"""The model of a solve on ranks: its arithmetic by what is known; its runs where PETSc is installed."""

import csv
import importlib.util
import io
import math
import shutil
from dataclasses import replace

import pytest
from hypothesis import given
from hypothesis import strategies as st
from shell import call

from icpmodel import InputError, NotApplicable
from icpmodel.benchmarks import distributed_cost, distributed_model
from icpmodel.benchmarks.beyond.launched import calibrated, launched
from icpmodel.benchmarks.beyond.rank_model import Calibration, LevelShape, Machine, Price, fitted, priced, spread

MISSING = [name for name in ("petsc4py", "mpi4py") if importlib.util.find_spec(name) is None]
MISSING += [] if shutil.which("mpiexec") else ["mpiexec"]
with_petsc = pytest.mark.skipif(bool(MISSING), reason=f"{' and '.join(MISSING)} not installed, see CONTRIBUTING.md")

#: a grid in the plane, of which each level has a quarter of the points
SHAPES = tuple(LevelShape(4.0**k, 5 * 4.0**k, 2 * 4.0**k, 2.0**k) for k in range(8, 0, -1))
FREE = Price(0.0, 0.0)
HERE = Machine(1e-6, 1e-9)
positive = st.floats(1e-2, 1e2)


def model(**prices):
    every = dict.fromkeys(("steps", "masks", "looks", "sweeps", "making"), FREE) | prices
    return Calibration(SHAPES, every, {("steps", 0): 10, ("looks", 0): 3, ("steps", 3): 2}, HERE, 2)


@given(level=positive, entry=positive)
def test_a_price_is_found_from_what_two_sizes_cost(level, entry):
    found = priced(4 * level + 100 * entry, 4, 100, 9 * level + 9_000 * entry, 9, 9_000)
    assert found.level == pytest.approx(level, rel=1e-6)
    assert found.entry == pytest.approx(entry, rel=1e-6)


def test_a_price_is_not_negative_where_the_small_size_was_slow():
    assert priced(5.0, 4, 100, 1.0, 9, 1_000) == Price(0.0, 1e-3)


def test_work_on_ranks_is_a_share_of_that_on_one_and_messages_come_to_it():
    """Ten steps on the finest level and two on the fourth, each of which goes through all levels below it."""
    made = model(steps=Price(0.0, 1e-9, messages=4.0, words=3.0, reductions=3.0))
    one, two = made.expected(4.0**8, 1), made.expected(4.0**8, 2)
    work = sum(1e-9 * 7 * 4.0**k * (12 if k <= 5 else 10) for k in range(8, 0, -1))
    assert one.seconds == pytest.approx(one.solving) == pytest.approx(work)
    assert two.solving == pytest.approx(work / 2)
    assert two.sent == 10 * 8 * 4 + 2 * 5 * 4
    assert two.rounds == 12 * 3
    assert two.size == sum(8 * 3 * 2.0**k * (12 if k <= 5 else 10) for k in range(8, 0, -1))
    assert two.seconds == pytest.approx(work / 2 + 1e-6 * two.sent + 1e-9 * two.size + 1e-6 * two.rounds)
    assert made.expected(4.0**8, 16).rounds == two.rounds
    assert made.expected(4.0**8, 16).reductions == pytest.approx(4 * two.reductions)


def test_where_hypre_searches_every_coarse_row_of_a_rank_is_compared_with_all_that_others_ask_for():
    """The finest rows are not; the ranks on either side ask for a line each, and for no more rows than others have,
    which is what it comes to on the levels where a rank has less than a line; one rank is asked by nobody."""
    made = replace(model(), search=1e-9)
    pairs = sum(4.0**k / 16 * (2 * 2.0**k) for k in range(7, 3, -1))
    few = made.expected(4.0**8, 16).searching - 1e-9 * pairs
    assert 0 <= few <= 1e-9 * sum(4.0**k / 16 * 4.0**k for k in range(3, 0, -1))
    assert made.expected(4.0**8, 1).searching == 0.0


def test_the_levels_of_more_unknowns_are_as_many_more_as_lead_down_to_as_few_rows():
    made = model()
    assert made.levels(4.0**8) == list(SHAPES)
    more = made.levels(4.0**11)
    assert len(more) == len(SHAPES) + 3
    assert [shape.rows for shape in more] == pytest.approx([4.0**k for k in range(11, 0, -1)])
    assert [shape.reach for shape in more] == pytest.approx([2.0**k for k in range(11, 0, -1)])
    assert len(made.levels(4.0**5)) == 5


@given(ranks=st.integers(1, 5000), side=st.integers(2, 2000))
def test_ranks_of_strips_ask_those_that_their_neighbouring_lines_are_on(ranks, side):
    """Each wants one line of the grid on each side; a line that is spread over k ranks makes k neighbours of one."""
    shape = LevelShape(float(side**2), 5.0 * side**2, 0.0, float(side))
    neighbours, ghosts = spread(shape, ranks)
    busy = min(ranks, side**2)
    assert 0 <= neighbours <= max(busy - 1, 0)
    assert ghosts <= side**2
    if 2 < busy <= side:
        assert neighbours == 2
        assert ghosts == pytest.approx(min(2 * side, side**2 - side**2 / busy))
    if side < busy:
        assert neighbours == min(busy - 1, 2 * math.ceil(side / (side**2 / busy)))


def told(n, seconds, ghosts=0.0, ranks=1):
    """What a run tells whose only price is 1 µs an entry, for a step and for the making."""
    shapes = [{"rows": n / 4**k, "entries": 5 * n / 4**k, "transfer": 0.0, "ghosts": ghosts / 2**k} for k in range(3)]
    entries = sum(shape["entries"] for shape in shapes)
    nothing = {"seconds": 0.0, "messages": 0.0, "bytes": 0.0, "reductions": 0.0}
    steps = {"seconds": 1e-6 * entries / ranks, "messages": 12.0, "bytes": 8 * 5 * ghosts * 1.75, "reductions": 3.0}
    parts = {"masks": nothing, "looks": nothing, "sweeps": nothing, "steps": steps}
    made = {"n": n, "shape": [1, 1], "ranks": ranks, "seconds": 1e-6 * entries * (seconds + 4), "shapes": shapes}
    return made | {"done": [("steps", 0, 4)], "parts": parts, "product": 1e-3}


def test_counts_and_times_of_runs_give_their_prices_back():
    small, large = told(1600, 1.0), told(160_000, 1.0)
    pair = told(160_000, 1.0, ghosts=400.0, ranks=2) | {"small": told(1600, 1.0, ghosts=40.0, ranks=2)}
    pair |= {"latency": 1e-6, "byte": 1e-9, "search": 2e-10, "seconds": 0.7 * large["seconds"]}
    own = {"cpu": large["seconds"], "n": 160_000, "beyond": 160e6, "memory": 300e6}
    found = fitted(small, large, pair, own)
    assert found.prices["steps"].entry == pytest.approx(1e-6)
    assert found.prices["making"].entry == pytest.approx(1e-6)
    assert found.prices["steps"][2:] == pytest.approx((4.0, 5.0, 3.0))
    assert found.memory == 1000.0
    assert found.search == 2e-10
    assert found.bandwidth == pytest.approx((12 * 5 + 24) * 160_000 / 1e-3)
    assert found.seconds(160_000, 1) == pytest.approx(large["seconds"])
    assert found.seconds(160_000, 2) == pytest.approx(pair["seconds"])
    assert found.seconds(640_000, 1) == pytest.approx(4 * large["seconds"], rel=0.02)


def test_wrong_arguments_are_told_before_anything_is_started():
    with pytest.raises(InputError, match="hand-lcp"):
        distributed_cost(["hand-lcp"])
    with pytest.raises(InputError, match="repeats is 0"):
        distributed_cost(repeats=0)
    with pytest.raises(InputError, match="bandwidth is -1"):
        distributed_model(bandwidth=-1)


@pytest.mark.skipif(not MISSING, reason="PETSc is installed")
def test_without_petsc_one_sentence_says_what_is_missing():
    with pytest.raises(NotApplicable, match=r"need .*: docs/distributed\.md"):
        distributed_cost(["membrane"], [400])


@with_petsc
def test_the_command_compares_ranks_with_one_process_and_with_snesvi(capsys):
    asked = ("--n", "400", "--rank", "2", "--repeats", "1", "--fitted", "0", "--csv")
    code, out, _ = call(capsys, "benchmark", "distributed", *asked)
    assert code == 0
    rows = list(csv.DictReader(io.StringIO(out)))
    assert [(row["method"], row["ranks"]) for row in rows] == [
        ("serial multilevel", ""),
        ("distributed", "2"),
        ("SNESVI", "2"),
    ]
    assert all(row["note"] == "" and row["n"] == "400" and float(row["solve, s"]) > 0 for row in rows)
    assert rows[1]["iterations"] == "2"
    assert float(rows[1]["SNESVI / time"]) > 0
    code, out, _ = call(capsys, "benchmark", "distributed", *asked, "--no-snesvi")
    assert code == 0
    assert [row["method"] for row in csv.DictReader(io.StringIO(out))] == ["serial multilevel", "distributed"]


@with_petsc
def test_a_run_that_takes_too_long_is_a_row_that_says_so():
    """It ends itself, on all ranks, wherever it waits."""
    table = distributed_cost(["membrane"], [400], ranks=[2], repeats=1, time_limit=0.2, fitted=0).records()
    assert [row["note"] for row in table] == ["not done in 0.2 s"] * 3
    assert {row["solve, s"] for row in table} == {None}


@with_petsc
def test_a_run_that_dies_says_what_it_died_of():
    assert "ValueError: could not convert" in launched("own", "membrane,mu=x", 400, 1, 30.0)


@with_petsc
def test_messages_are_counted_and_the_model_has_the_neighbours_that_there_are(capsys):
    code, out, _ = call(capsys, "benchmark", "distributed-counts", "--n", "2500", "--ranks", "3", "--csv")
    assert code == 0
    rows = {
        row["part"]: row for row in csv.DictReader(io.StringIO(out.partition("\n")[2] if "," not in out[:8] else out))
    }
    step, cycle, look = (rows[name] for name in ("a Krylov step", "the V-cycle in it", "a look"))
    assert float(step["messages"]) > float(cycle["messages"]) > 0
    assert (float(look["messages"]), float(look["reductions"])) == (2.0, 1.0)
    assert float(look["bytes"]) == 2 * 8 * 50  # a line of the grid from each side
    finest = rows["level 0"]
    assert float(finest["ghosts"]) == 2 * 50
    assert finest["neighbours"] == finest["neighbours by the model"] == "2.0"


@with_petsc
def test_the_model_of_a_small_problem_needs_few_seconds_for_it():
    made = calibrated("membrane", 4_000, 60.0)
    assert 0 < made.seconds(20_000, 1) < 60
    assert made.expected(1e9, 16).seconds > made.expected(1e9, 256).solving > 0
