"""Compiled loops. Importing this room loads numba, so the rest of the package imports it inside functions.

Positions are unsigned (`position`): a signed one makes numba look for a negative index at every access, which costs a
third of a sweep. Only "contract" of the fast-math flags is set: it lets a·b + c be fused, and leaves NaN and infinities
alone.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numba
import numpy as np

#: a position in an array
position = np.uint64


def compiled(function: Any, *, cache: bool = True) -> Any:
    """`function` compiled by numba; with `cache` the code is kept on disk between runs.

    >>> compiled(lambda x: 2.0 * x, cache=False)(1.5)
    3.0
    """
    code = numba.njit(function, fastmath={"contract"}, error_model="numpy", nogil=True)
    if cache:
        # without a writable folder for its cache numba raises; then every process compiles anew
        with contextlib.suppress(RuntimeError):
            code.enable_caching()
    return code
