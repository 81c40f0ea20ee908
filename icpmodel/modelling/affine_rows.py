"""Rows Zz + Ww(z) + constant, where w are the parts that are not affine, and operations on many of them at once."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics.arrays import Vector, row_of
from ..problem.affine import Affine
from ..problem.differences import steps
from ..problem.function import Function


class AffineRows(NamedTuple):
    """`Z`, `W` and the `constant` of some rows."""

    Z: sp.csr_array
    W: sp.csr_array
    constant: Vector

    def of(self, rows: slice | NDArray[np.intp]) -> AffineRows:
        """These rows, in this order."""
        return AffineRows(self.Z[rows], self.W[rows], self.constant[rows])

    def have_nan(self) -> NDArray[np.bool_]:
        """For each row, whether one of its numbers is NaN."""
        invalid = np.isnan(self.constant)
        for one in (self.Z, self.W):
            invalid[row_of(one)[np.isnan(one.data)]] = True
        return invalid

    def times(self, factor: Vector) -> AffineRows:
        """Row i times factor_i ≠ 0."""
        D = sp.diags_array(factor)
        return AffineRows(sp.csr_array(D @ self.Z), sp.csr_array(D @ self.W), factor * self.constant)

    def plus(self, other: AffineRows) -> AffineRows:
        """The sums, row by row."""
        return AffineRows(self.Z + other.Z, self.W + other.W, self.constant + other.constant)

    def stacked_on(self, other: AffineRows) -> AffineRows:
        """These rows, then those of `other`."""
        Z, W = (sp.vstack(pair, format="csr") for pair in zip(self[:2], other[:2], strict=True))
        return AffineRows(Z, W, np.concatenate([self.constant, other.constant]))

    def replaced(self, rows: NDArray[np.intp], others: AffineRows) -> AffineRows:
        """These rows, in which the `others` take the place of the `rows`."""
        selected = np.arange(self.constant.size)
        selected[rows] = self.constant.size + np.arange(rows.size)
        return self.stacked_on(others).of(selected)

    def wider(self, count: int) -> AffineRows:
        """The same rows of a z with `count` further entries."""
        Z = self.Z.copy()
        Z.resize((Z.shape[0], Z.shape[1] + count))
        return self._replace(Z=Z)

    def constants(self, count: int, value: float) -> AffineRows:
        """`count` rows in the same z and w that are the constant `value`."""
        Z, W = (sp.csr_array((count, one.shape[1])) for one in (self.Z, self.W))
        return AffineRows(Z, W, np.full(count, value))


class SumOfTerms:
    """ψ(z) = Gz + c + Vw(z), where w are functions that are not affine.

    `w` has a `value` and a `jacobian` at z, and a `magnitude`, the sums of the absolute values of its terms. `name` is
    the name of ψ in messages.
    """

    def __init__(self, G: sp.csr_array, c: Vector, V: sp.csr_array, w: Any, name: str) -> None:
        self.__name__ = name
        self.G, self.c, self.V, self.w = G, c, V, w

    def __call__(self, z: Vector) -> Vector:
        """ψ(z). Raises ArithmeticError if an expression has no finite value at `z`."""
        return np.asarray(self.G @ z + self.c + self.V @ self.w.value(z))

    def jacobian(self, z: Vector) -> sp.csr_array:
        """ψ′(z) = G + Vw′(z).

        At the edge of a domain, where w has no finite derivative, that at a point near z is used. Raises
        ArithmeticError if an expression has no gradient there either.
        """
        h = steps(z)
        for near in (z, z + h, z - h):
            with suppress(ArithmeticError):
                of_w = self.w.jacobian(near)
                if np.isfinite(of_w.data).all():
                    return sp.csr_array(self.G + self.V @ of_w)
        return sp.csr_array(self.G + self.V @ self.w.jacobian(z))


def obstacle(
    r: AffineRows, bound: AffineRows | None, nonlinear_map: Callable[[sp.csr_array, Vector, sp.csr_array], Function]
) -> Vector | Affine | Function:
    """The obstacle z − (r − `bound`)/ρ = Gz + c + Vw(z), where None is the bound 0.

    ρ_i > 0 is the coefficient of z_i in r_i. The obstacle is `nonlinear_map`(G, c, V) if V is not 0.
    """
    R, W, constant = r
    scale = R.diagonal()
    with np.errstate(over="ignore"):
        factor = -1.0 / scale
        others = R.indices != row_of(R)
        data = (R.data * factor[row_of(R)])[others]
        c = constant * factor + 0.0
    G = sp.csr_array((data, (row_of(R)[others], R.indices[others])), shape=R.shape)
    V = sp.csr_array(sp.diags_array(factor) @ W)
    if bound is not None:  # an infinite bound makes a constant obstacle
        moves = np.isfinite(bound.constant) & np.isfinite(c)
        ends = bound._replace(constant=np.where(moves, bound.constant, 0.0)).times(1.0 / scale)
        c = np.where(np.isinf(bound.constant), bound.constant, c + ends.constant)
        D = sp.diags_array(moves.astype(np.float64))
        G, V = (sp.csr_array(D @ (one + end)) for one, end in ((G, ends.Z), (V, ends.W)))
        G.eliminate_zeros()
        V.eliminate_zeros()
    if V.nnz:
        return nonlinear_map(G, c, V)
    return Affine(G, c) if G.nnz else c
