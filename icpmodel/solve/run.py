"""The only loop: it drives a method, tests its iterates, keeps the best, and says why it stopped."""

from __future__ import annotations

import contextlib
import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import MapError, NotApplicable, SingularOperator
from ..methods.contract import SAFE_HINT, HandOver, Infeasible
from ..numerics.arrays import Vector, as_number, norm
from ..problem.data import ProblemData
from ..theory.answers import Answer
from .choice import Choice, why_none
from .goal import AccuracyGoal, Goal
from .progress import Bar, progress_bar
from .solution import History, Solution, Status

#: after so many steps without a better iterate, or twice the number of unknowns (a signal may have to cross them all)
#: up to the second number, the run counts as stagnated …
_PATIENCE, _LONGEST_PATIENCE = 1000, 50_000
#: … and after so many without one that is better by a thousandth, it is asked whether rounding is the reason, which
#: explains nothing where it leaves more than that share of the first residual: z has run away
_PRECISION_CHECK, _LOW = 50, 0.1
#: a residual this many times the first one is taken for divergence even before it overflows
_BLOW_UP = 1e200


@dataclass(frozen=True, kw_only=True)
class Limits:
    """When to stop: Res(z) ≤ max(`atol`, `rtol`·Res(0)), `max_iter` iterations, `time_limit` seconds (None: no limit).

    With `accuracy`, a certified error of at most that is asked for instead of a residual.

    Raises InputError for numbers that make no sense.
    """

    rtol: float
    atol: float
    max_iter: int
    time_limit: float | None
    accuracy: float | None = None

    def __post_init__(self) -> None:
        as_number(self.rtol, "rtol", least=0, below=1)  # from 1 on, z = 0 would do
        as_number(self.atol, "atol", least=0)
        as_number(self.max_iter, "max_iter", least=0, whole=True)
        if self.time_limit is not None:
            as_number(self.time_limit, "time_limit", least=0)
        if self.accuracy is not None:
            as_number(self.accuracy, "accuracy", above=0)


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


#: another method may go where psi has values, or need no derivative
_WORTH_ANOTHER_METHOD = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED, Status.MAP_FAILED)


@dataclass
class _Best:
    """The best iterate so far and the choice that found it; its residual may be a hint until the end."""

    z: Vector
    residual: float
    iteration: int
    choice: Choice


class Job:
    """One `solve`: the loop, and what its methods share if one fails and the next is tried.

    Parameters: `problem`; `start` of shape (n,); `limits`; `callback` or None; whether to keep the `history` and to
    show `progress`. Raises MapError where ψ has no value at `start`.
    """

    def __init__(
        self,
        problem: ProblemData,
        start: Vector,
        limits: Limits,
        callback: Callable[[Progress], Any] | None,
        history: bool,
        progress: bool,
    ) -> None:
        self.clock = time.perf_counter()
        self.problem, self.start, self.limits, self.callback = problem, start, limits, callback
        self.history, self.progress = history, progress
        self.at_start = scale = problem.residual(start) if (moved := start.any()) else problem.residual_at_0()
        if not np.isfinite(scale) and (fault := _fault_of_psi(problem, start)):
            raise MapError(f"{fault} at the start z0; a finite number or -inf was expected")
        # a start that leads one method astray is not given to the next, unless psi has no value at 0
        self.restart = start
        if moved:
            at_0 = np.nan
            with contextlib.suppress(MapError):
                at_0 = problem.residual_at_0()
            if np.isfinite(at_0):
                self.restart = np.zeros(problem.n)
                scale = at_0 or scale  # if 0 solves the problem, it says nothing of its scale
        self.scale = scale if np.isfinite(scale) else np.inf
        self.goal = Goal(max(limits.atol, limits.rtol * scale) if np.isfinite(scale) else limits.atol)
        if limits.accuracy is not None:
            self.goal = AccuracyGoal(problem, limits.accuracy, start)
        self.best: _Best | None = None
        self.current, self.iteration = start, 0
        self.tried: list[tuple[Choice, str]] = []
        self.successor: Choice | None = None
        self.infeasible: Answer | None = None
        self.fault: MapError | None = None
        self.records: list[tuple[int, float, float]] = []

    def first_success(self, choices: Iterator[Choice], *, tolerate_singular: bool) -> Solution:
        """Try one choice after the other until one ends for a reason that no other method would change.

        Returns the solution, with the best iterate of all that were tried. Raises NotApplicable where none could start,
        SingularOperator unless `tolerate_singular`.
        """
        status, note = Status.STAGNATED, ""
        try:
            for choice, start in self._in_turn(choices):
                try:
                    with progress_bar(self.progress, choice.method.name) as bar:
                        status, note = self._run(choice, start, bar)
                except SingularOperator:
                    if not tolerate_singular:
                        raise
                    continue
                if not (self.successor and type(self.successor.method) is type(choice.method)):  # else it goes on
                    self.tried.append((choice, "handed over" if self.successor else status.value))
                if status not in _WORTH_ANOTHER_METHOD:
                    break
        except KeyboardInterrupt:  # while the next method was chosen
            if self.best is None:
                raise
            status, note = Status.INTERRUPTED, "by Ctrl-C"
        except MemoryError:  # the next method needs more than there is
            if self.best is None:
                raise
        if self.best is None:
            raise NotApplicable(f"no method takes this problem: {why_none(self.problem)}")
        return self._solution(self.best, status, note)

    def _in_turn(self, choices: Iterator[Choice]) -> Iterator[tuple[Choice, Vector]]:
        """Each choice with its start, and after it the one it handed over to, from the best z or that start again."""
        for choice in choices:
            yield choice, (start := self.restart if self.tried else self.start)
            while self.successor is not None and self.best is not None:
                following, self.successor = self.successor, None
                yield following, start if following.afresh else self.best.z

    def _run(self, choice: Choice, start: Vector, bar: Bar) -> tuple[Status, str]:
        """One method from `start` until there is a reason to stop; Ctrl-C and a failing ψ are reasons like others."""
        try:
            with np.errstate(over="ignore", invalid="ignore"):
                return self._loop(choice, start, bar)
        except KeyboardInterrupt:
            if self.best is None:
                self.best = _Best(start, self.problem.residual(start), 0, choice)
            return Status.INTERRUPTED, "by Ctrl-C"
        except MapError as error:
            if self.best is None:
                raise
            self.fault = error
            return Status.MAP_FAILED, str(error)
        except HandOver as over:
            self.successor = Choice(over.method, over.why, choice.hurry, over.afresh)
            return Status.STAGNATED, over.why
        except Infeasible as proof:
            self.infeasible = proof.answer
            return Status.INFEASIBLE, proof.answer.reason

    def _loop(self, choice: Choice, start: Vector, bar: Bar) -> tuple[Status, str]:
        first = self.iteration
        milestone, milestone_residual, milestone_z = first, np.nan, start
        progress_at, progress_residual = first, np.inf
        better_at, better_residual, first_residual = first, np.inf, np.inf
        patience = _PATIENCE if choice.hurry else min(max(_PATIENCE, 2 * self.problem.n), _LONGEST_PATIENCE)
        for step, (z, hint) in enumerate(choice.method.iterates(self.problem, start)):
            k = self.iteration = first + step
            still, self.current = step > 0 and z is self.current, z
            residual = self._residual(z, hint)
            seconds = time.perf_counter() - self.clock
            bar.update(k, residual, self.goal.tolerance)
            if self.history:
                self.records.append((k, residual, seconds))
            if step == 0:
                first_residual = residual
            if residual < better_residual:
                better_at, better_residual = k, residual
            if self.best is None or residual < self.best.residual:
                self.best = _Best(z, residual, k, choice)
            if self.callback is not None and self.callback(_state(k, z, residual, seconds)):
                return Status.STOPPED, "by the callback"
            if self.goal.reached(z, residual):
                self.best = _Best(z, residual, k, choice)
                return Status.SOLVED, ""
            if not residual < np.inf or residual > _BLOW_UP * max(first_residual, self.goal.tolerance):
                fault = _fault_of_psi(self.problem, z)
                if fault:
                    return Status.MAP_FAILED, f"{fault} at iteration {k}"
                return Status.DIVERGED, f"the residual is {residual:.3g} at iteration {k}"
            if still:
                return self._recurred(1)
            if choice.method.memoryless and residual == milestone_residual and np.array_equal(z, milestone_z):
                return self._recurred(k - milestone)
            if k - first >= 2 * (milestone - first):  # Brent's cycle search: compare with a late iterate
                milestone, milestone_residual, milestone_z = k, residual, z
            if residual < 0.999 * progress_residual:
                progress_at, progress_residual = k, residual
            elif (k - progress_at) % _PRECISION_CHECK == _PRECISION_CHECK - 1 and self._at_floor():
                return Status.PRECISION_LIMIT, self._floor_note()
            if k - better_at >= patience:
                return Status.STAGNATED, f"no better iterate in {patience} iterations"
            if k >= self.limits.max_iter:
                return Status.ITERATION_LIMIT, f"max_iter = {self.limits.max_iter}"
            if self.limits.time_limit is not None and seconds >= self.limits.time_limit:
                return Status.TIME_LIMIT, f"time_limit = {self.limits.time_limit:g} s"
        raise AssertionError("a method's iterates never end")

    def _residual(self, z: Vector, hint: float | None) -> float:
        """The method's hint while it is only a hint; the judge where a decision hangs on it."""
        low, high = SAFE_HINT
        if z is self.start:
            return self.at_start
        if hint is not None and low < hint < high and hint > self.goal.tolerance:
            return hint
        return self.problem.residual(z)

    def _floor(self) -> float:
        """An estimate of the residual that rounding alone leaves at the best iterate."""
        assert self.best is not None
        return norm(np.maximum(*self.problem.rounding(self.best.z)))

    def _at_floor(self) -> bool:
        assert self.best is not None
        return self.best.residual <= 2 * self._floor() < _LOW * self.scale

    def _floor_note(self) -> str:
        return f"rounding leaves a residual of up to about {self._floor():.2g} at this z"

    def _recurred(self, period: int) -> tuple[Status, str]:
        if self._at_floor():
            return Status.PRECISION_LIMIT, self._floor_note()
        if period == 1:
            return Status.STAGNATED, "the iterates stand still, but z is not a solution"
        return Status.CYCLED, f"the iterates repeat with period {period}"

    def _solution(self, best: _Best, status: Status, note: str) -> Solution:
        last = self.tried[-1][0] if self.tried else best.choice
        # hints chose the best iterate, so the judge has the last word; of a z that solved he has just had it
        candidates = [] if status is Status.SOLVED and not self.problem.psi.at_users_word else [best]
        if self.current is not best.z:
            candidates.append(_Best(self.current, np.inf, self.iteration, last))
        for candidate in candidates:
            with contextlib.suppress(MapError, KeyboardInterrupt):  # a ψ that failed may fail again, or take long
                candidate.residual = self.problem.residual(candidate.z)
            if candidate.residual < best.residual:
                best = candidate
        if self.goal.judge(best.z, best.residual):
            status = Status.SOLVED
        elif status is Status.SOLVED:
            status, note = Status.MAP_FAILED, "psi gives different values at the same z"
        message = "solved"
        if status is Status.SOLVED:
            last = best.choice
        else:
            by = "" if last is best.choice else f" by {best.choice.method!r}"
            advice = status.advice_with(last.method.to_try if len(self.tried) < 2 else "")
            message = (
                f"{last.method!r} {status.value}: {note}; best residual {best.residual:.3g}{by} "
                f"({self.goal.wanted(best.z)}). Advice: {advice}"
            )
        others = [f"{choice.method!r}: {ended}" for choice, ended in self.tried if choice is not best.choice]
        why = "; ".join([best.choice.why, *(["also tried: " + ", ".join(others)] if others else [])])
        past = None
        if self.history:
            columns = np.array(self.records, dtype=np.float64).reshape(-1, 3)
            past = History(columns[:, 0].astype(np.int64), columns[:, 1], columns[:, 2])
        z = best.z.copy()
        z.flags.writeable = False
        return Solution(
            problem=self.problem,
            z=z,
            status=status,
            message=message,
            method=best.choice.method,
            last_method=last.method,
            why=why,
            residual=best.residual,
            tolerance=self.goal.tolerance,
            accuracy=self.limits.accuracy,
            iterations=self.iteration,
            seconds=time.perf_counter() - self.clock,
            history=past,
            infeasible=self.infeasible if status is Status.INFEASIBLE else None,
        )


def _fault_of_psi(problem: ProblemData, z: Vector) -> str:
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
