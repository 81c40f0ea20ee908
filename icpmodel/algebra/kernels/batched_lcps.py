"""Batches of LCPs by Lemke's pivots: of one matrix, or each with a matrix of its own."""

from __future__ import annotations

import numpy as np

from ...numerics.kernels import compiled
from .balancing import scale
from .pivoting import START, continue_pivots, right


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
        y = continue_pivots(S, f, free, covering, units, D, labels, work, np.int64(START), limit)[2]
        for i in range(n):
            Z[k, i] += y[i]


@compiled
def each(M, covering, Q, C, limit, Z):
    # the same where each row has a matrix of its own
    for k in range(Q.shape[0]):
        S, r, c = scale(M[k])
        many(S, r, c, M[k], covering, Q[k : k + 1], C[k : k + 1], limit, Z[k : k + 1])
