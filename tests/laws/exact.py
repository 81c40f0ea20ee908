"""Exact rational arithmetic on small problems: what the bounds are held against."""

import math
from fractions import Fraction
from itertools import product
from typing import NamedTuple

import numpy as np

import icpmodel as icp


def rational(array):
    return [[Fraction(float(x)) for x in row] for row in np.atleast_2d(array)]


def solve_rational(M, b):
    """The solution of a small system of Fractions by elimination, or None where M is singular."""
    n = len(b)
    rows = [[*M[i], b[i]] for i in range(n)]
    for k in range(n):
        pivot = next((i for i in range(k, n) if rows[i][k] != 0), None)
        if pivot is None:
            return None
        rows[k], rows[pivot] = rows[pivot], rows[k]
        for i in range(n):
            if i != k and rows[i][k] != 0:
                factor = rows[i][k] / rows[k][k]
                rows[i] = [x - factor * y for x, y in zip(rows[i], rows[k], strict=True)]
    return [rows[i][n] / rows[i][i] for i in range(n)]


def solutions(problem):
    """All isolated solutions of an ICP with ψ = Gz + c (or constant), as lists of Fractions, by every active set."""
    n = problem.n
    A, q = rational(problem.A.toarray()), [Fraction(float(x)) for x in problem.q]
    G = rational(problem.psi.G.toarray()) if isinstance(problem.psi, icp.Affine) else [[Fraction(0)] * n] * n
    free = np.isneginf(problem.psi.c)
    c = [Fraction(0) if free[i] else Fraction(float(problem.psi.c[i])) for i in range(n)]
    moving = [[(1 if i == j else 0) - G[i][j] for j in range(n)] for i in range(n)]
    found = []
    for active in product((False, True), repeat=n):
        if (np.array(active) & free).any():
            continue
        z = solve_rational(
            [moving[i] if active[i] else A[i] for i in range(n)], [c[i] if active[i] else -q[i] for i in range(n)]
        )
        if z is None or z in found:
            continue
        p = [sum(a * x for a, x in zip(A[i], z, strict=True)) + q[i] for i in range(n)]
        r = [sum(m * x for m, x in zip(moving[i], z, strict=True)) - c[i] for i in range(n)]
        if all(p[i] >= 0 and (free[i] or r[i] >= 0) for i in range(n)):
            found.append(z)
    return found


def nearest_floats(z):
    return np.array([float(x) for x in z])


def exceeds(z, exact, delta):
    """The rows in which |z − z*| > δ, decided exactly."""
    return [i for i in range(len(exact)) if abs(Fraction(float(z[i])) - exact[i]) > Fraction(float(delta[i]))]


class Zeros(NamedTuple):
    """The isolated zeros of max(z − ψ̄, min(p, z − ψ)): those with ψ ≤ ψ̄, the solutions, and the others."""

    solutions: list
    others: list


def side(psi, n, none):
    """(I − G, c) of one obstacle Gz + c in fractions, `none` where c is infinite."""
    G, c = psi.linear
    moving = [[Fraction(int(i == j)) - x for j, x in enumerate(row)] for i, row in enumerate(rational(G.toarray()))]
    return moving, [none if np.isinf(x) else Fraction(float(x)) for x in c]


def pieces(problem):
    """All isolated zeros with two affine obstacles, by the 3ⁿ choices of rows of p, of ψ and of ψ̄."""
    n, A, q = problem.n, rational(problem.A.toarray()), [Fraction(float(x)) for x in problem.q]
    (low, c), (high, d) = side(problem.psi, n, None), side(problem.upper, n, None)
    found = Zeros([], [])
    for choice in product(range(3), repeat=n):
        if any((k == 1 and c[i] is None) or (k == 2 and d[i] is None) for i, k in enumerate(choice)):
            continue
        rows = [(A[i], low[i], high[i])[k] for i, k in enumerate(choice)]
        z = solve_rational(rows, [(-q[i], c[i], d[i])[k] for i, k in enumerate(choice)])
        if z is None or z in found.solutions or z in found.others:
            continue
        p = [dot(A[i], z) + q[i] for i in range(n)]
        below = [math.inf if c[i] is None else dot(low[i], z) - c[i] for i in range(n)]
        above = [-math.inf if d[i] is None else dot(high[i], z) - d[i] for i in range(n)]
        if all(max(b, min(x, a)) == 0 for x, a, b in zip(p, below, above, strict=True)):
            crosses = any(b > a for a, b in zip(below, above, strict=True))
            (found.others if crosses else found.solutions).append(z)
    return found


def dot(row, z):
    return sum((a * x for a, x in zip(row, z, strict=True)), Fraction(0))
