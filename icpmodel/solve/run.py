"""The only loop: it drives one candidate after the other, tests their iterates, keeps the best, and says why it ended.

Whole problems and parts of them go through it alike. The logger "icpmodel" tells what it decides, see `solve`.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..errors import MapError, OutOfTime, SingularOperator
from ..methods.contract import SAFE_HINT, Infeasible, Iterate, Method
from ..numerics import work
from ..numerics.arrays import Vector, locked, norm
from ..problem.data import ProblemData
from ..theory.answers import Answer
from .candidate import Candidate, Ended, Recent, Stalled
from .goal import Goal
from .progress import Bar, Progress, progress_bar
from .proved_convergence import ProvedConvergence
from .schedule import Schedule, Stage, Turn
from .solution import Status

_LOG = logging.getLogger("icpmodel")
_LOG.addHandler(logging.NullHandler())
#: after so many steps without a better iterate, or twice the number of unknowns (a signal may have to cross them all)
#: up to the second number, the run counts as stagnated
PATIENCE, _LONGEST_PATIENCE = 1000, 50_000
#: rounding explains nothing where it leaves more than this share of the first residual: z has run away
_LOW = 0.1
#: a residual this many times the first one is taken for divergence even before it overflows
_BLOW_UP = 1e200
#: how a candidate fares whose turn another one has
_WAITS = "waits"
#: its iterates are as good as those of one that goes on
_GOOD = (_WAITS, Status.TIME_LIMIT.value, Status.MEMORY_LIMIT.value)
#: another method may go where psi has values, or need no derivative
WORTH_ANOTHER_METHOD = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED, Status.MAP_FAILED)


@dataclass
class Best:
    """The best iterate, the candidate that found it, and its method with the numbers that it had settled on; its
    residual may be a hint until the end."""

    z: Vector
    residual: float
    candidate: Candidate
    settled: Method


@dataclass
class Tried:
    """A candidate that was begun, how it fared, and whether it began at the start of the run with its own problem."""

    candidate: Candidate
    outcome: str = _WAITS
    afresh: bool = False


class Refused(NamedTuple):
    """What was not begun: the end that it makes, the candidate, None where one was to be chosen, and what it raised."""

    ended: Ended
    candidate: Candidate | None
    error: Exception


@dataclass(eq=False)
class Run:
    """Candidates tried on a problem, one at a time, until one ends for a reason that no other would change.

    Parameters: `problem`; `start`, shape (n,), and `at_start` = Res_D(start); `goal`; `scale`, a residual by which
    others are judged, 0 for ‖z‖, and the share `aim` of it for which costs are forecast; `restart`, where a candidate
    begins after one that failed; `posed`, what methods are given in its place, a problem that has the same solutions;
    `follows_theorems`, whether a method that is proved to converge is given more patience, as one that was named is;
    `max_iter` and `time_limit`, None for none; `callback`, `history` and `progress` as in `solve`. `steps` is the loop;
    afterwards `ended` says why it ended, `best` what it found, `tried` who did how.
    """

    problem: ProblemData
    start: Vector
    at_start: float
    goal: Goal
    _: KW_ONLY
    aim: float
    scale: float
    restart: Vector | None = None
    posed: ProblemData | None = None
    follows_theorems: bool = False
    max_iter: float = np.inf
    time_limit: float | None = None
    callback: Callable[[Progress], Any] | None = None
    history: bool = False
    progress: bool = False
    clock: float = field(default_factory=work.clock)

    def __post_init__(self) -> None:
        self.records: list[tuple[int, float, float]] | None = [] if self.history else None
        self.current, self.iteration = self.start, -1
        self.candidate: Candidate
        self.proved: ProvedConvergence | None = None
        self.path: Iterator[Iterate] = iter(())
        self.best: Best | None = None
        self.tried: list[Tried] = []
        self.ended = Ended(Status.STAGNATED, "")
        self.infeasible: Answer | None = None
        # of the search that a failure leads to: a sentence that says its limit
        self.searched: tuple[str, ...] = ()
        self.fault: MapError | None = None
        # of what was not begun, as it would not have fitted into the time or the memory that were left: the last one
        self.refused: Refused | None = None
        self.singular: SingularOperator | None = None
        self.bar, self.told = Bar(), _LOG.isEnabledFor(logging.INFO)
        self.target = self.aim * (self.scale or self.at_start)

    def steps(self, stages: Iterator[Stage[Candidate]]) -> Iterator[None]:
        """The loop: a turn for each tested iterate that is not the last one of its candidate."""
        loops: dict[Turn[Candidate], Iterator[bool]] = {}
        schedule = Schedule(stages)
        turn = self._turn(schedule)
        with progress_bar(self.progress) as self.bar:
            while turn is not None:
                if self.told:
                    whose = self.problem.n, self.iteration, turn.who.method
                    _LOG.debug("n = %d, iteration %d: the turn is with %r", *whose)
                self.bar.begin(turn.who.method.name)
                loop = loops.get(turn) or loops.setdefault(turn, self._one(turn))
                following: Turn[Candidate] | None = turn
                while following is turn:
                    for look in loop:
                        yield
                        if look:
                            break
                    else:
                        if self.ended.status not in WORTH_ANOTHER_METHOD and not self.is_refused:
                            return
                        schedule.end(turn)
                    following = self._turn(schedule)
                turn = following
        if self.refused is not None:
            self.ended = self.refused.ended
            if self.refused.candidate is not None:
                self.candidate = self.refused.candidate

    def _turn(self, schedule: Schedule[Candidate]) -> Turn[Candidate] | None:
        """Whose turn it is, None where nobody is left or what must be known for that cannot be afforded."""
        try:
            return schedule.turn()
        except (OutOfTime, MemoryError) as error:
            self._refuse(error, None)
            return None

    def _refuse(self, error: Exception, candidate: Candidate | None) -> Ended:
        late = isinstance(error, OutOfTime)
        if late and self.time_limit is not None:
            error = OutOfTime(f"time_limit = {self.time_limit:g} s, and {error}")
        ended = Ended(Status.TIME_LIMIT if late else Status.MEMORY_LIMIT, str(error))
        self.refused = Refused(ended, candidate, error)
        return ended

    @property
    def is_refused(self) -> bool:
        """Whether what ended last did so for a lack of time or memory that was foreseen."""
        return self.refused is not None and self.ended is self.refused.ended

    def _one(self, turn: Turn[Candidate]) -> Iterator[bool]:
        """One candidate until there is a reason to stop, left in `ended`; whether it is time for a look at others."""
        self.candidate = turn.who
        self.tried.append(tried := Tried(turn.who))
        if self.told:
            _LOG.info("n = %d: %r begins: %s", self.problem.n, turn.who.method, turn.who.why or "it was named")
        try:
            self.ended = yield from self._loop(turn)
        except SingularOperator as error:
            self.singular = error
            self.tried.remove(tried)
            self._tell_end(turn.who, str(error))
            return
        except Infeasible as proof:
            self.infeasible = proof.answer
            self.ended = Ended(Status.INFEASIBLE, proof.answer.reason)
        except KeyboardInterrupt:
            tried.outcome = Status.INTERRUPTED.value
            raise
        except (OutOfTime, MemoryError) as error:
            self.ended = self._refuse(error, turn.who)
        except MapError as error:
            if self.best is None:
                raise
            self.fault, self.ended = error, Ended(Status.MAP_FAILED, str(error))
        tried.outcome = self.ended.status.value
        self._tell_end(turn.who, tried.outcome)

    def _tell_end(self, candidate: Candidate, why: str) -> None:
        if self.told:
            told = candidate.method, why, self.iteration, np.nan if self.best is None else self.best.residual
            _LOG.info("n = %d: %r ends, %s, at iteration %d; best residual %.3g", self.problem.n, *told)

    def _begin(self) -> Vector:
        """Where a new candidate begins: with the best iterate, unless that is of one that failed."""
        if self.best is None:
            return self.start
        failed = any(one.candidate is self.best.candidate and one.outcome not in _GOOD for one in self.tried)
        return self.best.z if self.restart is None or not failed else self.restart

    def _loop(self, turn: Turn[Candidate]) -> Generator[bool, None, Ended]:
        candidate, begin = turn.who, self._begin()
        self.tried[-1].afresh = begin is self.start and self.posed is None
        path = candidate.method.iterates(self.posed or self.problem, begin)
        recent = Recent(self.target)
        longest = min(max(PATIENCE, 2 * self.problem.n), _LONGEST_PATIENCE)
        self.proved = ProvedConvergence(self.posed or self.problem, candidate.method, lambda: float(self.iteration))
        stalled = Stalled(candidate.method.memoryless, longest, self.at_floor, self._further)
        expected, first, count, spent = None, np.nan, 0, 0.0
        unit = self.problem.matrix.unit
        # a generator is told how many more iterates are expected to be asked for
        ask: Callable[[float | None], Iterate] = getattr(path, "send", lambda expected: next(path))
        while True:
            self.path, self.candidate, before = path, candidate, work.done()
            try:
                z, hint = ask(expected)
            except StopIteration:
                return stalled.recurred()
            spent += work.done() - before
            if count or self.iteration < 0:  # where a candidate begins another one has been
                self.iteration += 1
            self.current = z
            residual, seconds = self._residual(z, hint), work.clock() - self.clock
            if not count:
                first = residual
            if self.best is None or residual < self.best.residual:
                self.best = self.found(z, residual)
            ended = self._seen(z, residual, seconds) or self._test(z, residual, first)
            if ended := ended or stalled.look(z, residual) or self._limit(seconds):
                return ended
            expected = recent.expected(residual)
            look, count = False, count + 1
            if count > 1:  # the set-up counts for the first step
                look, spent = turn.stepped((spent + work.COSTS.iterate) / unit, self._fallen(first, residual)), 0.0
            yield look

    def _fallen(self, first: float, residual: float) -> tuple[float, float] | None:
        """By how much a logarithm has fallen, and by how much it has to: that of the residual, which was `first`, or,
        for a finite method, of the rows that it takes for wrong; None where it does not say so."""
        if self.candidate.method.finite:
            wrong, every = getattr(self.path, "wrong", None), math.log1p(self.problem.n)
            return None if wrong is None else (every - math.log1p(wrong), every)
        need = _fall(first, self.target) if self.target < first < np.inf else np.inf
        return (_fall(first, residual) if residual > 0.0 and 0.0 < first < np.inf else 0.0), need

    def found(self, z: Vector, residual: float) -> Best:
        """`z` as an iterate of the candidate that is tried."""
        return Best(z, residual, self.candidate, getattr(self.path, "settled", self.candidate.method))

    def _residual(self, z: Vector, hint: float | None) -> float:
        """The method's hint while it is only a hint; the judge where a decision hangs on it."""
        low, high = SAFE_HINT
        if z is not self.start and hint is not None and low < hint < high and not self.goal.is_near(z, hint):
            return hint
        return self.goal.judged(z, self.at_start if z is self.start else self.problem.residual(z))

    def _seen(self, z: Vector, residual: float, seconds: float) -> Ended | None:
        """Who looks on sees `z`, and Res_D(z) itself where `residual` is that of the problem that methods are given."""
        if self.posed is not None and (self.progress or self.history or self.callback is not None):
            with suppress(MapError):
                residual = self.problem.residual(z)
        self.bar.update(self.iteration, residual, self.goal.tolerance)
        if self.records is not None:
            self.records.append((self.iteration, residual, seconds))
        # a copy, as whoever has a view can write through its base
        if self.callback is not None and self.callback(Progress(self.iteration, locked(z.copy()), residual, seconds)):
            return Ended(Status.STOPPED, "by the callback")
        return None

    def _test(self, z: Vector, residual: float, first: float) -> Ended | None:
        """What the iterate itself says: it is what was wanted, or it has run away from the `first` residual."""
        if self.goal.reached(z, residual):
            if self.best is None or self.best.z is not z:
                self.best = self.found(z, residual)
            return Ended(Status.SOLVED, "")
        if not residual < np.inf or residual > _BLOW_UP * max(first, self.goal.tolerance):
            if fault := fault_of_psi(self.problem, z):
                return Ended(Status.MAP_FAILED, f"{fault} at iteration {self.iteration}")
            return Ended(Status.DIVERGED, f"the iterates ran away, at iteration {self.iteration}")
        return None

    def _limit(self, seconds: float) -> Ended | None:
        if self.iteration >= self.max_iter:
            return Ended(Status.ITERATION_LIMIT, f"max_iter = {self.max_iter}")
        if self.time_limit is not None and seconds >= self.time_limit:
            return Ended(Status.TIME_LIMIT, f"time_limit = {self.time_limit:g} s")
        return None

    def _further(self, before: Vector, z: Vector) -> int:
        """How many more steps the run follows a theorem where the step from `before` to `z` brought nothing."""
        if self.proved is None or not self.follows_theorems:
            return 0
        return self.proved.further(before, z, self.goal.enough_at(z))

    def at_floor(self) -> Ended | None:
        """PRECISION_LIMIT, where rounding explains the residual of the best iterate."""
        if self.best is None:
            return None
        floor = self.problem.rounding_of_residual(self.best.z)
        if self.best.residual <= 2 * floor < _LOW * (self.scale or norm(self.best.z)):
            return Ended(Status.PRECISION_LIMIT, f"rounding leaves a residual of up to about {floor:.2g} at this z")
        return None


def _fall(high: float, low: float) -> float:
    """log(high/low), where the quotient may be out of range, too; infinite at low = 0."""
    return math.log(high) - math.log(low) if low > 0.0 else math.inf


def fault_of_psi(problem: ProblemData, z: Vector) -> str:
    """Which entry of ψ(z) is NaN or +∞, or of ψ̄(z) NaN or −∞, although z is finite; empty where none is."""
    if not np.isfinite(z).all():
        return ""
    for name, psi, none in (("psi", problem.psi, -np.inf), ("upper", problem.upper, np.inf)):
        if psi is not None:
            value = psi.value(z)
            bad = ~(np.isfinite(value) | (value == none))
            if bad.any():
                return f"{name}(z)[{np.argmax(bad)}] is {value[np.argmax(bad)]}"
    return ""
