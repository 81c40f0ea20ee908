"""Problems that are made for an answer known beforehand."""

import math
from fractions import Fraction

import numpy as np
from exact import solve_rational

import icpmodel as icp


def affine(G):
    """c ↦ ψ(z) = Gz + c, a constant where G is 0."""
    return (lambda c: icp.Affine(G, c)) if np.any(G) else icp.Constant


def around(rng, A, exact, psi=icp.Constant, of_p=1.0, of_r=1.0, free=0.0, above=0.0):
    """The ICP of A with the solution `exact`, psi(c) the map that is as much above psi(0) as c.

    Rows touch by chance; a share `free` of the others has no obstacle. The share `above` of all rows has one above as
    well, psi(d), and touches that in place of the lower one.
    """
    n = len(exact)
    active, held = rng.random(n) < 0.5, rng.random(n) < above
    p = np.where(active, rng.random(n), 0.0) * of_p
    bare, gap = exact - psi(np.zeros(n)).bind(n).value(exact), rng.random(n) * of_r
    c = bare - np.where(active & ~held, 0.0, gap)
    c[~active & (rng.random(n) < free)] = -np.inf
    upper = psi(np.where(held, bare + np.where(active, 0.0, gap), np.inf)) if held.any() else None
    return icp.ICP(A, np.where(held, -p, p) - A @ exact, psi(c), upper=upper)


def inverse(M):
    """M⁻¹ in fractions, None where M is singular."""
    n = len(M)
    columns = [solve_rational(M, [Fraction(int(i == j)) for i in range(n)]) for j in range(n)]
    return None if None in columns else [list(row) for row in zip(*columns, strict=True)]


def exact_sides(problem, z):
    """p, z − ψ and z − ψ̄ in fractions, infinite where there is no obstacle."""
    z = [Fraction(float(x)) for x in z]

    def dot(row, last):
        return sum((Fraction(float(a)) * x for a, x in zip(row, z, strict=True) if a), Fraction(float(last)))

    p = [dot(row, last) for row, last in zip(problem.A.toarray(), problem.q, strict=True)]
    sides = []
    for psi in (problem.psi, problem.upper):
        if psi is None:
            sides.append([-math.inf] * problem.n)
            continue
        G, c = psi.linear[0].toarray(), psi.linear[1]
        sides.append([x - dot(g, b) if np.isfinite(b) else -b for x, g, b in zip(z, G, c, strict=True)])
    return p, *sides


def exact_squares(problem, z):
    """Res(z)² as a fraction; the larger one of the two distances where the obstacles cross."""
    total = Fraction(0)
    for p, below, above in zip(*exact_sides(problem, z), strict=True):
        value = max(abs(below), abs(above)) if above > below else max(above, min(p, below))
        total += Fraction(value) ** 2
    return total
