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


def handy(M: Any) -> Any:
    """`M` as an array where its zeros cost a product less than a call of sparse code does, else as CSR."""
    if not sp.issparse(M):
        M = np.asarray(M, dtype=np.float64)
    zeros = M.shape[0] * M.shape[1] - (M.nnz if sp.issparse(M) else np.count_nonzero(M))
    if work.COSTS.entry * zeros > work.COSTS.call:
        return sp.csr_array(M, dtype=np.float64)
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
        Ax = b, Fx ≤ g, or Px + q + Fᵀλ + Aᵀν = 0, as a share of the sum of its |terms|, of what λᵀ(g − Fx) is of those
        of the objectives, and of the lesser share that a λ_i and its slack have; inf where one is not a number."""
        given, (P, A, F), size = self.matrices, self.matrices.absolute, np.abs(x)
        says = self.g < np.inf
        g = np.where(says, self.g, 0.0)
        gradient = given.P @ x + self.q + given.F.T @ inequality + given.A.T @ equality
        curved, bound = P @ size + np.abs(self.q), np.abs(g)
        of_gradient = curved + F.T @ inequality + A.T @ np.abs(equality)
        of_rows = bound + F @ size
        slack = np.where(says, g - given.F @ x, 0.0)
        terms = size @ curved + np.abs(self.b) @ np.abs(equality) + bound @ inequality
        pull: Any = F * (1.0 / np.where(of_gradient > 0, of_gradient, 1.0))
        pull = pull.max(axis=1) if pull.size else np.zeros(g.size)
        shares = (
            _shares(gradient, of_gradient),
            _shares(given.A @ x - self.b, np.abs(self.b) + A @ size),
            _shares(np.minimum(slack, 0.0), of_rows),
            np.minimum(_shares(slack, of_rows), inequality * (pull.toarray() if sp.issparse(pull) else pull)),
            _shares(np.array([inequality @ slack]), np.array([terms])),
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
