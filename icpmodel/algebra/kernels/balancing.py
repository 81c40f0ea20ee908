"""Scaling of a dense linear complementarity problem by powers of two for rows and columns, which loses no digit."""

from __future__ import annotations

import math

import numpy as np

from ...numerics.kernels import compiled
from .dictionary import ZERO


@compiled
def _row_units(M):
    # r such that the largest entry of each row of 2^(r_i) m_ij is in [1/2, 1); 0 for rows of zeros
    rows = np.zeros(M.shape[0], np.int64)
    for i in range(M.shape[0]):
        largest = 0.0
        for j in range(M.shape[1]):
            largest = max(largest, abs(M[i, j]))
        rows[i] = -math.frexp(largest)[1]
    return rows


@compiled
def scale(M):
    # (S, r, c) with s_ij = 2^(r_i + c_j) m_ij: the largest |entry| of each row is in [1/2, 1), or, where the largest of
    # some column is below ZERO, that of each column. (Entries that are small in their row and in their column are not
    # scaled: those of an inverse decay with the distance, and units in which they do not would make q grow as fast.)
    n = M.shape[0]
    r = _row_units(M)
    c = np.zeros(n, np.int64)
    S = np.empty((n, n))
    columns = np.zeros(n)
    for i in range(n):
        unit = math.ldexp(1.0, r[i])
        for j in range(n):
            S[i, j] = M[i, j] * unit if unit < np.inf else math.ldexp(M[i, j], r[i])
            columns[j] = max(columns[j], abs(S[i, j]))
    for largest in columns:
        if 0.0 < largest < ZERO:  # a pivot in this column may be a rounding error
            c = _row_units(S.T)
            break
    for j in range(n):
        if c[j] != 0:
            for i in range(n):
                S[i, j] = math.ldexp(M[i, j], r[i] + c[j])
    return S, r, c
