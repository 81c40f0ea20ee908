"""Compiled loops that call a user's compiled function.

numba looks up what a call's arguments are, and for a function among them that takes longer than a sweep over a small
problem. So the function becomes part of the code, which is compiled once for each.
"""

from __future__ import annotations

from functools import lru_cache

import numba
import numpy as np


@lru_cache(maxsize=64)
def sweep_with(kernel, f):
    """(before, c, after, z, out) ↦ kernel(*before, (c, f), *after, z, out), for ψ_i(z) = f(z_i) + c_i."""
    return numba.njit(lambda before, c, after, z, out: kernel(*before, (c, f), *after, z, out), nogil=True)


@lru_cache(maxsize=64)
def entrywise(f):
    """z ↦ (f(z_1), …, f(z_n)) for a scalar function f."""

    def apply(z):
        out = np.empty(z.size)
        for i in range(z.size):
            out[i] = f(z[i])
        return out

    return numba.njit(apply, nogil=True)
