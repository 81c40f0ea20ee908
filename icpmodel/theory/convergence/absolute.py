"""|X⁻¹|w for w ≥ 0, bounded from above and below with rounding included."""

from __future__ import annotations

import contextlib
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...algebra.splittings import Given
from ...errors import SingularOperator
from ...numerics.arrays import Vector, row_of
from ...numerics.equilibration import equilibrated, in_units
from ...numerics.factorisation import factorise
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ..matrices.comparison_matrix import comparison_matrix

#: up to this n the inverse of an X that is no M-matrix is computed densely, and so is known from both sides
DENSE = 300


def absolute_inverse(X: sp.csr_array, size: sp.csr_array | None = None) -> Comparison | Dense:
    """The best that is known of |X⁻¹|.

    |X⁻¹| ≤ ⟨X⟩⁻¹ for an H-matrix, with equality for an M-matrix; for other X with n ≤ 300 a computed inverse R and
    |X⁻¹ − R| ≤ |E|(I − |E|)⁻¹|R|, E = I − RX. X itself is known to a few units of roundoff of `size`, default |X|.
    Reference: Berman and Plemmons (1979), chapter 6; Neumaier, Interval Methods (1990), section 3.7.
    """
    size = sp.csr_array(abs(X)) if size is None else size
    comparison = Comparison(X, size)
    if X.shape[0] > DENSE or (comparison.exact and np.isfinite(comparison.upper(X.diagonal())).all()):
        return comparison
    return Dense.of(X, size) or comparison


def slack(size: sp.csr_array, v: Vector) -> Vector:
    """More than the rounding errors of a product with `v` of a matrix of at most 2·`size`, and of making it.

    8k(u·`size`|v| + 2⁻¹⁰⁷⁴), k eight more than the entries of the longest row; the second term is for underflow and
    asks for |v| ≤ 1.
    Reference: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.5.
    """
    k = int(np.diff(size.indptr).max()) + 8
    result: Vector = 8 * k * UNIT_ROUNDOFF * (size @ np.abs(v)) + 8 * k * SMALLEST
    return result


class Comparison:
    """|X⁻¹| ≤ ⟨X⟩⁻¹ by substitution or one factorisation; `exact`, `lower` and `upper` meet, where X = ⟨X⟩.

    y ≥ ⟨X⟩⁻¹w is proved by ⟨X⟩y ≥ w > 0, y > 0, which also proves that ⟨X⟩ is an M-matrix.
    """

    def __init__(self, X: sp.csr_array, size: sp.csr_array) -> None:
        self._C, self._size = comparison_matrix(X), size
        self.exact = bool((self._C.data == X.data).all())
        #: the last y > 0 with ⟨X⟩y > 0 that was found
        self._proof: Vector | None = None
        self._solve: Any = None
        with contextlib.suppress(SingularOperator):
            self._solve = Given(self._C).operator(self._C, np.zeros(X.shape[0])).solve

    def upper(self, w: Vector) -> Vector:
        """y ≥ |X⁻¹|w for `w` > 0, entry by entry; +inf where nothing is proved."""
        unknown = np.full(w.size, np.inf)
        if self._solve is None or not np.isfinite(w).all():
            return unknown
        more = slack(self._size, self._solve(w))
        for _ in range(3):
            y = self._solve(w + 2 * more)
            if not (np.isfinite(y).all() and (y > 0).all()):
                break
            if (self._C @ y - slack(self._size, y) >= w).all():
                self._proof = y
                return y
            more = 100 * more
        return unknown

    def lower(self, w: Vector) -> Vector:
        """0 ≤ y ≤ |X⁻¹|w for `w` ≥ 0; zero where nothing is proved. What `upper` found before helps."""
        if not self.exact or self._proof is None or not w.any():
            return np.zeros(w.size)
        # y with ⟨X⟩y ≤ w lies below ⟨X⟩⁻¹w whatever its signs; a little of the proof brings it below where w = 0
        y = self._solve(w)
        little = 2.0**-50 * float((y / self._proof)[w > 0].min())
        y = self._solve(w - 2 * slack(self._size, y)) - little * self._proof
        good = np.isfinite(y).all() and (self._C @ y + slack(self._size, y) <= w).all()
        return np.maximum(y, 0.0) if good else np.zeros(w.size)

    def resolvent(self, mu: float, F: sp.csr_array, v: Vector) -> Vector | None:
        """About (μI − |X⁻¹|F)⁻¹v, F ≥ 0, by (μ⟨X⟩ − F)y = ⟨X⟩v, without any proof; None where that is singular."""
        lu = factorise(sp.csr_array(mu * self._C - F))
        return None if lu is None else lu.solve(self._C @ v)


class Dense:
    """`below` ≤ |X⁻¹| ≤ `above`, dense, shape (n, n)."""

    exact = True

    def __init__(self, below: Any, above: Any) -> None:
        self._below, self._above = below, above

    @classmethod
    def of(cls, X: sp.csr_array, size: sp.csr_array) -> Dense | None:
        """The inverse of `X` (CSR, shape (n, n)) with a bound on its error, or None where it is too ill conditioned."""
        n, errstate = X.shape[0], np.errstate(all="ignore")
        with errstate:
            # so that units cost no accuracy
            S, rows, columns = equilibrated(size.toarray())
            Y = in_units(X.toarray(), rows, columns)
            try:
                R = np.linalg.inv(Y)
            except np.linalg.LinAlgError:
                return None
            absolute = np.abs(R)
            defect = np.abs(np.eye(n) - R @ Y) + 8 * (n + 8) * UNIT_ROUNDOFF * (absolute @ S + np.eye(n))
            e = float(defect.sum(axis=1).max()) * (1 + n * 4 * UNIT_ROUNDOFF)
            if not e < 0.5:
                return None
            error = absolute.max(axis=0) * (e / (1 - e)) * (1 + 8 * UNIT_ROUNDOFF)
            below = in_units(np.maximum(absolute - error, 0.0), columns, rows)
            above = in_units(absolute + error, columns, rows)
        return cls(below, above) if np.isfinite(above).all() else None

    def upper(self, w: Vector) -> Vector:
        y: Vector = (self._above @ w) * (1 + 4 * (w.size + 8) * UNIT_ROUNDOFF) + (w.size + 2) * SMALLEST
        return y

    def lower(self, w: Vector) -> Vector:
        y: Vector = (self._below @ w) * (1 - 4 * (w.size + 8) * UNIT_ROUNDOFF) - (w.size + 2) * SMALLEST
        return np.maximum(y, 0.0)

    def resolvent(self, mu: float, F: sp.csr_array, v: Vector) -> Vector | None:
        try:
            return np.linalg.solve(mu * np.eye(v.size) - self._above @ F, v)
        except np.linalg.LinAlgError:
            return None


def is_diagonal(matrix: sp.csr_array) -> bool:
    """Whether every nonzero entry of `matrix` (CSR) is on its diagonal."""
    return bool((matrix.data[matrix.indices != row_of(matrix)] == 0).all())
