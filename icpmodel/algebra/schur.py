"""Elimination of the rows without an obstacle by one factorisation, which leaves a problem of the Schur complement.

Let F be the rows without an obstacle, C the others. Then p_F = 0 gives z_F = −A_FF⁻¹(A_FC z_C + q_F). This leaves a
problem with the matrix S = A_CC − A_CF A_FF⁻¹ A_FC in the unknowns z_C.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 1.5, for mixed problems.
"""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics import work
from ..numerics.arrays import Vector, as_csr
from ..numerics.factorisation import Factors, factorise
from ..numerics.fill import factor_cost, part_fill
from ..numerics.symmetric_factors import SymmetricFactors
from ..problem.data import ProblemData
from ..problem.matrix import Matrix
from .factor_costs import factor_costs


class SchurComplement:
    """The Schur complement of the rows of A without an obstacle, and the factors that eliminate these.

    Parameters
    ----------
    matrix : Matrix
        A.
    rows : array of int
        The rows C that have an obstacle, ascending.
    S : array of shape (m, m)
        The complement, m the number of `rows`.
    factors : Factors or SymmetricFactors
        The factors of A_FF, where F are the other rows.
    """

    def __init__(
        self, matrix: Matrix, rows: NDArray[np.intp], S: NDArray[np.float64], factors: Factors | SymmetricFactors
    ) -> None:
        self.rows = rows
        self._equations = _others(matrix, rows)
        self._couplings = matrix.sparse[rows][:, self._equations]
        self._factors = factors
        complement = as_csr(S, "S", keep_diagonal=True)
        self._problem = ProblemData.of_checked(complement, np.zeros(rows.size), 0.0, matrix.row_weights[rows])

    def __repr__(self) -> str:
        n = self.rows.size + self._equations.size
        return f"n = {n} -> {self.rows.size} rows with an obstacle: the others are equations, and are eliminated"

    def reduced(self, problem: ProblemData) -> ProblemData:
        """The problem in the unknowns of `rows`; all calls return problems that share the matrix S and its facts."""
        q = problem.q[self.rows] - self._couplings @ self._factors.solve(problem.q[self._equations])
        return self._problem.with_q(q).with_psi(problem.psi.restricted(self.rows, np.zeros(problem.n)))

    def extended(self, problem: ProblemData, z: Vector) -> Vector:
        """A copy of `z` with the other rows set so that p_F = 0, by one solve and one step of refinement."""
        x = z.copy()
        for _ in range(2):
            x[self._equations] -= self._factors.solve(problem.p(x)[self._equations])
        return x


def elimination_cost(problem: ProblemData, limit: float) -> float:
    """The predicted cost of `elimination` in nanoseconds; inf where it is more than `limit`, or does not apply.

    ψ must be constant, and S must have no more entries than A. The half-solves are assumed to cost as much as the
    factorisation, and the rest as much as the calls of a Newton step; the products of rows are counted. Raises
    OutOfTime and OutOfMemory where the symbolic analysis needs more than is left.
    """
    if not problem.psi.is_constant:
        return np.inf
    rows = problem.facts.bounded_rows
    if not 0 < rows.size < problem.n or rows.size**2 > problem.nnz:
        return np.inf
    costs = factor_costs(problem.matrix)
    if costs.analysis.costs_more(min(0.5 * limit, costs.dense)) or not costs.fill.is_exact:
        return np.inf
    # a band factorisation may cost less, but QDLDL is used
    products = work.COSTS.dense_flop * problem.n * rows.size**2
    cost = 2.0 * factor_cost(costs.analysis.complete) + products + work.COSTS.newton
    return cost if cost <= limit else np.inf


def elimination(problem: ProblemData, max_cost: Callable[[], float] | None) -> SchurComplement | None:
    """The elimination of the equations of `problem`, new or the last one; None where a new one does not pay, or fails.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    max_cost : callable or None
        Returns the largest cost of a new one, in nanoseconds. None stands for four times what `record_run` recorded
        for the last run.

    Raises
    ------
    OutOfTime, OutOfMemory
        Where the factorisation needs more than is left.
    """
    if not problem.psi.is_constant:
        return None
    matrix = problem.matrix
    rows = problem.facts.bounded_rows
    key = rows.tobytes()
    known = _CACHE.get(matrix)
    if known is None or known[0] != key:
        if elimination_cost(problem, max_cost() if max_cost else _PROBLEMS * _LAST_COST.get(matrix, 0.0)) == np.inf:
            return None
        _CACHE.clear()
        known = _CACHE[matrix] = key, _schur_complement(matrix, rows)
    return known[1]


def record_run(problem: ProblemData, nanoseconds: float) -> None:
    """Record the cost of a run on `problem` without elimination, which decides on one in the next with the same A."""
    _LAST_COST[problem.matrix] = nanoseconds


def _schur_complement(matrix: Matrix, rows: NDArray[np.intp]) -> SchurComplement | None:
    """The complement in the `rows`; None where A_FF is singular, or the complement overflows."""
    equations = _others(matrix, rows)
    costs = factor_costs(matrix)
    signs = costs.analysis.signs
    A = sp.csr_array(matrix.sparse[equations][:, equations])
    B = sp.coo_array(matrix.sparse[equations][:, rows])
    S = matrix.sparse[rows][:, rows].toarray()
    factors: Factors | SymmetricFactors | None = None
    if signs is not None:
        fill = part_fill(costs.analysis.complete, equations.size)
        factors = SymmetricFactors(A, fill, signs[equations]).factors(A.data)
    if isinstance(factors, SymmetricFactors) and signs is not None:
        B.data *= signs[equations][B.row]
        S -= signs[rows, None] * factors.congruence(B)
    elif factors := factorise(A, triangles=True):
        S -= factors.product(matrix.sparse[rows][:, equations], B)
    return SchurComplement(matrix, rows, S, factors) if factors and np.isfinite(S).all() else None


def _others(matrix: Matrix, rows: NDArray[np.intp]) -> NDArray[np.intp]:
    """The rows that are not among the `rows`, ascending."""
    return np.setdiff1d(np.arange(matrix.n), rows)


#: the last elimination only, as factors may be large
_CACHE: WeakKeyDictionary[Matrix, tuple[bytes, SchurComplement | None]] = WeakKeyDictionary()
#: a new elimination must cost no more than this number of runs without it
_PROBLEMS = 4.0
#: the cost, in nanoseconds, of the last run without elimination on a problem with this A
_LAST_COST: WeakKeyDictionary[Matrix, float] = WeakKeyDictionary()
