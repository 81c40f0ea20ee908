"""Why a method stops: its iterates stagnate or cycle, or ψ has no value."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

from ..numerics.arrays import Vector, not_finite
from ..problem.data import ProblemData
from .solution import Status

#: after this many steps that reduce the residual by less than a thousandth in all, its rounding error is computed
_PRECISION_CHECK = 50
#: statuses after which another method is tried; after MAP_FAILED it may avoid the points where psi fails
WORTH_ANOTHER_METHOD = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED, Status.MAP_FAILED)


class StopReason(NamedTuple):
    """Why a method ended."""

    status: Status
    note: str

    def __str__(self) -> str:
        return f"{self.status.value}: {self.note}" if self.note else self.status.value


class StagnationTest:
    """The test for iterates that recur, stagnate, or are as accurate as rounding allows.

    Parameters
    ----------
    memoryless : bool
        Whether the last iterate alone decides the next one, see `Method.memoryless`.
    patience : int
        The number of steps without a better iterate after which the method stops.
    at_floor : callable
        Returns a reason if rounding explains that the residual does not fall, else None.

    Notes
    -----
    Cycles of a method without memory are detected by Brent's algorithm: each iterate is compared
    with the milestone, which is the iterate number 1, 2, 4, 8, …

    References
    ----------
    Brent, BIT 20 (1980).
    """

    def __init__(self, memoryless: bool, patience: int, at_floor: Callable[[], StopReason | None]) -> None:
        self.memoryless = memoryless
        self.patience = patience
        self.at_floor = at_floor
        self.step = self.milestone = 0
        self.milestone_residual = np.nan
        self.milestone_z: Vector = np.array([])
        self.progress_at = 0
        self.progress_residual = np.inf
        self.better_at = 0
        self.better_residual = np.inf

    def check(self, z: Vector, residual: float) -> StopReason | None:
        """Record the next iterate `z`; return the reason to stop at it, or None."""
        k = self.step
        self.step += 1
        if residual < self.better_residual:
            self.better_at = k
            self.better_residual = residual
        if self.memoryless and residual == self.milestone_residual and np.array_equal(z, self.milestone_z):
            return self._recurred(k - self.milestone)
        if k >= 2 * self.milestone:
            self.milestone = k
            self.milestone_residual = residual
            self.milestone_z = z
        if residual < 0.999 * self.progress_residual:
            self.progress_at = k
            self.progress_residual = residual
        elif (k - self.progress_at) % _PRECISION_CHECK == _PRECISION_CHECK - 1 and (stop_reason := self.at_floor()):
            return stop_reason
        if k - self.better_at >= self.patience:
            return StopReason(Status.STAGNATED, f"no better iterate in {k - self.better_at} iterations")
        return None

    def ended(self, why: str | None) -> StopReason:
        """The reason for the end if the method has no new iterate; `why` is the explanation of the method."""
        why = why or "it has no further step"
        return self.at_floor() or StopReason(Status.STAGNATED, f"{why}, but z is not a solution")

    def _recurred(self, period: int) -> StopReason:
        """The reason for the end if an iterate recurred."""
        still = StopReason(Status.STAGNATED, "the iterates no longer move, but z is not a solution")
        cycled = StopReason(Status.CYCLED, f"the iterates repeat with period {period}")
        return self.at_floor() or (still if period == 1 else cycled)


def fault_of_psi(problem: ProblemData, z: Vector) -> str:
    """An entry of ψ(z) that is NaN or +∞, of ψ̄(z) NaN or −∞, or of f(z) not finite, in words; empty if none.

    Empty as well if z is not finite.
    """
    if not np.isfinite(z).all():
        return ""
    if problem.f is not None and (fault := not_finite(problem.f.value(z), "f(z)")):
        return fault
    for name, psi, none in (("psi", problem.psi, -np.inf), ("upper", problem.upper, np.inf)):
        if psi is not None:
            value = psi.value(z)
            bad = ~(np.isfinite(value) | (value == none))
            if bad.any():
                return f"{name}(z)[{np.argmax(bad)}] is {value[np.argmax(bad)]}"
    return ""
