"""Small programs in rational arithmetic: Lemke's pivots without rounding, where floats find neither answer nor proof.

With x = x⁺ − x⁻, and an equation as two inequalities, the conditions of optimality are an LCP My + q ≥ 0, y ≥ 0 with a
positive semidefinite M. Ties are broken lexicographically, so that the pivots end, in a solution or in a ray; that
this is a proof is checked. Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (2009), section 4.4.
"""

from __future__ import annotations

from collections.abc import Iterator
from fractions import Fraction

import numpy as np

from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.rational import Rationals, nearest, rationals
from .program import Program

#: nanoseconds for an entry in a pivot, by cProfile for programs with up to 7 unknowns and rows; how many are too many
_ENTRY, _LONG = 1500.0, 4e8

Values = tuple[Vector, Vector, Vector]


def exact_outcome(program: Program) -> Values | str | None:
    """(x, ν, λ) rounded once, "primal" or "dual" as `contradiction` has it, None where that would take too long."""
    n, k = program.q.size, program.b.size
    says = np.flatnonzero(program.g < np.inf)
    given = program.matrices
    P, A, F = (rationals(M) for M in (given.P, given.A, given.F[says]))
    size = 2 * n + says.size + 2 * k
    if not 0.0 < _ENTRY * 2.0 * size**3 <= min(_LONG, work.nanoseconds_left()):
        return None
    rows, right = [*F, *A, *([-a for a in row] for row in A)], [*map(Fraction, program.g[says].tolist())]
    right += [sign * Fraction(b) for sign in (1, -1) for b in program.b.tolist()]
    q, zero = [Fraction(one) for one in program.q.tolist()], [Fraction(0)] * len(rows)
    columns = list(zip(*rows, strict=True)) if rows else [()] * n
    upper = [[*row, *(-a for a in row), *column] for row, column in zip(P, columns, strict=True)]
    M = [*upper, *([-a for a in row] for row in upper), *([*(-a for a in row), *row, *zero] for row in rows)]
    solved, y = lemke(M, [*q, *(-one for one in q), *right])
    x, multipliers = [a - b for a, b in zip(y[:n], y[n:], strict=False)], y[2 * n :]
    if solved:
        nu = [a - b for a, b in zip(multipliers[says.size : says.size + k], multipliers[says.size + k :], strict=True)]
        inequality = np.zeros(program.g.size)
        inequality[says] = _floats(multipliers[: says.size])
        return _floats(x), _floats(nu), inequality
    if _times(right, multipliers) < 0 and not any(_times(column, multipliers) for column in columns):
        return "primal"
    falls = _times(q, x) < 0 and not any(_times(row, x) for row in P)
    return "dual" if falls and all(_times(row, x) <= 0 for row in rows) else None


def lemke(M: Rationals, q: list[Fraction]) -> tuple[bool, list[Fraction]]:
    """Whether the LCP is solved, and y; else the direction of the ray in which the pivots end."""
    n = len(q)
    if min(q) >= 0:
        return True, [Fraction(0)] * n
    # the columns of w, y and t, and the right-hand side
    T = [[*(Fraction(i == j) for j in range(n)), *(-a for a in M[i]), Fraction(-1), q[i]] for i in range(n)]
    basic, entering = list(range(n)), 2 * n
    row = min(range(n), key=lambda i: (q[i], T[i][:n]))
    while True:
        _pivot(T, row, entering)
        basic[row], out = entering, basic[row]
        if out == 2 * n:
            return True, list(_unpacked(basic, [line[-1] for line in T]))
        entering = out + n if out < n else out - n
        able = [i for i in range(n) if T[i][entering] > 0]
        if not able:
            ray = list(_unpacked(basic, [-line[entering] for line in T]))
            if entering >= n:
                ray[entering - n] = Fraction(1)
            return False, ray
        # t leaves as soon as it can
        row = min(able, key=lambda i: (T[i][-1] / T[i][entering], basic[i] != 2 * n, _ratios(T[i], entering, n)))


def _ratios(line: list[Fraction], entering: int, n: int) -> list[Fraction]:
    return [a / line[entering] for a in line[:n]]


def _pivot(T: Rationals, row: int, column: int) -> None:
    pivot = T[row][column]
    T[row] = line = [a / pivot if a else a for a in T[row]]
    for i, other in enumerate(T):
        if i != row and (factor := other[column]):
            T[i] = [a - factor * b if b else a for a, b in zip(other, line, strict=True)]


def _unpacked(basic: list[int], values: list[Fraction]) -> Iterator[Fraction]:
    """y from the values of the basic variables."""
    known, n = dict(zip(basic, values, strict=True)), len(basic)
    return (known.get(n + j, Fraction(0)) for j in range(n))


def _times(a: list[Fraction] | tuple[Fraction, ...], b: list[Fraction]) -> Fraction:
    return sum((x * y for x, y in zip(a, b, strict=True) if x and y), Fraction(0))


def _floats(values: list[Fraction]) -> Vector:
    return np.array([nearest(one) for one in values])
