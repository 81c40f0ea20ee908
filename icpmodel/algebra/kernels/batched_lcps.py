"""Batches of LCPs by Lemke's pivots: of one matrix, or each with a matrix of its own."""

from __future__ import annotations

import numpy as np

from ...numerics.kernels import compiled
from .balancing import scale
from .dictionary import nearest_obstacles
from .pivoting import START, continue_pivots, scaled_vectors, work_arrays


@compiled
def solve_lcps(S, r, c, covering, Q, C, D, limit, Z):
    # solves one LCP for each row of Q, its obstacles in the rows of C and D, from a start of its own; z goes to Z
    n = S.shape[0]
    units = np.empty(n, np.int64)
    arrays = work_arrays(n)
    for k in range(Q.shape[0]):
        own = scaled_vectors(S, r, c, Q[k], *nearest_obstacles(C[k], D[k]), units)
        z = continue_pivots(S, *own, covering, units, *arrays, np.int64(START), limit)[2]
        for i in range(n):
            Z[k, i] = min(max(z[i], C[k, i]), D[k, i])  # subnormal numbers lose digits in other units


@compiled
def solve_stack(M, covering, Q, C, D, limit, Z):
    # the same, with the matrix M[k] for row k
    for k in range(Q.shape[0]):
        S, r, c = scale(M[k])
        own = slice(k, k + 1)
        solve_lcps(S, r, c, covering, Q[own], C[own], D[own], limit, Z[own])
