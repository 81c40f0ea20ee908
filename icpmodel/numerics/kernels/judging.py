"""The natural residuals of many dense problems at once: `many` says what for."""

from __future__ import annotations

import math

import numpy as np

from . import compiled


def _judge(M, Q, C, Z, norms):
    # the norms of min(z - c, Mz + q) for the rows of Q, C and Z: NaN stays NaN, squares do not overflow
    n = M.shape[0]
    F = np.empty(n)
    for k in range(Q.shape[0]):
        largest = 0.0
        for i in range(n):
            p = Q[k, i]
            for j in range(n):
                p += M[i, j] * Z[k, j]
            r = Z[k, i] - C[k, i]
            if math.isnan(p) or math.isnan(r):
                largest = math.nan
                break
            F[i] = abs(p if p < r else r)
            largest = max(largest, F[i])
        total = 0.0
        if 0.0 < largest < np.inf:
            for i in range(n):
                total += (F[i] / largest) ** 2
            largest *= math.sqrt(total)
        norms[k] = largest


judge = compiled(_judge)
