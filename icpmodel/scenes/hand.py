"""Problems small enough to be solved by hand; each docstring has the solution."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..icp import ICP
from ..problem.affine import Affine
from .grid import tridiagonal
from .registry import Scene, register

#: a symmetric positive definite M-matrix
PAIR = tridiagonal(2).toarray()


def by_hand(A: Any, q: Any, psi: Any, z: Any, models: str, z0: Any = None, upper: Any = None) -> Scene:
    """The scene with these data and their known solution `z`."""
    start = None if z0 is None else np.array(z0, dtype=float)
    return Scene(problem=ICP(A, q, psi, upper), models=models, z_exact=np.array(z, dtype=float), z0=start)


@register
def hand_lcp() -> Scene:
    """By hand: an LCP in two unknowns, one at its obstacle.

    A = [2, −1; −1, 2], q = (−1, 3), ψ = 0. Row 1: 2z₁ − z₂ = 1; row 2: z₂ = 0. z* = (½, 0), p* =
    (0, 2½).

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992).
    """
    return by_hand(PAIR, [-1, 3], 0.0, [0.5, 0.0], "Two weights on a string, one of which rests on the floor.")


@register
def hand_negative() -> Scene:
    """By hand: one unknown whose solution is negative.

    A = 2, q = 6, ψ(z) = z/2 − 2. p = 0 gives z* = −3, above its obstacle: ψ(−3) = −3½. Only p and r must be ≥ 0, not z:
    a solver that requires z ≥ 0 finds no solution (z = 0 has p = 6 and r = 2).
    """
    return by_hand(2, [6], Affine([[0.5]], -2.0), [-3.0], "A spring pressed below 0 over a floor that yields with it.")


@register
def hand_affine() -> Scene:
    """By hand: two unknowns that are each other's obstacle.

    A = [2, −1; −1, 2], q = (1, −2), ψ(z) = (z₂/2 + 1, z₁/2 − 3). Row 1 at its obstacle, z₁ = z₂/2 + 1; row 2 in
    balance, −z₁ + 2z₂ = 2. z* = (2, 2), p* = (3, 0), r* = (0, 4).
    """
    psi = Affine([[0.0, 0.5], [0.5, 0.0]], [1.0, -3.0])
    return by_hand(PAIR, [1, -2], psi, [2.0, 2.0], "Two weights on a string, each carrying a stop for the other.")


@register
def hand_degenerate() -> Scene:
    """By hand: a row with p = r = 0.

    A = [2, −1; −1, 2], q = (−2, 1), ψ = 0. z* = (1, 0), p* = (0, 0), r* = (1, 0): row 2 touches
    without force. Rounding decides whether a method takes it as active.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992).
    """
    return by_hand(PAIR, [-2, 1], 0.0, [1.0, 0.0], "Two weights on a string, one touching the floor without pressing.")


@register
def hand_cyclic() -> Scene:
    """By hand: a P-matrix on which Newton's iteration runs in a circle.

    A = [1, 0, 2; 2, 1, 0; 0, 2, 1], q = −(1, 1, 1), ψ = 0. Every row sum is 3, so z* = (1, 1, 1)/3
    has p* = 0. From `z0` = (1, 0, 0) the active-set Newton iteration repeats three points at Res =
    √10.

    References
    ----------
    Ben Gharbia and Gilbert, Math. Program. 134 (2012), doi:10.1007/s10107-010-0439-6.
    """
    A = [[1, 0, 2], [2, 1, 0], [0, 2, 1]]
    models = "Three quantities in a ring, each pushed by the one before it, that settle at the same level."
    return by_hand(A, [-1, -1, -1], 0.0, [1 / 3, 1 / 3, 1 / 3], models, z0=[1, 0, 0])


@register
def hand_splittings() -> Scene:
    """By hand: two unknowns on which some splittings fail.

    A = [1, −.9; −.9, 1], q = (−1, 3), ψ(z) = 1 − .9(z₂, z₁). Row 1 is in balance, z₁ = 1 + .9z₂.
    Row 2 is at its obstacle, z₂ = 1 − .9z₁. Hence 1.81z₁ = 1.9 and z* = (190, 10)/181, p* = (0,
    382)/181, r* = (18, 0)/181.

    From `z0` = (5, −7) MNMJ with Ω = D converges, MNMGS with Ω = D and MNMOD do not.
    """
    A = [[1.0, -0.9], [-0.9, 1.0]]
    psi = Affine([[0.0, -0.9], [-0.9, 0.0]], 1.0)
    models = "Two partners who pull each other up while the floor of each sinks as the other rises."
    return by_hand(A, [-1, 3], psi, [190 / 181, 10 / 181], models, z0=[5, -7])


@register
def hand_free() -> Scene:
    """By hand: rows that do not interact, one of them without an obstacle.

    A = diag(2, 4, 5), q = (−2, 8, 10), ψ = (0, 1, −∞). Row 1 is in balance, z₁ = 1. Row 2 is at its
    obstacle, z₂ = 1 with p₂ = 12. Row 3 has none, so p₃ = 0 and z₃ = −2.
    """
    models = "Three springs side by side: one free above a floor, one on it, one without a floor."
    return by_hand(np.diag([2, 4, 5]), [-2, 8, 10], [0.0, 1.0, -np.inf], [1, 1, -2], models)


@register
def hand_box() -> Scene:
    """By hand: three unknowns, one at each of two obstacles and one between.

    A = tridiag(−1, 2, −1), q = (1.5, 0, −2.5), ψ = 0, ψ̄ = 1. Row 1 at ψ, row 3 at ψ̄, row 2 in balance: 2z₂ = z₁ + z₃.
    z* = (0, ½, 1), p* = (1, 0, −1).
    """
    models = "Three weights on a string between the floor and the ceiling."
    return by_hand(tridiagonal(3), [1.5, 0.0, -2.5], 0.0, [0.0, 0.5, 1.0], models, upper=1.0)
