"""Manufactured solutions, for measuring methods: z is chosen first, and the data follow from it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import numpy as np

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..problem.affine import Affine
from ..problem.elementwise import Elementwise
from .grid import adjacency, five_point, side, square_points
from .registry import Scene, register


def random_numbers(seed: Any) -> np.random.Generator:
    """The random generator of a scene. Raises InputError for a bad seed."""
    return np.random.default_rng(int(as_number(seed, "seed", minimum=0, whole=True)))


def random_complementary(n: int, seed: Any, degenerate: float = 0.0) -> tuple[Vector, Vector, Vector]:
    """Random z* in [−1, 1], and p*, r* ≥ 0 with p*ᵀr* = 0 and entries in [.5, 1.5], each of shape (n,).

    `degenerate` is the share of rows with p* = r* = 0; half of the others are at the obstacle. Raises InputError for a
    bad seed.
    """
    random = random_numbers(seed)
    z = random.uniform(-1.0, 1.0, n)
    size = random.uniform(0.5, 1.5, n)
    order = random.permutation(n)
    strict = round((1.0 - degenerate) * n)
    size[order >= strict] = 0.0
    at_obstacle = order < strict // 2
    return z, np.where(at_obstacle, size, 0.0), np.where(at_obstacle, 0.0, size)


#: the distance of z* from an obstacle, in units of a random size; inf where there is none
AT, OFF = 0.0, 1.0
#: kind of row → the distances from ψ and from ψ̄
BOX_ROWS = {
    "at psi": (AT, OFF),
    "at upper": (OFF, AT),
    "between": (OFF, OFF),
    "at psi, the only one": (AT, np.inf),
    "at upper, the only one": (np.inf, AT),
    "equation": (np.inf, np.inf),
}


def random_box(n: int, seed: Any, kinds: Iterable[tuple[float, float]]) -> tuple[Vector, Vector, Vector, Vector]:
    """Random z* in [−1, 1], p*, r* = z* − ψ* and s* = ψ̄* − z*, sizes in [.5, 1.5], each of shape (n,).

    Each of the `kinds` of rows, values of `BOX_ROWS`, is equally frequent. p* has the sign of the obstacle that z* is
    at, and is 0 where it is at both. Raises InputError for a bad seed.
    """
    random = random_numbers(seed)
    table = np.array(tuple(kinds))
    z = random.uniform(-1.0, 1.0, n)
    sizes = random.uniform(0.5, 1.5, (n, 3))
    kind = random.permutation(n) % len(table)
    r, s = (table[kind] * sizes[:, 1:]).T
    return z, (r == 0.0) * sizes[:, 0] - (s == 0.0) * sizes[:, 0], r, s


def manufactured(A: Any, z: Vector, p: Any, psi: Any, models: str, upper: Any = None, **known: Any) -> Scene:
    """The scene with the solution `z` and p(z) = `p`, by q = p − Az; `psi` and `upper` must fit."""
    return Scene(problem=ICP(A, p - A @ z, psi, upper), models=models, z_exact=z, **known)


@register
def bai_symmetric(n: int = 900, mu: float = 4.0) -> Scene:
    """Bai's symmetric LCP, the standard test of the modulus literature.

    A = Tridiag(−I, S, −I) + μI, S = tridiag(−1, 4, −1), m × m blocks; ψ = 0. z* = (1, 2, 1, 2, …)
    and q = −Az*, so that p* = 0 in every row. `z0` = (1, 0, 1, 0, …) is the start of the
    literature, which stops at Res ≤ 1e−5.

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    mu : float, default 4
        The number μ ≥ 0; μ = 0 is the hard case.

    References
    ----------
    Bai, Numer. Linear Algebra Appl. 17 (2010), doi:10.1002/nla.680.
    """
    return _bai(n, mu, 0.0)


@register
def bai_nonsymmetric(n: int = 900, mu: float = 4.0) -> Scene:
    """Bai's nonsymmetric LCP: the same with transport.

    A = Tridiag(−1.5I, S, −.5I) + μI, S = tridiag(−1.5, 4, −.5), m × m blocks; ψ = 0. z* = (1, 2, 1,
    2, …), q = −Az*, `z0` = (1, 0, 1, 0, …).

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    mu : float, default 4
        The number μ ≥ 0.

    References
    ----------
    Bai, Numer. Linear Algebra Appl. 17 (2010), doi:10.1002/nla.680.
    """
    return _bai(n, mu, 0.5)


@register
def manufactured_affine(n: int = 900, mu: float = 4.0, seed: int = 0, skew: float = 0.0) -> Scene:
    """A random ICP with an affine map and a known solution.

    A = Tridiag(−(1 + s)I, S, −(1 − s)I) + μI, as in Bai's LCPs, where s is 0 or ½. ψ(z) = Gz + c
    with G = (.9/4)·adjacency of the m × m grid: each obstacle depends on the four neighbours, ‖G‖∞
    = .9.

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    mu : float, default 4
        The number μ ≥ 0.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.
    skew : float, default 0
        The number s in [−1, 1].

    Notes
    -----
    z* is random in [−1, 1]. A random half of the rows has p* in [.5, 1.5] and r* = 0, the other
    half r* in [.5, 1.5] and p* = 0. c = z* − r* − Gz* and q = p* − Az* make z* exact to rounding.

    References
    ----------
    Bai, Numer. Linear Algebra Appl. 17 (2010), doi:10.1002/nla.680, for A.
    """
    m, A = _bai_matrix(n, mu, skew)
    z, p, r = random_complementary(m * m, seed)
    G = (0.9 / 4.0) * adjacency(m)
    models = "A grid of cells, each resting on its own neighbours, with forces chosen so that the answer is known."
    psi = Affine(G, z - r - G @ z)
    return manufactured(A, z, p, psi, models, points=square_points(m))


@register
def manufactured_elementwise(n: int = 900, mu: float = 4.0, seed: int = 0, skew: float = 0.0) -> Scene:
    """A random ICP with a nonlinear map and a known solution.

    As manufactured-affine with ψ_i(z) = .3 sin z_i + c_i, c = z* − r* − .3 sin z*; |ψ′| ≤ .3.

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    mu : float, default 4
        The number μ ≥ 0.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.
    skew : float, default 0
        The number s in [−1, 1].

    References
    ----------
    Bai, Numer. Linear Algebra Appl. 17 (2010), doi:10.1002/nla.680, for A.
    """
    m, A = _bai_matrix(n, mu, skew)
    z, p, r = random_complementary(m * m, seed)
    models = "A grid of cells whose obstacles bend with them, with forces chosen so that the answer is known."
    psi = Elementwise(_sine, _cosine, lipschitz=0.3, c=z - r - _sine(z))
    return manufactured(A, z, p, psi, models, points=square_points(m))


@register
def manufactured_vertical(n: int = 900, mu: float = 4.0, seed: int = 0) -> Scene:
    """A random vertical LCP, of two matrices, with a known solution.

    min(Az + q, Bz + d) = 0 with A of Bai's nonsymmetric LCP and B = Aᵀ, the reverse flow. p* and r*
    are those of manufactured-affine; Bz* + d is r* times the diagonal of B. It discretises a
    Hamilton–Jacobi–Bellman equation with two controls.

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    mu : float, default 4
        The number μ ≥ 0.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.

    References
    ----------
    Lions and Mercier, RAIRO Anal. Numér. 14 (1980), for such equations.
    """
    m, A = _bai_matrix(n, mu, 0.5)
    z, p, r = random_complementary(m * m, seed)
    B = A.T
    problem = ICP.vertical(A, p - A @ z, B, r * B.diagonal() - B @ z)
    models = "A grid of cells that drift in one of two winds, in each the one that serves it, with a known answer."
    return Scene(problem=problem, models=models, z_exact=z, points=square_points(m))


@register
def box_manufactured(n: int = 900, mu: float = 4.0, skew: float = 0.0, coupling: float = 0.0, seed: int = 0) -> Scene:
    """A random problem between two obstacles, with a known solution.

    A = Tridiag(−(1 + s)I, S, −(1 − s)I) + μI. The obstacles are ψ(z) = Gz + c and ψ̄(z) = Gz + d
    with G = (g/4)·adjacency of the m × m grid, g = ‖G‖∞.

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    mu : float, default 4
        The number μ ≥ 0.
    skew : float, default 0
        The number s in [−1, 1].
    coupling : float, default 0
        The number g ≥ 0; below 1 there is one solution.
    seed : int, default 0
        Seed ≥ 0 of the random numbers.

    Notes
    -----
    There are six kinds of rows, a sixth of the rows each. In three kinds both obstacles are finite:
    z* at ψ, at ψ̄, or between. In two kinds z* is at the only finite obstacle, ψ or ψ̄. In the last
    kind there is no obstacle: an equation.

    z* is random in [−1, 1], forces and distances are in [.5, 1.5]. q = p* − Az*, c = z* − r* − Gz*
    and d = z* + s* − Gz* make z* exact to rounding.

    References
    ----------
    Bai, Numer. Linear Algebra Appl. 17 (2010), doi:10.1002/nla.680, for A.
    """
    m, A = _bai_matrix(n, mu, skew)
    coupling = as_number(coupling, "coupling", minimum=0)
    z, p, r, s = random_box(m * m, seed, BOX_ROWS.values())
    G = (coupling / 4.0) * adjacency(m)
    low = z - r - G @ z
    high = z + s - G @ z
    psi, upper = (Affine(G, low), Affine(G, high)) if coupling else (low, high)
    models = "A grid of cells, each between a floor and a ceiling, with forces chosen so that the answer is known."
    return manufactured(A, z, p, psi, models, upper, points=square_points(m))


def _bai_matrix(n: int, mu: Any, skew: Any) -> tuple[int, Any]:
    """m, and A of the m × m grid. Raises InputError for μ < 0, and for s outside [−1, 1]."""
    m = side(n)
    mu = as_number(mu, "mu", minimum=0)
    return m, five_point(m, mu, as_number(skew, "skew", minimum=-1, maximum=1))


def _bai(n: int, mu: Any, skew: float) -> Scene:
    m, A = _bai_matrix(n, mu, skew)
    odd: Vector = np.arange(m * m, dtype=np.float64) % 2.0
    models = "A grid of cells under forces chosen so that the answer is 1 and 2 in turn, off every obstacle."
    return manufactured(A, 1.0 + odd, 0.0, 0.0, models, z0=1.0 - odd, points=square_points(m))


def _sine(z: Vector) -> Vector:
    return 0.3 * np.sin(z)


def _cosine(z: Vector) -> Vector:
    return 0.3 * np.cos(z)
