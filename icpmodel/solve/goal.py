"""The convergence test of a run, and its limits."""

from __future__ import annotations

import math
from contextlib import AbstractContextManager
from dataclasses import dataclass
from typing import Any

from ..errors import InputError
from ..numerics import work
from ..numerics.arrays import Vector, as_number, described, norm
from ..numerics.rounding import SQRT_EPSILON, rounded_share
from ..problem.data import ProblemData
from ..problem.verdict import certified_residual, satisfies_paper

#: the default relative tolerance
RTOL = 1e-8
#: the sets of methods that a choice may be restricted to, see `select_method`
FAMILIES = ("paper", "modulus", None)


@dataclass(frozen=True, kw_only=True)
class Limits:
    """When a run stops: by tolerance, iterations, time or memory.

    The run has converged at Res_D(z) ≤ `rtol`·`residual_scale` or Res(z) ≤ `atol`. With `accuracy` it has converged
    once the error is certified to be at most that. It ends after `max_iter` iterations or `time_limit` seconds. It may
    allocate `memory_limit` bytes beyond those at the start (None: the machine is the limit). Invalid numbers
    raise InputError.
    """

    rtol: float
    atol: float
    max_iter: int
    time_limit: float | None
    accuracy: float | None = None
    memory_limit: float | None = None

    def __post_init__(self) -> None:
        as_number(self.rtol, "rtol", minimum=0, below=1)  # from 1 on, z = 0 would pass
        as_number(self.atol, "atol", minimum=0)
        as_number(self.max_iter, "max_iter", minimum=0, whole=True)
        if self.time_limit is not None:
            as_number(self.time_limit, "time_limit", minimum=0)
        if self.memory_limit is not None:
            as_number(self.memory_limit, "memory_limit", minimum=0)
        if self.accuracy is not None:
            as_number(self.accuracy, "accuracy", above=0)

    @property
    def is_default(self) -> bool:
        """Whether at least one iteration may be made, and nothing but the residual is limited."""
        return self.max_iter > 0 and self.time_limit is self.memory_limit is self.accuracy is None

    def tolerance(self, scale: Any) -> Any:
        """`rtol`·`scale`, a number or an array of them."""
        return rounded_share(scale, self.rtol)

    def enforced(self, start_time: float | None = None) -> AbstractContextManager[None]:
        """Enforce in a block the limits of memory and of time, from `start_time` or now on: see `work_limit`."""
        from ..numerics import kernels  # noqa: F401  loads numba, before the clock begins

        seconds, memory = (math.inf if limit is None else limit for limit in (self.time_limit, self.memory_limit))
        return work.work_limit(seconds, memory, start_time=start_time)


def check_family(family: Any) -> None:
    """Raise InputError unless `family` is one of `FAMILIES`."""
    if not isinstance(family, str | None) or family not in FAMILIES:
        raise InputError(f"family is {described(family)}; 'paper', 'modulus' or None was expected")


@dataclass
class Goal:
    """The test for convergence: Res_D(z) ≤ `tolerance` or Res(z) ≤ `atol`; exact residuals if `problem` is given.

    If `tolerance` is 0, `rtol_of_z`·min(‖z‖, `start_norm`) takes its place, for problems in which all data are 0 at
    z = 0. The minimum keeps diverging iterates from passing the test. If both are given, the smaller one applies: where
    p is nonlinear, Res_D(0) need not be of the size of z.
    """

    tolerance: float
    problem: ProblemData | None = None
    atol: float = 0.0
    rtol_of_z: float = 0.0
    start_norm: float = math.inf

    def tolerance_at(self, z: Vector) -> float:
        """The largest Res_D(z) with which `z` passes the test."""
        if not self.rtol_of_z:
            return self.tolerance
        by_size = float(rounded_share(min(norm(z), self.start_norm), self.rtol_of_z))
        return min(self.tolerance, by_size) if self.tolerance else by_size

    def judged(self, z: Vector, residual: float) -> float:
        """The residual by which `z` is judged, from the float64 value `residual` of Res_D(z)."""
        return residual if self.problem is None else certified_residual(self.problem, z, residual, self.tolerance_at(z))

    def is_near(self, z: Vector, residual: float) -> bool:
        """Whether `z`, with about this Res_D(z), may meet the test: Res(z) ≥ min(1, d_i) Res_D(z)."""
        if residual <= self.tolerance_at(z):
            return True
        if not self.atol or self.problem is None:
            return False
        return residual <= (1.0 + SQRT_EPSILON) * max(float(self.problem.matrix.row_weights.max()), 1.0) * self.atol

    def reached(self, z: Vector, residual: float) -> bool:
        """Whether `z`, shape (n,), with Res_D(z) = `residual` meets the test; NaN does not."""
        if residual <= self.tolerance_at(z):
            return True
        return self.problem is not None and self.is_near(z, residual) and satisfies_paper(self.problem, z, self.atol)

    def in_words(self, z: Vector) -> str:
        """The test in words, for the message of a run that failed it with `z`."""
        return f"stop at {self.tolerance_at(z):.3g}" + (f", or at Res(z) = {self.atol:.3g}" if self.atol else "")
