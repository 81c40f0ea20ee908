"""Batches of LCPs by Lemke's pivots: of one matrix, or each with a matrix of its own."""

from __future__ import annotations

import numpy as np

from ...numerics.kernels import compiled
from .balancing import scale
from .dictionary import bounds
from .pivoting import START, continue_pivots, right, work_arrays


@compiled
def many(S, r, c, M, covering, Q, C, D, limit, Z):
    # the LCPs with the rows of Q between the rows of C and D, each from its own start, to the rows of Z
    n = S.shape[0]
    f = np.empty(n)
    units = np.empty(n, np.int64)
    arrays = work_arrays(n)
    upper = np.empty(n)
    scaled = np.empty(n)
    q = np.empty(n)
    for k in range(Q.shape[0]):
        for i in range(n):
            Z[k, i], upper[i] = bounds(C[k, i], D[k, i])
        # (loops, as the array expressions of NumPy take three seconds to compile)
        for i in range(n):
            q[i] = Q[k, i]
            for j in range(n):
                q[i] += M[i, j] * Z[k, j]
        right(q, r, c, upper, f, units, scaled)
        y = continue_pivots(S, f, scaled, covering, units, *arrays, np.int64(START), limit)[2]
        for i in range(n):
            Z[k, i] = D[k, i] if y[i] == upper[i] else Z[k, i] + y[i]


@compiled
def each(M, covering, Q, C, D, limit, Z):
    # the same where each row has a matrix of its own
    for k in range(Q.shape[0]):
        S, r, c = scale(M[k])
        own = slice(k, k + 1)
        many(S, r, c, M[k], covering, Q[own], C[own], D[own], limit, Z[own])
