"""Calls of user code: its exceptions and invalid results become a MapError; its signature is checked in advance."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from inspect import signature
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..errors import InputError, MapError
from ..numerics.arrays import Vector, as_array, described
from ..numerics.rounding import UNIT_ROUNDOFF, is_ctrl_c
from .map import Map

#: the hint for the usual errors in a function of z
_WHOLE = "z is an array of all unknowns: use np.sin, not math.sin, and np.where, not if (jnp.sin in JAX)"


def is_compiled(f: object) -> bool:
    """Whether `f` was compiled with `numba.njit`. Does not import numba."""
    return hasattr(f, "py_func") and hasattr(f, "nopython_signatures")


#: the assumed relative error of the values of a user's function, in unit roundoffs
USER_ULPS = 8.0


def as_function(f: Any, name: str, argument: str = "z") -> Callable[..., Any]:
    """`f`, which must be callable with one `argument`. Raises InputError."""
    if not callable(f):
        raise InputError(f"{name} is {described(f)}; a function was expected")
    try:
        parameters = signature(f)
    except ValueError:  # some compiled functions have no signature
        return f
    try:
        parameters.bind(None)
    except TypeError:
        raise InputError(f"{name} is a function of {parameters}; one of {argument} alone was expected") from None
    return f


def map_violation(psi: Map, z: Vector, name: str) -> str:
    """A sentence if |ψ(z) − ψ(0)| exceeds what the user's Lipschitz matrix allows, beyond rounding; else empty."""
    allowed = psi.change(np.abs(z)) if psi.calls_user_code else None
    if allowed is None:
        return ""
    with suppress(MapError), np.errstate(all="ignore"):  # ψ may have no value at 0
        psi_z = psi.value(z)
        psi_0 = psi.value(np.zeros(z.size))
        moved = np.abs(psi_z - psi_0)
        excess = moved - allowed - USER_ULPS * UNIT_ROUNDOFF * (np.abs(psi_z) + np.abs(psi_0))
        if (excess > 0.0).any():
            i = int(np.nanargmax(excess))
            actual = f"{name}_{i} differs by {moved[i]:.6g} between z and 0, and it allows {allowed[i]:.6g}"
            advice = "give a larger one, or none: a number stands for a diagonal matrix"
            return f"{name}.lipschitz is too small: {actual} ({advice})"
    return ""


@contextmanager
def as_map_error() -> Iterator[None]:
    """Turn an InputError of the block, which checks the result of a user's function, into a MapError."""
    try:
        yield
    except InputError as error:
        raise MapError(str(error)) from None


def call(f: Callable[[Vector], Any], z: Vector, name: str) -> Any:
    """The result of the user's function at a copy of `z`; its exceptions become a MapError about `name`."""
    try:
        return f(z.copy())
    except Exception as error:
        if is_ctrl_c(error):
            raise KeyboardInterrupt from error
        hint = f"; {_WHOLE}" if isinstance(error, TypeError | ValueError) else ""
        raise MapError(f"{name}(z) raised {type(error).__name__}: {error}{hint}") from error


def vector_of(value: Any, shape: tuple[int, ...], name: str, kinds: str = "biuf") -> NDArray[Any]:
    """The result of a user's function as an array. Raises MapError unless `shape` and dtype `kinds` fit; NaN passes."""
    with as_map_error():
        vector = as_array(value, name)
    if vector.shape != shape:
        raise MapError(f"{name} has shape {vector.shape}; shape {shape} was expected")
    if vector.dtype.kind not in kinds:
        expected = "real numbers" if "f" in kinds else "integers"
        raise MapError(f"{name} has shape {shape} and dtype {vector.dtype}; {expected} were expected")
    return vector


def call_for_vector(f: Callable[[Vector], Any], z: Vector, name: str) -> Vector:
    """The result of the user's function at `z`, as float64 of shape (n,). Raises MapError where it is anything else."""
    return vector_of(call(f, z, name), z.shape, f"{name}(z)").astype(np.float64)
