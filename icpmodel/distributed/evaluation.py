"""p, the distances from the obstacles, and residuals, active set and rounding at one point of a problem on ranks."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np

from ..algebra.equations import Pattern
from ..numerics.arrays import Vector
from ..numerics.rounding import SMALLEST, gamma
from ..problem.two_sided import ObstaclePair, mid
from .ranks import norm


class Evaluation:
    """`p`, `r` = z − ψ and `r_upper` = z − ψ̄ in the own rows, at the `Vec` z. Each member is collective at first."""

    def __init__(self, problem: Any, z: Any) -> None:
        self.problem = problem
        self.z = z
        self.p, self.r, self.r_upper = problem.sides(z)

    @cached_property
    def residual(self) -> float:
        """Res_D(z)."""
        with np.errstate(all="ignore"):
            return norm(self.problem.comm, mid(self.problem.matrix.row_weights * self.p, self.r, self.r_upper))

    @cached_property
    def paper_residual(self) -> float:
        """Res(z)."""
        return norm(self.problem.comm, mid(self.p, self.r, self.r_upper))

    @cached_property
    def pattern(self) -> Pattern:
        """The active set."""
        with np.errstate(all="ignore"):
            # in these units p and r change alike with z_i
            a = self.p / self.problem.matrix.diagonal * self.problem.psi.own_slope
            return Pattern.of(self.r, self.r_upper, a)

    @cached_property
    def rounding(self) -> tuple[Vector, Vector]:
        """Bounds on the rounding errors of p and r in the own rows, as `ProblemData.rounding`."""
        problem = self.problem
        size = np.abs(self.z.array_r)
        k = problem.matrix.terms + 2
        rounding_p = gamma(k) * (problem.matrix.absolute(size) + np.abs(problem.q)) + k * SMALLEST
        rounding_r = np.zeros(size.size)
        for one in problem.maps:
            value = np.abs(one.value(self.z))
            lost = gamma(one.terms) * (size + one.change(size) + value) + one.terms * SMALLEST
            rounding_r = np.maximum(rounding_r, np.where(np.isinf(value), 0.0, lost))
        return rounding_p, rounding_r

    @cached_property
    def rounding_of_residuals(self) -> tuple[float, float]:
        """Bounds on the rounding errors of both residuals."""
        rounding_p, rounding_r = self.rounding
        weighted = self.problem.matrix.row_weights * rounding_p, rounding_p
        residual, paper_residual = (norm(self.problem.comm, np.maximum(one, rounding_r)) for one in weighted)
        return residual, paper_residual

    def after_sweeps(self, count: int) -> Evaluation:
        """The evaluation after `count` sweeps of projected Gauss–Seidel in the rows of each rank.

        Ranks exchange their values between two sweeps; the obstacles keep their values at this point. Collective.
        """
        from ..algebra.kernels.sweeps import sweep_rows  # loads numba

        problem = self.problem
        matrix = problem.matrix
        A = matrix.block
        rows = (A.indptr, A.indices, A.data, matrix.block_diagonal, matrix.row_weights)
        at = self.z.copy()
        z = self.z.array_r.copy()
        psi: Any = z - self.r
        if self.r_upper is not None:
            psi = ObstaclePair(psi, z - self.r_upper)
        out = np.empty(z.size)
        for k in range(count):
            q = problem.q
            if problem.comm.size > 1:  # add the terms with unknowns of other ranks
                q = q + (matrix.product(at).array_r - A @ z)
            if z.size:
                sweep_rows(*rows, q, psi, (1.0,), k % 2 == 0, z, out)
                z, out = out, z
            at.setArray(z)
        return Evaluation(problem, at)
