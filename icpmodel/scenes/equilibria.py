"""Equilibria of markets and games, p nonlinear: few unknowns, known answers."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import root

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..numerics.rounding import UNIT_ROUNDOFF
from .registry import Quantity, Scene, register


def _nearest_distance(*solutions: Any) -> dict[str, Quantity]:
    """The quantity "z", the distance of z to the nearest of the known `solutions` in the maximum norm."""
    known = np.array(solutions, dtype=float)
    return {"z": Quantity(0.0, partial(_distance, known), order=None)}


def _distance(known: Any, z: Vector) -> float:
    return float(np.abs(known - z).max(axis=1).min())


@register
def five_firms() -> Scene:
    """Five firms that compete in quantities: a nonlinear Nash–Cournot game.

    Firm i sells z_i ≥ 0. Its marginal profit is −p_i: p_i(z) = c_i + (z_i/5)^(1/b_i) − P(Q) − z_i P′(Q), with Q = Σz,
    the price P(Q) = (5000/Q)^(1/1.1), c = (10, 8, 6, 4, 2) and b = (1.2, 1.1, 1, .9, .8).

    Returns
    -------
    Scene
        With the start (10, …, 10), as P has no value at 0. The quantity "z" is the distance to the equilibrium.

    References
    ----------
    Murphy, Sherali and Soyster, Math. Programming 24 (1982), doi:10.1007/BF01585096.
    """
    problem = ICP.nonlinear(marginal_loss, n=5)
    models = "Five firms choose how much to sell, each to its own profit, at a price that falls with the total."
    start = np.full(5, 10.0)
    solution = root(marginal_loss, start, tol=UNIT_ROUNDOFF).x  # all firms sell, and no marginal profit is left
    return Scene(problem=problem, models=models, quantities=_nearest_distance(solution), z0=start)


def marginal_loss(z: Vector) -> Vector:
    """p of the scene `five_firms`, shape (5,)."""
    total = z.sum()
    with np.errstate(divide="ignore", invalid="ignore"):
        price = (5000.0 / total) ** (1.0 / 1.1)
        cost = np.array([10.0, 8.0, 6.0, 4.0, 2.0]) + (z / 5.0) ** (1.0 / np.array([1.2, 1.1, 1.0, 0.9, 0.8]))
        loss: Vector = cost - price + z * price / (1.1 * total)
    return loss


@register
def kojima_shindo() -> Scene:
    """Four quadratics with two solutions, one of them degenerate.

    - p₁ = 3z₁² + 2z₁z₂ + 2z₂² + z₃ + 3z₄ − 6. p₂ = 2z₁² + z₁ + z₂² + 10z₃ + 2z₄ − 2.
    - p₃ = 3z₁² + z₁z₂ + 2z₂² + 2z₃ + 9z₄ − 9. p₄ = z₁² + 3z₂² + 2z₃ + 3z₄ − 3.

    ψ = 0. At (√6/2, 0, 0, ½) row 3 has p = r = 0; the other solution is (1, 0, 3, 0).

    Returns
    -------
    Scene
        The quantity "z" is the distance to the nearer solution.

    References
    ----------
    Kojima and Shindo, J. Oper. Res. Soc. Japan 29 (1986), doi:10.15807/jorsj.29.352.
    """
    solutions = _nearest_distance([1.5**0.5, 0.0, 0.0, 0.5], [1.0, 0.0, 3.0, 0.0])
    models = (
        "A test of methods for nonlinear complementarity: two solutions, at one of which a row touches without force."
    )
    return Scene(problem=ICP.nonlinear(_four_quadratics, n=4), models=models, quantities=solutions)


def _four_quadratics(z: Vector) -> Vector:
    a, b, c, d = z
    return np.array(
        [
            3 * a**2 + 2 * a * b + 2 * b**2 + c + 3 * d - 6,
            2 * a**2 + a + b**2 + 10 * c + 2 * d - 2,
            3 * a**2 + a * b + 2 * b**2 + 2 * c + 9 * d - 9,
            a**2 + 3 * b**2 + 2 * c + 3 * d - 3,
        ]
    )


@register
def exchange(delta: float = 0.01) -> Scene:
    """Prices at which two consumers trade, one good being unwanted.

    Consumer 1 has one unit each of goods 1 and 3, consumer 2 one of good 2. Consumer 1 spends half of the income on
    good 1 and half on good 2, consumer 2 a quarter and three quarters; nobody wants good 3. Good 1 has the price 1.
    z holds the prices of goods 2 and 3, and p is supply less demand: p = (1 − (1 + z₂)/(2z₁) − ¾, 1).

    Parameters
    ----------
    delta : float, default 0.01
        The price floor δ > 0, ψ = (δ, δ).

    Returns
    -------
    Scene
        The quantity "z" is the distance to the equilibrium, z* = (2(1 + δ), δ).

    Raises
    ------
    InputError
        Unless δ > 0.

    References
    ----------
    Mathiesen, Math. Programming Study 23 (1985), doi:10.1007/BFb0121030, for the form.
    """
    delta = as_number(delta, "delta", above=0)
    problem = ICP.nonlinear(_excess_supply, psi=[delta, delta])
    models = "Two consumers trade three goods, of which nobody wants one: its price falls to the floor."
    return Scene(problem=problem, models=models, quantities=_nearest_distance([2.0 * (1.0 + delta), delta]))


def _excess_supply(z: Vector) -> Vector:
    with np.errstate(divide="ignore"):
        return np.array([0.25 - (1.0 + z[1]) / (2.0 * z[0]), 1.0])
