"""Pairs of a lower and an upper obstacle; and maps from whatever a user may give as an obstacle."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import InputError
from ..numerics.arrays import Mask, Vector, as_vector, axes, described, freeze
from .affine import Constant
from .function import Function
from .map import Map
from .user_code import as_function


class ObstaclePair(NamedTuple):
    """The values ψ(z) and ψ̄(z) together, for compiled loops and other callers."""

    lower: Any
    upper: Any


class TwoSidedObstacle(Map):
    """The obstacles ψ ≤ z ≤ ψ̄: as a map it is the lower one, `lower`; the upper one is `upper`.

    `ICP` makes it from its `psi` and `upper`. Its facts, such as the Lipschitz matrix G, hold for both obstacles. But
    `linear` is that of the lower one, and is known only if both are affine.

    Examples
    --------
    >>> psi = TwoSidedObstacle(icp.Constant(0), icp.Constant(1)).bind(2)
    >>> psi.value(np.zeros(2)), psi.upper.value(np.zeros(2))
    (array([0., 0.]), array([1., 1.]))
    """

    upper: Map

    def __init__(self, lower: Map, upper: Map) -> None:
        self.lower = lower
        self.upper = upper
        self.is_constant = lower.is_constant and upper.is_constant
        self.calls_user_code = lower.calls_user_code or upper.calls_user_code
        self.has_policies = lower.has_policies or upper.has_policies
        if upper.linear is not None:
            self.linear = lower.linear
        if lower.links is not None and upper.links is not None:
            self.links = sp.csr_array(lower.links + upper.links)

    def bind(self, n: int) -> TwoSidedObstacle:
        return TwoSidedObstacle(self.lower.bind(n), self.upper.bind(n))

    @cached_property
    def _fixed_rows(self) -> tuple[Any, Mask] | None:
        """The rows in which ψ̄ − ψ does not depend on z, and those in which c > c̄; None unless both are affine."""
        if self.linear is None or self.upper.linear is None:
            return None
        (G, c) = self.linear
        (H, d) = self.upper.linear
        return G is H or np.diff(sp.csr_array(G - H).indptr) == 0, c > d

    def crossed_everywhere(self) -> int | None:
        """A row where ψ_i > ψ̄_i at every z; found for constant and affine maps only, else None."""
        fixed, crossed = self._fixed_rows or (False, np.zeros(1, dtype=bool))
        crossed = fixed & crossed
        return int(np.argmax(crossed)) if np.any(crossed) else None

    @cached_property
    def parallel(self) -> bool:  # type: ignore[override]
        """Whether ψ = Gz + c and ψ̄ = Gz + c̄, with one G and c ≤ c̄, so that ψ ≤ ψ̄ at every z."""
        fixed, crossed = self._fixed_rows or (False, np.zeros(1, dtype=bool))
        return bool(np.all(fixed & ~crossed))

    @cached_property
    def lipschitz(self) -> sp.csr_array | None:  # type: ignore[override]
        G = self.lower.lipschitz
        H = self.upper.lipschitz
        if G is None or H is None:
            return None
        return G if self.is_constant else freeze(sp.csr_array(G.maximum(H)))

    def value(self, z: Vector) -> Vector:
        return self.lower.value(z)

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        return self.lower.jacobian(z)

    def no_derivative(self) -> str | None:
        above = self.upper.no_derivative()
        return self.lower.no_derivative() or (above and above.replace("psi", "upper", 1))

    def change(self, delta: Vector) -> Vector | None:
        below = self.lower.change(delta)
        above = self.upper.change(delta)
        return None if below is None or above is None else np.maximum(below, above)

    def isotone(self) -> bool | None:
        answers = {self.lower.isotone(), self.upper.isotone()}
        return False if False in answers else None if None in answers else True

    def restricted(self, rows: NDArray[np.intp], z: Vector) -> Map:
        return self._of_both(lambda one: one.restricted(rows, z))

    def composed(self, P: sp.csr_array, shift: Any = 0.0, rows: Any = slice(None), factor: float = 1.0) -> Map:
        return self._of_both(lambda one: one.composed(P, shift, rows, factor))

    def _of_both(self, transform: Callable[[Map], Map]) -> TwoSidedObstacle:
        return TwoSidedObstacle(transform(self.lower), transform(self.upper))

    def describe(self) -> str:
        if self.is_constant:
            return f"below: {self.lower!r}, above: {self.upper!r}; neither moves: a problem with bounds on both sides"
        sides = (f"{one!r}, fixed" if one.is_constant else one.describe() for one in (self.lower, self.upper))
        return "below: {}; above: {}; ".format(*sides) + ("they never" if self.parallel else "they may") + " cross"

    def __repr__(self) -> str:
        return f"TwoSidedObstacle({self.lower!r}, {self.upper!r})"


class Rowwise(Map):
    """The one obstacle whose row i is that of `maps[which[i]]`; `which` of shape (n,)."""

    def __init__(self, maps: Sequence[Map], which: NDArray[np.integer]) -> None:
        self.maps = tuple(maps)
        self.which = which
        self.is_constant = all(one.is_constant for one in maps)
        self.calls_user_code = any(one.calls_user_code for one in maps)
        self.has_policies = any(one.has_policies for one in maps)

    def bind(self, n: int) -> Rowwise:
        return self

    def value(self, z: Vector) -> Vector:
        return np.choose(self.which, [one.value(z) for one in self.maps])

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        return self._matrix([one.jacobian(z) for one in self.maps])

    @cached_property
    def lipschitz(self) -> sp.csr_array | None:  # type: ignore[override]
        return self._matrix([one.lipschitz for one in self.maps])

    @cached_property
    def linear(self) -> tuple[sp.csr_array, Vector] | None:  # type: ignore[override]
        known = [one.linear or (None, None) for one in self.maps]
        G = self._matrix([G for G, _ in known])
        return None if G is None else (G, np.choose(self.which, [c for _, c in known]))

    def _matrix(self, matrices: Sequence[sp.csr_array | None]) -> sp.csr_array | None:
        if any(matrix is None for matrix in matrices):
            return None
        n = self.which.size
        return sp.csr_array(sp.vstack(matrices, format="csr")[self.which * n + np.arange(n)])


def sides_of(psi: Map) -> tuple[Map, ...]:
    """The lower obstacle, and the upper one if there is one."""
    return (psi.lower, psi.upper) if isinstance(psi, TwoSidedObstacle) else (psi,)


def obstacle_values(psi: Map, z: Vector) -> Any:
    """ψ(z), or the pair of ψ(z) and ψ̄(z) where there is an upper obstacle, as compiled loops take them."""
    return psi.value(z) if psi.upper is None else ObstaclePair(psi.value(z), psi.upper.value(z))


def select_obstacle(psi: Map, above: Mask | None) -> Map:
    """`psi` as one obstacle: the upper one in the rows `above`, else the lower; `psi` itself where it has one only."""
    return psi if psi.upper is None or above is None else Rowwise((psi, psi.upper), above.astype(np.intp))


def mid(p: Vector, r: Vector, r_upper: Vector | None = None, scale: Any = None) -> Vector:
    """mid(Ω(z − ψ̄), p, Ω(z − ψ)), the median of the three; min(p, Ω(z − ψ)) without an upper obstacle.

    Parameters
    ----------
    p : array of shape (n,)
        Az + q.
    r : array of shape (n,)
        z − ψ.
    r_upper : array of shape (n,), optional
        z − ψ̄ ≤ z − ψ.
    scale : float or array of shape (n,), optional
        The diagonal of Ω; by default 1.

    Returns
    -------
    array of shape (n,)
        The median. Where the obstacles cross, ψ_i > ψ̄_i, it is the one of `r` and `r_upper` with
        the larger absolute value, which is never 0.

    Examples
    --------
    >>> mid(np.array([3.0, -3.0, 0.5]), np.ones(3), -np.ones(3))
    array([ 1. , -1. ,  0.5])
    """
    if scale is not None:
        r = scale * r
        r_upper = None if r_upper is None else scale * r_upper
    least: Vector = np.minimum(p, r)
    if r_upper is None:
        return least
    result: Vector = np.maximum(r_upper, least)
    crossed = r_upper > r
    if crossed.any():
        larger = np.where(np.abs(r_upper) > np.abs(r), r_upper, r)
        result = np.where(crossed, larger, result)
    return result


def as_map(psi: Any, n: int, upper: Any = None) -> Map:
    """Convert the obstacles of a user to one `Map` for vectors of length `n`.

    Parameters
    ----------
    psi : Map, float, array_like of shape (n,) or callable
        The obstacle ψ; a callable is z ↦ ψ(z).
    n : int
        Number of unknowns.
    upper : optional
        The obstacle ψ̄ above, in the same forms, or None.

    Returns
    -------
    Map
        The obstacle, or the pair of obstacles.

    Raises
    ------
    InputError
        For an obstacle of another kind, and where the two cross for every z.
    """
    if upper is None:
        if type(psi) is float and psi == 0.0:
            return _at_zero(n)
        return psi.bind(n) if isinstance(psi, TwoSidedObstacle) else _one_side(psi, n, "psi", -np.inf)
    if isinstance(psi, TwoSidedObstacle):
        raise InputError("psi has an upper obstacle already; give upper, or that one")
    both = TwoSidedObstacle(_one_side(psi, n, "psi", -np.inf), _one_side(upper, n, "upper", np.inf))
    if (row := both.crossed_everywhere()) is not None:
        below, above = both.value(np.zeros(n))[row], both.upper.value(np.zeros(n))[row]
        raise InputError(
            f"the obstacles cross in row {row}: psi has {below:g} there, upper {above:g}; psi <= upper was expected"
        )
    return both


def _one_side(value: Any, n: int, name: str, none: float) -> Map:
    """The obstacle `value`, called `name` in messages; the infinite number `none` stands for no obstacle."""
    if isinstance(value, TwoSidedObstacle):
        raise InputError(f"{name} has two sides; one obstacle was expected")
    if callable(value) and not isinstance(value, Map | type):
        value = Function(as_function(value, name))
    if isinstance(value, Map):
        bound = value.bind(n) if none < 0 else value.bind(n).as_upper()
        return bound if (c := getattr(bound, "c", None)) is None else _check_bound(bound, c, f"{name}.c", none)
    if isinstance(value, str | type) or value is None:
        expected = "a number, a vector, a callable or one of icpmodel's maps"
        raise InputError(f"{name} is {described(value)}; {expected} was expected")
    is_pair = isinstance(value, list | tuple) and len(value) == 2 and not isinstance(value[0], int | str)
    if is_pair and axes(value[0], f"{name}[0]") == 2:
        raise InputError(f"{name} is a matrix G and a vector c; Affine(G, c) was expected")
    vector = as_vector(value, n, name, infinite=none)
    bound = Constant.of_checked(vector)
    return bound if none < 0.0 else _check_bound(bound, vector, name, none)  # `infinite` = inf lets both pass


def _check_bound(bound: Map, c: Vector, name: str, none: float) -> Map:
    """`bound`, after a check that `c` is nowhere the infinity opposite to `none`. Raises InputError."""
    if (invalid := c == -none).any():
        i = int(np.argmax(invalid))
        raise InputError(f"{name}[{i}] is {c[i]}; a finite number or {none} was expected")
    return bound


@lru_cache(maxsize=1)
def _at_zero(n: int) -> Map:
    """ψ = 0, shared by all LCPs of one size."""
    return Constant(0.0).bind(n)
