"""Friction as physics engines state it: bounds on a row that are multiples of the normal impulse in another row."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import InputError
from ..numerics.arrays import Mask, Vector, as_array, as_vector
from .affine import Affine
from .two_sided import TwoSidedObstacle


class FrictionIndex(TwoSidedObstacle):
    """The obstacles of contact with friction, lo_i ≤ z_i ≤ hi_i or lo_t z_n ≤ z_t ≤ hi_t z_n with n = findex[t].

    Parameters
    ----------
    lo, hi : array_like, shape (n,)
        Bounds of the rows without an index; in the others the coefficients of friction, usually −μ and μ.
    findex : array_like of int, shape (n,)
        The normal row that bounds each row of friction, −1 in all others.

    Raises
    ------
    InputError
        Where a shape, a sign or an index is wrong.

    Examples
    --------
    >>> from icpmodel.problem.friction import FrictionIndex
    >>> psi = FrictionIndex([0, -0.5], [np.inf, 0.5], [-1, 0])
    >>> psi.value(np.array([4.0, 0.0])), psi.upper.value(np.array([4.0, 0.0]))
    (array([ 0., -2.]), array([inf,  2.]))
    """

    def __init__(self, lo: Any, hi: Any, findex: Any) -> None:
        index = as_array(findex, "findex")
        if index.ndim != 1 or index.dtype.kind not in "iu":
            raise InputError(
                f"findex has shape {index.shape} and dtype {index.dtype}; a vector of integers was expected"
            )
        self.n = index.size
        self.low = as_vector(lo, self.n, "lo", infinite=-np.inf)
        self.high = as_vector(hi, self.n, "hi", infinite=np.inf)
        self.findex = index.astype(np.intp)
        self._check()
        super().__init__(self._side(self.low), self._side(self.high))

    def _check(self) -> None:
        findex = self.findex
        low = self.low
        high = self.high
        last = self.n - 1
        if (i := _first((findex < -1) | (findex > last))) is not None:
            raise InputError(f"findex[{i}] is {findex[i]}; -1, or a row 0 ... {last}, was expected")
        friction = self.friction
        if (i := _first(friction & friction[findex])) is not None:
            raise InputError(f"findex[{i}] is {findex[i]}, a row of friction itself; a normal row was expected")
        if (i := _first(friction & (low[findex] < 0.0))) is not None:
            n = findex[i]
            raise InputError(
                f"lo[{n}] is {low[n]}, and row {n} is normal as findex[{i}] says; lo[{n}] >= 0 was expected"
            )
        if (i := _first(friction & ((low > 0.0) | (high < 0.0)))) is not None:
            raise InputError(f"row {i} of friction has lo = {low[i]} and hi = {high[i]}; lo <= 0 <= hi was expected")

    @property
    def friction(self) -> Mask:
        """The mask of the rows of friction, shape (n,)."""
        return np.asarray(self.findex >= 0)

    def _side(self, bounds: Vector) -> Affine:
        rows = np.flatnonzero(self.friction & np.isfinite(bounds))
        G = sp.csr_array((bounds[rows], (rows, self.findex[rows])), shape=(self.n, self.n))
        c = bounds.copy()
        c[rows] = 0.0
        return Affine(G, c)

    def bind(self, n: int) -> FrictionIndex:
        if n != self.n:
            raise InputError(f"findex has shape ({self.n},); shape ({n},) was expected")
        return self

    def __repr__(self) -> str:
        return f"FrictionIndex({int(self.friction.sum())} of {self.n} rows are friction)"


def _first(mask: Mask) -> int | None:
    return int(np.argmax(mask)) if mask.any() else None
