"""What `solve()` tries before it says that it stagnated, cycled or diverged: methods that go through many starts or all
active sets of a small problem."""

from __future__ import annotations

from collections.abc import Callable, Iterator

from ..methods.contract import Method
from ..methods.enumeration import Enumerate
from ..methods.milp import LARGEST, MixedInteger
from ..methods.restarts import Restarts
from ..numerics import work
from .candidate import Candidate, Ended
from .run import Run
from .schedule import Stage, in_turn
from .solution import Status

#: seconds for all of it where no time limit was given
SECONDS = 10.0
#: they fail where no global search helps
_FAILED = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED)
_METHODS: tuple[Method, ...] = (Restarts(), Enumerate(), MixedInteger())


def search(run: Run, carry_out: Callable[[Run, Iterator[Stage[Candidate]]], None]) -> None:
    """Try `Restarts`, `Enumerate` and `MixedInteger` in turn where `run` ended as stagnated, cycled or diverged.

    Only problems of up to `LARGEST` unknowns are searched. Where nothing is found `run` ends as it did
    before, and its note says what was tried.
    """
    before = run.ended
    if run.best is None or before.status not in _FAILED or run.problem.n > LARGEST:
        return
    candidate = run.candidate
    methods = [one for one in _METHODS if one.why_not(run.problem) is None]
    if not methods:
        return
    seconds = SECONDS if run.time_limit is None else work.seconds_left()
    why = f"the methods before it {before.status.value}; a search of at most {seconds:.3g} s"
    with work.at_most(seconds):
        carry_out(run, in_turn(*(Candidate(method, why) for method in methods)))
    if run.ended.status in _FAILED or (run.ended.status is Status.TIME_LIMIT and run.time_limit is None):
        tried = " and ".join(method.name for method in methods)
        run.ended = Ended(before.status, f"{before.note}; {tried} found no solution in {seconds:.3g} s")
        run.candidate = candidate
