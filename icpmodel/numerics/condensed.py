"""Factors of matrices whose diagonal block is eliminated first, as that of Gx ≤ h in optimality conditions."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from . import work
from .arrays import Mask, Vector, row_of
from .factorisation import DenseFactors, array_factors
from .threads import one_blas_thread


def product_cost(kept: int, eliminated: int) -> float:
    """The cost of BD⁻¹Bᵀ for `kept` rows and a diagonal of `eliminated` ones."""
    return work.COSTS.call + (work.COSTS.dense_entry + work.COSTS.dense_flop * kept) * kept * eliminated


class CondensedFactors:
    """Factors of matrices M = [[H, B], [−Bᵀ, D]] with one pattern, by LU of the Schur complement H + BD⁻¹Bᵀ.

    Parameters
    ----------
    A : CSR array of shape (n, n)
        The pattern, its diagonal stored.
    kept : array of bool, shape (n,)
        The rows of H; D is diagonal.
    """

    def __init__(self, A: sp.csr_array, kept: Mask) -> None:
        self._kept = kept
        row = row_of(A)
        self._stored = kept[row]
        self._diagonal = (row == A.indices) & ~kept[row]
        # the columns of H stand before those of B
        self._size = int(np.count_nonzero(kept))
        place = np.argsort(np.argsort(~kept, kind="stable"))
        self._places = place[row[self._stored]], place[A.indices[self._stored]]
        self._rows = np.zeros((self._size, kept.size))

    def factors(self, data: Vector) -> DenseFactors | None:
        """Factorise the matrix with the entries `data`; None where that fails. Earlier factors become invalid.

        The factors solve Mx = f for f of shape (n,), not Mᵀx = f. Raises OutOfTime and OutOfMemory.
        """
        kept = self._kept
        self._rows[self._places] = data[self._stored]
        H, B = np.split(self._rows, [self._size], axis=1)
        D = data[self._diagonal]
        work.charge(product_cost(*B.shape), 24.0 * self._rows.size)
        with one_blas_thread():
            complement = H + (B / D) @ B.T
        factors = array_factors(np.asfortranarray(complement)) if np.isfinite(complement).all() else None
        if factors is None:
            return None

        def solve(f: Vector, transposed: bool) -> tuple[Vector]:
            x = f.copy()
            x[kept] = y = factors.solve(f[kept] - B @ (f[~kept] / D))
            x[~kept] = (f[~kept] + y @ B) / D
            return (x,)

        return DenseFactors(solve, factors.pivots, 2 * B.size)
