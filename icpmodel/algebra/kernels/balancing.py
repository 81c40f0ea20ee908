"""Units for a dense linear complementarity problem: powers of two for its rows and columns, which cost no digit."""

from __future__ import annotations

import math

import numpy as np

from ...numerics.kernels import compiled

#: entries within a factor 2^± this of each other need no balancing; the exponent of 0
_BALANCED_RANGE = 20
_ZERO_EXPONENT = -5000


@compiled
def _row_units(M, columns):
    # r such that the largest entry of each row of 2^(r_i + columns_j) m_ij is in [1/2, 1); 0 for rows of zeros
    rows = np.zeros(M.shape[0], np.int64)
    for i in range(M.shape[0]):
        largest = _ZERO_EXPONENT
        for j in range(M.shape[1]):
            if M[i, j] != 0.0:
                largest = max(largest, math.frexp(M[i, j])[1] + columns[j])
        if largest > _ZERO_EXPONENT:
            rows[i] = -largest
    return rows


@compiled
def scale(M):
    # (S, r, c) with s_ij = 2^(r_i + c_j) m_ij: the largest entry of each row and column is in [1/2, 1) where those of
    # rows or columns differ much; else all are divided by the largest of all. (Entries that are small in their row and
    # in their column are no reason: those of an inverse fade with the distance, and units in which they do not would
    # make q grow as fast.)
    n = M.shape[0]
    r = np.zeros(n, np.int64)
    c = np.zeros(n, np.int64)
    rows = np.zeros(n)
    columns = np.zeros(n)
    for i in range(n):
        for j in range(n):
            size = abs(M[i, j])
            rows[i] = max(rows[i], size)
            columns[j] = max(columns[j], size)
    high = rows.max()
    low = high
    for largest in (rows, columns):
        for size in largest:
            if size > 0.0:
                low = min(low, size)
    exponent = math.frexp(high)[1]
    unit = math.ldexp(1.0, -exponent)
    if exponent - math.frexp(low)[1] <= 2 * _BALANCED_RANGE and 0.0 < unit < np.inf:
        r[:] = -exponent
        return M * unit, r, c
    r = _row_units(M, c)
    c = _row_units(M.T, r)
    S = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            S[i, j] = math.ldexp(M[i, j], r[i] + c[j])
    return S, r, c
