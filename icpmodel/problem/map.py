"""The contract of the obstacle map ψ, and the generic methods of every map.

ψ may be −∞ in a row: that row has no obstacle, and p_i = 0 must hold there. A map may also be
the upper obstacle, where +∞ means none. A new kind of ψ is one file with a subclass of `Map` that
has `bind`, `value` and `jacobian`. All other methods have a generic default, which the subclass may
override by a faster one.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics.arrays import Mask, ReadOnly, Vector, as_vector
from ..numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ..numerics.sparse_structure import is_diagonal
from ..present.display import Displayable


class Map(ReadOnly, Displayable, ABC):
    """ψ: Rⁿ → (R ∪ {−∞})ⁿ.

    Maps are made without a length; `ICP` binds them to n unknowns. They never change.

    Attributes
    ----------
    lipschitz : CSR array of shape (n, n) or None
        A matrix G ≥ 0 with |ψ(x) − ψ(y)| ≤ G|x − y| componentwise, None where none is known.

    Notes
    -----
    `value(z)` is ψ(z). `jacobian(z)` is an element of the generalised Jacobian, or None where it is
    not known.

    Examples
    --------
    >>> icp.Affine([[0, 0.5], [0.5, 0]], 1).bind(2).value(np.array([2.0, 4.0]))
    array([3., 2.])
    """

    #: the CSR matrix G, or None
    lipschitz: sp.csr_array | None = None
    #: (G, c) where ψ(z) = Gz + c is known, shapes (n, n) and (n,); else None
    linear: tuple[sp.csr_array, Vector] | None = None
    #: a CSR matrix with an entry wherever ψ_i may depend on z_j, or None where that is not known
    links: sp.csr_array | None = None
    #: the upper obstacle, where this is the lower of two: see `two_sided.TwoSidedObstacle`
    upper: Map | None = None
    #: whether the obstacles are known never to cross: there is one, or both are Gz + c with the same G
    parallel: bool = True
    #: whether ψ does not depend on z
    is_constant: bool = False
    #: whether ψ's values come from a user's code, so that nothing is known of their rounding errors
    calls_user_code: bool = False
    #: whether ψ_i is the best of several values, among which policy iteration chooses
    has_policies: bool = False

    def __setattr__(self, name: str, value: Any) -> None:
        if name in self.__dict__:
            raise AttributeError(f"a map never changes; make a new one instead of setting {name}")
        super().__setattr__(name, value)

    @abstractmethod
    def bind(self, n: int) -> Map:
        """The same map for vectors of length `n`: numbers broadcast, shapes checked.

        Parameters
        ----------
        n : int
            Number of unknowns.

        Returns
        -------
        Map
            The bound map.

        Raises
        ------
        InputError
            Where the map's own data has another length.

        Examples
        --------
        >>> icp.Constant(1).bind(2).c
        array([1., 1.])
        """

    @abstractmethod
    def value(self, z: Vector) -> Vector:
        """ψ(z).

        Parameters
        ----------
        z : array of shape (n,)
            The point.

        Returns
        -------
        array of shape (n,)
            The obstacle at z.

        Raises
        ------
        MapError
            Where a user's function fails.

        Examples
        --------
        >>> icp.Constant(1).bind(2).value(np.zeros(2))
        array([1., 1.])
        """

    @abstractmethod
    def jacobian(self, z: Vector) -> sp.csr_array | None:
        """An element of the generalised Jacobian of ψ.

        Parameters
        ----------
        z : array of shape (n,)
            The point.

        Returns
        -------
        csr_array of shape (n, n) or None
            None where it is not known.

        Examples
        --------
        >>> icp.Constant(1).bind(2).jacobian(np.zeros(2)).nnz
        0
        """

    def no_derivative(self) -> str | None:
        """Why `jacobian` is not known, in one sentence with what to do, or None where it is.

        Examples
        --------
        >>> icp.Function(np.sin).bind(1).no_derivative()
        'psi has no derivative: give `jacobian` to Function, or sparsity=np.ones((n, n)) for differences'
        """
        return None

    def change(self, delta: Vector) -> Vector | None:
        """A bound on |ψ(x) − ψ(y)| for all x, y with |x − y| ≤ delta: Gδ, rounded up.

        Parameters
        ----------
        delta : array of shape (n,)
            The bound of |x − y|, entry by entry.

        Returns
        -------
        array of shape (n,) or None
            None where no bound is known.

        Examples
        --------
        >>> bool(icp.Affine([[0.5]]).bind(1).change(np.array([2.0]))[0] >= 1.0)
        True
        """
        G = self.lipschitz
        if G is None:
            return None
        k = np.diff(G.indptr) + 2
        with np.errstate(over="ignore"):
            result: Vector = (G @ delta) * (1 + 2 * k * UNIT_ROUNDOFF) + k * SMALLEST
        return result

    def isotone(self) -> bool | None:
        """Whether x ≤ y gives ψ(x) ≤ ψ(y), None where that is not known.

        Examples
        --------
        >>> icp.Affine([[-0.5]]).bind(1).isotone()
        False
        """
        return None

    def restricted(self, rows: NDArray[np.intp], z: Vector) -> Map:
        """ψ in some unknowns alone; the others keep their values.

        Parameters
        ----------
        rows : array of int
            The unknowns, ascending.
        z : array of shape (n,)
            The values of all others.

        Returns
        -------
        Map
            A map in len(rows) unknowns.

        Examples
        --------
        >>> psi = icp.Affine([[0, 0.5], [0.5, 0]]).bind(2)
        >>> psi.restricted(np.array([0]), np.array([0.0, 4.0])).value(np.zeros(1))
        array([2.])
        """
        others = z.copy()
        others[rows] = 0.0
        into = sp.csr_array((np.ones(rows.size), (rows, np.arange(rows.size))), shape=(z.size, rows.size))
        return self.composed(into, others, rows)

    def composed(self, P: sp.csr_array, shift: Any = 0.0, rows: Any = slice(None), factor: float = 1.0) -> Map:
        """y ↦ t·ψ(Py + s) in some rows: ψ on a coarser level, or in other units.

        Parameters
        ----------
        P : CSR array of shape (n, m)
            The matrix.
        shift : array of shape (n,) or 0
            The vector s.
        rows : array of int, optional
            The m rows that are kept; by default all.
        factor : float, default 1
            The factor t > 0.

        Returns
        -------
        Map
            The map for vectors of length m.

        Examples
        --------
        >>> P = sp.csr_array([[1.0], [0.5]])
        >>> icp.Constant([1, 2]).bind(2).composed(P, np.zeros(2), np.array([1])).c
        array([2.])
        """
        return ComposedMap(self, P, shift, rows, factor)

    def as_upper(self) -> Map:
        """The same map as an upper obstacle, where +∞ means none.

        Returns
        -------
        Map
            The map.

        Examples
        --------
        >>> icp.Constant(3).bind(1).as_upper().c
        array([3.])
        """
        return self

    def data_change(self, z: Vector, change: Any, name: str) -> tuple[sp.csr_array | None, Vector]:
        """(H, d): where ψ's own data change by `change`, ψ changes by Hz + d, to first order.

        Parameters
        ----------
        z : array of shape (n,)
            The point.
        change : float or array_like of shape (n,)
            The change of the data; by default the data are the values ψ(z).
        name : str
            Name of the argument in messages.

        Returns
        -------
        tuple
            H, None for 0, and d of shape (n,).

        Raises
        ------
        InputError
            For a `change` of another kind.

        Examples
        --------
        >>> icp.Constant([1, 2]).bind(2).data_change(np.zeros(2), 3, "dpsi")[1]
        array([3., 3.])
        """
        return None, as_vector(change, z.size, name)

    def data_gradient(self, z: Vector, weight: Vector) -> Any:
        """The gradient of wᵀψ(z) with respect to ψ's own data, at fixed z.

        Parameters
        ----------
        z : array of shape (n,)
            The point.
        weight : array of shape (n,)
            w.

        Returns
        -------
        object
            In the form of the data. By default these are the values of ψ, and the gradient is w.

        Examples
        --------
        >>> icp.Affine([[0.5]]).bind(1).data_gradient(np.array([3.0]), np.ones(1)).G.toarray()
        array([[3.]])
        """
        return weight

    def nonsmooth_rows(self, z: Vector, delta: Vector) -> Mask:
        """Rows in which ψ may have another derivative at an x with |x − z| ≤ `delta`.

        A user's function is taken to be smooth.

        Parameters
        ----------
        z, delta : array of shape (n,)
            The point and the distance.

        Returns
        -------
        mask of shape (n,)
            The rows that are not known, or assumed, to be smooth.

        Examples
        --------
        >>> jumps = sp.csr_array([[0.0, 1.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        >>> icp.Intervention(jumps).bind(3).nonsmooth_rows(np.zeros(3), np.zeros(3))
        array([ True, False, False])
        """
        return np.zeros(z.size, dtype=np.bool_)

    def directional_derivative(self, z: Vector, delta: Vector, change: Any, name: str) -> Map | None:
        """The directional derivative d ↦ lim (ψ_t(z + td) − ψ(z))/t as t ↓ 0, where it is not linear.

        ψ_t has its own data changed by t · `change`.

        Parameters
        ----------
        z, delta : array of shape (n,)
            The point, and the distance within which values count as equal.
        change : optional
            The change of the data, as for `data_change`.
        name : str
            Name of the argument in messages.

        Returns
        -------
        Map or None
            The derivative where ψ has `nonsmooth_rows` at z, else None.

        Raises
        ------
        InputError
            For a `change` of another kind.

        Examples
        --------
        >>> jumps = sp.csr_array([[0.0, 1.0, 1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        >>> psi = icp.Intervention(jumps).bind(3)
        >>> slope = psi.directional_derivative(np.zeros(3), np.zeros(3), 0.0, "dpsi")
        >>> slope.value(np.array([0.0, -2.0, 4.0]))[0]
        np.float64(4.0)
        """
        return None

    def describe(self) -> str:
        """Describe in one sentence what is known of ψ.

        Returns
        -------
        str
            The sentence.

        Examples
        --------
        >>> print(icp.Constant(1).bind(2).describe())
        constant: G = 0
        """
        G = self.lipschitz
        if G is None:
            return f"{self!r}: no Lipschitz matrix is known"
        slope = float(np.asarray(G.sum(axis=1)).max())
        diagonal = "; each row depends on its own unknown only" if is_diagonal(G) else ""
        word = " (at the user's word)" if self.calls_user_code else ""
        return f"{self!r}: Lipschitz matrix G with {G.nnz} entries, largest row sum {slope:.6g}{word}{diagonal}"


class ComposedMap(Map):
    """y ↦ t·ψ(Py + s) in some rows, see `Map.composed`."""

    def __init__(self, psi: Map, P: sp.csr_array, shift: Any, rows: Any, factor: float) -> None:
        self.psi = psi
        self.P = P
        self.shift = shift
        self.rows = rows
        self.factor = factor
        self.calls_user_code = psi.calls_user_code

    def bind(self, n: int) -> ComposedMap:
        return self

    def value(self, z: Vector) -> Vector:
        value: Vector = self.factor * self.psi.value(self.P @ z + self.shift)[self.rows]
        return value

    def jacobian(self, z: Vector) -> sp.csr_array | None:
        return self._chain_rule(self.psi.jacobian(self.P @ z + self.shift), self.P)

    def no_derivative(self) -> str | None:
        return self.psi.no_derivative()

    @cached_property
    def lipschitz(self) -> sp.csr_array | None:  # type: ignore[override]
        return self._chain_rule(self.psi.lipschitz, abs(self.P))

    def _chain_rule(self, matrix: sp.csr_array | None, P: sp.csr_array) -> sp.csr_array | None:
        return None if matrix is None else sp.csr_array(self.factor * (matrix[self.rows] @ P))

    def composed(self, P: sp.csr_array, shift: Any = 0.0, rows: Any = slice(None), factor: float = 1.0) -> Map:
        # so that ψ is evaluated once, however many levels there are
        selected = np.arange(self.P.shape[0])[self.rows][rows]
        inner = self.P @ np.broadcast_to(shift, P.shape[:1]) + self.shift
        return ComposedMap(self.psi, self.P @ P, inner, selected, factor * self.factor)

    def __repr__(self) -> str:
        return f"ComposedMap({self.psi!r})"
