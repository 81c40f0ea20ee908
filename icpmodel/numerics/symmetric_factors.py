"""LDLᵀ factors of symmetric matrices with one pattern, by QDLDL."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from . import work
from .arrays import Mask, Vector, row_of
from .fill import Fill, factor_cost, refactor_cost, solve_cost
from .half_solves import half_solve, inner_products
from .threads import LARGEST_RATIO, run_with_deadline


class SymmetricFactors:
    """LDLᵀ factors, by QDLDL, of matrices with the pattern of `A`, symmetric up to the signs of their rows.

    Parameters
    ----------
    A : CSR array of shape (n, n)
        The pattern.
    fill : Fill
        The predicted fill.
    signs : array of shape (n,)
        Signs ±1 of the rows that make the matrices symmetric.

    Notes
    -----
    There are no exchanges of rows. A pivot that is nearly 0 shows in the residual of the solves.
    With supernodes in compiled loops, whole solves took 1/0.95 of the time for 500 ≤ n ≤ 5000, and
    1/1.05 for 5000 ≤ n ≤ 60 000: geometric means over the families of the benchmarks.

    References
    ----------
    Stellato et al., Math. Program. Comput. 12 (2020), section 3.1.
    """

    def __init__(self, A: sp.csr_array, fill: Fill, signs: Vector) -> None:
        row = row_of(A)
        self.fill = fill
        self._signs = signs
        # the rows of the lower triangle are the columns of the upper one
        self._stored = np.flatnonzero(A.indices <= row)
        self._row = row[self._stored]
        self._column = A.indices[self._stored]
        start = np.append(0, np.cumsum(np.bincount(self._row, minlength=A.shape[0])))
        self._upper = sp.csc_array((np.zeros(self._row.size), self._column, start), shape=A.shape)
        self._ldl: Any = None

    @property
    def pivots(self) -> Vector:
        """The diagonal of U in M = LU, in some order."""
        _, pivots, order = self._ldl.factors()
        return np.asarray(self._signs[order] * pivots)

    def factors(self, data: Vector, free: Mask | None = None) -> SymmetricFactors | None:
        """Factorise the matrix with the entries `data`; return this object, or None where that fails.

        With `free`, rows and columns that are not free are 0 except for the diagonal. The previous
        factors are lost. Raises OutOfTime and OutOfMemory.
        """
        import qdldl

        i = self._row
        j = self._column
        entries = self._signs[i] * data[self._stored]
        if free is not None:
            entries[(i != j) & ~(free[i] & free[j])] = 0.0
        if not np.isfinite(entries).all():
            return None
        upper = self._upper
        upper.data = entries
        cost = factor_cost(self.fill) if self._ldl is None else refactor_cost(self.fill)
        work.charge(cost, work.ENTRY_BYTES * (self.fill.entries + data.size))

        def step() -> Any:
            if self._ldl is None:
                return qdldl.Solver(upper, upper=True)
            self._ldl.update(upper, upper=True)
            return self._ldl

        try:
            self._ldl = run_with_deadline(step, LARGEST_RATIO * cost)
        except RuntimeError:  # a pivot is 0
            self._ldl = None
        return self if self._ldl else None

    def congruence(self, B: sp.coo_array) -> NDArray[np.float64]:
        """Bᵀ(σM)⁻¹B with the signs σ, shape (k, k), for `B` of shape (n, k); raises OutOfTime and OutOfMemory."""
        L, pivots, order = self._ldl.factors()
        X = half_solve(L, np.argsort(order), B)
        return inner_products(X, X, pivots)

    def solve(self, f: Vector, trans: str = "N") -> Vector:
        """M⁻¹f, or M⁻ᵀf with `trans` = "T"; both of shape (n,)."""
        work.count(solve_cost(self.fill))
        x = self._ldl.solve(np.asarray(f if trans == "T" else self._signs * f, dtype=np.float64))
        return np.asarray(self._signs * x if trans == "T" else x)
