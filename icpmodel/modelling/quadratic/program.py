"""A convex quadratic program, and how far an answer is from optimal in the program's own units.

min ½xᵀPx + qᵀx   subject to   Ax = b,  Fx ≤ g
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.rounding import gamma


def handy(M: Any) -> Any:
    """`M` as an array where its zeros cost a product less than a call of sparse code does, else as CSR with sorted
    indices: what SciPy sorts later on is the indices of all that share them, and the entries of one."""
    if not sp.issparse(M):
        M = np.asarray(M, dtype=np.float64)
    zeros = M.shape[0] * M.shape[1] - (M.nnz if sp.issparse(M) else np.count_nonzero(M))
    if work.COSTS.entry * zeros > work.COSTS.call:
        M = sp.csr_array(M, dtype=np.float64)
        if not M.has_canonical_format:
            M = M.copy()
            M.sum_duplicates()
        return M
    return np.ascontiguousarray(M.toarray() if sp.issparse(M) else M, dtype=np.float64)


class Matrices:
    """P, A and F of a program, each an array or CSR, whatever is quicker."""

    def __init__(self, P: Any, A: Any, F: Any) -> None:
        self.parts = P, A, F
        self.P, self.A, self.F = handy(P), handy(A), handy(F)

    def is_of(self, parts: tuple[Any, ...]) -> bool:
        """Whether it was made of matrices equal to these, stored in the same way."""
        return all(map(_same, self.parts, parts))

    @cached_property
    def absolute(self) -> tuple[Any, Any, Any]:
        """|P|, |A| and |F|."""
        return abs(self.P), abs(self.A), abs(self.F)

    @cached_property
    def terms(self) -> int:
        """The most terms that there are in a row of Px + q + Fᵀλ + Aᵀν, Fx − g or Ax − b."""
        of_columns: Any = sum(np.asarray((M != 0).sum(axis=0)) for M in (self.P, self.F, self.A))
        of_rows = [np.asarray((M != 0).sum(axis=1)) for M in (self.F, self.A)]
        return 1 + int(max(one.max(initial=0) for one in (of_columns, *of_rows)))


@dataclass(frozen=True, eq=False)
class Program:
    """min ½xᵀPx + qᵀx subject to Ax = b, Fx ≤ g, P positive semidefinite; g = +inf where a row says nothing."""

    matrices: Matrices
    q: Vector
    b: Vector
    g: Vector

    @classmethod
    def of(cls, P: Any, q: Vector, A: Any, b: Vector, F: Any, g: Vector) -> Program:
        return cls(Matrices(P, A, F), q, b, g)

    def objective(self, x: Vector) -> float:
        return float(0.5 * x @ (self.matrices.P @ x) + self.q @ x)

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def violation(self, x: Vector, equality: Vector, inequality: Vector) -> float:
        """How far x, ν and λ ≥ 0 are from being optimal, whatever the units: the largest of what is wrong in a row, of
        Ax = b, Fx ≤ g, or Px + q + Fᵀλ + Aᵀν = 0, as a share of the sum of its |terms|, of the lesser share that a λ_i
        and its slack have, and of what the objective may be above the least one as a share of what it is made of; inf
        where one is not a number.

        By the last, large entries of P do not hide what is wrong with q. With the gradient g = Px + q + Fᵀλ + Aᵀν and
        all x* = x + Δ that meet the constraints the objective is at most −gᵀΔ + λᵀ(g − Fx) + νᵀ(b − Ax) above that of
        x*; |Δ_i| is taken to be no more than (|P||x|)_i/p_ii, which moves row i by as much as all that is in it, and
        is |x_i| where P has but the diagonal. Not more is said of the gradient than its rounding allows."""
        given, (P, A, F), size = self.matrices, self.matrices.absolute, np.abs(x)
        says = self.g < np.inf
        g = np.where(says, self.g, 0.0)
        of_x = given.P @ x
        gradient = of_x + self.q + given.F.T @ inequality + given.A.T @ equality
        of_P, bound, price = P @ size, np.abs(g), np.abs(equality)
        of_gradient = of_P + np.abs(self.q) + F.T @ inequality + A.T @ price
        of_rows, of_equations = bound + F @ size, np.abs(self.b) + A @ size
        slack, left = np.where(says, g - given.F @ x, 0.0), given.A @ x - self.b
        diagonal = P.diagonal()
        reach = np.where(diagonal > 0, of_P / np.where(diagonal > 0, diagonal, 1.0), size)
        gap = np.abs(gradient) @ reach + inequality @ np.abs(slack) + price @ np.abs(left)
        rounded = gamma(given.terms) * (of_gradient @ reach + inequality @ of_rows + price @ of_equations)
        terms = max(x @ of_x, 0.0) + size @ np.abs(self.q) + np.abs(self.b) @ price + bound @ inequality
        pull: Any = F * (1.0 / np.where(of_gradient > 0, of_gradient, 1.0))
        pull = pull.max(axis=1) if pull.size else np.zeros(g.size)
        shares = (
            _shares(gradient, of_gradient),
            _shares(left, of_equations),
            _shares(np.minimum(slack, 0.0), of_rows),
            np.minimum(_shares(slack, of_rows), inequality * (pull.toarray() if sp.issparse(pull) else pull)),
            _shares(np.maximum(np.array([gap - rounded]), 0.0), np.array([terms])),
        )
        largest = float(np.concatenate(shares).max(initial=0.0))
        return largest if largest < np.inf else np.inf


def _shares(wrong: Vector, size: Vector) -> Vector:
    """|wrong|/size, 0 where nothing is wrong."""
    return np.where(wrong == 0, 0.0, np.abs(wrong) / size)


def _same(one: Any, other: Any) -> bool:
    if one.shape != other.shape or not (sp.issparse(one) and sp.issparse(other)):
        return False
    return all(np.array_equal(getattr(one, part), getattr(other, part)) for part in ("data", "indices", "indptr"))
