"""Problems whose answer is known beforehand, for the tests of this folder."""

from fractions import Fraction

import numpy as np
from exact import solve_rational

import icpmodel as icp


def around(rng, A, exact, G=None, of_p=1.0, of_r=1.0, free=0.0):
    """The ICP of A and ψ(z) = Gz + c with the solution `exact`: rows touch by chance, a share of the others is free."""
    n = len(exact)
    active = rng.random(n) < 0.5
    p = np.where(active, rng.random(n), 0.0) * of_p
    moves = G is not None and np.any(G)
    c = exact - np.where(active, 0.0, rng.random(n)) * of_r - (G @ exact if moves else 0.0)
    c[~active & (rng.random(n) < free)] = -np.inf
    return icp.ICP(A, p - A @ exact, icp.Affine(G, c) if moves else c)


def inverse(M):
    """M⁻¹ in fractions, None where M is singular."""
    n = len(M)
    columns = [solve_rational(M, [Fraction(int(i == j)) for i in range(n)]) for j in range(n)]
    return None if None in columns else [list(row) for row in zip(*columns, strict=True)]
