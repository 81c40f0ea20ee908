"""Proved bounds, from both sides, on |X⁻¹|w for w ≥ 0 and the spectral radius of v ↦ |X⁻¹| max_k F_k v, all F_k ≥ 0."""

from __future__ import annotations

import contextlib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Any, NamedTuple, Protocol

import numpy as np
import scipy.sparse as sp

from ...algebra.splittings import UserSplitting
from ...errors import OutOfTime, SingularOperator
from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.equilibration import equilibrated, in_units, times_rows
from ...numerics.factorisation import factorise
from ...numerics.fill import dense_cost
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ..matrices.comparison_matrix import comparison_matrix

#: up to this n the inverse of an X that is no M-matrix is computed densely, and so is bounded from both sides
_DENSE_UP_TO = 300
#: up to this number of entries Noda's steps are made, a factorisation each; entries that all power steps may read
_MAX_FACTORISED_ENTRIES = 200_000
_MAX_READ_ENTRIES = 400_000_000
_MIN_GAIN = 0.01  #: a gain of this share of the distance to 1 (or to 0) is worth another step


def absolute_inverse(X: sp.csr_array, size: sp.csr_array) -> ComparisonInverse | DenseInverse:
    """The best available bounds on |X⁻¹|.

    For an H-matrix |X⁻¹| ≤ ⟨X⟩⁻¹, with equality for an M-matrix. For other X with n ≤ 300 an
    inverse R is computed, and |X⁻¹ − R| ≤ |E|(I − |E|)⁻¹|R|, E = I − RX. X itself is known to a few
    units of roundoff of `size`.

    References
    ----------
    Berman and Plemmons (1979), chapter 6. Neumaier, Interval Methods (1990), section 3.7.
    """
    comparison = ComparisonInverse(X, size)
    if X.shape[0] > _DENSE_UP_TO or (comparison.exact and np.isfinite(comparison.upper(X.diagonal())).all()):
        return comparison
    return DenseInverse.of(X, size) or comparison


def rounding_bound(size: sp.csr_array, v: Vector) -> Vector:
    """A bound on the rounding errors of a product with `v` of a matrix of at most 2·`size`, assembly included.

    8k(u·`size`|v| + 2⁻¹⁰⁷⁴), k the number of entries of the longest row plus 8. The second term covers underflow if
    |v| ≤ 1.
    Reference: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.5.
    """
    k = int(np.diff(size.indptr).max()) + 8
    return 8 * k * UNIT_ROUNDOFF * (size @ np.abs(v)) + 8 * k * SMALLEST


class ComparisonInverse:
    """|X⁻¹| ≤ ⟨X⟩⁻¹ by substitution or one factorisation; `exact` if X = ⟨X⟩, where both sides are equal.

    y ≥ ⟨X⟩⁻¹w is proved by ⟨X⟩y ≥ w > 0, y > 0, which also proves that ⟨X⟩ is an M-matrix.
    """

    def __init__(self, X: sp.csr_array, size: sp.csr_array) -> None:
        self._C, self._size = comparison_matrix(X), size
        self.exact = bool((self._C.data == X.data).all())
        self._is_m_matrix = False  # not known: no y > 0 with ⟨X⟩y > 0 was found yet
        self._solve: Any = None
        with contextlib.suppress(SingularOperator):
            self._solve = UserSplitting(self._C).operator(self._C, np.zeros(X.shape[0])).solve

    def upper(self, w: Vector) -> Vector:
        """y ≥ |X⁻¹|w for `w` > 0, entry by entry; +inf where nothing is proved."""
        unknown = np.full(w.size, np.inf)
        if self._solve is None or not np.isfinite(w).all():
            return unknown
        y = self._solve(w + 2 * rounding_bound(self._size, self._solve(w)))
        if not ((y > 0).all() and np.isfinite(y).all() and (self._C @ y - rounding_bound(self._size, y) >= w).all()):
            return unknown
        self._is_m_matrix = True
        return y

    def lower(self, w: Vector) -> Vector:
        """0 ≤ y ≤ |X⁻¹|w for `w` ≥ 0; zero where nothing is proved, and before `upper` has proved anything."""
        if not self.exact or not self._is_m_matrix:
            return np.zeros(w.size)
        # y with ⟨X⟩y ≤ w lies below ⟨X⟩⁻¹w whatever its signs
        y = self._solve(w - 2 * rounding_bound(self._size, self._solve(w)))
        good = np.isfinite(y).all() and (self._C @ y + rounding_bound(self._size, y) <= w).all()
        return np.maximum(y, 0.0) if good else np.zeros(w.size)

    def resolvent(self, mu: float, F: sp.csr_array, v: Vector) -> Vector | None:
        """About (μI − |X⁻¹|F)⁻¹v, F ≥ 0, by (μ⟨X⟩ − F)y = ⟨X⟩v, not proved; None if that is singular."""
        lu = factorise(sp.csr_array(mu * self._C - F))
        return None if lu is None else lu.solve(self._C @ v)


@dataclass(frozen=True, eq=False)
class DenseInverse:
    """`below` ≤ |X⁻¹| ≤ `above`, dense, shape (n, n)."""

    below: Any
    above: Any

    @classmethod
    def of(cls, X: sp.csr_array, size: sp.csr_array) -> DenseInverse | None:
        """Bounds from a computed inverse of `X` (CSR, shape (n, n)) and its error; None if X is too ill conditioned."""
        n = X.shape[0]
        work.charge(4 * dense_cost(n))
        with np.errstate(all="ignore"):
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
        return (self.above @ w) * (1 + 4 * (w.size + 8) * UNIT_ROUNDOFF) + (w.size + 2) * SMALLEST

    def lower(self, w: Vector) -> Vector:
        y = (self.below @ w) * (1 - 4 * (w.size + 8) * UNIT_ROUNDOFF) - (w.size + 2) * SMALLEST
        return np.maximum(y, 0.0)

    def resolvent(self, mu: float, F: sp.csr_array, v: Vector) -> Vector | None:
        work.charge(3 * dense_cost(v.size))
        try:
            return np.linalg.solve(mu * np.eye(v.size) - self.above @ F, v)
        except np.linalg.LinAlgError:
            return None


class HomogeneousMap(Protocol):
    """T ≥ 0 on v ≥ 0, monotone, positively homogeneous, and bounded from both sides; `limit` as in `MonotoneMap`."""

    @property
    def limit(self) -> float: ...

    @property
    def entries(self) -> int:
        """How many matrix entries one evaluation reads; solves with X and sweeps charge their own cost."""

    def upper(self, v: Vector) -> Vector:
        """At least T(`v`), entry by entry, for `v` > 0 of shape (n,)."""

    def lower(self, v: Vector) -> Vector:
        """At most T(`v`), entry by entry, for `v` ≥ 0 of shape (n,); zero where nothing is known."""

    def resolvent(self, mu: float, v: Vector) -> Vector | None:
        """About (μI − T_v)⁻¹v, T_v the linear map equal to T at `v`: a step of Noda's iteration; None if singular."""


@dataclass(frozen=True, eq=False)
class MonotoneMap:
    """T(v) = |X⁻¹| max_k F_k v, the maximum entry by entry.

    `inverse` is |X⁻¹|, `parts` are the F_k ≥ 0 (CSR, shape (n, n)), `size` a matrix ≥ F_k/2 of which the F_k are known
    to a few units of roundoff. A theorem states its condition ρ(T) < 1 as `limit`·ρ(T) < `limit`.
    """

    inverse: ComparisonInverse | DenseInverse
    parts: tuple[sp.csr_array, ...]
    size: sp.csr_array
    limit: float = 1.0

    @property
    def entries(self) -> int:
        return int(self.size.nnz) * (2 + len(self.parts))

    def upper(self, v: Vector) -> Vector:
        return self.inverse.upper(self._largest(v) + rounding_bound(self.size, v))

    def lower(self, v: Vector) -> Vector:
        return self.inverse.lower(np.maximum(self._largest(v) - rounding_bound(self.size, v), 0.0))

    def resolvent(self, mu: float, v: Vector) -> Vector | None:
        choice = np.array([F @ v for F in self.parts]).argmax(axis=0)
        picked = (times_rows((choice == k).astype(float), F) for k, F in enumerate(self.parts))
        return self.inverse.resolvent(mu, sum(picked), v)

    def _largest(self, v: Vector) -> Vector:
        return np.asarray([F @ v for F in self.parts]).max(axis=0)


class Radius(NamedTuple):
    """ρ(T) ≤ `upper` = max_i T(v)_i/v_i with `v` > 0, both proved, or infinite and None; `holds` whether ρ(T) < 1."""

    upper: float = np.inf
    v: Any = None
    holds: bool | None = None


def radius(T: HomogeneousMap, starts: Iterable[Vector], target: float = 0.0) -> Radius:
    """Bounds on the spectral radius of `T` by Collatz–Wielandt quotients.

    Parameters
    ----------
    T : HomogeneousMap
        The monotone, homogeneous map.
    starts : iterable of arrays of shape (n,)
        Candidates for v. They are read only until one gives a quotient below 1.
    target : float, default 0
        The iteration ends once the upper bound is below it: 1 if only `holds` is needed.

    Returns
    -------
    Radius
        The bounds.

    Raises
    ------
    OutOfTime
        Where the work limit is reached before anything is decided.

    Notes
    -----
    Every v > 0 gives ρ(T) ≤ max_i T(v)_i/v_i. ρ(T) < 1 if and only if some v > 0 has T(v) < v.
    Every v ≥ 0, v ≠ 0 with T(v) ≥ v where v > 0 gives ρ(T) ≥ 1.

    Where a sparse factorisation is cheap, the best of `starts` is improved by Noda's iteration:
    v ← (μI − T_v)⁻¹v, μ = max_i T(v)_i/v_i. It converges quadratically and keeps v > 0. Then the
    steps v ← T(v) + ¼μv follow, which never increase μ. Both stop at the work limit.

    References
    ----------
    Berman and Plemmons, Nonnegative Matrices in the Mathematical Sciences (1979), chapter 2. Noda,
    Numer. Math. 17 (1971). Nussbaum, Linear Algebra Appl. 75 (1986), for maps that are not linear.
    """
    with np.errstate(all="ignore"):
        best = Radius()
        for v in starts:
            best = _improve(T, v, best)
            if best.upper < 1:
                break
        if best.v is None:
            return best
        if T.entries <= _MAX_FACTORISED_ENTRIES:
            best = _noda(T, best, target)
        best, last = _power(T, best, int(np.clip(_MAX_READ_ENTRIES // T.entries, 3, 100)), target)
        if best.upper < 1:
            return best._replace(holds=True)
        if _invariant_part(T, last):
            return best._replace(holds=False)
        work.check_budget(_cost(T))
        return best


def _cost(T: HomogeneousMap) -> float:
    return 2.0 * work.product_cost(0, T.entries)


def _quotient(T: HomogeneousMap, v: Vector) -> tuple[float, Vector]:
    """(max_i T(v)_i/v_i rounded up, T(v)); infinite for a v that is not positive."""
    if not ((v > 0).all() and np.isfinite(v).all()):
        return np.inf, v
    work.count(_cost(T))
    image = T.upper(v)
    return float(np.nextafter((image / v).max(), np.inf)), image


def _improve(T: HomogeneousMap, v: Vector | None, best: Radius) -> Radius:
    if v is None:
        return best
    v = v / np.abs(v).max()
    quotient, _ = _quotient(T, v)
    return Radius(quotient, v) if quotient < best.upper else best


def _worthwhile(before: float, after: float) -> bool:
    return before - after > _MIN_GAIN * min(abs(1.0 - after), after)


def _noda(T: HomogeneousMap, best: Radius, target: float) -> Radius:
    with contextlib.suppress(OutOfTime, MemoryError):
        for _ in range(20):
            if best.upper < target:
                break
            before = best.upper
            best = _improve(T, T.resolvent(before, best.v), best)
            if not _worthwhile(before, best.upper):
                break
    return best


def _power(T: HomogeneousMap, best: Radius, steps: int, target: float) -> tuple[Radius, Vector]:
    """Make power steps while they gain, or until T(v) ≥ v; return the best bound and the last v."""
    v = best.v
    for step in range(steps):
        if best.upper < target or work.nanoseconds_left() < _cost(T):
            break
        before = best.upper
        quotient, image = _quotient(T, v)
        if quotient < before:
            best = Radius(quotient, v)
        is_settled = step and quotient < 1 and not _worthwhile(before, quotient)
        if is_settled or not np.isfinite(quotient) or (image >= v).all():
            break
        v = image + 0.25 * quotient * v
        v = v / v.max()
    return best, v


def _invariant_part(T: HomogeneousMap, v: Vector) -> bool:
    """Whether T(u) ≥ u on the support of some u ≠ 0 that arises from `v` by setting entries that fail to 0."""
    u = v.copy()
    for _ in range(50):
        if work.nanoseconds_left() < _cost(T):
            break
        work.count(_cost(T))
        short = (u > 0) & ~(T.lower(u) >= u)
        if not short.any():
            return bool((u > 0).any())
        u[short] = 0.0
    return False
