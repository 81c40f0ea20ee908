"""The two halves of a V-cycle on one level, on the `free` rows; the others keep the correction 0.

Gauss–Seidel goes forward before the coarser level and backward after it, so that the cycle of a symmetric matrix is
symmetric. `diag[i]` is the position of the diagonal entry of row i; P's rows are those of the finer level. `add_both`
is for Krylov methods around the cycle, `largest_of` for the levels on ranks.
"""

from __future__ import annotations

import numpy as np

from . import compiled, one, row_sum, uint


@compiled
def descend(indptr, indices, data, diag, inverse, free, f, p_indptr, p_indices, p_data, x, coarse):
    # one forward sweep from x = 0, which needs the lower triangle alone
    for i in range(uint(x.size)):
        x[i] = -row_sum(-f[i], indptr[i], diag[i], indices, data, x) * inverse[i] if free[i] else 0.0
    # coarse + P'(f - Ax): after the sweep the residual of a row is minus the product of its upper triangle with x
    for i in range(uint(x.size)):
        if free[i]:
            left = -row_sum(0.0, diag[i] + uint(1), indptr[i + uint(1)], indices, data, x)
            k = uint(p_indptr[i])
            stop = uint(p_indptr[i + uint(1)])
            while k < stop:
                coarse[uint(p_indices[k])] += p_data[k] * left
                k += one()


@compiled
def ascend(indptr, indices, data, inverse, free, f, p_indptr, p_indices, p_data, x, coarse):
    # x + P coarse
    for i in range(uint(x.size)):
        if free[i]:
            x[i] = row_sum(x[i], p_indptr[i], p_indptr[i + uint(1)], p_indices, p_data, coarse)
    # one backward sweep
    n = x.size
    for step in range(n):
        row = uint(n - 1 - step)
        if free[row]:
            x[row] -= row_sum(-f[row], indptr[row], indptr[row + uint(1)], indices, data, x) * inverse[row]


@compiled
def add_both(x, y, share, v, w, part):
    # x + share y and v + part w, in place in one pass: what a step of a Krylov method does with a pair of vectors
    for i in range(uint(x.size)):
        x[i] += share * y[i]
        v[i] += part * w[i]


@compiled
def largest_of(indptr, groups, data, count):
    # position and row of the first largest |entry| of each of the `count` groups; position -1 where a group is empty
    places = np.full(count, -1)
    rows = np.zeros(count, np.int64)
    for i in range(indptr.size - 1):
        for k in range(indptr[i], indptr[i + 1]):
            j = groups[k]
            if places[j] < 0 or abs(data[k]) > abs(data[places[j]]):
                places[j] = k
                rows[j] = i
    return places, rows
