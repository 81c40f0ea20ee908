"""Combinations of rows in exact arithmetic: candidates next to a computed one, and what they prove."""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np
import scipy.sparse as sp

from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.exact_polyhedron import row_reduce
from ...numerics.rational import nearest, rationals
from ...numerics.rounding import UNIT_ROUNDOFF
from ...problem.data import ProblemData
from .combination_rows import ZERO, Combination, CombinationRows

#: rows up to which a system is solved in rational arithmetic
_RATIONAL = 30
#: denominators that are tried first: the rays of problems in small whole numbers have them
_DENOMINATOR = 1000
#: nanoseconds for an entry of A in fractions, by cProfile; how many are too many
_FRACTION = 3000.0
_LONG = 4e8


def candidates_near(
    problem: ProblemData, y: Vector, support: np.ndarray, rows: CombinationRows
) -> Iterator[Combination]:
    cost = _FRACTION * float(np.diff(problem.A.indptr)[support].sum())
    if cost > min(_LONG, work.nanoseconds_left()):
        return
    yield {int(i): Fraction(float(y[i])).limit_denominator(_DENOMINATOR) for i in support}
    yield {int(i): Fraction(float(y[i])) for i in support}
    if support.size <= _RATIONAL:
        yield exact_combination(problem, support, y, rows, support)  # a ray has zeros there, a linear program need not
        yield exact_combination(
            problem, support, y, rows, np.flatnonzero(np.isneginf(rows.low) & np.isposinf(rows.high))
        )


def exact_combination(
    problem: ProblemData, support: np.ndarray, y: Vector, bounds: CombinationRows, zero: np.ndarray
) -> Combination:
    """x on the support of y with (Aᵀx)_i = 0 exactly where (Aᵀy)_i is about 0, or is to be; x_i left open is y_i."""
    with np.errstate(over="ignore", invalid="ignore"):
        tight = np.abs(problem.A.T @ y) <= ZERO * (problem.matrix.absolute.T @ np.abs(y))
    tight[zero] = True
    tight &= ~(np.isfinite(bounds.low) & np.isfinite(bounds.high))
    rows = [row for row in rationals(problem.A[support][:, tight].T) if any(row)]
    x = [Fraction(float(y[i])) for i in support]
    pivots = row_reduce(rows, len(x))
    others = [j for j in range(len(x)) if j not in pivots]
    for row, pivot in zip(rows, pivots, strict=False):
        x[pivot] = -sum((row[j] * x[j] for j in others), Fraction(0))
    return dict(zip(map(int, support), x, strict=True))


def contradiction(problem: ProblemData, rows: CombinationRows, y: Combination) -> Fraction | None:
    """What (Az + q)ᵀy is at most, where it is negative and y has the right signs, in exact arithmetic; else None."""
    y = {i: weight for i, weight in y.items() if weight}
    if any(not (rows.falls if weight < 0 else rows.rises)[i] for i, weight in y.items()):
        return None
    if _is_hopeless(problem, rows, y):
        return None
    weights = list(y.values())
    A = sp.csc_array(problem.A[list(y)])
    total = sum((weight * Fraction(float(problem.q[i])) for i, weight in y.items()), Fraction(0))
    for j in np.flatnonzero(np.diff(A.indptr)):  # by columns, as one that is not 0 may end it
        part = range(A.indptr[j], A.indptr[j + 1])
        entry = sum((weights[A.indices[k]] * Fraction(float(A.data[k])) for k in part), Fraction(0))
        if entry:
            end = float(rows.high[j] if entry > 0 else rows.low[j])
            if not np.isfinite(end):
                return None
            total += entry * Fraction(end)
    return total if total < 0 else None


@np.errstate(all="ignore")
def _is_hopeless(problem: ProblemData, rows: CombinationRows, y: Combination) -> bool:
    """Whether floats say already, beyond their rounding, that an entry of Aᵀy is on the side where z has no bound."""
    x = np.zeros(problem.n)
    x[list(y)] = [nearest(weight) for weight in y.values()]
    columns = problem.A.T @ x
    off = 4.0 * (problem.n + 4) * UNIT_ROUNDOFF * (problem.matrix.absolute.T @ np.abs(x))
    return bool(((columns > off) & np.isposinf(rows.high) | (columns < -off) & np.isneginf(rows.low)).any())
