"""Loops with a scalar function for each row: equations c = ψ(c), for `Facts.obstacle`, and calls of a user's compiled
function."""

from __future__ import annotations

import math
from functools import lru_cache

import numba
import numpy as np

from ...numerics.kernels import compiled


@compiled
def settled(c, value, tolerance):
    # whether |c - psi(c)| <= tolerance |c| in all rows that have an obstacle
    return np.all((np.abs(value) == np.inf) | (np.abs(c - value) <= tolerance * np.abs(c)))


@compiled
def improve(c, value, slope, own, low, high, out):
    # Newton's step for c - psi(c) = 0 where it stays in the bracket, low ... high, that |psi'| <= slope < 1 gives, else
    # the middle of it; `own` is psi' or empty. Returns whether anything moved
    moved = False
    for i in range(c.size):
        r = 0.0 if abs(value[i]) == math.inf else c[i] - value[i]
        near = c[i] - r / (1.0 + slope[i])
        far = c[i] - r / (1.0 - slope[i])
        low[i] = max(low[i], min(near, far))
        high[i] = min(high[i], max(near, far))
        newton = c[i] - r / (1.0 - own[i]) if own.size else math.nan
        out[i] = newton if low[i] <= newton <= high[i] else 0.5 * (low[i] + high[i])
        if math.isnan(r):
            out[i] = math.nan
        moved = moved or out[i] != c[i]
    return moved


@lru_cache(maxsize=64)
def entrywise(f):
    """z ↦ (f(z_1), …, f(z_n)) for a scalar function f, which becomes a part of the code: for an argument numba looks up
    at every call what it is, which takes longer than the loop over a small z."""

    def apply(z):
        out = np.empty(z.size)
        for i in range(z.size):
            out[i] = f(z[i])
        return out

    return numba.njit(apply, nogil=True)
