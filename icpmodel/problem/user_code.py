"""Calls of a user's code: what it raises or returns wrongly becomes a MapError, what it is given is checked."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, MapError
from ..numerics.arrays import Vector, as_array, as_vector, freeze
from ..numerics.rounding import is_ctrl_c


def is_compiled(f: object) -> bool:
    """Whether `f` was compiled with `numba.njit`. Does not import numba."""
    return hasattr(f, "py_func") and hasattr(f, "nopython_signatures")


def diagonal_lipschitz(value: Any, n: int) -> sp.csr_array:
    """diag(ℓ), CSR, for numbers ℓ ≥ 0 that a user gave, `value` a number or of shape (n,). Raises InputError."""
    vector = as_vector(value, n, "psi.lipschitz")
    if (vector < 0).any():
        raise InputError(f"psi.lipschitz has the entry {vector.min()}; numbers >= 0 were expected")
    return freeze(sp.csr_array((vector, np.arange(n), np.arange(n + 1)), shape=(n, n)))


def as_function(f: Any, name: str) -> Callable[..., Any]:
    """`f`, which must be callable. Raises InputError."""
    if not callable(f):
        raise InputError(f"{name} is a {type(f).__name__}; a function was expected")
    return f


def raising_map_error(call: Callable[[], Any], name: str) -> Any:
    """What the user's function returns; what it raises becomes a MapError about `name`."""
    try:
        return call()
    except Exception as error:
        if is_ctrl_c(error):
            raise KeyboardInterrupt from error
        raise MapError(f"{name}(z) raised {type(error).__name__}: {error}") from error


def call_user(call: Callable[[], Any], shape: tuple[int, ...], name: str) -> Vector:
    """What the user's function returns, as float64 of `shape`. NaN passes: the judge sees it.

    Raises MapError where it raises or returns another shape or no real numbers.
    """
    try:
        value = as_array(raising_map_error(call, name), f"{name}(z)")
    except InputError as error:
        raise MapError(str(error)) from None
    if value.shape != shape:
        raise MapError(f"{name}(z) has shape {value.shape}; shape {shape} was expected")
    if value.dtype.kind not in "biuf":
        raise MapError(f"{name}(z) has dtype {value.dtype}; real numbers were expected")
    return value.astype(np.float64)
