"""Combinations of rows in exact arithmetic: candidates near a computed one, and what they prove."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray
from scipy.linalg import qr

from ...errors import OutOfTime
from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.equilibration import Exponents
from ...numerics.rational import echelon_of, nearest, substitute
from ...numerics.rounding import product_lower_bound, product_upper_bound
from .combination_rows import ZERO, CombinationRows

Combination = dict[int, Fraction]

#: the largest denominator that is tried first: the rays of problems in small whole numbers have none above it
FIRST_DENOMINATOR = 1000
#: nanoseconds per entry of A in fractions, measured with cProfile, a weight counting as six entries; and the limit
_FRACTION_COST = 3000.0
_MAX_COST = 4e8
#: the largest number of rows of a combination that is sought exactly: 60 equations in random floats take .6 s
_MAX_SUPPORT = 60
#: nanoseconds per number that an elimination step changes, measured with random floats
_ELIMINATION_COST = 80.0


def candidates_near(
    rows: CombinationRows, shares: Vector, exponents: Exponents, *, solves: bool
) -> Iterator[Combination]:
    """Yield combinations near 2^`exponents` · `shares`, except those that floats show to prove nothing.

    With `solves`, the last one is the exact solution of the equations, empty for more than 60 rows. Nothing is yielded
    if the work limit does not allow it.
    """
    support = np.flatnonzero(shares)
    entries = 6.0 * support.size + float(np.diff(rows.matrix.indptr)[support].sum())
    if _FRACTION_COST * entries > min(_MAX_COST, work.nanoseconds_left()):
        return
    units = exponents[support]
    exact = [Fraction(share) for share in shares[support].tolist()]
    for weights in ([share.limit_denominator(FIRST_DENOMINATOR) for share in exact], exact):
        if not _is_hopeless(rows, support, np.ldexp(np.array(weights, dtype=float), units)):
            yield {int(i): w * Fraction(2) ** int(e) for i, w, e in zip(support, weights, units, strict=True)}
    if solves:
        yield exact_combination(rows, np.ldexp(shares, exponents))


def exact_combination(rows: CombinationRows, y: Vector) -> Combination:
    """An x on the support of `y` with (Mᵀx)_j = 0 exactly where z_j has no bound or (Mᵀy)_j is about 0.

    Equations that are linearly dependent up to rounding are dropped. Empty for more than 60 rows, or if there is too
    little time left.
    """
    support = np.flatnonzero(y)
    if support.size > _MAX_SUPPORT:
        return {}
    with np.errstate(over="ignore", invalid="ignore"):
        terms = y[support, None] * rows.matrix[support].toarray()
        size = np.abs(terms).sum(axis=0)
        tight = (size > 0.0) & (rows.free | (np.abs(terms.sum(axis=0)) <= ZERO * size))
        terms = np.nan_to_num(terms[:, tight] / size[tight])
    _, triangle, order = qr(terms, mode="economic", pivoting=True)
    pivots = np.abs(triangle.diagonal())
    equations = np.flatnonzero(tight)[order[: np.count_nonzero(pivots > ZERO * pivots.max(initial=0.0))]]
    cost = _ELIMINATION_COST * support.size**2 * equations.size**2
    if cost > work.nanoseconds_left():
        return {}
    work.count(cost)
    columns = rows.exact_columns(support)
    system = [[columns[j].get(k, Fraction(0)) for k in range(support.size)] for j in map(int, equations)]
    try:
        x = substitute(echelon_of(system), [Fraction(float(y[i])) for i in support])
    except OutOfTime:
        return {}
    return dict(zip(map(int, support), x, strict=True))


def highest_value(rows: CombinationRows, y: Combination) -> tuple[Fraction, Combination] | None:
    """(The largest value of (Mz + m)ᵀy, Mᵀy), if it is negative and y has the right signs; else None."""
    y = {i: weight for i, weight in y.items() if weight}
    if any(not (rows.nonpositive if weight < 0 else rows.nonnegative)[i] for i, weight in y.items()):
        return None
    weights = list(y.values())
    support = np.array([*y], dtype=np.intp)
    if _is_hopeless(rows, support, np.array([nearest(weight) for weight in weights])):
        return None
    total = sum((weight * Fraction(float(rows.offset[i])) for i, weight in y.items()), Fraction(0))
    columns: Combination = {}
    for j, column in rows.exact_columns(support).items():
        entry = sum((weights[k] * x for k, x in column.items()), Fraction(0))
        if entry:
            end = float(rows.high[j] if entry > 0 else rows.low[j])
            if not np.isfinite(end):
                return None
            total += entry * Fraction(end)
            columns[j] = entry
    return (total, columns) if total < 0 else None


@np.errstate(all="ignore")
def _is_hopeless(rows: CombinationRows, support: NDArray[np.intp], y: Vector) -> bool:
    """Whether an entry of Mᵀy is certain, rounding included, to have the sign for which z has no bound."""
    columns = sp.csr_array(rows.matrix[support].T)
    positive = product_lower_bound(columns, y) > 0.0
    negative = product_upper_bound(columns, y) < 0.0
    return bool((positive & np.isposinf(rows.high) | negative & np.isneginf(rows.low)).any())
