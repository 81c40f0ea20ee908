"""The only loop: it drives one method after the other, tests their iterates, keeps the best, and says why it ended.

Whole problems and parts of them go through it alike. The logger "icpmodel" says what it decides, see `solve`.
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
from .choice import InTurn, Job, Ladder
from .ended import Ended, Stalled, fault_of_psi
from .goal import Goal, Limits
from .progress import Bar, Progress, progress_bar
from .proved_convergence import proved_convergence
from .solution import Status

_LOG = logging.getLogger("icpmodel")
_LOG.addHandler(logging.NullHandler())
#: after so many steps without a better iterate, or twice the number of unknowns (a signal may have to cross them all)
#: up to the second number, the run counts as stagnated
PATIENCE = 1000
_LONGEST_PATIENCE = 50_000
#: rounding explains nothing where it leaves more than this share of the first residual: z has run away
_LOW = 0.1
#: a residual this many times the first one is taken for divergence even before it overflows
_BLOW_UP = 1e200
#: how a method ended whose iterates are as good as those of one that goes on
_GOOD = ("", Status.SOLVED.value, Status.TIME_LIMIT.value, Status.MEMORY_LIMIT.value)
#: another method may go where psi has values, or need no derivative
WORTH_ANOTHER_METHOD = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED, Status.MAP_FAILED)


@dataclass
class Best:
    """The best iterate, the job that found it, and its method with the numbers that it had adapted; its residual may
    be a hint until the end."""

    z: Vector
    residual: float
    job: Job
    adapted_method: Method


class Refused(NamedTuple):
    """What was not begun: the end that it makes, the job, None where one was to be chosen, and what it raised."""

    ended: Ended
    job: Job | None
    error: Exception


@dataclass(eq=False)
class Run:
    """Methods tried on a problem, one at a time, until one ends for a reason that no other would change.

    `steps` is the loop. Afterwards `ended` says why it ended, `best` what it found, `tried` what each method did.

    Parameters
    ----------
    problem : ProblemData
    start : array of shape (n,)
    at_start : float
        Res_D(start).
    goal : Goal
    limits : Limits
    aim : float
        The share of `scale` for which costs are estimated.
    scale : float
        A residual by which others are judged, 0 for ‖z‖.
    restart : array of shape (n,), optional
        Where a method begins after one that failed.
    presolved : ProblemData, optional
        What methods are given in place of `problem`: one that has the same solutions.
    follows_theorems : bool
        Whether a method that is proved to converge goes on where its residual is flat, as one that was named does.
    watch : function, optional
        What is called with every iterate and its residual in place of `callback`; an `Ended` ends the run.
    callback, history, progress
        As in `solve`.
    """

    problem: ProblemData
    start: Vector
    at_start: float
    goal: Goal
    _: KW_ONLY
    limits: Limits
    aim: float
    scale: float
    restart: Vector | None = None
    presolved: ProblemData | None = None
    follows_theorems: bool = False
    watch: Callable[[Vector, float], Ended | None] | None = None
    callback: Callable[[Progress], Any] | None = None
    history: bool = False
    progress: bool = False
    clock: float = field(default_factory=work.clock)

    def __post_init__(self) -> None:
        self.records: list[tuple[int, float, float, str]] | None = [] if self.history else None
        self.current, self.iteration = self.start, -1
        self.previous = self.start
        self.proof = ""
        self.job: Job
        self.path: Iterator[Iterate] = iter(())
        self.best: Best | None = None
        self.tried: list[Job] = []
        self.loops: dict[Job, Iterator[bool]] = {}
        #: whether it ended for a reason that no other method would change
        self.is_over = False
        self.ended = Ended(Status.STAGNATED, "")
        self.infeasible: Answer | None = None
        # of the search that a failure leads to: a sentence that says its limit
        self.searched: tuple[str, ...] = ()
        self.fault: MapError | None = None
        # of what was not begun, as it would not have fitted into the time or the memory that were left: the last one
        self.refused: Refused | None = None
        self.singular: SingularOperator | None = None
        self.bar = Bar()
        self.target = self.aim * (self.scale or self.at_start)

    def steps(self, ladder: Ladder | InTurn) -> Iterator[None]:
        """The loop; it stops after each tested iterate that is not the last one of its method."""
        with progress_bar(self.progress) as self.bar:
            job = self._next(ladder)
            while job is not None:
                self.bar.begin(job.method.name)
                loop = self.loops.get(job) or self.loops.setdefault(job, self._one(job))
                following: Job | None = job
                while following is job:
                    for is_due in loop:
                        yield
                        if is_due:
                            break
                    else:
                        if self.ended.status not in WORTH_ANOTHER_METHOD and not self.is_refused:
                            self.is_over = True
                            return
                        ladder.end(job)
                    following = self._next(ladder)
                if following is not None and job.outcome == "":
                    _LOG.info("n = %d: %s, then %r", self.problem.n, job, following.method)
                job = following
        if self.refused is not None:
            self.ended = self.refused.ended
            if self.refused.job is not None:
                self.job = self.refused.job

    def _next(self, ladder: Ladder | InTurn) -> Job | None:
        """The next method, None where none is left or what must be known for that takes more than the limits leave."""
        try:
            return ladder.next()
        except (OutOfTime, MemoryError) as error:
            self._refuse(error, None)
            return None

    def _refuse(self, error: Exception, job: Job | None) -> Ended:
        late = isinstance(error, OutOfTime)
        if late and self.limits.time_limit is not None:
            error = OutOfTime(f"time_limit = {self.limits.time_limit:g} s, and {error}")
        ended = Ended(Status.TIME_LIMIT if late else Status.MEMORY_LIMIT, str(error))
        self.refused = Refused(ended, job, error)
        return ended

    @property
    def is_refused(self) -> bool:
        """Whether what ended last did so for a lack of time or memory that was foreseen."""
        return self.refused is not None and self.ended is self.refused.ended

    def _one(self, job: Job) -> Iterator[bool]:
        """One method until there is a reason to stop, left in `ended`; whether it is time to compare it with others."""
        self.job = job
        self.tried.append(job)
        _LOG.info("n = %d: %r begins: %s", self.problem.n, job.method, job.choice.why or "it was named")
        try:
            self.ended = yield from self._loop(job)
        except SingularOperator as error:
            self.singular = error
            self.tried.remove(job)
            job.outcome = str(error)
            self._log_end(job)
            return
        except Infeasible as proof:
            self.infeasible = proof.answer
            self.ended = Ended(Status.INFEASIBLE, proof.answer.reason)
        except KeyboardInterrupt:
            job.outcome = Status.INTERRUPTED.value
            raise
        except (OutOfTime, MemoryError) as error:
            self.ended = self._refuse(error, job)
        except MapError as error:
            if self.best is None:
                raise
            self.fault = error
            self.ended = Ended(Status.MAP_FAILED, str(error))
        job.outcome = self.ended.status.value
        self._log_end(job)

    def _log_end(self, job: Job) -> None:
        best = np.nan if self.best is None else self.best.residual
        _LOG.info("n = %d: %s: %s; best residual %.3g", self.problem.n, job, job.outcome, best)

    def _begin(self) -> Vector:
        """Where a method begins: with the best iterate, unless that is of one that failed."""
        if self.best is None:
            return self.start
        return self.best.z if self.restart is None or self.best.job.outcome in _GOOD else self.restart

    def _loop(self, job: Job) -> Generator[bool, None, Ended]:
        begin = self._begin()
        job.is_fresh = begin is self.start and self.presolved is None
        path = job.method.iterates(self.presolved or self.problem, begin)
        longest = min(max(PATIENCE, 2 * self.problem.n), _LONGEST_PATIENCE)
        stalled = Stalled(job.method.memoryless, longest, self.at_floor, self._is_proved)
        first = np.nan
        count = 0
        spent = 0.0
        while True:
            self.path = path
            self.job = job
            before = work.done()
            try:
                z, hint = next(path)
            except StopIteration:
                return stalled.recurred()
            spent += work.done() - before
            if count or self.iteration < 0:  # where a method begins another one has been
                self.iteration += 1
            self.previous = self.current
            self.current = z
            residual = self._residual(z, hint)
            seconds = work.clock() - self.clock
            if not count:
                first = residual
            if self.best is None or residual < self.best.residual:
                self.best = self.candidate(z, residual)
            ended = self._seen(z, residual, seconds) or self._test(z, residual, first)
            if ended := ended or stalled.check(z, residual) or self._limit(seconds):
                job.steps = max(count, job.steps)
                return ended
            is_due = False
            count += 1
            if count > 1:  # the set-up counts for the first step
                is_due = job.step(spent + work.COSTS.iterate, *self._log_reduction(first, residual))
                spent = 0.0
            yield is_due

    def _log_reduction(self, first: float, residual: float) -> tuple[float, float]:
        """How far the logarithm of the residual, which was `first`, has fallen, and how far it has to."""
        need = _fall(first, self.target) if self.target < first < np.inf else np.inf
        return (_fall(first, residual) if residual > 0.0 and 0.0 < first < np.inf else 0.0), need

    def candidate(self, z: Vector, residual: float) -> Best:
        """`z` as an iterate of the method that is tried."""
        return Best(z, residual, self.job, getattr(self.path, "adapted_method", self.job.method))

    def _residual(self, z: Vector, hint: float | None) -> float:
        """The method's hint while it is only a hint; the judge where a decision hangs on it."""
        low, high = SAFE_HINT
        if z is not self.start and hint is not None and low < hint < high and not self.goal.is_near(z, hint):
            return hint
        return self.goal.judged(z, self.at_start if z is self.start else self.problem.residual(z))

    @property
    def is_watched(self) -> bool:
        """Whether a bar, the history or a callback is to see the iterates."""
        return self.progress or self.history or self.callback is not None

    def seen(self, z: Vector) -> Ended | None:
        """Show an iterate that was made of one of a part."""
        with suppress(MapError):
            return self._seen(z, self.problem.residual(z), work.clock() - self.clock)
        return None

    def _seen(self, z: Vector, residual: float, seconds: float) -> Ended | None:
        """Show `z`, with Res_D(z) where `residual` is that of the problem that methods are given."""
        if self.watch is not None:
            return self.watch(z, residual)
        if self.presolved is not None and self.is_watched:
            with suppress(MapError):
                residual = self.problem.residual(z)
        self.bar.update(self.iteration, residual, self.goal.tolerance)
        if self.records is not None:
            self.records.append((self.iteration, residual, seconds, self.job.method.name))
        # a copy, as whoever has a view can write through its base
        if self.callback is not None and self.callback(Progress(self.iteration, locked(z.copy()), residual, seconds)):
            return Ended(Status.STOPPED, "by the callback")
        return None

    def _test(self, z: Vector, residual: float, first: float) -> Ended | None:
        """What the iterate itself says: it is what was wanted, or it has run away from the `first` residual."""
        if self.goal.reached(z, residual):
            if self.best is None or self.best.z is not z:
                self.best = self.candidate(z, residual)
            return Ended(Status.SOLVED, "")
        if not residual < np.inf or residual > _BLOW_UP * max(first, self.goal.tolerance):
            if fault := fault_of_psi(self.problem, z):
                return Ended(Status.MAP_FAILED, f"{fault} at iteration {self.iteration}")
            return Ended(Status.DIVERGED, f"the iterates diverged, at iteration {self.iteration}")
        return None

    def _limit(self, seconds: float) -> Ended | None:
        most = self.limits.time_limit
        if self.iteration >= self.limits.max_iter:
            return Ended(Status.ITERATION_LIMIT, f"max_iter = {self.limits.max_iter}")
        if most is not None and seconds >= most:
            return Ended(Status.TIME_LIMIT, f"time_limit = {most:g} s")
        return None

    def _is_proved(self) -> bool:
        if self.follows_theorems:
            problem = self.presolved or self.problem
            tolerance = self.goal.tolerance_at(self.current)
            self.proof = proved_convergence(
                problem, self.job.method, self.previous, self.current, tolerance, self.iteration
            )
        return bool(self.proof)

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
