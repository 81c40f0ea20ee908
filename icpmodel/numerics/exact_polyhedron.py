"""Linear equations and inequalities in rational arithmetic, for a few unknowns.

Reference: Schrijver, Theory of Linear and Integer Programming (1986), chapter 12.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

from . import work
from .rational import Rationals

Rational = list[Fraction]
#: independent rows, each with its first column that is not 0, in which the rows after it are 0
Echelon = tuple[tuple[int, list[int]], ...]


def row_reduce(rows: Rationals, columns: int) -> list[int]:
    """Gauss–Jordan elimination in place on the first `columns` columns, without fractions on the way.

    Returns the pivot columns; row k then has 1 in the k-th of them, and the others have 0 there. Raises OutOfTime.

    References
    ----------
    Bareiss, Math. Comp. 22 (1968): all entries are minors, so that the divisions have no remainder.
    """
    integers = [in_integers(row) for row in rows]
    pivots: list[int] = []
    last = 1
    for column in range(columns):
        work.check_budget()
        top = len(pivots)
        k = next((k for k in range(top, len(integers)) if integers[k][column]), None)
        if k is None:
            continue
        integers[top], integers[k] = integers[k], integers[top]
        row = integers[top]
        pivot = row[column]
        for i, other in enumerate(integers):
            if i != top:
                factor = other[column]
                integers[i] = [(pivot * x - factor * y) // last for x, y in zip(other, row, strict=True)]
        last = pivot
        pivots.append(column)
    rows[:] = [[Fraction(entry, last) for entry in row] for row in integers]
    return pivots


def in_integers(row: Sequence[Fraction | int]) -> list[int]:
    """The least positive multiple of `row` in whole numbers."""
    unit = math.lcm(*(entry.denominator for entry in row))
    whole = [entry.numerator * (unit // entry.denominator) for entry in row]
    divisor = math.gcd(*whole) or 1
    return [entry // divisor for entry in whole]


def with_row(echelon: Echelon, row: list[int]) -> Echelon:
    """The `echelon` and `row`, reduced by it; the `echelon` alone if `row` depends on it.

    Examples
    --------
    >>> with_row(((0, [2, 1]),), [1, 1]), with_row(((0, [2, 1]),), [4, 2])
    (((0, [2, 1]), (1, [0, 1])), ((0, [2, 1]),))
    """
    for column, other in echelon:
        pivot = other[column]
        factor = row[column]
        if factor:
            row = [pivot * x - factor * y for x, y in zip(row, other, strict=True)]
    divisor = math.gcd(*row)
    if divisor == 0:
        return echelon
    first = next(column for column, entry in enumerate(row) if entry)
    return *echelon, (first, [entry // divisor for entry in row])


def affine_solutions(rows: Sequence[Any], columns: int) -> tuple[Rational, Rationals] | None:
    """A point of {x : row · (x, 1) = 0 for every row} and a basis of its directions; None where it is empty.

    x has `columns` entries, and each row one more: its constant.
    """
    reduced = list(rows)
    pivots = row_reduce(reduced, columns)
    if any(row[columns] for row in reduced[len(pivots) :]):
        return None
    free = [column for column in range(columns) if column not in pivots]
    point = [Fraction(0)] * columns
    basis = [[Fraction(int(k == column)) for k in range(columns)] for column in free]
    for pivot, row in zip(pivots, reduced, strict=False):
        point[pivot] = -row[columns]
        for direction, column in zip(basis, free, strict=True):
            direction[pivot] = -row[column]
    return point, basis


def relative_interior(rows: Sequence[Sequence[Any]], columns: int) -> Rational | None:
    """A point t in the relative interior of {t : row · (t, 1) ≥ 0 for every row}; None where that is empty.

    t has `columns` entries. Rows that are 0 there are 0 on all of the polyhedron. Raises OutOfTime.

    Notes
    -----
    Fourier and Motzkin's elimination: sums of two rows without t_1 describe the projection. Above a point of its
    relative interior, the middle of the segment is one of that of the polyhedron.

    References
    ----------
    Rockafellar, Convex Analysis (1970), theorem 6.8.

    Examples
    --------
    >>> relative_interior([[1, 1], [-1, 3]], 1), relative_interior([[1, -2], [-1, 1]], 1)
    ([Fraction(1, 1)], None)
    """
    work.check_budget()
    if any(row[-1] < 0 and not any(row[:-1]) for row in rows):
        return None
    if not columns:
        return []
    rising = [row for row in rows if row[0] > 0]
    falling = [row for row in rows if row[0] < 0]
    pairs = [[up[0] * y - down[0] * x for x, y in zip(up, down, strict=True)] for up in rising for down in falling]
    shadow = {tuple(in_integers(row[1:])) for row in pairs + [row for row in rows if not row[0]]}
    point = relative_interior(list(shadow), columns - 1)
    if point is None:
        return None
    lows, highs = ([-dot(row[1:], [*point, 1]) / row[0] for row in side] for side in (rising, falling))
    low = max(lows, default=min(highs, default=Fraction(1)) - 2)
    high = min(highs, default=low + 2)
    return [(low + high) / 2, *point]


def dot(row: Sequence[Fraction | int], x: Sequence[Fraction | int]) -> Fraction:
    """The sum of the products of entries that both have."""
    return sum((a * b for a, b in zip(row, x, strict=False) if a and b), Fraction(0))
