"""The operators X⁻¹, X = M₁ + φ + Ω, and the step of the modulus family that each makes possible.

By |x − y| = x + y − 2 min(x, y) every method of the family is the one step

    z⁺ = z − 2 X⁻¹ F_Ω(z),        F_Ω(z) = min(Az + q, Ω(z − ψ(z))).

So a method is a choice of X and Ω. With an upper obstacle, F_Ω is mid(Ω(z − ψ̄(z)), Az + q, Ω(z −
ψ(z))), the median of the three. `Operator.step` is that line; the operators of relaxation methods
fuse it into one compiled pass over A.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import SingularOperator
from ..numerics import work
from ..numerics.arrays import Vector
from ..numerics.equilibration import equilibrated
from ..numerics.factorisation import array_factors, factorise
from ..numerics.fill import least_factor_cost
from ..numerics.rounding import UNIT_ROUNDOFF
from ..numerics.sparse_structure import diagonal_positions
from ..problem.data import ProblemData
from ..problem.matrix import MAX_DENSE_ROWS
from .steps import Step, compiled_step


class Operator(ABC):
    """X⁻¹ of a splitting."""

    @abstractmethod
    def solve(self, f: Vector) -> Vector:
        """X⁻¹f, shape (n,)."""

    def step(self, problem: ProblemData, omega: Vector) -> Step:
        """The modulus step z ↦ (z − 2 X⁻¹ F_Ω(z), Res_D(z)) on `problem` with Ω = diag(`omega`)."""

        def step(z: Vector) -> tuple[Vector, float]:
            p = problem.matrix.product(z) + problem.offset(z)
            r = z - problem.psi.value(z)
            r_upper = problem.r_upper(z)
            F = np.minimum(p, omega * r)
            if r_upper is not None:
                F = np.maximum(omega * r_upper, F)
            return z - 2.0 * self.solve(F), problem.residual_of(p, r, r_upper, problem.weights_at(z, p))

        return step


@dataclass(frozen=True)
class AOROperator(Operator):
    """X = diag(1/`inverse`) + `tau` times the strict lower triangle of `A`; diagonal where `tau` = 0."""

    inverse: Vector
    A: sp.csr_array
    tau: float

    @cached_property
    def _diag(self) -> Any:
        return diagonal_positions(self.A)

    def solve(self, f: Vector) -> Vector:
        from .kernels.sweeps import substitute

        A = self.A
        out = np.empty(f.size)
        work.count(work.product_cost(f.size, A.nnz))
        substitute(A.indptr, self._diag, A.indices, A.data, self.tau, self.inverse, f, out)
        return out

    def step(self, problem: ProblemData, omega: Vector) -> Step:
        return compiled_step(problem, (omega, self.inverse, self.tau))


class FactorisedOperator(Operator):
    """X⁻¹ by an LU factorisation of the CSR matrix `X`, made once, dense for few rows.

    Raises SingularOperator where X is singular to working precision.
    """

    def __init__(self, X: sp.csr_array) -> None:
        n = X.shape[0]
        work.check_budget(2.0 * least_factor_cost(n, X.nnz))
        few = n <= MAX_DENSE_ROWS
        # equilibrated, so that different units are not mistaken for singularity
        scaled, self._rows, self._columns = equilibrated(X.toarray() if few else sp.csr_array(X))
        factors: Any = array_factors(np.array(scaled, order="F")) if few else factorise(scaled)
        self._lu = factors
        if factors is not None:
            pivots = np.abs(factors.pivots)
            if pivots.min() > 16 * UNIT_ROUNDOFF * pivots.max():
                return
        row = _dependent_row(sp.csr_array(scaled))
        raise SingularOperator(
            f"X = M1 + phi + Omega is singular to working precision: row {row} is a linear combination of the others; "
            "change phi or phi2",
            row,
        )

    def solve(self, f: Vector) -> Vector:
        solution: Vector = np.ldexp(self._lu.solve(np.ldexp(f, self._rows)), self._columns)
        return solution


def inverse_diagonal(diagonal: Vector, shift: Vector) -> Vector:
    """1/(`diagonal` + `shift`), both of shape (n,). Raises SingularOperator where the sum cancels."""
    total = diagonal + shift
    if diagonal.min() > 0.0 and shift.min() >= 0.0:  # nothing cancels
        return np.divide(1.0, total, out=total)
    bad = np.abs(total) <= 4 * UNIT_ROUNDOFF * (np.abs(diagonal) + np.abs(shift))
    if bad.any():
        row = int(np.argmax(bad))
        raise SingularOperator(
            f"X = M1 + phi + Omega is singular: its diagonal entry in row {row} is {total[row]:g} "
            f"({diagonal[row]:g} from M1, {shift[row]:g} from phi + Omega); change phi or phi2",
            row,
        )
    inverse: Vector = 1.0 / total
    return inverse


def _dependent_row(X: sp.csr_array) -> int:
    """The row of the largest entry in a left null vector of X, by two steps of inverse iteration on a shifted X."""
    lu = factorise(sp.csr_array(X + 1e-10 * sp.eye_array(X.shape[0])))
    if lu is None:
        return 0
    # a start without symmetries, which could be orthogonal to the null vector
    y = lu.solve(lu.solve(np.random.default_rng(0).random(X.shape[0]), trans="T"), trans="T")
    return int(np.argmax(np.abs(y)))
