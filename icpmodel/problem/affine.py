"""Constant obstacles, ψ = c, and affine ones, ψ = Gz + c."""

from __future__ import annotations

from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, check_arguments
from ..numerics.arrays import Vector, as_csr, as_vector, axes, freeze, locked, row_of, with_entries
from ..numerics.labels import check_labels
from ..present.display import counted
from .map import Map


@check_arguments
class Constant(Map):
    """ψ(z) = c: an obstacle that does not move.

    Parameters
    ----------
    c : float or array_like of shape (n,)
        The obstacle, in the units of z. −inf means no obstacle in that row; in an upper obstacle +inf does.

    Examples
    --------
    >>> Constant([0, 1]).bind(2).value(np.array([5.0, 5.0]))
    array([0., 1.])
    """

    is_constant = True

    def __init__(self, c: Any) -> None:
        self.index = check_labels({"Constant.c": c})
        self._is_number = axes(c, "Constant.c") == 0
        self.c = as_vector(c, 1 if self._is_number else None, "Constant.c", infinite=np.inf)

    @classmethod
    def of_checked(cls, c: Vector) -> Constant:
        """The obstacle of a valid vector, which is made read-only, but neither checked nor copied.

        Parameters
        ----------
        c : array of shape (n,)
            The obstacle.

        Returns
        -------
        Constant
            Bound to n unknowns.
        """
        bound = object.__new__(cls)
        bound.c = locked(c)
        bound._is_number = False
        bound.lipschitz = zero(c.size)
        bound.linear = bound.lipschitz, bound.c
        return bound

    def bind(self, n: int) -> Constant:
        return Constant.of_checked(
            as_vector(self.c[0] if self._is_number else self.c, n, "Constant.c", infinite=np.inf)
        )

    def value(self, z: Vector) -> Vector:
        return self.c

    def jacobian(self, z: Vector) -> sp.csr_array:
        return zero(z.size)

    def isotone(self) -> bool:
        return True

    def composed(self, P: sp.csr_array, shift: Any = 0.0, rows: Any = slice(None), factor: float = 1.0) -> Map:
        c = factor * self.c[rows]
        return Constant(c).bind(c.size)

    def describe(self) -> str:
        free = int(np.isinf(self.c).sum())
        rows = f"; {counted(free, 'row')} without obstacle" if free else ""
        return f"constant: G = 0{rows}"

    def __repr__(self) -> str:
        low = self.c.min()
        high = self.c.max()
        return f"Constant({low:g})" if low == high else f"Constant({low:g} ... {high:g})"


class AffineData(NamedTuple):
    """The data of an affine ψ, a change of them, or a gradient: `G`, CSR, shape (n, n), and `c`, shape (n,).

    Examples
    --------
    >>> psi = icp.Affine([[0.5]], [1.0]).bind(1)
    >>> psi.data_gradient(np.array([3.0]), np.array([2.0])).c
    array([2.])
    """

    G: sp.csr_array
    c: Vector


class Affine(Map):
    """ψ(z) = Gz + c. Its Lipschitz matrix is |G|.

    Parameters
    ----------
    G : array_like or sparse matrix of shape (n, n)
        The matrix.
    c : float or array_like of shape (n,), default 0
        The constant part. −inf means no obstacle in that row; in an upper obstacle +inf does.

    Examples
    --------
    >>> Affine([[0, 1], [0, 0]], [1, 2]).bind(2).value(np.array([3.0, 4.0]))
    array([5., 2.])
    """

    @check_arguments
    def __init__(self, G: Any, c: Any = 0.0) -> None:
        self.index = check_labels({"Affine.G": G, "Affine.c": c})
        self.G = as_csr(G, "Affine.G")
        n = self.G.shape[0]
        self.c = locked(as_vector(c, n, "Affine.c", infinite=np.inf))
        self.lipschitz = self.links = freeze(abs(self.G))
        self.linear = self.G, self.c

    def bind(self, n: int) -> Affine:
        if self.G.shape[0] != n:
            raise InputError(f"Affine.G has shape {self.G.shape}; shape ({n}, {n}) was expected")
        return self

    def value(self, z: Vector) -> Vector:
        return self.G @ z + self.c

    def jacobian(self, z: Vector) -> sp.csr_array:
        return self.G

    def isotone(self) -> bool:
        return bool((self.G.data >= 0).all())

    def composed(self, P: sp.csr_array, shift: Any = 0.0, rows: Any = slice(None), factor: float = 1.0) -> Map:
        c = self.value(np.broadcast_to(shift, self.c.shape))[rows]
        return Affine(factor * (self.G[rows] @ P), factor * c)

    def data_change(self, z: Vector, change: Any, name: str) -> tuple[sp.csr_array | None, Vector]:
        if not isinstance(change, tuple):
            return super().data_change(z, change, name)
        if len(change) != 2:
            raise InputError(f"{name} has {len(change)} parts; (dG, dc) was expected, or dc alone")
        return as_csr(change[0], f"{name}[0]", z.size), as_vector(change[1], z.size, f"{name}[1]")

    def data_gradient(self, z: Vector, weight: Vector) -> AffineData:
        G = self.G
        return AffineData(with_entries(G, weight[row_of(G)] * z[G.indices]), weight)

    def __repr__(self) -> str:
        return f"Affine(G with {self.G.nnz} entries)"


def vertical_map(B: Any, d: Any, n: int) -> Affine:
    """ψ(z) = z − D⁻¹(Bz + d), D the diagonal of B: see `ProblemData.vertical`."""
    B = as_csr(B, "B", n)
    d = as_vector(d, n, "d", infinite=np.inf)
    if np.isneginf(d).any():
        raise InputError(f"d[{int(np.argmin(d))}] is -inf; a finite number, or inf for no second side, was expected")
    largest = np.maximum(abs(B).max(axis=1).toarray(), np.where(np.isinf(d), 0.0, np.abs(d)))
    positive = B.diagonal() > largest / np.finfo(np.float64).max  # else the quotients overflow
    unit = np.where(positive, B.diagonal(), np.where(largest > 0, largest, 1.0))
    scaled = with_entries(B, B.data / unit[row_of(B)])
    return Affine(sp.eye_array(n) - scaled, -d / unit)


@lru_cache(maxsize=2)
def zero(n: int) -> sp.csr_array:
    """The n × n matrix without entries, which maps of one length share."""
    return freeze(sp.csr_array((n, n)))
