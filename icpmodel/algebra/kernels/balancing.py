"""Units for a dense linear complementarity problem: powers of two for its rows and columns, which cost no digit."""

from __future__ import annotations

import math

import numpy as np

from ...numerics.kernels import compiled

#: entries within 2^±so many of each other need no balancing; passes of balancing; the exponent of 0
_TAME = 20
_PASSES = 60
_NONE = -5000


@compiled
def _to_means(size, c, r):
    # r such that the means of size_ij + r_i + c_j over the rows are near 0; returns how far it moved
    moved = 0
    for i in range(r.size):
        total = 0
        count = 0
        for j in range(c.size):
            if size[i, j] != _NONE:
                total += size[i, j] + c[j]
                count += 1
        to = -round(total / count) if count else 0
        moved = max(moved, abs(to - r[i]))
        r[i] = to
    return moved


@compiled
def _balance(M, r, c):
    # units of rows and columns whose geometric means are near 1
    n = M.shape[0]
    size = np.full((n, n), _NONE)
    for i in range(n):
        for j in range(n):
            if M[i, j] != 0.0:
                size[i, j] = math.frexp(M[i, j])[1]
    for _ in range(_PASSES):
        if max(_to_means(size, c, r), _to_means(size.T, r, c)) <= 1:
            break


@compiled
def scale(M):
    # (S, r, c) with s_ij = 2^(r_i + c_j) m_ij near 1: geometric means of rows and columns in turn, where
    # the largest entries of rows or columns differ much; else all are divided by the largest of all. (Entries that are
    # small in their row and in their column are no reason: those of an inverse fade with the distance, and units in
    # which they do not would make q grow as fast.)
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
    if exponent - math.frexp(low)[1] <= 2 * _TAME and 0.0 < unit < np.inf:
        r[:] = -exponent
        return M * unit, r, c
    _balance(M, r, c)
    S = np.empty((n, n))
    for i in range(n):
        for j in range(n):
            S[i, j] = math.ldexp(M[i, j], r[i] + c[j])
    return S, r, c
