"""Compiled loops. Importing this room loads numba, so the rest of the package imports it inside functions.

Positions are unsigned (`position`): a signed one makes numba look for a negative index at every access, which costs a
third of a sweep. Of the fast-math flags "contract" is set, which lets a·b + c be fused, and "reassoc" where only inner
products are summed; both leave NaN and infinities alone.
"""

from __future__ import annotations

import contextlib
from typing import Any

import numba
import numpy as np

#: a position in an array
position = np.uint64


def compiled(function: Any, *, cache: bool = True, reassociate: bool = False) -> Any:
    """`function` compiled by numba; with `cache` the code is kept on disk between runs.

    With `reassociate` sums may be added up in another order, which lets inner products run in vector instructions.

    >>> compiled(lambda x: 2.0 * x, cache=False)(1.5)
    3.0
    """
    flags = {"contract", "reassoc"} if reassociate else {"contract"}
    code = numba.njit(function, fastmath=flags, error_model="numpy", nogil=True)
    if cache:
        # without a writable folder for its cache numba raises; then every process compiles anew
        with contextlib.suppress(RuntimeError):
            code.enable_caching()
    return code
