"""Equations eliminated: rows without any obstacle leave by one factorisation; what iterates is the Schur complement.

Where F are the rows without an obstacle and C the others, p_F = 0 gives z_F = −A_FF⁻¹(A_FC z_C + q_F). What is left is
the problem of the matrix S = A_CC − A_CF A_FF⁻¹ A_FC in the unknowns z_C.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 1.5, for mixed problems.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError
from ..numerics import work
from ..numerics.arrays import Vector, as_csr
from ..numerics.factorisation import Factors, factorise
from ..problem.data import ProblemData
from ..problem.matrix import Matrix
from .factor_costs import factor_costs

#: dense arrays of the columns of A_FC that are held at once
_DENSE_ARRAYS = 3


class SchurComplement:
    """The Schur complement of the rows of A without an obstacle, and the factors that eliminate these.

    Parameters
    ----------
    matrix : Matrix
        A.
    rows : array of int
        The rows C that have an obstacle, ascending.
    equations : array of int
        The others, F.
    factors : Factors
        Those of A_FF.

    Raises
    ------
    InputError
        Where the complement overflows.
    """

    def __init__(self, matrix: Matrix, rows: NDArray[np.intp], equations: NDArray[np.intp], factors: Factors) -> None:
        self.rows = rows
        self._equations = equations
        self._factors = factors
        A = matrix.sparse[rows]
        self._couplings = A[:, equations]
        S = A[:, rows].toarray()
        S -= self._couplings @ factors.solve(matrix.sparse[equations][:, rows].toarray())
        complement = as_csr(S, "S", keep_diagonal=True)
        self._problem = ProblemData.of_checked(complement, np.zeros(rows.size), 0.0, matrix.row_weights[rows])

    def __repr__(self) -> str:
        n = self.rows.size + self._equations.size
        return f"n = {n} -> {self.rows.size} rows with an obstacle: the others are equations, and are eliminated"

    def reduced(self, problem: ProblemData) -> ProblemData:
        """The problem in the unknowns of `rows`; problems that share A share the facts of its matrix."""
        q = problem.q[self.rows] - self._couplings @ self._factors.solve(problem.q[self._equations])
        return self._problem.with_q(q).with_psi(problem.psi.restricted(self.rows, np.zeros(problem.n)))

    def extended(self, problem: ProblemData, z: Vector) -> Vector:
        """The point with p_F = 0 that has z in the `rows`; a step of refinement takes the rounding back."""
        x = z.copy()
        for _ in range(2):
            x[self._equations] -= self._factors.solve(problem.p(x)[self._equations])
        return x


def elimination(problem: ProblemData, max_cost: Callable[[], float]) -> SchurComplement | None:
    """The elimination of the equations of `problem`; None if they are few or a factorisation does not pay.

    Parameters
    ----------
    problem : ProblemData
        The problem, with constant obstacles.
    max_cost : callable
        Returns what the elimination may cost, in nanoseconds.

    Raises
    ------
    OutOfTime, OutOfMemory
        Where the factorisation takes more than is left.

    Notes
    -----
    S is to have no more entries than A. Its columns cost a solve each, which serves all problems that share A.
    """
    matrix = problem.matrix
    rows = problem.facts.bounded_rows
    if not 0 < rows.size < problem.n or rows.size**2 > matrix.nnz:
        return None
    costs = factor_costs(matrix)
    limit = min(max_cost() - work.COSTS.newton, costs.dense)
    if costs.analysis.costs_more(limit) or not costs.fill.is_exact or costs.unsymmetric > limit:
        return None
    key = rows.tobytes()
    known = _CACHE.get(matrix)
    if known is None or known[0] != key:
        _CACHE.clear()
        known = _CACHE[matrix] = key, _schur_complement(matrix, rows)
    return known[1]


def _schur_complement(matrix: Matrix, rows: NDArray[np.intp]) -> SchurComplement | None:
    """The complement in the `rows`; None where A_FF is singular."""
    equations = np.setdiff1d(np.arange(matrix.n), rows)
    work.check_budget(memory=_DENSE_ARRAYS * 8.0 * rows.size * equations.size)
    A = sp.csr_array(matrix.sparse[equations][:, equations])
    factors = factorise(A, triangles=True)  # a solve with a wide band costs many times as much
    with suppress(InputError):
        return None if factors is None else SchurComplement(matrix, rows, equations, factors)
    return None


#: the last one; factors may be large
_CACHE: WeakKeyDictionary[Matrix, tuple[bytes, SchurComplement | None]] = WeakKeyDictionary()
