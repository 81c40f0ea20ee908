"""The problem of a comparison, and the residual by which all its answers are judged."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import IcpError, InputError
from ..icp import ICP
from ..numerics.arrays import as_float64
from ..problem.data import ProblemData
from ..solve.solution import Solution, Status
from ..solvers.formulations import Target
from ..solvers.typical_units import in_typical_units


def uncached_copy(problem: ProblemData) -> ICP:
    """The same problem as a new ICP, which has no cached facts."""
    return ICP(problem.A, problem.q, problem.psi)


def uninterrupted(solution: Solution) -> Solution:
    """Return `solution`; raise KeyboardInterrupt if Ctrl-C ended its run, so that the whole study ends."""
    if solution.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return solution


@dataclass(frozen=True, eq=False)
class Case:
    """The `problem` of a comparison, with the scale of its residuals and its form for foreign solvers."""

    problem: ProblemData

    @cached_property
    def scale(self) -> float:
        """Res_D(0), by which residuals are divided. Raises InputError where it is 0 or not finite."""
        scale = self.problem.residual_at_0()
        if not 0 < scale < np.inf:
            raise InputError(f"Res_D(0) of the problem is {scale:g}; there is nothing to measure")
        return scale

    @cached_property
    def formulation(self) -> tuple[Target, float] | None:
        """The problem in typical units for foreign solvers, and its unit of z; None where ψ is not affine."""
        if self.problem.psi.linear is None:
            return None
        problem, unit = in_typical_units(self.problem)
        return Target(problem), unit

    def relative_residual(self, z: Any) -> float | None:
        """Res_D(z)/Res_D(0); None where it is not finite, or z is no finite vector of shape (n,)."""
        try:
            ratio = self.problem.residual(as_float64(z, "z")) / self.scale
        except (IcpError, TypeError, ValueError):
            return None
        return ratio if np.isfinite(ratio) else None
