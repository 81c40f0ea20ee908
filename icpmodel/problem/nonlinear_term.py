"""The term f in p(z) = Az + q + f(z): a user's map, with a derivative by differences where none is given."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, MapError
from ..numerics.arrays import Vector, described, not_finite
from ..numerics.rounding import UNIT_ROUNDOFF
from ..present.display import Displayable
from .affine import Affine
from .elementwise import Elementwise
from .function import Function
from .map import Map
from .matrix import MIN_DIAGONAL, Matrix, weights_of
from .user_code import USER_ULPS, as_function
from .user_map import UserMap

#: the largest n for which a dense Jacobian is approximated from n + 1 values of f without being requested
DENSE_UP_TO = 1000


@contextmanager
def _about_f() -> Iterator[None]:
    """Replace psi by f in the messages of errors that the block raises about a map."""
    try:
        yield
    except (InputError, MapError) as error:
        raise type(error)(str(error).replace("psi", "f")) from error.__cause__


class NonlinearTerm(Displayable):
    """The map f for `n` unknowns.

    Parameters
    ----------
    f : Affine, Elementwise, Function or callable
        The map; a callable is z ↦ f(z).
    n : int
        Number of unknowns.

    Raises
    ------
    InputError
        For an f of another kind or length, and for more than 1000 unknowns without a derivative.

    Examples
    --------
    >>> f = NonlinearTerm(lambda z: z**2, 2)
    >>> f.value(np.array([1.0, 3.0])), f.jacobian(np.array([1.0, 3.0])).diagonal().round(6)
    (array([1., 9.]), array([2., 6.]))
    """

    def __init__(self, f: Any, n: int) -> None:
        if not isinstance(f, Affine | Elementwise | Function) and (isinstance(f, Map) or not callable(f)):
            expected = "a callable, Elementwise, Function or Affine was expected"
            raise InputError(f"f is {described(f)}; {expected}")
        with _about_f():
            self.map: Map = (f if isinstance(f, Map) else Function(as_function(f, "f"))).bind(n)
        self.n = n
        #: the last z and f′(z), which both the residual and the next tangent need
        self._last_jacobian: tuple[Vector, sp.csr_array] | None = None
        if isinstance(self.map, UserMap) and self.map.no_derivative() is not None:
            if n > DENSE_UP_TO and not self.is_elementwise:
                advice = (
                    f"for more than {DENSE_UP_TO} unknowns give Function(f, jacobian) or Function(f, sparsity=pattern)"
                )
                raise InputError(f"f has no derivative: {advice}, or Elementwise(f) where f_i depends on z_i alone")
            self.map = self.map.with_sparsity(sp.eye_array(n) if self.is_elementwise else np.ones((n, n)))

    @property
    def is_elementwise(self) -> bool:
        """Whether f_i depends on z_i alone."""
        return isinstance(self.map, Elementwise)

    def value(self, z: Vector) -> Vector:
        """f(z), shape (n,). Raises MapError where the user's function fails."""
        with _about_f():
            return self.map.value(z)

    def jacobian(self, z: Vector) -> sp.csr_array:
        """f′(z), CSR, shape (n, n), by differences where no derivative was given.

        Raises
        ------
        MapError
            Where the user's functions fail or f′(z) is not finite.
        """
        last = self._last_jacobian
        if last is not None and np.array_equal(last[0], z):
            return last[1]
        with _about_f():
            J = self.map.jacobian(z)
        assert J is not None, "a map without a derivative was given a sparsity"
        if fault := not_finite(J.data, "the derivative of f"):
            raise MapError(f"{fault}; a finite number was expected")
        self._last_jacobian = (z.copy(), J)
        return J

    def rounding(self, value: Vector) -> Vector:
        """A bound on the rounding error of a `value` of f, assumed to be exact to `USER_ULPS` unit roundoffs."""
        return USER_ULPS * UNIT_ROUNDOFF * np.abs(value)

    @cached_property
    def slope_range(self) -> tuple[Vector, Vector] | None:
        """(m, M) with m_i ≤ (f_i(x) − f_i(y))/(x_i − y_i) ≤ M_i, shape (n,) each; None where that is not known."""
        return self.map.slope_range if isinstance(self.map, Elementwise) else None

    def change(self, z: Vector, delta: Vector) -> Vector:
        """A bound on |f(x) − f(z)| for all |x − z| ≤ `delta`, infinite where nothing is known of the slopes.

        f − mz does not decrease, so its values at z ± δ bound it.

        Examples
        --------
        >>> f = NonlinearTerm(icp.Elementwise(np.exp, slope_range=(0, np.inf)), 1)
        >>> f.change(np.zeros(1), np.ones(1)).round(3)
        array([1.718])
        """
        if self.slope_range is None:
            return np.full(self.n, np.inf)
        m = self.slope_range[0]
        low, here, high = (self.value(x) for x in (z - delta, z, z + delta))
        most = np.maximum(high - here, here - low) + np.abs(m) * (2.0 * delta)
        rounding = self.rounding(np.maximum(np.abs(low), np.abs(high)) + np.abs(here) + most)
        return np.nan_to_num(most + rounding, nan=np.inf, posinf=np.inf)

    def slope_violation(self, z: Vector) -> str:
        """A message if a mean slope between `z` and 0 is outside `slope_range` beyond rounding; else empty."""
        if self.slope_range is None:
            return ""
        with suppress(MapError), np.errstate(all="ignore"):
            f_z, f_0 = self.value(z), self.value(np.zeros(self.n))
            room = self.rounding(f_z) + self.rounding(f_0)
            moved = f_z - f_0
            ends = [np.where(side == 0.0, 0.0, side * z) for side in self.slope_range]
            violated = (moved < np.minimum(*ends) - room) | (moved > np.maximum(*ends) + room)
            if violated.any():
                i = int(np.argmax(violated))
                slope, (m, M) = moved[i] / z[i], (side[i] for side in self.slope_range)
                actual = f"f_{i} has the mean slope {slope:.6g} between z and 0"
                return f"f.slope_range is wrong: {actual}, outside of [{m:g}, {M:g}]"
        return ""

    def tangent(self, A: Matrix, z: Vector) -> tuple[Matrix, Vector]:
        """(A + f′(z), f′(z)z), the matrix dense where A is."""
        J = self.jacobian(z)
        if A.dense is None and self.is_elementwise:
            return A.plus_diagonal(J.diagonal()), J @ z
        total = sp.csr_array(A.sparse + J) if A.dense is None else A.dense + J.toarray()
        return Matrix(total, A.index), J @ z

    def weighted(self, A: Matrix) -> Matrix:
        """A with the row weights of p: d_i is the mean of the largest |entries| of row i of A + f′ at z = ½ and 1.

        If f′ is finite at one of the two points only, that one counts; if at neither, and in zero rows,
        d_i = 1. So the scale does not depend on the start or on iterates. The point 0 is not used, as
        the slope of a power or of a root is not typical there.
        """
        sizes = []
        for at in (0.5, 1.0):
            with suppress(MapError), np.errstate(all="ignore"):
                J = self.jacobian(np.full(self.n, at))
                sizes.append(abs(sp.csr_array(A.sparse + J)).max(axis=1).toarray().reshape(-1))
        largest = np.mean(sizes, axis=0) if sizes else np.zeros(self.n)
        D = np.where(largest > 0.0, largest, 1.0)
        weighted = Matrix.of_checked(A.sparse, weights_of(D), A.dense)
        weighted.weights = D
        weighted.index = A.index
        return weighted

    def weights_at(self, A: Matrix, z: Vector, p: Any = 0.0) -> Vector:
        """The diagonal of D⁻¹ at z: d_i is the largest |entry| of row i of A + f′(z) where that is less than D's.

        So Res_D(z) counts a step of Newton's method in full, and a slope that grows without bound hides no p. A weight
        is ∞ where slopes that are larger elsewhere underflow, as p may then underflow before z is near a solution. A
        row of slope 0 counts as an empty one. As its slope may have underflowed, too, a nonzero entry of `p` = p(z) in
        it counts as at least the size of z.
        """
        with np.errstate(all="ignore"):
            J = self.jacobian(z)
            if self.is_elementwise:
                size = np.maximum(np.abs(A.rows.diagonal + J.diagonal()), A.largest_beside)
            else:
                size = abs(sp.csr_array(A.sparse + J)).max(axis=1).toarray().reshape(-1)
            far = np.where((size == 0.0) & (p != 0.0), np.abs(z).max() / np.abs(p), 0.0)
        underflows = (size > 0.0) & (size < MIN_DIAGONAL) & (A.row_weights < 1.0 / MIN_DIAGONAL)
        weights = np.maximum.reduce([A.row_weights, weights_of(size), far])
        return np.where(underflows, np.inf, weights)

    def describe(self) -> str:
        """One sentence: the form of f, and what is known of its slopes.

        Examples
        --------
        >>> print(NonlinearTerm(icp.Elementwise(np.exp, slope_range=(0, np.inf)), 1).describe())
        Elementwise(exp): its slopes are in [0, inf]
        """
        known = self.slope_range
        slopes = "nothing is known of its slopes"
        if known is not None:
            slopes = f"its slopes are in [{known[0].min():g}, {known[1].max():g}]"
        return f"{self!r}: {slopes}"

    def __repr__(self) -> str:
        return repr(self.map)
