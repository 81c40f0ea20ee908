"""Products BM⁻¹C with sparse B and C, by one triangular solve for each row of B and each column of C."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from . import work
from .arrays import Vector, read_only
from .threads import LARGEST_RATIO, one_blas_thread, run_with_deadline

#: the rows of a matrix that may be nonzero: their indices, ascending, and their entries
HalfSolved = tuple[NDArray[np.intp], NDArray[np.float64]]


def half_solve(L: Any, rows: NDArray[np.integer], B: sp.coo_array) -> HalfSolved:
    """The nonzero rows of L⁻¹PB for sparse `B` (n × k); row i of B is row `rows`[i] of PB.

    `L` is unit lower triangular, stored by columns without its diagonal. Raises OutOfTime and OutOfMemory.
    """
    from .kernels.forward import forward_solve, reached_rows  # loads numba

    places = rows[B.row]
    reached = reached_rows(*read_only((L.indptr, L.indices, places)))
    width = B.shape[1]
    cost = work.COSTS.full_entry * width * float(np.diff(L.indptr)[reached].sum())
    work.charge(cost, 8.0 * reached.size * width)
    arrays = read_only((L.indptr, L.indices, L.data, reached, places, B.col, B.data))
    return reached, run_with_deadline(lambda: forward_solve(*arrays, width), LARGEST_RATIO * cost)


def inner_products(left: HalfSolved, right: HalfSolved, pivots: Vector) -> NDArray[np.float64]:
    """XᵀD⁻¹Y for the matrices X, Y of `left` and `right`, and D = diag(`pivots`); raises as `half_solve` does."""
    rows, X = left
    Y = right[1]
    if right is not left:
        work.check_budget(memory=8.0 * (X.size + Y.size))  # of the copies
        rows, i, j = np.intersect1d(rows, right[0], assume_unique=True, return_indices=True)
        X = X[i]
        Y = Y[j]
    cost = work.COSTS.dense_flop * rows.size * X.shape[1] * Y.shape[1]
    work.charge(cost, 8.0 * Y.size)

    def product() -> Any:
        with one_blas_thread():
            return X.T @ (Y / pivots[rows, None])

    return np.asarray(run_with_deadline(product, cost))
