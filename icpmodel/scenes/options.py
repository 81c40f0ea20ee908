"""Options: contracts that their holder may exercise, and their writer cancel."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from .grid import smooth_fit, tridiagonal, value_equation
from .registry import Quantity, Scene, distance_to, register, size

#: interest rate and volatility, per year; the bounded solution of the equation decays as s^-DECAY
INTEREST = 0.05
VOLATILITY = 0.3
DECAY = 2.0 * INTEREST / VOLATILITY**2

#: the names of the coordinates in pictures
_AXES = ("log of price / strike",)


@register
def game_put(n: int = 201, delta: float = 0.05) -> Scene:
    """A perpetual put that its writer may cancel.

    The holder may exercise for (1 − s)⁺. The writer may cancel at the penalty δ for (1 − s)⁺ + δ
    (an Israeli option, strike 1). Let p = rV − ½σ²V″ − (r − ½σ²)V′ as a function of y = ln s, with
    r = .05, σ = .3. The value V satisfies p ≥ 0 where V is the first payoff, p ≤ 0 where it is the
    second, and p = 0 between.

    Parameters
    ----------
    n : int, default 201
        Number of unknowns, at least 33; even numbers are raised by 1.
    delta : float, default 0.05
        Penalty δ > 0.

    Returns
    -------
    Scene
        With two quantities. "V" is the largest error over the grid. "k" is where the slopes of the
        first three cells with V above 1 − s, extrapolated, reach that of 1 − s (smooth fit).

    Notes
    -----
    Let γ = 2r/σ² and k the root in (0, 1) of k^(γ+1) + γ = (1 + δ)(1 + γ)k. Then V = 1 − s up to s
    = k, V = as + bs^−γ up to 1, with V′ continuous at k, and δs^−γ beyond 1. The writer cancels at
    s = 1, in one row; for δ ≥ (1 − k)k^γ with k = γ/(1 + γ), never.

    Discretised on n points, −1 ≤ y ≤ 1, by central differences; n is odd, so that s = 1 is one of
    them. Row 0 is V = 1 − s. The last row has V′ = −γV by a ghost point. Both quantities are O(h²).
    The factor depends on where k falls between two points: measured at most .12h² and .34h² for δ =
    .05.

    References
    ----------
    Kifer, Finance Stoch. 4 (2000), 443-463. Kyprianou, Finance Stoch. 8 (2004), 73-86.
    """
    n = size(n, 33) | 1
    delta = as_number(delta, "delta", above=0)
    y = np.linspace(-1.0, 1.0, n)
    h = 2.0 / (n - 1)
    s = np.exp(y)
    A, q = _operator(n, h)
    payoff = np.maximum(1.0 - s, 0.0)
    problem = ICP(A, q, payoff, payoff + delta)
    value, k = game_put_value(delta)
    known = {"V": distance_to(value(s)), "k": Quantity(k, partial(_exercise, problem, y), order=2.0)}
    models = "The value of a put for ever, which its holder may exercise and its writer cancel at a penalty."
    return Scene(
        problem=problem, models=models, quantities=known, h=h, points=y, axes=_AXES, unknown="option value z, strikes"
    )


def game_put_value(delta: float) -> tuple[Any, float]:
    """The value function s ↦ V(s), and k, below which the holder exercises."""
    from scipy.optimize import brentq

    g = DECAY
    k = g / (1.0 + g)
    if delta >= (1.0 - k) * k**g:  # an American put
        return partial(_value, k, (1.0 - k) * k**g), k
    k = float(brentq(lambda k: k ** (g + 1.0) + g - (1.0 + delta) * (1.0 + g) * k, 0.0, 1.0, xtol=1e-15))
    return partial(_value, k, delta), k


def _value(k: float, at_1: float, s: Vector) -> Vector:
    """V(s) with V(1) = `at_1`. By smooth fit at k, b = k^γ/(1 + γ) and a = γ/((1 + γ)k) − 1."""
    a = DECAY / ((1.0 + DECAY) * k) - 1.0
    b = k**DECAY / (1.0 + DECAY)
    decay = s**-DECAY
    return np.where(s <= k, 1.0 - s, np.where(s < 1.0, a * s + b * decay, at_1 * decay))


def _operator(n: int, h: float) -> tuple[Any, Vector]:
    """A and q of rV − ½σ²V″ − (r − ½σ²)V′ with V = 1 − 1/e in row 0 and V′ = −γV at the right end."""
    left, middle, right = value_equation(n, h, INTEREST, INTEREST - 0.5 * VOLATILITY**2, VOLATILITY)
    q = np.zeros(n)
    # row 0 has the diagonal of the other rows, and the last row is halved, to make A + A' positive definite
    right[0] = 0.0
    q[0] = middle[0] * (np.exp(-1.0) - 1.0)
    # ghost point: V(y + h) = V(y - h) - 2h·DECAY·V(y)
    left[-1] = (left[-1] + right[-1]) / 2.0
    middle[-1] = middle[-1] / 2.0 - h * DECAY * right[-1]
    return tridiagonal(n, left, middle, right), q


def _exercise(problem: ICP, y: Vector, z: Vector) -> float:
    first = int(np.argmax(problem.r(z) > problem.p(z)))
    return float(np.exp(smooth_fit(y, z + np.exp(y), first, 0.0)))
