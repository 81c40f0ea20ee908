"""The spectral radius of monotone maps v ↦ |X⁻¹| max_k F_k v, bounded from both sides with rounding included."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Vector
from .absolute import Comparison, Dense, slack

#: entries up to which a step costs a factorisation, and entries that all power steps together may read
_FACTORISED, _READ = 200_000, 400_000_000
#: a gain of this share of the distance to 1 (or to 0) is worth another step
_WORTH = 0.01


@dataclass(frozen=True, eq=False)
class MonotoneMap:
    """T(v) = |X⁻¹| max_k F_k v, the maximum entry by entry; monotone and positively homogeneous on v ≥ 0.

    `inverse` is |X⁻¹|, `parts` are the F_k ≥ 0 (CSR, shape (n, n)), `size` a matrix ≥ F_k/2 of which the F_k are known
    to a few units of roundoff.
    """

    inverse: Comparison | Dense
    parts: tuple[sp.csr_array, ...]
    size: sp.csr_array

    def upper(self, v: Vector) -> Vector:
        """At least T(`v`), entry by entry, for `v` > 0 of shape (n,)."""
        return self.inverse.upper(self._largest(v) + slack(self.size, v))

    def lower(self, v: Vector) -> Vector:
        """At most T(`v`), entry by entry, for `v` ≥ 0 of shape (n,); zero where nothing is known."""
        return self.inverse.lower(np.maximum(self._largest(v) - slack(self.size, v), 0.0))

    def steeper(self, mu: float, v: Vector) -> Vector | None:
        """(μI − T_v)⁻¹v with T_v the linear map that T is at `v`: one step of Noda's iteration, unproved."""
        products = np.array([F @ v for F in self.parts])
        choice = products.argmax(axis=0)
        picked = sum(sp.diags_array((choice == k).astype(float)) @ F for k, F in enumerate(self.parts))
        return self.inverse.resolvent(mu, sp.csr_array(picked), v)

    @property
    def entries(self) -> int:
        """How many entries one evaluation reads."""
        return self.size.nnz * (2 + len(self.parts))

    def _largest(self, v: Vector) -> Vector:
        result = self.parts[0] @ v
        for F in self.parts[1:]:
            result = np.maximum(result, F @ v)
        return result


@dataclass(frozen=True, eq=False)
class Radius:
    """ρ(T) ≤ `upper` = max_i T(v)_i/v_i with `v` > 0, both proved; `at_least_one` whether ρ(T) ≥ 1 is proved.

    ρ(T) < 1 exactly if some v > 0 has T(v) < v. `v` is None and `upper` infinite where no bound was found.
    """

    upper: float
    v: Vector | None
    at_least_one: bool

    @property
    def holds(self) -> bool | None:
        """Whether ρ(T) < 1; None where neither that nor the contrary is proved."""
        return True if self.upper < 1 else False if self.at_least_one else None


def radius(T: MonotoneMap, starts: Iterable[Vector]) -> Radius:
    """Bounds on the spectral radius of `T` by Collatz–Wielandt quotients.

    Every v > 0 gives ρ(T) ≤ max_i T(v)_i/v_i; every v ≥ 0, v ≠ 0 with T(v) ≥ v where v > 0 gives ρ(T) ≥ 1. The best
    of `starts` (vectors of shape (n,), asked for only until one gives less than 1) is improved by v ← T(v) + v/4·ρ,
    which never makes the quotient larger, and, where a sparse factorisation is cheap, by Noda's iteration
    v ← (μI − T_v)⁻¹v, μ the quotient, which converges quadratically and keeps v > 0.
    Reference: Berman and Plemmons, Nonnegative Matrices in the Mathematical Sciences (1979), chapter 2; Noda, Numer.
    Math. 17 (1971); Nussbaum, Linear Algebra Appl. 75 (1986), for maps that are not linear.
    """
    with np.errstate(all="ignore"):
        best = Radius(np.inf, None, False)
        for v in starts:
            best = _better(T, v, best)
            if best.upper < 1:
                break
        if T.entries <= _FACTORISED:
            best = _noda(T, best)
        best, last = _power(T, best)
        if best.upper < 1 or best.v is None or last is None:
            return best
        return Radius(best.upper, best.v, _invariant_part(T, last) or _invariant_part(T, best.v))


def _quotient(T: MonotoneMap, v: Vector) -> tuple[float, Vector]:
    """(max_i T(v)_i/v_i rounded up, T(v)); infinite for a v that is not positive."""
    if not ((v > 0).all() and np.isfinite(v).all()):
        return np.inf, v
    image = T.upper(v)
    return float(np.nextafter((image / v).max(), np.inf)), image


def _better(T: MonotoneMap, v: Vector | None, best: Radius) -> Radius:
    if v is None:
        return best
    v = v / np.abs(v).max()
    quotient, _ = _quotient(T, v)
    return Radius(quotient, v, False) if quotient < best.upper else best


def _worthwhile(before: float, after: float) -> bool:
    return before - after > _WORTH * min(abs(1.0 - after), after)


def _noda(T: MonotoneMap, best: Radius) -> Radius:
    if best.v is None:
        return best
    # where rho < 1 this start alone proves it: T(v) = v - start
    best = _better(T, T.steeper(1.0, best.v), best)
    for _ in range(20):
        assert best.v is not None
        before, best = best, _better(T, T.steeper(best.upper, best.v), best)
        if not _worthwhile(before.upper, best.upper):
            break
    return best


def _power(T: MonotoneMap, best: Radius) -> tuple[Radius, Vector | None]:
    """Power steps for as long as they gain; where the quotient stays above 1, until its minimum is above 1 as well.

    Returns the best bound and the vector of the last step.
    """
    v = best.v
    if v is None:
        return best, None
    for step in range(int(np.clip(_READ // T.entries, 3, 100))):
        before = best.upper
        quotient, image = _quotient(T, v)
        if quotient < before:
            best = Radius(quotient, v, False)
        if not np.isfinite(quotient) or (step and quotient < 1 and not _worthwhile(before, quotient)):
            break
        if (image >= v).all():
            break
        v = image + 0.25 * quotient * v
        v = v / v.max()
    return best, v


def _invariant_part(T: MonotoneMap, v: Vector) -> bool:
    """Whether T(u) ≥ u on the support of some u ≤ v, u ≠ 0, that arises by dropping the entries that fail."""
    u = v.copy()
    for _ in range(50):
        short = (u > 0) & ~(T.lower(u) >= u)
        if not short.any():
            return bool((u > 0).any())
        u[short] = 0.0
    return False


def balanced(size: sp.csr_array) -> Iterator[Vector]:
    """v = 1, and for n ≤ 500 the units of z in which rows and columns of D⁻¹·`size` have like norms.

    Reference: Osborne, J. ACM 7 (1960).
    """
    n = size.shape[0]
    yield np.ones(n)
    if 1 < n <= 500:
        from scipy.linalg import matrix_balance

        with np.errstate(all="ignore"):
            quotients = size.toarray() / size.diagonal()[:, None]
        if np.isfinite(quotients).all():
            yield matrix_balance(quotients, permute=False, separate=True)[1][0]
