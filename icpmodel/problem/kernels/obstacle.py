"""The loop that calls a user's compiled function for each row."""

from __future__ import annotations

from functools import lru_cache

import numba
import numpy as np


@lru_cache(maxsize=64)
def entrywise(f):
    """z ↦ (f(z_1), …, f(z_n)) for a scalar function f.

    f is compiled into the loop. If it were an argument, numba would look up its type at every call, which takes longer
    than the loop over a small z.
    """

    def apply(z):
        out = np.empty(z.size)
        for i in range(z.size):
            out[i] = f(z[i])
        return out

    return numba.njit(apply, nogil=True)
