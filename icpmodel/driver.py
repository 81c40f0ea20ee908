"""The only loop: it drives a method, tests its iterates, keeps the best, and says why it stopped."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Vector
from .errors import InputError, MapError, NotApplicable, NotSolved, SingularOperator
from .methods import Method, named
from .methods.choose import Choice, choose
from .problem import ICP
from .progress import Bar, progress_bar
from .solution import History, Solution, Status

#: outside this range the squares that a sweep sums for its hint over- or underflow; the judge does not
_SAFE_HINT = (1e-140, 1e140)
#: after so many steps without a better iterate the run counts as stagnated …
_PATIENCE = 1000
#: … and after so many without one that is better by a thousandth, it is asked whether rounding is the reason
_PRECISION_CHECK = 50
#: a residual this many times the first one is taken for divergence even before it overflows
_BLOW_UP = 1e100


@dataclass(frozen=True, kw_only=True)
class Limits:
    """When to stop: Res(z) ≤ max(`atol`, `rtol`·Res(0)), `max_iter` iterations, `time_limit` seconds (None: no limit).

    Raises InputError for numbers that make no sense.

    >>> Limits(rtol=-1.0)
    Traceback (most recent call last):
    icpmodel.errors.InputError: rtol is -1.0; a finite number >= 0 was expected
    """

    rtol: float = 1e-8
    atol: float = 0.0
    max_iter: int = 100_000
    time_limit: float | None = None

    def __post_init__(self) -> None:
        for name in ("rtol", "atol", "max_iter", "time_limit"):
            value = getattr(self, name)
            if name == "time_limit" and value is None:
                continue
            whole = name == "max_iter"
            right_type = isinstance(value, (int, np.integer) if whole else (int, float, np.number))
            if not right_type or isinstance(value, bool) or not 0 <= value < np.inf:
                raise InputError(f"{name} is {value!r}; a {'whole' if whole else 'finite'} number >= 0 was expected")


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


def solve(
    problem: ICP,
    method: str | Method | None = None,
    *,
    z0: Any = None,
    rtol: float = 1e-8,
    atol: float = 0.0,
    max_iter: int = 100_000,
    time_limit: float | None = None,
    callback: Callable[[Progress], Any] | None = None,
    history: bool = False,
    progress: bool = False,
    raise_on_failure: bool = True,
    **options: Any,
) -> Solution:
    """Solve an ICP: stop at Res(z) = ‖min(r, p)‖₂ ≤ max(atol, rtol·Res(0)), Res(0) being that of the vector 0
    (of z0 where ψ has no value at 0).

    Parameters:
    `problem`; `method` a name (with its `options`, e.g. theta1=1.2), a `Method`, or None to have one picked;
    `z0` the start, shape (n,), or an earlier `Solution` (default 0); `rtol`, `atol` (the paper's ε is atol);
    `max_iter` iterations in all; `time_limit` in seconds, set-up included, looked at between iterations;
    `callback` gets a `Progress` per tested iterate and stops the run by returning True;
    `history` keeps the residuals in `Solution.history`; `progress` shows a bar where standard error is a terminal;
    `raise_on_failure`.
    Returns a `Solution`; its z is the best iterate, and SOLVED means that the residual of this very z was recomputed.
    Raises InputError, NotApplicable (SingularOperator), MapError where ψ fails at the start, and NotSolved, which
    carries the best iterate, where the run fails, runs out of time or is interrupted, unless `raise_on_failure` is
    False: then that solution is returned.

    >>> solution = solve(ICP([[4, -1], [-2, 4]], [-3, -2]), "mnmsor", theta1=1.1)
    >>> solution.status, solution.z.round(6)
    (<Status.SOLVED: 'solved'>, array([1., 1.]))
    """
    limits = Limits(rtol=rtol, atol=atol, max_iter=max_iter, time_limit=time_limit)
    if callback is not None and not callable(callback):
        raise InputError(f"callback is a {type(callback).__name__}; a function was expected")
    start = problem.vector(np.zeros(problem.n) if z0 is None else getattr(z0, "z", z0), "z0").copy()
    if not np.isfinite(start).all():
        i = int(np.argmin(np.isfinite(start)))
        raise InputError(f"z0[{i}] is {start[i]}; a finite number was expected")
    job = _Job(problem, start, limits, callback, history, progress)
    solution = job.first_success(_choices(problem, method, options), tolerate_singular=method is None)
    if raise_on_failure and not solution.solved:
        raise NotSolved(solution)
    return solution


def _choices(problem: ICP, method: str | Method | None, options: dict[str, Any]) -> Iterator[Choice]:
    if method is None:
        if options:
            raise InputError(
                f"solve has no option {next(iter(options))}; it takes {', '.join(_OPTIONS)}, "
                "and the options of a method only where one is named"
            )
        yield from choose(problem)
        return
    if isinstance(method, Method):
        if options:
            raise InputError(f"{next(iter(options))}: the options of a Method object go into its constructor")
    else:
        try:
            method = named(method, **options)
        except InputError as error:
            raise InputError(f"{error}" + (f"; solve takes {', '.join(_OPTIONS)}" if options else "")) from None
    why_not = method.why_not(problem)
    if why_not is not None:
        raise NotApplicable(f"{method.name}: {why_not}")
    yield Choice(method, "")


_OPTIONS = ("z0", "rtol", "atol", "max_iter", "time_limit", "callback", "history", "progress", "raise_on_failure")
_WORTH_ANOTHER_METHOD = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED)


@dataclass
class _Job:
    """What all runs of one `solve` share."""

    problem: ICP
    start: Vector
    limits: Limits
    callback: Callable[[Progress], Any] | None
    history: bool
    progress: bool

    def __post_init__(self) -> None:
        self.clock = time.perf_counter()
        fault = _fault_of_psi(self.problem, self.start)
        if fault:
            raise MapError(f"{fault} at the start z0; a finite number or -inf was expected")
        self.tolerance = max(self.limits.atol, self.limits.rtol * self._scale())

    def _scale(self) -> float:
        """Res(0), which a warm start does not change; Res(z⁰) where ψ has no value at 0."""
        with contextlib.suppress(MapError):
            scale = self.problem.residual(np.zeros(self.problem.n))
            if np.isfinite(scale):
                return scale
        scale = self.problem.residual(self.start)
        return scale if np.isfinite(scale) else 0.0

    def first_success(self, choices: Iterator[Choice], *, tolerate_singular: bool) -> Solution:
        """Try one choice after the other until one ends for a reason that no other method would change."""
        solution: Solution | None = None
        for choice in choices:
            try:
                with progress_bar(self.progress, choice.method.name, self.tolerance) as bar:
                    solution = _Run(self, choice, solution, bar).go()
            except SingularOperator:
                if not tolerate_singular:
                    raise
                continue
            if solution.status not in _WORTH_ANOTHER_METHOD:
                break
        if solution is None:
            raise NotApplicable("no method takes this problem: diag(A) is not positive, A + Omega cannot be factorised")
        return solution


class _Run:
    """One method on one job; `before` is what earlier methods of the same job left."""

    def __init__(self, job: _Job, choice: Choice, before: Solution | None, bar: Bar) -> None:
        self.job, self.choice, self.before, self.bar = job, choice, before, bar
        self.problem, self.limits, self.tolerance = job.problem, job.limits, job.tolerance
        self.records: list[tuple[int, float, float]] = []
        if before is None:
            self.start = self.best = job.start
            self.first, self.best_residual = 0, np.inf
        else:
            # a start that led one method astray is not given to the next, but its best iterate is kept
            self.start, self.best = np.zeros(job.problem.n), before.z
            self.first, self.best_residual = before.iterations, before.residual
            if before.history is not None:
                past = before.history
                self.records = list(zip(past.iteration, past.residual, past.seconds, strict=True))
        self.best_iteration = self.last = self.first

    def go(self) -> Solution:
        """Iterate until there is a reason to stop; Ctrl-C and a failing ψ are reasons like others."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                status, note, k = self._loop()
        except KeyboardInterrupt:
            status, note, k = Status.INTERRUPTED, "by Ctrl-C", self.last
        except MapError as error:
            if self.last == self.first:
                raise
            status, note, k = Status.MAP_FAILED, str(error), self.last
        return self._solution(status, note, k)

    def _loop(self) -> tuple[Status, str, int]:
        milestone, milestone_residual, milestone_z = self.first, np.nan, self.start
        progress_at, progress_residual = self.first, np.inf
        first_residual = np.inf
        for step, (z, hint) in enumerate(self.choice.method.iterates(self.problem, self.start)):
            k = self.last = self.first + step
            residual = self._residual(z, hint)
            seconds = time.perf_counter() - self.job.clock
            self.bar.update(k, residual)
            if self.job.history:
                self.records.append((k, residual, seconds))
            if step == 0:
                first_residual = residual
            if residual < self.best_residual or k == 0:
                self.best, self.best_residual, self.best_iteration = z, residual, k
            if self.job.callback is not None and self.job.callback(_state(k, z, residual, seconds)):
                return Status.STOPPED, "stopped by the callback", k
            if residual <= self.tolerance:
                return Status.SOLVED, "", k
            if not residual < np.inf or residual > _BLOW_UP * max(first_residual, self.tolerance):
                fault = _fault_of_psi(self.problem, z)
                if fault:
                    return Status.MAP_FAILED, f"{fault} at iteration {k}", k
                return Status.DIVERGED, f"the residual is {residual:.3g} at iteration {k}", k
            if self.choice.method.memoryless and residual == milestone_residual and np.array_equal(z, milestone_z):
                return *self._recurred(k - milestone), k
            if k - self.first >= 2 * (milestone - self.first):  # Brent's cycle search: compare with a late iterate
                milestone, milestone_residual, milestone_z = k, residual, z
            if residual < 0.999 * progress_residual:
                progress_at, progress_residual = k, residual
            elif (k - progress_at) % _PRECISION_CHECK == _PRECISION_CHECK - 1 and self._at_floor():
                return Status.PRECISION_LIMIT, self._floor_note(), k
            if k - self.best_iteration >= _PATIENCE:
                return Status.STAGNATED, f"no better iterate in {_PATIENCE} iterations", k
            if k >= self.limits.max_iter:
                return Status.ITERATION_LIMIT, f"max_iter = {self.limits.max_iter} iterations", k
            if self.limits.time_limit is not None and seconds >= self.limits.time_limit:
                return Status.TIME_LIMIT, f"time_limit = {self.limits.time_limit:g} s", k
        raise AssertionError("a method's iterates never end")

    def _residual(self, z: Vector, hint: float | None) -> float:
        """The method's hint while it is only a hint; the judge where a decision hangs on it."""
        low, high = _SAFE_HINT
        if hint is not None and low < hint < high and hint > self.tolerance:
            return hint
        return self.problem.residual(z)

    def _at_floor(self) -> bool:
        return bool(self.best_residual <= 2 * self._floor())

    def _floor(self) -> float:
        """An estimate of the residual that rounding alone leaves at the best iterate."""
        return float(np.linalg.norm(self.problem.rounding(self.best)))

    def _floor_note(self) -> str:
        return f"rounding leaves a residual of up to about {self._floor():.2g} at this z"

    def _recurred(self, period: int) -> tuple[Status, str]:
        if self._at_floor():
            return Status.PRECISION_LIMIT, self._floor_note()
        if period == 1:
            return Status.STAGNATED, "the step is below the rounding of z, but z is not a solution"
        return Status.CYCLED, f"the iterates repeat with period {period}"

    def _solution(self, status: Status, note: str, k: int) -> Solution:
        z, why = self.best, self.choice.why
        if self.before is not None:
            last = self.before
            why = f"{why}; before it {last.method!r}: {last.status.value}"
        # a ψ that failed may fail again: then the residual seen during the run has to do
        residual = self.best_residual if status is Status.MAP_FAILED else self.problem.residual(z)
        message = "solved"
        if status is not Status.SOLVED:
            message = (
                f"{self.choice.method!r} {status.value}: {note}; best residual {residual:.3g} "
                f"(stop at {self.tolerance:.3g}). Advice: {status.advice}"
            )
        past = None
        if self.job.history:
            columns = np.array(self.records, dtype=np.float64).reshape(-1, 3)
            past = History(columns[:, 0].astype(np.int64), columns[:, 1], columns[:, 2])
        seconds = time.perf_counter() - self.job.clock
        z = z.copy()
        z.flags.writeable = False
        return Solution(
            self.problem, z, status, message, self.choice.method, why, residual, self.tolerance, k, seconds, past
        )


def _fault_of_psi(problem: ICP, z: Vector) -> str:
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
