"""Families of problems, random within each and drawn anew for every seed: a gallery that nobody can tune to."""

import zlib
from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

import icpmodel as icp

from . import bodies, finite_differences, graphs, markets, optimality
from .draw import scattered


class _Family(NamedTuple):
    """`build`(n, rng); whether A is an M-matrix; the largest n that there is."""

    build: Callable
    is_m: bool = False
    most: int = 10**6


#: n² numbers of eight bytes, at most 200 MB
_DENSE = 5000
#: beyond it rounding in the second differences, 1e-16 n², hides a residual of 1e-8
_LINE = 100_000

_GRIDS = {
    f"grid-{k}d-{kind}": _Family(partial(finite_differences.grid, k, kind), True)
    for k in (1, 2, 3)
    for kind in ("constant", "jumping", "anisotropic")
    if (k, kind) != (1, "anisotropic")
}
_FAMILIES = {
    **_GRIDS,
    "plate": _Family(finite_differences.plate),
    "convection": _Family(finite_differences.convection, True),
    "graph-expander": _Family(graphs.expander, True),
    "graph-geometric": _Family(graphs.geometric, True),
    "graph-scale-free": _Family(graphs.scale_free, True),
    "graph-directed": _Family(graphs.directed, True),
    "market-leontief": _Family(markets.leontief, True),
    "market-trade": _Family(markets.trade),
    "market-prices": _Family(markets.prices),
    "market-cournot": _Family(markets.cournot),
    "market-traffic": _Family(markets.traffic),
    "contact-chain": _Family(bodies.chain),
    "contact-pile": _Family(bodies.pile),
    "contact-redundant": _Family(bodies.redundant),
    "program-control": _Family(optimality.control),
    "program-flow": _Family(optimality.flow),
    "program-regression": _Family(optimality.regression),
    "option-one": _Family(partial(finite_differences.option, 1, False), True, _LINE),
    "option-two": _Family(partial(finite_differences.option, 2, False), True),
    "option-cross": _Family(partial(finite_differences.option, 2, True)),
    "dense-covariance": _Family(graphs.covariance, most=_DENSE),
    "dense-definite": _Family(graphs.definite, most=_DENSE),
    "dense-nonsymmetric": _Family(partial(graphs.definite, skew=True), most=_DENSE),
}
_KINDS = ("", "+affine", "+elementwise", "+box")


def family_names(beginnings=()):
    """Names of the families: what A is, and what ψ is if not constant.

    Parameters
    ----------
    beginnings : sequence of str
        Only families whose names begin with one of these; by default all.

    Raises
    ------
    ValueError
        If no family begins with one of them.
    """
    known = [name + kind for name in _FAMILIES for kind in _KINDS]
    for one in beginnings:
        if not any(name.startswith(one) for name in known):
            raise ValueError(f"there is no family {one!r}; the families are: {', '.join(_FAMILIES)}")
    return [name for name in known if not beginnings or name.startswith(tuple(beginnings))]


def drawn(family, n, rng):
    """A random problem of `family` with about `n` unknowns, which has a solution.

    Why one exists with a fixed obstacle c is said where A is made; what ψ is else keeps that:
    "+affine", A an M-matrix: ψ = c + G(z − c), G ≥ 0 the weights of a row's neighbours in A, their sum γ in [.3, .9].
    With w = A⁻¹1 and ε small, v = 1 + εw has Av > 0 and Gv < v, so there is one solution (Kumar, Deepmala and Das).
    "+affine" else: r = (1 − γ)(z − c) + (γ/s)p, an obstacle that gives way under force, ‖G‖∞ < 1. It is feasible where
    the fixed one is, Aᵀ(I − G) is monotone as A is, and an LCP in r with the monotone matrix A(I − G)⁻¹.
    "+elementwise": ψ_i(c_i) = c_i and |ψ'| < 1, so r_i and z_i − c_i have one sign: the solutions are the same.
    "+box": an upper obstacle as well, at a height of a tenth to a hundred times what a row alone would move by. Where
    c is finite z is in a compact set, on which there is a solution; a row without c has none above either.

    Parameters
    ----------
    family : str
        One of `family_names()`.
    n : int
        Wanted number of unknowns, at least 3.
    rng : numpy.random.Generator
        Its state decides everything.

    Returns
    -------
    ICP
    """
    base, _, kind = family.partition("+")
    if family not in family_names():
        raise ValueError(f"family is {family!r}; one of {', '.join(family_names())} was expected")
    one = _FAMILIES[base]
    if not 3 <= n <= one.most:
        raise ValueError(f"n is {n}; an integer from 3 to {one.most} was expected for {family}")
    A, c, q = one.build(n, rng)
    if kind == "box":
        return icp.ICP(A, q, c, upper=_above(A, c, q, rng))
    if kind == "affine":
        psi = _leaning(A, c, rng) if one.is_m else _giving_way(A, c, q, rng)
    else:
        psi = _bending(c, rng) if kind else c
    return icp.ICP(A, q, psi)


def drawn_sizes(family, seed, low, high, count):
    """`count` sizes from `low` to `high`, one at random in each of as many geometric steps.

    None is above the largest size of the family; a name that is no family has no such bound.
    """
    if (one := _FAMILIES.get(family.partition("+")[0])) is not None:
        high = min(high, one.most)
    if high < low:
        return []
    places = (np.arange(count) + _generator(seed, family).random(count)) / count
    found = [round(low * (high / low) ** place) for place in places]
    return list(dict.fromkeys(n + (n % 10 == 0) * (1 if n < high else -1) for n in found))


def problem_of(family, seed, n):
    """The problem that `seed` stands for, whatever else is drawn."""
    return drawn(family, n, _generator(seed, family, n))


def _generator(seed, family, n=0):
    return np.random.default_rng([seed, zlib.crc32(family.encode()), n])


def _leaning(A, c, rng):
    W = sp.csr_array(sp.diags_array(A.diagonal()) - A)
    W.eliminate_zeros()
    sums = W.sum(axis=1)
    G = sp.diags_array(rng.uniform(0.3, 0.9) / np.where(sums > 0, sums, 1.0)) @ W
    return icp.Affine(G, c - G @ c)


def _giving_way(A, c, q, rng):
    A = sp.csr_array(A)
    s = float(abs(A).sum(axis=1).max())
    B = sp.eye_array(A.shape[0]) - A / s
    gamma = rng.uniform(0.3, 0.9) / max(1.0, float(abs(B).sum(axis=1).max()))
    return icp.Affine(gamma * B, (1.0 - gamma) * c - (gamma / s) * q)


def _above(A, c, q, rng):
    A, held = sp.csr_array(A), np.isfinite(c)
    diagonal = np.abs(A.diagonal())
    moves = np.abs(A @ np.where(held, c, 0.0) + q) / np.where(diagonal > 0, diagonal, 1.0)
    height = 10.0 ** rng.uniform(-1.0, 2.0) * (float(np.median(moves)) or 1.0)
    return np.where(held, c + height * rng.uniform(0.5, 1.5, c.size), np.inf)


def _bending(c, rng):
    held = np.isfinite(c)
    spread = float(c[held].std()) or 1.0
    steep, scale, kind = rng.uniform(0.2, 0.9), scattered(rng, 0.3, 3.0) * spread, rng.integers(3)
    f, slope = (partial(one, steep, scale) for one in (_SHAPES[kind], _SLOPES[kind]))
    return icp.Elementwise(f, slope, lipschitz=steep, c=np.where(held, c - f(np.where(held, c, 0.0)), c))


#: f(t) = scale·steep·g(t/scale), |g'| ≤ 1, and its derivative
_SHAPES = (
    lambda steep, scale, t: scale * steep * np.sin(t / scale),
    lambda steep, scale, t: scale * steep * np.arctan(t / scale),
    lambda steep, scale, t: scale * steep * -np.sqrt(1.0 + (t / scale) ** 2),
)
_SLOPES = (
    lambda steep, scale, t: steep * np.cos(t / scale),
    lambda steep, scale, t: steep / (1.0 + (t / scale) ** 2),
    lambda steep, scale, t: steep * -(t / scale) / np.sqrt(1.0 + (t / scale) ** 2),
)


def expander(n):
    """An M-matrix on a random graph that nothing small cuts in two, so that its factors are as good as dense."""
    return drawn("graph-expander", n, np.random.default_rng(0))
