"""Polyhedra {t : Ct + e ≥ 0} in rational arithmetic, for a few unknowns: a point inside, and which rows are equations.

Reference: Freund, Roundy and Todd, Identifying the set of always-active constraints in a system of linear inequalities
by a single linear program, MIT Working Paper 1674-85 (1985).
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


def _eliminate(rows: Rationals, top: int, column: int) -> None:
    """Make the entry of row `top` in the `column` 1, and the others there 0, in place."""
    pivot = rows[top][column]
    rows[top] = [entry / pivot for entry in rows[top]]
    for i, row in enumerate(rows):
        if i != top and row[column]:
            factor = row[column]
            rows[i] = [a - factor * b for a, b in zip(row, rows[top], strict=True)]


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


def relative_interior(C: Rationals, e: Rational) -> tuple[Rational, list[int]] | None:
    """A point t in the relative interior of {t : Ct + e ≥ 0}, and the rows that are equations on all of it.

    Parameters
    ----------
    C : list of m rows with k entries, k ≥ 1
        Rational coefficients.
    e : list of m entries
        Rational constants.

    Returns
    -------
    tuple or None
        The point and the rows; None where the polyhedron is empty.

    Notes
    -----
    One linear program: maximise Σu for Ct + eτ − u ≥ 0, 0 ≤ u ≤ 1, τ ≥ 1. Then t/τ is inside, and
    u_j = 0 exactly in the rows that are equations. It is solved in units in which the largest entry of each
    row of C and of e is 1, so that the point is the same in all units.

    Examples
    --------
    >>> one, two = Fraction(1), Fraction(2)
    >>> (
    ...     relative_interior([[one], [-one]], [one, one])[1],
    ...     relative_interior([[one], [-one]], [-two, one]),
    ... )
    ([], None)
    """
    m = len(C)
    k = len(C[0])
    sizes = [max(map(abs, row)) for row in C]
    unit = max((abs(x) / size for x, size in zip(e, sizes, strict=True) if size), default=Fraction(0)) or Fraction(1)
    C = [[x / (size or 1) for x in row] for row, size in zip(C, sizes, strict=True)]
    e = [x / (size * unit or abs(x) or 1) for x, size in zip(e, sizes, strict=True)]
    tableau, basis = _tableau(C, e)
    columns = len(tableau[0]) - 1
    artificial = range(columns - m, columns)
    if _maximise(tableau, basis, [Fraction(-int(j in artificial)) for j in range(columns)], columns) < 0:
        return None
    _maximise(tableau, basis, [Fraction(int(2 * k < j <= 2 * k + m)) for j in range(columns)], columns - m)
    x = [Fraction(0)] * columns
    for row, label in zip(tableau, basis, strict=True):
        x[label] = row[-1]
    tau = 1 + x[2 * k]
    point = [unit * (x[i] - x[k + i]) / tau for i in range(k)]
    return point, [j for j in range(m) if x[2 * k + 1 + j] == 0]


def _tableau(C: Rationals, e: Rational) -> tuple[Rationals, list[int]]:
    """The rows of the linear program with their right-hand sides, and the basic unknowns.

    The unknowns are t⁺, t⁻, τ − 1, u, the slacks of the rows and those of u ≤ 1, and artificial ones
    where e_j < 0.
    """
    m = len(C)
    k = len(C[0])
    columns = 2 * k + 1 + 3 * m + m
    none = [Fraction(0)] * m
    tableau = []
    basis = []
    for j in range(m):
        unit = [Fraction(int(i == j)) for i in range(m)]
        row = [*C[j], *(-c for c in C[j]), e[j], *(-x for x in unit + unit), *none, *unit, -e[j]]
        if e[j] >= 0:
            row = [-x for x in row]
            row[columns - m + j] = Fraction(0)
        basis.append(2 * k + 1 + m + j if e[j] >= 0 else columns - m + j)
        tableau.append(row)
    for j in range(m):
        unit = [Fraction(int(i == j)) for i in range(m)]
        tableau.append([*([Fraction(0)] * (2 * k + 1)), *unit, *none, *unit, *none, Fraction(1)])
        basis.append(2 * k + 1 + 2 * m + j)
    return tableau, basis


def _maximise(tableau: Rationals, basis: list[int], cost: Rational, columns: int) -> Fraction:
    """The simplex method with Bland's rule, in place, on the first `columns` unknowns; returns the maximum.

    A label of `basis` beyond `columns` has the value 0, and stays 0: it leaves as soon as its row has an entry.
    """
    while True:
        used = [(cost[label], row) for label, row in zip(basis, tableau, strict=True) if cost[label]]
        entering = next((j for j in range(columns) if cost[j] > sum(price * row[j] for price, row in used)), None)
        if entering is None:
            return sum((price * row[-1] for price, row in used), Fraction(0))
        ratios = [
            (Fraction(0) if basis[i] >= columns else row[-1] / row[entering], basis[i], i)
            for i, row in enumerate(tableau)
            if row[entering] > 0 or (basis[i] >= columns and row[entering])
        ]
        _, _, leaving = min(ratios)  # Σu is bounded, so that there is one
        _eliminate(tableau, leaving, entering)
        basis[leaving] = entering
