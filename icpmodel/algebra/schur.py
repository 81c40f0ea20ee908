"""Equations eliminated: rows without any obstacle leave by one factorisation; what iterates is the Schur complement.

Where F are the rows without an obstacle and C the others, p_F = 0 gives z_F = −A_FF⁻¹(A_FC z_C + q_F). What is left is
the problem of the matrix S = A_CC − A_CF A_FF⁻¹ A_FC in the unknowns z_C.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 1.5, for mixed problems. Duff and Reid,
ACM TOMS 9 (1983), for the complement from a factorisation that ends early.
"""

from __future__ import annotations

from collections.abc import Callable
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics import work
from ..numerics.arrays import Vector, as_csr, row_of
from ..numerics.factorisation import Factors, factors_and_schur
from ..problem.data import ProblemData
from ..problem.matrix import Matrix
from .factor_costs import factor_costs


class SchurComplement:
    """The factors of the rows of A without an obstacle, and the Schur complement of the others.

    Parameters
    ----------
    matrix : Matrix
        A.
    rows : array of int
        The rows that have an obstacle, ascending.
    factors : Factors
        Factors of A + T, where T is diagonal, and 0 in the other rows.
    shifted : CSR array
        The Schur complement of A + T in the `rows`, S + T.
    shift : array
        The diagonal of T in the `rows`.

    Notes
    -----
    T lets S be singular, as that of a body is which nothing but contact holds.
    """

    def __init__(
        self, matrix: Matrix, rows: NDArray[np.intp], factors: Factors, shifted: sp.csr_array, shift: Vector
    ) -> None:
        self.n = matrix.n
        self.rows = rows
        self._factors = factors
        self._shifted = shifted
        S = as_csr(shifted - sp.diags_array(shift), "S", keep_diagonal=True)
        self._schur_problem = ProblemData.of_checked(S, np.zeros(rows.size), 0.0, matrix.row_weights[rows])

    def __repr__(self) -> str:
        return f"n = {self.n} -> {self.rows.size} rows with an obstacle: the others are equations, and are eliminated"

    def _equations(self, f: Vector) -> tuple[Vector, Vector]:
        """x with ((A + T)x)_F = f_F and ((A + T)x)_C = 0, and A_CF A_FF⁻¹ f_F."""
        f = f.copy()
        f[self.rows] = 0.0
        x = self._factors.solve(f)
        return x, -(self._shifted @ x[self.rows])

    def reduced(self, problem: ProblemData) -> ProblemData:
        """The problem in the unknowns of `rows`; problems that share A share the facts of its matrix."""
        q = problem.q[self.rows] - self._equations(problem.q)[1]
        return self._schur_problem.with_q(q).with_psi(problem.psi.restricted(self.rows, np.zeros(self.n)))

    def extended(self, problem: ProblemData, z: Vector) -> Vector:
        """The point with p_F = 0 that has z in the `rows`; a step of refinement takes the rounding back."""
        x = z.copy()
        for _ in range(2):
            change, coupling = self._equations(-problem.p(x))
            f = np.zeros(self.n)
            f[self.rows] = coupling
            change += self._factors.solve(f)
            change[self.rows] = 0.0
            x += change
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
    S is to have no more entries than A. Besides the factors it costs about as much as the calls of a Newton step.
    """
    matrix = problem.matrix
    rows = problem.facts.bounded_rows
    if not 0 < rows.size < problem.n or rows.size**2 > matrix.nnz:
        return None
    costs = factor_costs(matrix)
    max_factor_cost = min(max_cost() - work.COSTS.newton, costs.dense)
    if costs.analysis.costs_more(max_factor_cost) or not costs.fill.is_exact or costs.unsymmetric > max_factor_cost:
        return None
    key = rows.tobytes()
    known = _CACHE.get(matrix)
    if known is None or known[0] != key:
        _CACHE.clear()
        known = _CACHE[matrix] = key, _schur_complement(matrix, rows)
    return known[1]


def _schur_complement(matrix: Matrix, rows: NDArray[np.intp]) -> SchurComplement | None:
    """The complement in the `rows`; None where the factorisation fails."""
    shift = 1.0 / matrix.row_weights[rows]
    A = _link_rows(matrix.sparse, rows, shift)
    factors = factors_and_schur(A, rows)
    return None if factors is None else SchurComplement(matrix, rows, *factors, shift)


def _link_rows(A: sp.csr_array, rows: NDArray[np.intp], shift: Vector) -> sp.csr_array:
    """A + T, where each of the `rows` stores an entry, possibly 0, in the columns of its two neighbours."""
    i = np.concatenate([row_of(A), rows, rows[1:], rows[:-1]])
    j = np.concatenate([A.indices, rows, rows[:-1], rows[1:]])
    data = np.concatenate([A.data, shift, np.zeros(2 * rows.size - 2)])
    return sp.csr_array(sp.coo_array((data, (i, j)), shape=A.shape))


#: the last one; factors may be large
_CACHE: WeakKeyDictionary[Matrix, tuple[bytes, SchurComplement | None]] = WeakKeyDictionary()
