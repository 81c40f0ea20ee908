"""Units for a dense linear complementarity problem: powers of two for its rows and columns, which cost no digit."""

from __future__ import annotations

import math

import numpy as np

from . import compiled

#: entries within 2^±so many of each other need no balancing; passes of balancing
_TAME, _PASSES = 20, 60


def _balance(M):
    # exponents (r, c) such that the 2^(r_i + c_j) m_ij are near 1: geometric means of rows and columns in turn, where
    # entries differ much; else all are divided by the largest
    n = M.shape[0]
    r, c = np.zeros(n, np.int64), np.zeros(n, np.int64)
    low, high = 5000, -5000
    size = np.zeros((n, n), np.int64)
    for i in range(n):
        for j in range(n):
            if M[i, j] != 0.0:
                size[i, j] = math.frexp(M[i, j])[1]
                low, high = min(low, size[i, j]), max(high, size[i, j])
    if high - low <= 2 * _TAME:
        for i in range(n):
            r[i] = -high if high > -5000 else 0
        return r, c
    for _ in range(_PASSES):
        moved = 0
        for i in range(n):
            total, count = 0, 0
            for j in range(n):
                if M[i, j] != 0.0:
                    total += size[i, j] + c[j]
                    count += 1
            to = -round(total / count) if count else 0
            moved, r[i] = max(moved, abs(to - r[i])), to
        for j in range(n):
            total, count = 0, 0
            for i in range(n):
                if M[i, j] != 0.0:
                    total += size[i, j] + r[i]
                    count += 1
            to = -round(total / count) if count else 0
            moved, c[j] = max(moved, abs(to - c[j])), to
        if moved <= 1:
            break
    return r, c


_exponents = compiled(_balance)


def _scale(M):
    # (S, r, c) with S the matrix in these units
    r, c = _exponents(M)
    S = np.empty_like(M)
    for i in range(M.shape[0]):
        for j in range(M.shape[0]):
            S[i, j] = math.ldexp(M[i, j], r[i] + c[j])
    return S, r, c


scale = compiled(_scale)
