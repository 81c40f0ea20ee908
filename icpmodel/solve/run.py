"""The only solve loop: `Run` iterates the methods, tests each iterate, keeps the best one and records why it stopped.

It serves whole problems and parts of them. Its decisions are logged by the logger "icpmodel", see `solve`.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import KW_ONLY, dataclass, field
from typing import Any, NamedTuple

import numpy as np

from ..errors import MapError, OutOfTime, SingularOperator
from ..methods.contract import SAFE_SIZE, Infeasible, Iterate, Method
from ..numerics import work
from ..numerics.arrays import Vector, locked, norm
from ..numerics.rounding import UNIT_ROUNDOFF, is_ctrl_c
from ..problem.data import ProblemData
from ..theory.answers import Answer
from .choice import Ladder
from .goal import Goal, Limits
from .jobs import Job, MethodSequence
from .progress import Bar, CallbackFailure, Progress, progress_bar
from .solution import Status
from .stopping import WORTH_ANOTHER_METHOD, StagnationTest, StopReason, fault_of_psi

_LOG = logging.getLogger("icpmodel")
_LOG.addHandler(logging.NullHandler())
#: a run stagnates after max(`PATIENCE`, 2n) steps without a better iterate; 2n because information may have to cross
#: all unknowns
PATIENCE = 1000
#: the largest share of `Run.scale`, or of ‖z‖, that rounding may explain; beyond it the iterates have diverged
MAX_ROUNDING = 0.1
#: a residual of this many times the first one counts as divergence, before it overflows
_DIVERGENCE = 1e200
#: outcomes after which the next method starts from the best iterate; "" is that of a method that is only paused
_CONTINUABLE = ("", Status.SOLVED.value, Status.TIME_LIMIT.value, Status.MEMORY_LIMIT.value)


@dataclass
class BestIterate:
    """The best iterate, the job that found it, and the method with its adapted parameters.

    Until the end of the run `residual` may be the estimate that the method itself gave.
    """

    z: Vector
    residual: float
    job: Job
    adapted_method: Method


class Refusal(NamedTuple):
    """A method that could not start or go on, or (`job` None) be chosen, for lack of time or memory."""

    stop_reason: StopReason
    job: Job | None
    error: Exception


@dataclass(eq=False)
class Run:
    """Try methods on a problem, one at a time, until one solves it, none is left, or no other would help.

    `steps` is the loop. Afterwards `stop_reason` says why it stopped or, if all methods failed, how the method of the
    best iterate ended. `best` is the best iterate, `tried` the jobs.

    Parameters
    ----------
    problem : ProblemData
    start : array of shape (n,)
    start_residual : float
        Res_D(start).
    goal : Goal
    limits : Limits
    target_reduction : float
        The costs of methods are estimated for this residual, relative to `scale`.
    scale : float
        The reference residual; if 0, ‖z‖ takes its place.
    restart : array of shape (n,), optional
        The start of a method after one that failed.
    warm_start : bool
        Whether the user gave the start.
    presolved : ProblemData, optional
        A problem with the same solutions that the methods get in place of `problem`.
    watch : function, optional
        Called with every iterate and its residual in place of `callback`; it ends the run by returning a `StopReason`.
    callback, history, progress
        As in `solve`.
    start_time, start_cost : float
        `work.clock()` and `work.counter()` when the run began; seconds and costs count from there.
    """

    problem: ProblemData
    start: Vector
    start_residual: float
    goal: Goal
    _: KW_ONLY
    limits: Limits
    target_reduction: float
    scale: float
    restart: Vector | None = None
    warm_start: bool = False
    presolved: ProblemData | None = None
    watch: Callable[[Vector, float], StopReason | None] | None = None
    callback: Callable[[Progress], Any] | None = None
    history: bool = False
    progress: bool = False
    start_time: float = field(default_factory=work.clock)
    start_cost: float = field(default_factory=work.counter)

    def __post_init__(self) -> None:
        self.records: list[tuple[int, float, float, str]] | None = [] if self.history else None
        self.current = self.start
        self.iteration = -1
        self.job: Job
        self.path: Iterator[Iterate] = iter(())
        self.best: BestIterate | None = None
        self.tried: list[Job] = []
        self.loops: dict[Job, Iterator[bool]] = {}
        #: whether no other method is to be tried
        self.is_over = False
        self.stop_reason = StopReason(Status.STAGNATED, "")
        self.infeasible: Answer | None = None
        # what the global search after a failure adds to `Solution.why`: its limit and its result
        self.search_notes: tuple[str, ...] = ()
        self.fault: MapError | None = None
        # the last method that could not start or go on for lack of time or memory
        self.refusal: Refusal | None = None
        self.singular: SingularOperator | None = None
        self.bar = Bar()
        # rounding may not allow a smaller one
        self.target_reduction = min(max(self.target_reduction, UNIT_ROUNDOFF), 1.0)
        self.target = self.target_reduction * (self.scale or self.start_residual) or UNIT_ROUNDOFF

    def steps(self, ladder: Ladder | MethodSequence) -> Iterator[None]:
        """Run the loop; yield after each tested iterate but the last one of a method."""
        with progress_bar(self.progress) as self.bar:
            last: Job | None = None
            while (job := self._next_job(ladder)) is not None:
                if job is not last:
                    if last is not None and last.stop_reason is None:
                        _LOG.info("n = %d: %s, then %r", self.problem.n, last, job.method)
                    self.bar.begin(job.method.name)
                    last = job
                for is_due in self.loops.setdefault(job, self._run_method(job)):
                    yield
                    if is_due:
                        break
                else:
                    if self.stop_reason.status not in WORTH_ANOTHER_METHOD and not self.is_refused:
                        self.is_over = True
                        return
                    ladder.end(job)
        if self.refusal is not None:
            self.stop_reason = self.refusal.stop_reason
            if self.refusal.job is not None:
                self.job = self.refusal.job
        elif self.best is not None and self.best.job.stop_reason:  # how others ended says nothing of this iterate
            self.job = self.best.job
            self.stop_reason = self.best.job.stop_reason

    def _next_job(self, ladder: Ladder | MethodSequence) -> Job | None:
        """The next job; None if none is left, or if choosing one would exceed the limits."""
        try:
            return ladder.next()
        except (OutOfTime, MemoryError) as error:
            self._refuse(error, None)
            return None

    def _refuse(self, error: Exception, job: Job | None) -> StopReason:
        """Record in `refusal` that time or memory is lacking for `job`; return the stop reason."""
        is_late = isinstance(error, OutOfTime)
        note = str(error)
        if is_late and self.limits.time_limit is not None:
            note = f"time_limit = {self.limits.time_limit:g} s, and {error}"
        stop_reason = StopReason(Status.TIME_LIMIT if is_late else Status.MEMORY_LIMIT, note)
        self.refusal = Refusal(stop_reason, job, error)
        return stop_reason

    @property
    def is_refused(self) -> bool:
        """Whether `stop_reason` is that of `refusal`: a method lacked time or memory."""
        return self.refusal is not None and self.stop_reason is self.refusal.stop_reason

    def _run_method(self, job: Job) -> Iterator[bool]:
        """Run one method to its end; set `stop_reason`. Yield whether it is time to compare it with other methods."""
        self.job = job
        self.tried.append(job)
        _LOG.info("n = %d: %r begins: %s", self.problem.n, job.method, job.choice.why or "it was named")
        try:
            self.stop_reason = yield from self._loop(job)
        except SingularOperator as error:
            self.singular = error
            self.tried.remove(job)
            job.stop_reason = StopReason(Status.STAGNATED, str(error))
            self._log_end(job)
            return
        except Infeasible as proof:
            self.infeasible = proof.answer
            self.stop_reason = StopReason(Status.INFEASIBLE, proof.answer.reason)
        except KeyboardInterrupt:
            job.stop_reason = StopReason(Status.INTERRUPTED, "")
            raise
        except (OutOfTime, MemoryError) as error:
            self.stop_reason = self._refuse(error, job)
        except MapError as error:
            if self.best is None:
                raise
            self.fault = error
            self.stop_reason = StopReason(Status.MAP_FAILED, str(error))
        job.stop_reason = self.stop_reason
        self._log_end(job)

    def _log_end(self, job: Job) -> None:
        best = np.nan if self.best is None else self.best.residual
        _LOG.info("n = %d: %s: %s; best residual %.3g", self.problem.n, job, job.stop_reason, best)

    def _starting_point(self) -> Vector:
        """The best iterate, or `restart` if its method failed; `start` if there is no best iterate."""
        if self.best is None:
            return self.start
        return self.best.z if self.restart is None or self.best.job.outcome in _CONTINUABLE else self.restart

    def _loop(self, job: Job) -> Generator[bool, None, StopReason]:
        """Test the iterates of one method; return its stop reason. Yield as `_run_method` does."""
        start = self._starting_point()
        job.is_fresh = start is self.start and self.presolved is None
        path = job.method.iterates(self.presolved or self.problem, start)
        patience = max(PATIENCE, 2 * self.problem.n)
        stalled = StagnationTest(job.method.memoryless, patience, self.at_floor)
        count = 0
        spent = 0.0
        while True:
            self.path = path
            self.job = job
            before = work.counter()
            try:
                z, hint = next(path)
            except StopIteration as end:
                return stalled.ended(end.value)
            spent += work.counter() - before
            if count or self.iteration < 0:  # a later method starts from an iterate that was counted before
                self.iteration += 1
            self.current = z
            residual = self._residual(z, hint)
            seconds = work.clock() - self.start_time
            if not count:
                job.residuals.append(residual)
            if self.best is None or residual < self.best.residual:
                self.best = self.candidate(z, residual)
            stop_reason = self._report(z, residual, seconds) or self._end_at(z, residual)
            if stop_reason := stop_reason or stalled.check(z, residual) or self._end_by_limit():
                job.steps = max(count, job.steps)
                return stop_reason
            is_due = False
            count += 1
            if count > 1:  # the set-up counts as a part of the first step
                is_due = job.step(spent + work.COSTS.iterate, residual, self.target)
                spent = 0.0
            yield is_due
            # a method that ran in between may have used the last iteration
            if is_due and (stop_reason := self._end_by_limit()):
                return stop_reason

    def candidate(self, z: Vector, residual: float) -> BestIterate:
        """`z` as a best iterate, found by the current method."""
        return BestIterate(z, residual, self.job, getattr(self.path, "adapted_method", self.job.method))

    def _residual(self, z: Vector, hint: float | None) -> float:
        """The residual that the method estimates (`hint`), or the exact one if the run might end at `z`.

        It is also exact if a run on the `presolved` problem is watched, so that no residual shown is better than that
        of the answer.
        """
        hint = None if z is self.start else hint
        if hint is not None and SAFE_SIZE < hint < 1.0 / SAFE_SIZE and not self.goal.is_near(z, hint):
            if self.presolved is not None and self.is_watched:
                with suppress(MapError):
                    return self.goal.judged(z, self.problem.residual(z))
            return hint
        return self.goal.judged(z, self.start_residual if z is self.start else self.problem.residual(z))

    @property
    def is_watched(self) -> bool:
        """Whether the iterates go to a progress bar, the history or a callback."""
        return self.progress or self.history or self.callback is not None

    def report_whole(self, z: Vector) -> StopReason | None:
        """Report `z`, completed from an iterate of a part, and keep it if it is the best; return as `_report` does."""
        with suppress(MapError):
            residual = self.goal.judged(z, self.problem.residual(z))
            if self.best is None or residual < self.best.residual:
                self.best = self.candidate(z, residual)
            return self._report(z, residual, work.clock() - self.start_time)
        return None

    def _report(self, z: Vector, residual: float, seconds: float) -> StopReason | None:
        """Report `z` to `watch`, or to bar, history and callback; return a stop reason if one of them stops the run.

        Raises CallbackFailure.
        """
        if self.watch is not None:
            return self.watch(z, residual)
        self.bar.update(self.iteration, residual, self.goal.tolerance)
        if self.records is not None:
            self.records.append((self.iteration, residual, seconds, self.job.method.name))
        if self.callback is None:
            return None
        # a copy: a view could be written to through its base
        progress = Progress(self.iteration, locked(z.copy()), residual, seconds)
        try:
            return StopReason(Status.STOPPED, "by the callback") if self.callback(progress) else None
        except Exception as error:
            if isinstance(error, OutOfTime) or is_ctrl_c(error):  # of this run
                raise
            raise CallbackFailure(error) from None

    def _end_at(self, z: Vector, residual: float) -> StopReason | None:
        """SOLVED, or DIVERGED or MAP_FAILED by the growth of the residual; None if the run goes on.

        A `z` that solves the problem becomes the best iterate.
        """
        if self.goal.reached(z, residual):
            if self.best is None or self.best.z is not z:
                self.best = self.candidate(z, residual)
            return StopReason(Status.SOLVED, "")
        if not residual < np.inf or residual > _DIVERGENCE * max(self.job.residuals[0], self.goal.tolerance):
            if fault := fault_of_psi(self.problem, z):
                return StopReason(Status.MAP_FAILED, f"{fault} at iteration {self.iteration}")
            return StopReason(Status.DIVERGED, f"the iterates diverged, at iteration {self.iteration}")
        return None

    def _end_by_limit(self) -> StopReason | None:
        """ITERATION_LIMIT or TIME_LIMIT, if one is reached; the time limit may be that of an enclosing run."""
        time_limit = self.limits.time_limit
        if self.iteration >= self.limits.max_iter:
            return StopReason(Status.ITERATION_LIMIT, f"max_iter = {self.limits.max_iter}")
        if work.seconds_left() == 0.0:
            enclosing = "the time limit of what encloses this run"
            return StopReason(Status.TIME_LIMIT, enclosing if time_limit is None else f"time_limit = {time_limit:g} s")
        return None

    def at_floor(self) -> StopReason | None:
        """PRECISION_LIMIT if rounding explains the residual of the best iterate, else None."""
        if self.best is None:
            return None
        floor = self.problem.rounding_of_residual(self.best.z)
        if self.best.residual <= 2 * floor < MAX_ROUNDING * (self.scale or norm(self.best.z)):
            return StopReason(
                Status.PRECISION_LIMIT, f"rounding leaves a residual of up to about {floor:.2g} at this z"
            )
        return None
