"""Combinations of rows in exact arithmetic: candidates next to a computed one, and what they prove."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import scipy.sparse as sp

from ...numerics import work
from ...numerics.arrays import Mask, Vector
from ...numerics.equilibration import Exponents
from ...numerics.exact_polyhedron import row_reduce
from ...numerics.rational import nearest
from ...numerics.rounding import product_lower_bound, product_upper_bound
from .combination_rows import ZERO, CombinationRows

Combination = dict[int, Fraction]

#: the largest number of rows of a combination that is sought exactly: 60 equations in floats take .6 s
MAX_SUPPORT = 60
#: denominators that are tried first: the rays of problems in small whole numbers have them
_FIRST_DENOMINATOR = 1000
#: nanoseconds for an entry of A in fractions, by cProfile; how many are too many
_FRACTION_COST = 3000.0
_MAX_COST = 4e8


def candidates_near(rows: CombinationRows, shares: Vector, exponents: Exponents) -> Iterator[Combination]:
    """Combinations next to 2^`exponents` · `shares`."""
    support = np.flatnonzero(shares)
    if _FRACTION_COST * float(np.diff(rows.matrix.indptr)[support].sum()) > min(_MAX_COST, work.nanoseconds_left()):
        return
    units = [Fraction(2) ** int(exponents[i]) for i in support]
    exact = [Fraction(float(shares[i])) for i in support]
    for near in ([share.limit_denominator(_FIRST_DENOMINATOR) for share in exact], exact):
        yield {int(i): share * unit for i, share, unit in zip(support, near, units, strict=True)}
    y = np.ldexp(shares, exponents)
    if support.size <= MAX_SUPPORT:
        own = np.zeros(rows.low.size, dtype=bool)
        own[support[support < own.size]] = True
        yield exact_combination(rows, y, own | rows.free)  # a ray has zeros there, a linear program need not
        yield exact_combination(rows, y, rows.free)


def exact_combination(rows: CombinationRows, y: Vector, zero: Mask) -> Combination:
    """x on the support of `y` with (Mᵀx)_j = 0 exactly in the columns `zero`, and where (Mᵀy)_j is about 0."""
    support = np.flatnonzero(y)
    with np.errstate(over="ignore", invalid="ignore"):
        part = rows.matrix[support]
        tight = np.abs(part.T @ y[support]) <= ZERO * (abs(part).T @ np.abs(y[support]))
    tight |= zero
    columns = rows.exact_columns(support)
    system = [[columns[j].get(k, Fraction(0)) for k in range(support.size)] for j in columns if tight[j]]
    x = [Fraction(float(y[i])) for i in support]
    pivots = row_reduce(system, len(x))
    others = [j for j in range(len(x)) if j not in pivots]
    for row, pivot in zip(system, pivots, strict=False):
        x[pivot] = -sum((row[j] * x[j] for j in others), Fraction(0))
    return dict(zip(map(int, support), x, strict=True))


def highest_value(rows: CombinationRows, y: Combination) -> tuple[Fraction, Combination] | None:
    """(The largest value of (Mz + m)ᵀy, Mᵀy), if it is negative and y has the right signs; else None."""
    y = {i: weight for i, weight in y.items() if weight}
    if any(not (rows.nonpositive if weight < 0 else rows.nonnegative)[i] for i, weight in y.items()):
        return None
    if _is_hopeless(rows, y):
        return None
    weights = list(y.values())
    total = sum((weight * Fraction(float(rows.offset[i])) for i, weight in y.items()), Fraction(0))
    columns: Combination = {}
    for j, column in rows.exact_columns(np.array([*y], dtype=np.intp)).items():
        entry = sum((weights[k] * x for k, x in column.items()), Fraction(0))
        if entry:
            end = float(rows.high[j] if entry > 0 else rows.low[j])
            if not np.isfinite(end):
                return None
            total += entry * Fraction(end)
            columns[j] = entry
    return (total, columns) if total < 0 else None


@np.errstate(all="ignore")
def _is_hopeless(rows: CombinationRows, y: Combination) -> bool:
    """Whether floats say already, beyond their rounding, that an entry of Mᵀy is on the side where z has no bound."""
    columns = sp.csr_array(rows.matrix[list(y)].T)
    x = np.array([nearest(weight) for weight in y.values()])
    positive = product_lower_bound(columns, x) > 0.0
    negative = product_upper_bound(columns, x) < 0.0
    return bool((positive & np.isposinf(rows.high) | negative & np.isneginf(rows.low)).any())
