"""Rational arithmetic, for small matrices on which rounding leaves a question open.

`reduced` does all elimination, on whole numbers: each row may be multiplied by a positive number.
References: Bareiss, Math. Comp. 22 (1968); Schrijver, Theory of Linear and Integer Programming (1986), chapter 12.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from fractions import Fraction
from functools import reduce
from typing import Any

import numpy as np
import scipy.sparse as sp

from . import work
from .arrays import Vector

Rational = list[Fraction]
Rationals = list[Rational]
#: pairs (column of the pivot, row); later rows are 0 in that column
Echelon = tuple[tuple[int, list[int]], ...]
#: a combination of rows with positive factors: the indices of the rows, and its entries
Sum = tuple[frozenset[int], tuple[int, ...]]


def rationals(A: Any) -> Rationals:
    """The entries of the sparse or dense `A` as fractions, row by row; floats are fractions already."""
    dense = A.toarray() if sp.issparse(A) else np.asarray(A)
    return [[Fraction(float(entry)) for entry in row] for row in dense]


def exact_sum(entries: Any) -> Fraction | float:
    """The sum of floats, rounded once at most, so that its sign is right."""
    try:
        return math.fsum(entries)
    except OverflowError:
        return sum(map(Fraction, np.asarray(entries).tolist()), Fraction(0))


def in_integers(row: Sequence[Fraction | int]) -> list[int]:
    """The least positive multiple of `row` in whole numbers."""
    unit = math.lcm(*(entry.denominator for entry in row))
    whole = [entry.numerator * (unit // entry.denominator) for entry in row]
    divisor = math.gcd(*whole) or 1
    return [entry // divisor for entry in whole]


def dot(row: Sequence[Any], x: Sequence[Any]) -> Fraction:
    """Σ row_i x_i over the length of the shorter one."""
    return sum((a * b for a, b in zip(row, x, strict=False) if a and b), Fraction(0))


def reduced(echelon: Echelon, row: list[int]) -> list[int]:
    """A multiple of `row` minus multiples of the rows of the `echelon` that is 0 in their pivot columns.

    The factor of `row` is positive if all pivots are. If every row of the `echelon` was reduced by those before it, all
    entries are minors, and divisions have no remainder. Raises OutOfTime.
    """
    work.check_budget()
    last = 1
    for column, other in echelon:
        pivot = other[column]
        factor = row[column]
        row = [(pivot * x - factor * y) // last for x, y in zip(row, other, strict=True)]
        last = pivot
    return row


def with_row(echelon: Echelon, row: list[int]) -> Echelon:
    """The `echelon` with the reduced `row` appended, pivot its first nonzero; the `echelon` itself if it reduces to 0.

    Examples
    --------
    >>> with_row(((0, [2, 1]),), [1, 1]), with_row(((0, [2, 1]),), [4, 2])
    (((0, [2, 1]), (1, [0, 1])), ((0, [2, 1]),))
    """
    row = reduced(echelon, row)
    first = next((column for column, entry in enumerate(row) if entry), None)
    return echelon if first is None else (*echelon, (first, row))


def echelon_of(rows: Iterable[Sequence[Fraction | int]]) -> Echelon:
    """The echelon with the span of these `rows`."""
    return reduce(with_row, map(in_integers, rows), ())


def substitute(echelon: Echelon, x: Sequence[Fraction | int]) -> Rational:
    """A copy of `x` whose entries in the pivot columns are set so that its product with each row is 0."""
    solution = [Fraction(entry) for entry in x]
    for column, row in reversed(echelon):
        solution[column] = Fraction(0)
        solution[column] = -dot(row, solution) / row[column]
    return solution


def unit_vector(k: int, n: int) -> list[int]:
    """1 in entry `k` of `n`, else 0."""
    return [int(i == k) for i in range(n)]


def affine_solutions(rows: Iterable[Sequence[Fraction | int]], columns: int) -> tuple[Rational, Rationals] | None:
    """A point of {x : row · (x, 1) = 0 for every row} and a basis of its directions; None where it is empty.

    x has `columns` entries, and each row one more: its constant.
    """
    echelon = echelon_of(rows)
    pivots = {column for column, _ in echelon}
    if columns in pivots:
        return None
    free = [column for column in range(columns + 1) if column not in pivots]
    *basis, point = (substitute(echelon, unit_vector(column, columns + 1))[:columns] for column in free)
    return point, basis


def relative_interior(rows: Sequence[Sequence[Any]], columns: int) -> Rational | None:
    """A point t in the relative interior of {t : row · (t, 1) ≥ 0 for every row}; None where that is empty.

    t has `columns` entries. Rows that are 0 at t are 0 on all of the polyhedron. Raises OutOfTime.

    Notes
    -----
    Fourier–Motzkin elimination: combinations of two rows without t_1 describe the projection. Take a point of its
    relative interior. The middle of the segment above this point is in the relative interior of the polyhedron. Once
    t_1 … t_k are eliminated, combinations of more than k + 1 of the `rows` are redundant (Chernikov).

    References
    ----------
    Rockafellar, Convex Analysis (1970), theorem 6.8. Schrijver, Theory of Linear and Integer Programming (1986), 12.2.

    Examples
    --------
    >>> relative_interior([[1, 1], [-1, 3]], 1), relative_interior([[1, -2], [-1, 1]], 1)
    ([Fraction(1, 1)], None)
    """
    return _interior({(frozenset([k]), tuple(in_integers(row))) for k, row in enumerate(rows)}, columns, 2)


def _interior(sums: set[Sum], columns: int, max_terms: int) -> Rational | None:
    """`relative_interior` of `sums` of rows; once t_1 is eliminated, sums may combine `max_terms` rows."""
    if any(row[-1] < 0 and not any(row[:-1]) for _, row in sums):
        return None
    if not columns:
        return []
    rising = [one for one in sums if one[1][0] > 0]
    falling = [one for one in sums if one[1][0] < 0]
    shadow = {(terms, row[1:]) for terms, row in sums if not row[0]}
    for terms, up in rising:
        work.check_budget()
        for others, down in falling:
            if len(terms | others) <= max_terms:
                row = in_integers([up[0] * y - down[0] * x for x, y in zip(up, down, strict=True)])
                shadow.add((terms | others, tuple(row[1:])))
    point = _interior(shadow, columns - 1, max_terms + 1)
    if point is None:
        return None
    lows, highs = ([-dot(row[1:], [*point, 1]) / row[0] for _, row in side] for side in (rising, falling))
    unit = max(map(abs, lows + highs), default=Fraction(0)) or Fraction(1)  # an open end is 2 units from the other one
    low = max(lows, default=min(highs, default=unit) - 2 * unit)
    high = min(highs, default=low + 2 * unit)
    return [(low + high) / 2, *point]


def leading_minor(M: Rationals) -> tuple[int, Echelon] | None:
    """The index k of the row of the first leading minor ≤ 0, and the echelon of rows < k; None if all are positive."""
    echelon: Echelon = ()
    for k, row in enumerate(M):
        left = reduced(echelon, in_integers(row))
        if left[k] <= 0:
            return k, echelon
        echelon = (*echelon, (k, left))
    return None


def m_matrix(C: Any) -> Rational | None:
    """An x ≥ 0, x ≠ 0 with Cx ≤ 0 for the Z-matrix `C`; None where it is a nonsingular M-matrix.

    It is one if and only if its leading minors are positive. Reference: Berman and Plemmons (1994), chapter 6.
    """
    M = rationals(C)
    failed = leading_minor(M)
    return None if failed is None else substitute(failed[1], unit_vector(failed[0], len(M)))


def curvature(M: Rationals) -> tuple[bool, Rational | None]:
    """Whether the symmetric `M` is positive semidefinite; and a witness x ≠ 0, None where M is definite.

    xᵀMx = 0 where M is semidefinite, else xᵀMx < 0.
    """
    n = len(M)
    flat = None
    echelon: Echelon = ()
    for k in range(n):
        row = reduced(echelon, in_integers(M[k]))
        if row[k] > 0:
            echelon = (*echelon, (k, row))
        elif row[k] < 0:
            return False, substitute(echelon, unit_vector(k, n))
        elif (partner := next((j for j in range(k + 1, n) if row[j]), None)) is not None:
            # along x_k the form is linear where x_partner = 1
            other = reduced(echelon, in_integers(M[partner]))
            x: list[Any] = unit_vector(partner, n)
            x[k] = Fraction(-(other[partner] + 1), 2 * other[k])
            return False, substitute(echelon, x)
        elif flat is None:
            flat = k
    return True, None if flat is None else substitute(echelon, unit_vector(flat, n))


def nearest(x: Fraction | float) -> float:
    """The float nearest to `x`, infinite where it overflows."""
    try:
        return float(x)
    except OverflowError:
        return float("inf") if x > 0 else float("-inf")


def as_witness(x: list[Fraction], proves: Any) -> Vector:
    """`x` divided by its largest size, in floats, if `proves` accepts these as fractions; else `x` in fractions."""
    largest = max(abs(entry) for entry in x)
    floats = np.array([float(entry / largest) for entry in x])
    return floats if proves([Fraction(entry) for entry in floats]) else np.array(x, dtype=object)
