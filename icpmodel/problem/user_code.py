"""Calls of a user's code: what it raises or returns wrongly becomes a MapError, what it is given is checked."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from inspect import signature
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError, MapError
from ..numerics.arrays import Vector, as_array, as_rows, as_vector, axes, described, freeze
from ..numerics.rounding import UNIT_ROUNDOFF, is_ctrl_c
from .map import Map

#: the usual error of a function that does not take z
_WHOLE = "z is an array of all unknowns: use np.sin, not math.sin, and np.where, not if (jnp.sin in JAX)"


def is_compiled(f: object) -> bool:
    """Whether `f` was compiled with `numba.njit`. Does not import numba."""
    return hasattr(f, "py_func") and hasattr(f, "nopython_signatures")


def diagonal_lipschitz(value: Any, n: int, name: str) -> sp.csr_array:
    """diag(ℓ), CSR, for numbers ℓ ≥ 0 that a user gave, `value` a number or of shape (n,). Raises InputError."""
    vector = as_vector(value, n, name)
    if (vector < 0).any():
        raise InputError(f"{name} has the entry {vector.min()}; numbers >= 0 were expected")
    return freeze(sp.csr_array((vector, np.arange(n), np.arange(n + 1)), shape=(n, n)))


#: units in the last place to which the values of a user's function are taken as exact
USER_ULPS = 8.0


def as_function(f: Any, name: str, argument: str = "z") -> Callable[..., Any]:
    """`f`, which must be callable with one `argument`. Raises InputError."""
    if not callable(f):
        raise InputError(f"{name} is {described(f)}; a function was expected")
    try:
        parameters = signature(f)
    except ValueError:  # some compiled functions do not say what they take
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


def raising_map_error(call: Callable[[], Any], name: str) -> Any:
    """Call the user's function; its exceptions become a MapError about `name`."""
    try:
        return call()
    except Exception as error:
        if is_ctrl_c(error):
            raise KeyboardInterrupt from error
        hint = f"; {_WHOLE}" if isinstance(error, TypeError | ValueError) else ""
        raise MapError(f"{name}(z) raised {type(error).__name__}: {error}{hint}") from error


def returned(value: Any, name: str) -> NDArray[Any]:
    """The result of a user's function as an array of any kind. Raises MapError if it is no array."""
    try:
        return as_array(value, name)
    except InputError as error:
        raise MapError(str(error)) from None


def call_user(call: Callable[[], Any], shape: tuple[int, ...], name: str) -> Vector:
    """What the user's function returns, as float64 of `shape`. NaN passes: the judge sees it.

    Raises MapError where it raises or returns another shape or no real numbers.
    """
    value = returned(raising_map_error(call, name), f"{name}(z)")
    if value.shape != shape:
        raise MapError(f"{name}(z) has shape {value.shape}; shape {shape} was expected")
    if value.dtype.kind not in "biuf":
        raise MapError(f"{name}(z) has dtype {value.dtype}; real numbers were expected")
    return value.astype(np.float64)


class Parametrised(Map):
    """A map by a user's functions; one of them may be the derivative of ψ by the user's own parameters."""

    def __init__(self, parameter_derivative: Callable[[Vector], Any] | None) -> None:
        function = parameter_derivative
        name = f"{type(self).__name__}.parameter_derivative"
        self.parameter_derivative = None if function is None else as_function(function, name)

    def data_change(self, z: Vector, change: Any, name: str) -> tuple[sp.csr_array | None, Vector]:
        if self.parameter_derivative is None:
            return super().data_change(z, change, name)
        D = self._by_parameters(z)
        return None, np.asarray(D @ as_vector(change, D.shape[1], name))

    def data_gradient(self, z: Vector, weight: Vector) -> Any:
        return weight if self.parameter_derivative is None else np.asarray(self._by_parameters(z).T @ weight)

    def _by_parameters(self, z: Vector) -> Any:
        """∂ψ(z)/∂θ, shape (n, m), m the number of parameters."""
        derivative = self.parameter_derivative
        name = f"{type(self).__name__}.parameter_derivative"
        assert derivative is not None
        D = raising_map_error(lambda: derivative(z.copy()), name)
        try:
            D = as_rows(D if axes(D, name) != 1 else as_array(D, name)[:, None], f"{name}(z)")
        except InputError as error:
            raise MapError(str(error)) from None
        if D.shape[0] != z.size:
            raise MapError(f"{name}(z) has shape {D.shape}; a row for each unknown, ({z.size}, m), was expected")
        return D
