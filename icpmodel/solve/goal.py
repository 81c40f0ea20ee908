"""When a run has what it was asked for: a small residual, or a certified error below a bound."""

from __future__ import annotations

import contextlib
import math
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import MapError, NotApplicable, OutOfTime
from ..numerics import work
from ..numerics.arrays import Vector, as_number
from ..numerics.rounding import at_most, share_of
from ..problem.data import ProblemData
from ..problem.verdict import certain
from ..theory.certificates.bounds import error_bound

#: the default relative tolerance
RTOL = 1e-8


@dataclass(frozen=True, kw_only=True)
class Limits:
    """When to stop: Res(z) ≤ max(`atol`, `rtol`·Res(0)), `max_iter` iterations, `time_limit` seconds,
    `memory_limit` bytes beyond what was held at the start (None: no limit but the machine's).

    With `accuracy`, a certified error of at most that is asked for instead of a residual.
    Raises InputError for numbers that make no sense.
    """

    rtol: float
    atol: float
    max_iter: int
    time_limit: float | None
    accuracy: float | None = None
    memory_limit: float | None = None

    def __post_init__(self) -> None:
        as_number(self.rtol, "rtol", least=0, below=1)  # from 1 on, z = 0 would do
        as_number(self.atol, "atol", least=0)
        as_number(self.max_iter, "max_iter", least=0, whole=True)
        if self.time_limit is not None:
            as_number(self.time_limit, "time_limit", least=0)
        if self.memory_limit is not None:
            as_number(self.memory_limit, "memory_limit", least=0)
        if self.accuracy is not None:
            as_number(self.accuracy, "accuracy", above=0)

    def tolerance(self, scale: Any) -> Any:
        """max(`atol`, `rtol`·`scale`), a number or an array of them."""
        return np.maximum(self.atol, share_of(scale, self.rtol))

    def kept(self, begun: float | None = None) -> AbstractContextManager[None]:
        """A block that keeps to the limits of time, which `begun` then or now, and memory: see `numerics.work`."""
        from ..numerics import kernels  # noqa: F401  loads numba, before the clock begins

        seconds, memory = (math.inf if limit is None else limit for limit in (self.time_limit, self.memory_limit))
        return work.within(seconds, memory, begun)


@dataclass
class Goal:
    """Res(z) ≤ `tolerance`, of the exact residual where the `problem` is given."""

    tolerance: float
    problem: ProblemData | None = None

    def judged(self, z: Vector, residual: float) -> float:
        """The residual by which `z` is judged, `residual` being what float64 makes of Res(z)."""
        return residual if self.problem is None else certain(self.problem, z, residual, self.tolerance)

    def reached(self, z: Vector, residual: float) -> bool:
        """Whether `z`, shape (n,), with Res(z) = `residual` is what was asked for; NaN is not."""
        return residual <= self.tolerance

    def judge(self, z: Vector, residual: float) -> bool:
        """The last word on `z`: `reached`, but for looks that were left out to save time."""
        return self.reached(z, residual)

    def wanted(self, z: Vector) -> str:
        """What was asked for, in words, for the message of a run that did not get there with `z`."""
        return f"stop at {self.tolerance:.3g}"


class AccuracyGoal(Goal):
    """A certified bound on max|z − z*| that is at most `accuracy`.

    The bound costs more than a residual and falls about as fast, so it is looked at only where the residual is at most
    `tolerance`, which every look sets anew. Raises NotApplicable where nothing bounds the error of `problem`.
    """

    def __init__(self, problem: ProblemData, accuracy: float, start: Vector) -> None:
        super().__init__(np.inf)
        self.of, self.accuracy = problem, accuracy
        self.looked_at, self.bound = start, None
        try:
            bound = error_bound(problem, start)
        except (OutOfTime, MemoryError):  # the run will tell
            return
        self.bound = bound.value
        # whether obstacles that move cross is told by a small bound alone
        if not bound.unique and (problem.upper is None or problem.psi.is_constant):
            raise NotApplicable(
                f"accuracy: nothing bounds the error of this problem: {bound.reason}; give rtol instead"
            )

    def reached(self, z: Vector, residual: float) -> bool:
        if not residual <= self.tolerance:
            return False
        if self.judge(z, residual):
            return True
        share = 0.0 if self.bound is None else self.accuracy / self.bound
        self.tolerance = residual * min(max(share, 0.1), 0.5)
        return False

    def judge(self, z: Vector, residual: float) -> bool:
        bound = self._look(z)
        return bound is not None and bound <= self.accuracy

    def wanted(self, z: Vector) -> str:
        bound = self._look(z)
        known = "nothing is certain of its error" if bound is None else f"its error is at most {at_most(bound)}"
        return f"{known}; {self.accuracy:.3g} was wanted"

    def _look(self, z: Vector) -> float | None:
        """The bound on the error of `z`, None where there is none; at a point that does not move one look will do."""
        if not np.array_equal(z, self.looked_at):
            self.bound = None
            with contextlib.suppress(MapError, OutOfTime, MemoryError):
                self.bound = error_bound(self.of, z).value
            self.looked_at = z
        return self.bound
