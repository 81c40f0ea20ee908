"""Factors where a diagonal block leaves by a product, as rows of Gx ≤ h do from conditions of optimality."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from . import work
from .arrays import Mask, Vector
from .factorisation import DenseFactors, array_factors
from .threads import one_blas_thread


def product_cost(kept: int, eliminated: int) -> float:
    """The cost of BD⁻¹Bᵀ for `kept` rows and a diagonal of `eliminated` ones."""
    return work.COSTS.call + (work.COSTS.dense_entry + work.COSTS.dense_flop * kept) * kept * eliminated


def condensed_factors(M: sp.csr_array, kept: Mask) -> DenseFactors | None:
    """Those of M = [[H, B], [−Bᵀ, D]], H in the rows `kept` and D diagonal, by LU of H + BD⁻¹Bᵀ; None where it fails.

    They solve Mx = f alone, not with Mᵀ, for f of shape (n,). Raises OutOfTime and OutOfMemory.
    """
    rows = M[kept].toarray()
    B = rows[:, ~kept]
    D = M.diagonal()[~kept]
    work.charge(product_cost(*B.shape), 24.0 * rows.size)
    with one_blas_thread():
        complement = rows[:, kept] + (B / D) @ B.T
    factors = array_factors(np.asfortranarray(complement)) if np.isfinite(complement).all() else None
    if factors is None:
        return None

    def solve(f: Vector, transposed: bool) -> tuple[Vector]:
        x = f.copy()
        x[kept] = y = factors.solve(f[kept] - B @ (f[~kept] / D))
        x[~kept] = (f[~kept] + y @ B) / D
        return (x,)

    return DenseFactors(solve, factors.pivots, 2 * B.size)
