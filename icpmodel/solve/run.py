"""The only loop: it drives one candidate after the other, tests their iterates, keeps the best, and says why it stopped.

Whole problems and parts of them go through it alike.
"""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Generator, Iterator
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ..errors import MapError, SingularOperator
from ..methods.contract import SAFE_HINT, Infeasible, Iterate, Method
from ..numerics.arrays import Vector, norm
from ..problem.data import ProblemData
from ..theory.answers import Answer
from .candidate import Candidate, Upcoming, Watched
from .goal import Goal
from .progress import Bar, progress_bar
from .solution import Status

#: after so many steps without a better iterate, or twice the number of unknowns (a signal may have to cross them all)
#: up to the second number, the run counts as stagnated …
PATIENCE, _LONGEST_PATIENCE = 1000, 50_000
#: … and after so many without one that is better by a thousandth, it is asked whether rounding is the reason, which
#: explains nothing where it leaves more than that share of the first residual: z has run away
_PRECISION_CHECK, _LOW = 50, 0.1
#: a residual this many times the first one is taken for divergence even before it overflows
_BLOW_UP = 1e200
#: another method may go where psi has values, or need no derivative
_WORTH_ANOTHER_METHOD = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED, Status.MAP_FAILED)


@dataclass(frozen=True)
class Progress:
    """What a callback sees: `iteration`, `z` (read-only, shape (n,)), `residual` and `seconds` since the start.

    >>> seen = []
    >>> _ = ICP([[2.0]], [-2.0]).solve("mnmgs", callback=lambda state: seen.append(state.iteration))
    >>> seen
    [0, 1]
    """

    iteration: int
    z: Vector
    residual: float
    seconds: float


@dataclass
class Best:
    """The best iterate so far, the candidate that found it, and the numbers that its method had settled on; its residual
    may be a hint until the end."""

    z: Vector
    residual: float
    iteration: int
    candidate: Candidate
    settled: Method


@dataclass(frozen=True)
class Ended:
    """Why a candidate ended. `after`: it gave way, to this one or, where it is None, to the next."""

    status: Status
    note: str
    gave_way: bool = False
    after: Candidate | None = None


class Run:
    """Candidates tried on a problem, one after the other, until one ends for a reason that no other would change.

    Parameters: `problem`; `start`, shape (n,), and `at_start` = Res(start); `goal`; `aim` > 0, the residual for which
    steps are forecast; `scale`, by which rounding is judged; `restart`, where a candidate begins after one that failed;
    `max_iter` and `time_limit`, None for none; `callback`, `history` and `progress` as in `solve`.
    `steps` is the loop; afterwards `ended` says why it ended, `best` what it found.
    """

    def __init__(
        self,
        problem: ProblemData,
        start: Vector,
        at_start: float,
        goal: Goal,
        *,
        aim: float,
        scale: float,
        restart: Vector | None = None,
        max_iter: float = np.inf,
        time_limit: float | None = None,
        callback: Callable[[Progress], Any] | None = None,
        history: bool = False,
        progress: bool = False,
        clock: float | None = None,
    ) -> None:
        self.clock = time.perf_counter() if clock is None else clock
        self.problem, self.start, self.at_start, self.goal = problem, start, at_start, goal
        self.aim, self.scale, self.restart = aim, scale, start if restart is None else restart
        self.max_iter, self.time_limit, self.callback = max_iter, time_limit, callback
        self.progress = progress
        self.records: list[tuple[int, float, float]] | None = [] if history else None
        self.best: Best | None = None
        self.candidate: Candidate | None = None
        self.current, self.iteration = start, 0
        self.tried: list[tuple[Candidate, str]] = []
        self.ended = Ended(Status.STAGNATED, "")
        self.infeasible: Answer | None = None
        self.fault: MapError | None = None

    def steps(self, candidates: Iterator[Candidate], *, tolerate_singular: bool = True) -> Iterator[None]:
        """The loop, a turn for each tested iterate. Raises SingularOperator unless `tolerate_singular`."""
        upcoming = Upcoming(candidates)
        candidate, start = upcoming.take(), self.start
        while candidate is not None:
            self.candidate = candidate
            try:
                with progress_bar(self.progress, candidate.method.name) as bar:
                    yield from self._one(candidate, start, upcoming, bar)
                    self.tried.append((candidate, "gave way" if self.ended.gave_way else self.ended.status.value))
            except SingularOperator:
                if not tolerate_singular:
                    raise
            if self.ended.status not in _WORTH_ANOTHER_METHOD:
                return
            ended, before = self.ended, candidate
            candidate = ended.after or upcoming.take()
            if candidate is None:
                return
            if ended.gave_way and self.tried[-1][0] is before:
                assert self.best is not None
                start = self.best.z if candidate.goes_on else start
                if ended.after is None:
                    candidate = replace(candidate, why=f"{candidate.why} ({ended.note})")
            else:
                start = self.restart if self.tried else self.start

    def _one(self, candidate: Candidate, start: Vector, upcoming: Upcoming, bar: Bar) -> Iterator[None]:
        """One candidate until there is a reason to stop, which is left in `ended`; a failing ψ is one like others."""
        try:
            yield from self._loop(candidate, start, upcoming, bar)
        except MapError as error:
            if self.best is None:
                raise
            self.fault = error
            self.ended = Ended(Status.MAP_FAILED, str(error))
        except Infeasible as proof:
            self.infeasible = proof.answer
            self.ended = Ended(Status.INFEASIBLE, proof.answer.reason)

    def _loop(self, candidate: Candidate, start: Vector, upcoming: Upcoming, bar: Bar) -> Iterator[None]:
        first = self.iteration
        path = candidate.method.iterates(self.problem, start)
        ask = _asking(path)
        watched, stalled = Watched(candidate.watch, self.aim), _Stalled(self, candidate, first)
        expected, first_residual = np.inf, np.inf
        for k in range(first, 2**62):
            iterate = ask(expected)
            if iterate is None:
                self.ended = self._stand_still()
                return
            z, hint = iterate
            self.iteration, self.current = k, z
            residual = self._residual(z, hint)
            seconds = time.perf_counter() - self.clock
            bar.update(k, residual, self.goal.tolerance)
            if self.records is not None:
                self.records.append((k, residual, seconds))
            if k == first:
                first_residual = residual
            if self.best is None or residual < self.best.residual:
                self._keep(z, residual, candidate, path)
            ended = self._test(z, residual, seconds, first_residual, candidate, path)
            expected = watched.expected(residual)
            ended = ended or stalled.look(z, residual) or self._limit(seconds)
            if ended is None and (verdict := watched.verdict(expected)) is not None:
                ended = self._give_way(verdict, upcoming, watched)
            if ended is not None:
                self.ended = ended
                return
            yield

    def _keep(self, z: Vector, residual: float, candidate: Candidate, path: Iterator[Iterate]) -> None:
        settled = getattr(path, "settled", candidate.method)
        self.best = Best(z, residual, self.iteration, candidate, settled)

    def _test(
        self,
        z: Vector,
        residual: float,
        seconds: float,
        first_residual: float,
        candidate: Candidate,
        path: Iterator[Iterate],
    ) -> Ended | None:
        """What the iterate itself says: it is what was wanted, or it has run away."""
        k = self.iteration
        if self.callback is not None and self.callback(_state(k, z, residual, seconds)):
            return Ended(Status.STOPPED, "by the callback")
        if self.goal.reached(z, residual):
            self._keep(z, residual, candidate, path)
            return Ended(Status.SOLVED, "")
        if not residual < np.inf or residual > _BLOW_UP * max(first_residual, self.goal.tolerance):
            if fault := fault_of_psi(self.problem, z):
                return Ended(Status.MAP_FAILED, f"{fault} at iteration {k}")
            return Ended(Status.DIVERGED, f"the residual is {residual:.3g} at iteration {k}")
        return None

    def _limit(self, seconds: float) -> Ended | None:
        if self.iteration >= self.max_iter:
            return Ended(Status.ITERATION_LIMIT, f"max_iter = {self.max_iter}")
        if self.time_limit is not None and seconds >= self.time_limit:
            return Ended(Status.TIME_LIMIT, f"time_limit = {self.time_limit:g} s")
        return None

    def _give_way(self, verdict: str | Candidate, upcoming: Upcoming, watched: Watched) -> Ended | None:
        """To the candidate of the `verdict`, or to the next one, if there is one."""
        if isinstance(verdict, Candidate):
            return Ended(Status.STAGNATED, verdict.why, True, verdict)
        following = upcoming.peek()
        if following is None:
            watched.look = 0
            return None
        return Ended(Status.STAGNATED, verdict, True)

    def _residual(self, z: Vector, hint: float | None) -> float:
        """The method's hint while it is only a hint; the judge where a decision hangs on it."""
        low, high = SAFE_HINT
        if z is self.start:
            return self.at_start
        if hint is not None and low < hint < high and hint > self.goal.tolerance:
            return hint
        return self.problem.residual(z)

    def floor(self) -> float:
        """An estimate of the residual that rounding alone leaves at the best iterate."""
        assert self.best is not None
        return norm(np.maximum(*self.problem.rounding(self.best.z)))

    def at_floor(self) -> Ended | None:
        """PRECISION_LIMIT, where rounding is why the residual does not fall."""
        assert self.best is not None
        floor = self.floor()
        if self.best.residual <= 2 * floor < _LOW * self.scale:
            return Ended(Status.PRECISION_LIMIT, f"rounding leaves a residual of up to about {floor:.2g} at this z")
        return None

    def _stand_still(self) -> Ended:
        still = Ended(Status.STAGNATED, "the iterates stand still, but z is not a solution")
        return still if self.best is None else self.at_floor() or still

    def recurred(self, period: int) -> Ended:
        """An iterate came back after so many steps."""
        if period == 1:
            return self._stand_still()
        return self.at_floor() or Ended(Status.CYCLED, f"the iterates repeat with period {period}")


class _Stalled:
    """Whether a candidate's iterates come back, lead no further, or are as good as rounding lets them be.

    Cycles are found by Brent's search: an iterate is compared with one that is kept while their number doubles.
    Reference: Brent, BIT 20 (1980).
    """

    def __init__(self, run: Run, candidate: Candidate, first: int) -> None:
        self.run, self.first, self.memoryless = run, first, candidate.method.memoryless
        longest = min(max(PATIENCE, 2 * run.problem.n), _LONGEST_PATIENCE)
        self.patience = longest if candidate.patience is None else candidate.patience
        self.milestone, self.milestone_residual, self.milestone_z = first, np.nan, run.start
        self.progress_at, self.progress_residual = first, np.inf
        self.better_at, self.better_residual = first, np.inf

    def look(self, z: Vector, residual: float) -> Ended | None:
        k = self.run.iteration
        if residual < self.better_residual:
            self.better_at, self.better_residual = k, residual
        if self.memoryless and residual == self.milestone_residual and np.array_equal(z, self.milestone_z):
            return self.run.recurred(k - self.milestone)
        if k - self.first >= 2 * (self.milestone - self.first):
            self.milestone, self.milestone_residual, self.milestone_z = k, residual, z
        if residual < 0.999 * self.progress_residual:
            self.progress_at, self.progress_residual = k, residual
        elif (k - self.progress_at) % _PRECISION_CHECK == _PRECISION_CHECK - 1 and (ended := self.run.at_floor()):
            return ended
        if k - self.better_at >= self.patience:
            return Ended(Status.STAGNATED, f"no better iterate in {self.patience} iterations")
        return None


def _asking(path: Iterator[Iterate]) -> Callable[[float], Iterate | None]:
    """The next iterate of `path`, None at its end; a generator is told how many more are expected to be asked for."""
    if not isinstance(path, Generator):
        return lambda expected: next(path, None)
    begun = False

    def ask(expected: float) -> Iterate | None:
        nonlocal begun
        begun, sent = True, expected if begun else None
        with contextlib.suppress(StopIteration):
            iterate: Iterate = path.send(sent)
            return iterate
        return None

    return ask


def fault_of_psi(problem: ProblemData, z: Vector) -> str:
    """Which entry of ψ(z) is NaN or +∞ although z is finite; empty where none is."""
    if not np.isfinite(z).all():
        return ""
    psi = problem.psi.value(z)
    bad = ~(np.isfinite(psi) | np.isneginf(psi))
    return f"psi(z)[{np.argmax(bad)}] is {psi[np.argmax(bad)]}" if bad.any() else ""


def _state(k: int, z: Vector, residual: float, seconds: float) -> Progress:
    view = z.view()
    view.flags.writeable = False
    return Progress(k, view, residual, seconds)
