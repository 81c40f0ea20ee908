"""Exact rational arithmetic on small problems: what the bounds are held against."""

from fractions import Fraction
from itertools import product

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
