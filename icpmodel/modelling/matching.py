"""Matchings of rows and unknowns: each row of r = Rz + … owns a z_j with r_i = ρz_j − …, ρ > 0, and no j twice."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics.arrays import Mask, row_of

Columns = NDArray[np.intp]


def resemblance_to_r(R: sp.csr_array) -> int:
    """How much Rz + … looks like z − ψ(z), as 2, 1 or 0, for an R without stored zeros.

    2: one positive entry alone in each row, no column twice; 1: a 1 in each row; 0: neither.
    """
    is_alone = R.nnz == R.shape[0] and bool((np.diff(R.indptr) == 1).all() and (R.data > 0).all())
    if is_alone and np.unique(R.indices).size == R.nnz:
        return 2
    return int(np.unique(row_of(R)[R.data == 1.0]).size == R.shape[0])


def own_entries(R: sp.csr_array) -> Columns | None:
    """The column that each row of `R`, CSR (m, n), owns: positive entries, no column twice; None if that is impossible.

    Their total cost is least: 1 for an entry 1, as in most z − ψ(z), else 2 + log(the row's largest / entry).
    """
    n = R.shape[0]
    rows, positive = row_of(R), R.data > 0
    rows, columns, entries = rows[positive], R.indices[positive], R.data[positive]
    largest = np.zeros(n)
    np.maximum.at(largest, rows, entries)
    if not largest.all():
        return None
    cost = np.where(entries == 1.0, 1.0, 2.0 + np.log(largest[rows] / entries))
    return cheapest(rows, columns, cost, n, R.shape[1])


def arranged(A: sp.csr_array, free: Mask) -> tuple[Columns, NDArray[np.float64]]:
    """An order of the rows of `A`, CSR (n, n), and their signs; only the rows `free`, which are equations, may change.

    They keep their order if each row i has an entry a_ii, or an a_ij with a_ji ≠ 0, as blocks Cᵀ and C have. Else they
    are ordered so that the diagonal has no zeros, if such an order exists. The signs make the diagonal positive. Where
    a_ii = 0 the two entries a_ij and a_ji get opposite signs, which adds nothing to A + Aᵀ.
    """
    order, rows = np.arange(A.shape[0]), np.flatnonzero(free)
    if (np.asarray(abs(A).multiply(abs(A).T).sum(axis=1))[rows] == 0).any():
        block = sp.coo_array(A[rows][:, rows])
        block.eliminate_zeros()
        if np.unique(block.row).size == rows.size:
            cost = -np.log2(np.abs(block.data))
            diagonal_columns = cheapest(block.row, block.col, cost, rows.size, rows.size)
            if diagonal_columns is not None:
                order[rows[diagonal_columns]] = rows
                A = A[order]
    diagonal, both = A.diagonal(), np.asarray(A.multiply(A.T).sum(axis=1))
    return order, np.where(free & ((diagonal < 0) | ((diagonal == 0) & (both > 0))), -1.0, 1.0)


def cheapest(rows: Columns, columns: Columns, cost: NDArray[np.float64], m: int, n: int) -> Columns | None:
    """A column of n for each of m rows, no column twice, with the least total cost; None if there is no such choice."""
    from scipy.sparse.csgraph import min_weight_full_bipartite_matching

    order = np.lexsort((cost, rows))
    nearest: Columns = columns[order[np.searchsorted(rows[order], np.arange(m))]].astype(np.intp)
    if np.unique(nearest).size == m:
        return nearest
    try:
        graph = sp.csr_array((cost - cost.min() + 1.0, (rows, columns)), shape=(m, n))
        return np.asarray(min_weight_full_bipartite_matching(graph)[1], dtype=np.intp)
    except ValueError:  # there is no full matching
        return None


def left_over(rows: Columns, columns: Columns, shape: tuple[int, int]) -> tuple[Columns, Columns]:
    """The rows and the columns that a maximum matching of the pairs (row, column) leaves over."""
    from scipy.sparse.csgraph import maximum_bipartite_matching

    graph = sp.csr_array((np.ones(rows.size), (rows, columns)), shape=shape)
    of_row: Any = maximum_bipartite_matching(graph, perm_type="column")
    return np.flatnonzero(of_row < 0), np.setdiff1d(np.arange(shape[1]), of_row)
