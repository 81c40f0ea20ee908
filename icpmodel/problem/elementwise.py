"""Obstacles ψ_i that depend on z_i alone."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any, Self

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError, check_arguments
from ..numerics.arrays import Vector, as_float64, as_vector, locked
from ..numerics.labels import check_labels
from .map import Map
from .user_code import call_for_vector, is_compiled
from .user_map import UserMap


class Elementwise(UserMap):
    """ψ_i(z) = f(z_i) + c_i: every row's obstacle moves with its own unknown.

    Parameters
    ----------
    f : callable
        A function of an array of shape (n,), applied entry by entry (NumPy style). Or a scalar
        function compiled with `numba.njit`, which is then called in a compiled loop.
    derivative : callable, optional
        Derivative of f, in the same style.
    lipschitz : float or array_like of shape (n,), optional
        ℓ ≥ 0 with |f(s) − f(t)| ≤ ℓ_i|s − t|. The Lipschitz matrix is diag(ℓ).
    c : float or array_like of shape (n,), default 0
        The constant part.
    slope_range : tuple of two floats or array_like of shape (n,), optional
        (m, M) with m_i ≤ (f(s) − f(t))/(s − t) ≤ M_i for all s ≠ t; (0, inf) for a nondecreasing f.
        Proofs about a nonlinear p use it. They also assume that f is continuous, which a finite M
        implies. Without `lipschitz` ℓ = max(|m|, |M|) where that is finite.
    parameter_derivative : callable, optional
        For `icpmodel.Derivative`: maps z to the derivative of ψ(z) with respect to m parameters of yours.
        Its shape is (n, m), dense or sparse, or (n,) for one parameter. These parameters replace c
        as the data of ψ.

    Examples
    --------
    >>> psi = Elementwise(
    ...     lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z), lipschitz=0.3, c=1.0
    ... ).bind(2)
    >>> psi.value(np.zeros(2))
    array([1., 1.])
    >>> psi.jacobian(np.zeros(2)).diagonal()
    array([0.3, 0.3])
    """

    function_names = ("f", "derivative")

    @check_arguments
    def __init__(
        self,
        f: Callable[[Any], Any],
        derivative: Callable[[Any], Any] | None = None,
        lipschitz: Any = None,
        c: Any = 0.0,
        *,
        slope_range: Any = None,
        parameter_derivative: Callable[[Vector], Any] | None = None,
    ) -> None:
        self.index = check_labels({"Elementwise.c": c, "Elementwise.lipschitz": lipschitz})
        self.slope_range = None if slope_range is None else _range(slope_range)
        if lipschitz is None and self.slope_range is not None:
            largest = np.maximum(*map(np.abs, self.slope_range))
            lipschitz = largest if np.isfinite(largest).all() else None
        super().__init__(f, derivative, lipschitz, parameter_derivative)
        if np.ndim(self.given_lipschitz) > 1:
            raise InputError("Elementwise.lipschitz is a matrix; a number or one for each row was expected")
        self.c = locked(as_float64(c, "Elementwise.c"))
        if is_compiled(f) is not is_compiled(derivative) and derivative is not None:
            raise InputError(
                "Elementwise.f and Elementwise.derivative: both or neither must be compiled with numba.njit"
            )

    def bind(self, n: int) -> Self:
        sides = self.slope_range
        if sides is not None:  # first, as the Lipschitz constants may be derived from them
            sides = locked(tuple(as_vector(side, n, "Elementwise.slope_range", infinite=np.inf) for side in sides))
        c = locked(as_vector(self.c, n, "Elementwise.c", infinite=np.inf))
        bound = super().bind(n)
        vars(bound).update(c=c, slope_range=sides)
        return bound

    def value(self, z: Vector) -> Vector:
        return self._entrywise(self.fun, z, "Elementwise.f") + self.c

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        if self.derivative is None:
            return super().jacobian(z)
        slopes = self._entrywise(self.derivative, z, "Elementwise.derivative")
        n = z.size
        return sp.csr_array((slopes, np.arange(n), np.arange(n + 1)), shape=(n, n))

    def no_derivative(self) -> str | None:
        return "psi has no derivative: give `derivative` to Elementwise" if self.derivative is None else None

    def restricted(self, rows: NDArray[np.intp], z: Vector) -> Map:
        constants = self.given_lipschitz
        lipschitz = constants if constants is None or constants.ndim == 0 else constants[rows]
        return Elementwise(self.fun, self.derivative, lipschitz, self.c[rows]).bind(rows.size)

    def _entrywise(self, f: Callable[[Any], Any], z: Vector, name: str) -> Vector:
        if is_compiled(f):
            from .kernels.obstacle import entrywise  # loads numba

            f = entrywise(f)
        return call_for_vector(f, z, name)


def _range(slope_range: Any) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """(m, M), m finite and m ≤ M. Raises InputError."""
    if not isinstance(slope_range, tuple | list) or len(slope_range) != 2:
        expected = "a pair (m, M) was expected, as (0, inf) for a nondecreasing f"
        raise InputError(f"Elementwise.slope_range is {slope_range!r}; {expected}")
    m, M = (as_float64(side, "Elementwise.slope_range") for side in slope_range)
    if not (np.isfinite(m).all() and (m <= M).all()):
        raise InputError(f"Elementwise.slope_range is ({m}, {M}); finite m <= M were expected")
    return locked(m), locked(M)
