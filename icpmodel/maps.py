"""The obstacle map ψ of an ICP: its value, an element of its generalised Jacobian, and a Lipschitz matrix G.

ψ may be −∞ in a row: that row has no obstacle, and p_i = 0 must hold there.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from functools import lru_cache
from typing import Any

import numpy as np
import scipy.sparse as sp

from .arrays import Vector, as_array, as_csr, as_vector, freeze
from .errors import InputError, MapError


class Map(ABC):
    """ψ: Rⁿ → (R ∪ {−∞})ⁿ. What every map can tell.

    `value(z)` is ψ(z); `jacobian(z)` an element of the generalised Jacobian, or None where it is not known;
    `lipschitz` a matrix G ≥ 0 with |ψ(x) − ψ(y)| ≤ G|x − y| componentwise, or None where none is known.
    Maps are made without a length; `ICP` binds them to its own.

    >>> Affine([[0, 0.5], [0.5, 0]], 1).bind(2).value(np.array([2.0, 4.0]))
    array([3., 2.])
    """

    #: the CSR matrix G, or None
    lipschitz: sp.csr_array | None = None
    #: whether ψ's values come from a user's code, so that nothing is known of their rounding errors
    at_users_word: bool = False

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self.__dict__:
            raise AttributeError(f"a map never changes; make a new one instead of setting {name}")
        super().__setattr__(name, value)

    @abstractmethod
    def bind(self, n: int) -> Map:
        """The same map for vectors of length `n`: numbers broadcast, shapes checked.

        Raises InputError where the map's own data has another length.

        >>> Constant(1).bind(2).c
        array([1., 1.])
        """

    @abstractmethod
    def value(self, z: Vector) -> Vector:
        """ψ(z), shape (n,), for `z` of shape (n,). Raises MapError where a user's function fails.

        >>> Constant(1).bind(2).value(np.zeros(2))
        array([1., 1.])
        """

    @abstractmethod
    def jacobian(self, z: Vector) -> sp.csr_array | None:
        """An element of the generalised Jacobian of ψ at `z` (n × n, CSR), or None where it is not known.

        >>> Constant(1).bind(2).jacobian(np.zeros(2)).nnz
        0
        """

    def change(self, delta: Vector) -> Vector | None:
        """A bound on |ψ(x) − ψ(y)| for all x, y with |x − y| ≤ `delta`, shape (n,); None where none is known.

        Gδ, rounded up.

        >>> bool(Affine([[0.5]]).bind(1).change(np.array([2.0]))[0] >= 1.0)
        True
        """
        G = self.lipschitz
        if G is None:
            return None
        k = np.diff(G.indptr) + 2
        with np.errstate(over="ignore"):
            result: Vector = (G @ delta) * (1 + 2 * k * 2.0**-53) + k * 2.0**-1074
        return result


class Constant(Map):
    """ψ(z) = c: an obstacle that does not move.

    Parameters: `c` a number or a vector of shape (n,), in the units of z; −inf means no obstacle in that row.

    >>> Constant([0, 1]).bind(2).value(np.array([5.0, 5.0]))
    array([0., 1.])
    """

    def __init__(self, c: Any) -> None:
        self.c = as_vector(c, None if np.ndim(c) else 1, "psi", infinite=-np.inf)
        self._is_number = np.ndim(c) == 0

    def bind(self, n: int) -> Constant:
        """See `Map.bind`."""
        bound = object.__new__(Constant)
        bound.c = np.full(n, self.c[0]) if self._is_number else as_vector(self.c, n, "psi", infinite=-np.inf)
        bound._is_number = False
        bound.c.flags.writeable = False
        bound.lipschitz = _zero(n)
        return bound

    def value(self, z: Vector) -> Vector:
        """See `Map.value`."""
        return self.c

    def jacobian(self, z: Vector) -> sp.csr_array:
        """Zero: see `Map.jacobian`."""
        return _zero(z.size)

    def __repr__(self) -> str:
        low, high = self.c.min(), self.c.max()
        return f"Constant({low:g})" if low == high else f"Constant({low:g} ... {high:g})"


class Affine(Map):
    """ψ(z) = Gz + c. Its Lipschitz matrix is |G|.

    Parameters: `G` dense or sparse, shape (n, n); `c` a number or a vector of shape (n,), −inf for no obstacle.

    >>> Affine([[0, 1], [0, 0]], [1, 2]).bind(2).value(np.array([3.0, 4.0]))
    array([5., 2.])
    """

    def __init__(self, G: Any, c: Any = 0.0) -> None:
        self.G = as_csr(G, "psi.G")
        n = self.G.shape[0]
        self.c = as_vector(c, n, "psi.c", infinite=-np.inf)
        self.c.flags.writeable = False
        self.lipschitz = freeze(abs(self.G))

    def bind(self, n: int) -> Affine:
        """See `Map.bind`."""
        if self.G.shape[0] != n:
            raise InputError(f"psi.G has shape {self.G.shape}; shape ({n}, {n}) was expected")
        return self

    def value(self, z: Vector) -> Vector:
        """See `Map.value`."""
        return self.G @ z + self.c

    def jacobian(self, z: Vector) -> sp.csr_array:
        """G: see `Map.jacobian`."""
        return self.G

    def __repr__(self) -> str:
        return f"Affine(G with {self.G.nnz} entries)"


class Elementwise(Map):
    """ψ_i(z) = f(z_i) + c_i: every row's obstacle moves with its own unknown.

    Parameters: `f` a function of an array of shape (n,), applied entry by entry (NumPy style), or a scalar function
    compiled with `numba.njit`, which then runs inside the compiled sweeps; `derivative` of f, in the same style;
    `lipschitz` a number or vector ℓ ≥ 0 with |f(s) − f(t)| ≤ ℓ_i|s − t|; `c` a number or vector of shape (n,).
    The Lipschitz matrix is diag(ℓ).

    >>> psi = Elementwise(lambda z: 0.3 * np.sin(z), lambda z: 0.3 * np.cos(z), lipschitz=0.3, c=1.0).bind(2)
    >>> psi.value(np.zeros(2))
    array([1., 1.])
    >>> psi.jacobian(np.zeros(2)).diagonal()
    array([0.3, 0.3])
    """

    at_users_word = True

    def __init__(
        self,
        f: Callable[[Any], Any],
        derivative: Callable[[Any], Any] | None = None,
        lipschitz: Any = None,
        c: Any = 0.0,
    ) -> None:
        self.f = _callable(f, "psi.f")
        self.derivative = None if derivative is None else _callable(derivative, "psi.derivative")
        self.given_lipschitz = lipschitz
        self.c = c
        if is_compiled(f) is not is_compiled(derivative) and derivative is not None:
            raise InputError("psi.f and psi.derivative: both or neither must be compiled with numba.njit")

    def bind(self, n: int) -> Elementwise:
        """See `Map.bind`."""
        c = as_vector(self.c, n, "psi.c", infinite=-np.inf)
        c.flags.writeable = False
        bound = Elementwise(self.f, self.derivative, self.given_lipschitz, c)
        if self.given_lipschitz is not None:
            bound.lipschitz = freeze(sp.diags_array(_nonnegative(self.given_lipschitz, n)).tocsr())
        return bound

    def value(self, z: Vector) -> Vector:
        """See `Map.value`."""
        return self._entrywise(self.f, z, "psi.f") + self.c

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        """diag(f′(z)), or None without `derivative`: see `Map.jacobian`."""
        slopes = self.slopes(z)
        return None if slopes is None else sp.diags_array(slopes).tocsr()

    def slopes(self, z: Vector) -> Vector | None:
        """f′(z), shape (n,), or None without `derivative`. Raises MapError where the user's function fails."""
        return None if self.derivative is None else self._entrywise(self.derivative, z, "psi.derivative")

    def _entrywise(self, f: Callable[[Any], Any], z: Vector, name: str) -> Vector:
        if is_compiled(f):
            from .kernels.user import entrywise  # loads numba

            return call_user(lambda: entrywise(f)(z), z.shape, name)
        return call_user(lambda: f(z.copy()), z.shape, name)

    def __repr__(self) -> str:
        return f"Elementwise({getattr(self.f, '__name__', 'f')})"


class Function(Map):
    """ψ given by a Python function of the whole vector.

    Parameters: `fun` maps shape (n,) to shape (n,); `jacobian`, if known, maps z to an element of the generalised
    Jacobian, shape (n, n), dense or sparse; `lipschitz`, if known, the matrix G ≥ 0, shape (n, n), or a number or
    vector that stands for diag(ℓ) and thus says that ψ_i depends on z_i only.

    >>> psi = Function(lambda z: 0.5 * z[::-1], lipschitz=[[0, 0.5], [0.5, 0]]).bind(2)
    >>> psi.value(np.array([2.0, 4.0]))
    array([2., 1.])
    """

    at_users_word = True

    def __init__(
        self,
        fun: Callable[[Vector], Any],
        jacobian: Callable[[Vector], Any] | None = None,
        lipschitz: Any = None,
    ) -> None:
        self.fun = _callable(fun, "psi")
        self.derivative = None if jacobian is None else _callable(jacobian, "psi.jacobian")
        self.given_lipschitz = lipschitz

    def bind(self, n: int) -> Function:
        """See `Map.bind`."""
        bound = Function(self.fun, self.derivative, self.given_lipschitz)
        if self.given_lipschitz is None:
            return bound
        if sp.issparse(self.given_lipschitz) or np.ndim(self.given_lipschitz) == 2:
            G = as_csr(self.given_lipschitz, "psi.lipschitz", n)
            if (G.data < 0).any():
                raise InputError(f"psi.lipschitz has the entry {G.data.min()}; entries >= 0 were expected")
            bound.lipschitz = G
        else:
            bound.lipschitz = freeze(sp.diags_array(_nonnegative(self.given_lipschitz, n)).tocsr())
        return bound

    def value(self, z: Vector) -> Vector:
        """See `Map.value`."""
        return call_user(lambda: self.fun(z.copy()), z.shape, "psi")

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        """The user's Jacobian, checked, or None: see `Map.jacobian`. Raises MapError where it is no such matrix."""
        if self.derivative is None:
            return None
        derivative = self.derivative
        matrix = raising_map_error(lambda: derivative(z.copy()), "psi.jacobian")
        try:
            return as_csr(matrix, "psi.jacobian(z)", z.size)
        except InputError as error:
            raise MapError(str(error)) from None

    def __repr__(self) -> str:
        return f"Function({getattr(self.fun, '__name__', 'psi')})"


def as_map(psi: Any, n: int) -> Map:
    """Whatever a user may give as ψ, as a `Map` for vectors of length `n`.

    Parameters: `psi` a `Map`, a number, a vector of shape (n,), or a callable z ↦ ψ(z).
    Raises InputError where it is none of these.

    >>> as_map(0, 2)
    Constant(0)
    """
    if type(psi) is float and psi == 0.0:
        return _at_zero(n)
    if isinstance(psi, Map):
        return psi.bind(n)
    if callable(psi):
        return Function(psi).bind(n)
    if isinstance(psi, str) or psi is None:
        raise InputError(f"psi is {psi!r}; a number, a vector, a callable or one of icpmodel's maps was expected")
    return Constant(psi).bind(n)


def is_compiled(f: object) -> bool:
    """Whether `f` was compiled with `numba.njit`. Does not import numba.

    >>> is_compiled(np.sin)
    False
    """
    return hasattr(f, "py_func") and hasattr(f, "nopython_signatures")


@lru_cache(maxsize=2)
def _zero(n: int) -> sp.csr_array:
    return freeze(sp.csr_array((n, n)))


@lru_cache(maxsize=1)
def _at_zero(n: int) -> Map:
    """ψ = 0, which LCPs of one size share: a map never changes."""
    return Constant(0.0).bind(n)


def _nonnegative(value: Any, n: int) -> Vector:
    vector = as_vector(value, n, "psi.lipschitz")
    if (vector < 0).any():
        raise InputError(f"psi.lipschitz has the entry {vector.min()}; numbers >= 0 were expected")
    return vector


def _callable(f: Any, name: str) -> Callable[..., Any]:
    if not callable(f):
        raise InputError(f"{name} is a {type(f).__name__}; a function was expected")
    return f


def raising_map_error(call: Callable[[], Any], name: str) -> Any:
    """What the user's function returns; what it raises becomes a MapError about `name`.

    >>> raising_map_error(lambda: 1 / 0, "psi")
    Traceback (most recent call last):
    icpmodel.errors.MapError: psi(z) raised ZeroDivisionError: division by zero
    """
    try:
        return call()
    except Exception as error:
        raise MapError(f"{name}(z) raised {type(error).__name__}: {error}") from error


def call_user(call: Callable[[], Any], shape: tuple[int, ...], name: str) -> Vector:
    """What the user's function returns, as float64 of `shape`. NaN passes: the judge sees it.

    Raises MapError where it raises or returns another shape or no real numbers.

    >>> call_user(lambda: [1.0], (2,), "psi")
    Traceback (most recent call last):
    icpmodel.errors.MapError: psi(z) has shape (1,); shape (2,) was expected
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
