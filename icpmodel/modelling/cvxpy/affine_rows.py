"""Rows Zz + Ww + constant, w being what is not affine in z, and what is done with many of them at once."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics.arrays import Vector


class AffineRows(NamedTuple):
    """`Z`, `W` and the `constant` of some rows."""

    Z: sp.csr_array
    W: sp.csr_array
    constant: Vector

    def of(self, rows: slice | NDArray[np.intp]) -> AffineRows:
        """These rows, in this order."""
        return AffineRows(self.Z[rows], self.W[rows], self.constant[rows])

    def times(self, factor: Vector) -> AffineRows:
        """Row i times factor_i; a row times 0 is 0 whatever it is, and stores nothing."""
        zero = factor == 0
        D = sp.diags_array(factor)
        Z = sp.csr_array(D @ self.Z)
        W = sp.csr_array(D @ self.W)
        if zero.any():
            Z.eliminate_zeros()
            W.eliminate_zeros()
        return AffineRows(Z, W, np.where(zero, 0.0, factor * np.where(zero, 0.0, self.constant)))

    def plus(self, other: AffineRows) -> AffineRows:
        """The sums, row by row."""
        return AffineRows(self.Z + other.Z, self.W + other.W, self.constant + other.constant)

    def above(self, other: AffineRows) -> AffineRows:
        """These rows, then those of `other`."""
        Z, W = (sp.vstack(pair, format="csr") for pair in zip(self[:2], other[:2], strict=True))
        return AffineRows(Z, W, np.concatenate([self.constant, other.constant]))

    def spread(self, rows: NDArray[np.intp], count: int, default: float) -> AffineRows:
        """`count` rows, of which the `rows` are these and the others the constant `default`."""
        S = sp.csr_array((np.ones(rows.size), (rows, np.arange(rows.size))), shape=(count, rows.size))
        constant = np.full(count, default)
        constant[rows] = self.constant
        return AffineRows(sp.csr_array(S @ self.Z), sp.csr_array(S @ self.W), constant)

    def wider(self, count: int) -> AffineRows:
        """The same rows of a z with `count` further entries."""
        Z = self.Z.copy()
        Z.resize((Z.shape[0], Z.shape[1] + count))
        return self._replace(Z=Z)

    def constants(self, count: int, value: float) -> AffineRows:
        """`count` rows in the same z and w that are the constant `value`."""
        nothing = np.zeros(0, dtype=np.intp)
        return self.of(nothing).spread(nothing, count, value)
