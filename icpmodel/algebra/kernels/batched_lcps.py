"""Batches of LCPs by Lemke's pivots: of one matrix, or each with a matrix of its own."""

from __future__ import annotations

import numpy as np

from ...numerics.kernels import compiled
from .balancing import scale
from .pivoting import SINGULAR, START, continue_pivots, first_tableau, right


@compiled
def split(M, q, free):
    # the LCP in which each unknown of a `free` row is the difference of two that are >= 0. The second ones are the last
    # unknowns; their rows are the free rows with the other sign
    n = q.size
    size = n
    rows = np.empty(2 * n, np.int64)
    for i in range(n):
        rows[i] = i
        if free[i]:
            rows[size] = i
            size += 1
    whole = np.empty((size, size))
    f = np.empty(size)
    for i in range(size):
        sign = 1.0 if i < n else -1.0
        f[i] = sign * q[rows[i]]
        for j in range(size):
            whole[i, j] = M[rows[i], rows[j]] * (sign if j < n else -sign)
    return whole, f


@compiled
def _by_differences(M, q, free, limit, y):
    # y where the rows that are `free` cannot be eliminated
    whole, f = split(M, q, free)
    S, r, c = scale(whole)
    tableau = first_tableau(S, r, c, f, np.zeros(f.size, np.bool_), np.ones(f.size))
    solution = continue_pivots(*tableau, np.int64(START), limit)[2]
    second = y.size
    for i in range(y.size):
        y[i] = solution[i]
        if free[i]:
            y[i] -= solution[second]
            second += 1


@compiled
def many(S, r, c, M, covering, Q, C, limit, Z):
    # the LCPs with the rows of Q over the obstacles in the rows of C, each from its own start, to the rows of Z
    n = S.shape[0]
    f = np.empty(n)
    units = np.empty(n, np.int64)
    D = np.empty((n, n + 2))
    labels = np.empty(5 * n + 2, np.int64)
    work = np.empty(n + 1)
    free = np.empty(n, np.bool_)
    q = np.empty(n)
    for k in range(Q.shape[0]):
        for i in range(n):
            free[i] = C[k, i] == -np.inf
            Z[k, i] = 0.0 if free[i] else C[k, i]
        # (loops, as the array expressions of NumPy take three seconds to compile)
        for i in range(n):
            q[i] = Q[k, i]
            for j in range(n):
                q[i] += M[i, j] * Z[k, j]
        right(q, r, c, f, units)
        code, _, y, _ = continue_pivots(S, f, free, covering, units, D, labels, work, np.int64(START), limit)
        if code == SINGULAR:
            _by_differences(M, q, free, limit, y)
        for i in range(n):
            Z[k, i] += y[i]


@compiled
def each(M, covering, Q, C, limit, Z):
    # the same where each row has a matrix of its own
    for k in range(Q.shape[0]):
        S, r, c = scale(M[k])
        many(S, r, c, M[k], covering, Q[k : k + 1], C[k : k + 1], limit, Z[k : k + 1])
