"""Impulse control: when to act, and how far, if every act has a fixed cost."""

from __future__ import annotations

from functools import partial
from operator import itemgetter
from typing import Any

import numpy as np
from scipy.optimize import fsolve

from ..icp import ICP
from ..numerics.arrays import Vector
from ..problem.intervention import Intervention
from .grid import smooth_fit, tridiagonal, value_equation
from .registry import Quantity, Scene, register, size

#: drift and volatility of the reserve, discount rate, and the fixed cost of a payment
DRIFT = 0.5
VOLATILITY = 0.3
DISCOUNT = 0.2
COST = 0.05
#: the value of one unit paid out, after a tax of .2
WORTH = 1.0 / 1.2

#: the names of the coordinates in pictures
_AXES = ("reserve x",)


@register
def dividend(n: int = 241) -> Scene:
    """Dividends with a fixed cost: when to pay, and how much.

    A reserve follows dX = μdt + σdW until ruin at 0. Paying it down from x to y is worth (x − y −
    c)/(1 + λ). Its value V satisfies p = ρV − ½σ²V″ − μV′ ≥ 0, V ≥ ψ(V), complementary, with V(0) =
    0. The obstacle is ψ(V)(x) = max over y ≤ x − c of V(y) + (x − y − c)/(1 + λ). The constants are
    μ = .5, σ = .3, ρ = λ = .2, c = .05.

    Parameters
    ----------
    n : int, default 241
        Number of unknowns; the nearest 30k + 1 with k ≥ 1 is taken.

    Returns
    -------
    Scene
        With three quantities. "V(1)" is the value at x = 1. "x*" is where V′ reaches 1/(1 + λ)
        (smooth fit), extrapolated from the last three cells without payment. "target" is where V′
        first falls to 1/(1 + λ).

    Raises
    ------
    InputError
        For n < 31.

    Notes
    -----
    Without payments V = C(e^(ax) − e^(bx)), a and b the roots of ½σ²s² + μs = ρ. The reserve is paid
    down from x* to y*, where V′(x*) = V′(y*) = 1/(1 + λ) and V(x*) − V(y*) = (x* − y* − c)/(1 + λ).

    Discretised on x_i = ih, 0 ≤ i < n, up to 1.5, by central differences. The step is h = c/k, so
    that the jump of length c and the point x = 1 lie on the grid: n = 30k + 1. Row 0 is z_0 = 0.
    The last row has the slope 1/(1 + λ) by a ghost point. Rows with x < c allow no jump: ψ = −∞. A
    is a Z-matrix (h < σ²/μ), A1 > 0, ψ isotone, ρ(G) ≥ 1. Units: money in units of the reserve,
    time in years; p is money per year.

    All quantities are O(h²). The factor depends on where x* falls between two grid points: measured
    2.1 to 3.2, 2.5 to 3.8 and 2.3 to 3.1 times h² for k ≥ 2.

    References
    ----------
    Bensoussan and Lions, Impulse Control and Quasi-Variational Inequalities (1984).
    Jeanblanc-Picqué and Shiryaev, Russ. Math. Surv. 50 (1995).
    """
    k = round((size(n, 31) - 1) / 30)
    h = COST / k
    # up to 1.5, beyond the free boundary: there V is a straight line, and the length has no influence
    x = h * np.arange(30 * k + 1, dtype=np.float64)
    A, q = _operator(x.size, h)
    problem = ICP(A, q, Intervention(partial(_best_payment, x=x, k=k)))

    target, boundary, value_at_1 = dividend_solution()
    known = {
        "V(1)": Quantity(value_at_1, itemgetter(20 * k), order=2.0),
        "x*": Quantity(boundary, partial(_boundary, problem, x), order=2.0),
        "target": Quantity(target, partial(_target, x), order=2.0),
    }
    models = "The value of a reserve to its owner, who pays himself dividends at a fixed cost and a tax."
    return Scene(
        problem=problem, models=models, quantities=known, h=h, points=x, axes=_AXES, unknown="value z of the reserve"
    )


def dividend_solution() -> tuple[float, float, float]:
    """The target y*, the boundary x* and V(1)."""
    rates = np.roots([0.5 * VOLATILITY**2, DRIFT, -DISCOUNT])

    def value_and_slope(x: Any) -> Any:
        """V/C and V′/C without payments; a > 0 > b."""
        return np.exp(np.multiply.outer(x, rates)) @ np.transpose([np.sign(rates), np.abs(rates)])

    def misfit(ends: Vector) -> Vector:
        (low, slope), (high, slope_at_high) = value_and_slope(ends)
        return np.array([slope_at_high - slope, high - low - slope * (ends[1] - ends[0] - COST)])

    target, boundary = fsolve(misfit, [0.0, 1.0])
    return float(target), float(boundary), float(WORTH * value_and_slope(1.0)[0] / value_and_slope(target)[1])


def _boundary(problem: ICP, x: Vector, z: Vector) -> float:
    """x*, by smooth fit in the last three cells without payment."""
    return smooth_fit(x, z, int(np.argmax(problem.r(z) < problem.p(z))) - 3, WORTH)


def _target(x: Vector, z: Vector) -> float:
    return smooth_fit(x, z, int(np.argmax(np.diff(z) / (x[1] - x[0]) < WORTH)) - 1, WORTH)


def _operator(n: int, h: float) -> tuple[Any, Vector]:
    """A and q of ρV − ½σ²V″ − μV′ with V(0) = 0 in row 0 and V′ = 1/(1 + λ) at the right end."""
    left, middle, right = value_equation(n, h, DISCOUNT, DRIFT, VOLATILITY)
    q = np.zeros(n)
    middle[0] = 1.0
    right[0] = 0.0
    # ghost point: V(x + h) = V(x - h) + 2h·WORTH
    left[-1] += right[-1]
    q[-1] = 2.0 * h * WORTH * right[-1]
    return tridiagonal(n, left, middle, right), q


def _best_payment(z: Vector, x: Vector, k: int) -> tuple[Vector, np.ndarray]:
    """(ψ(z), target) in one pass: the best j ≤ i − k maximises z_j − x_j/(1 + λ), which does not depend on i."""
    merit = z - WORTH * x
    best = np.maximum.accumulate(merit)
    record = np.concatenate([[True], merit[1:] > best[:-1]])
    where = np.maximum.accumulate(np.where(record, np.arange(z.size), 0))
    value = np.full(z.size, -np.inf)
    target = np.full(z.size, -1)
    value[k:] = best[:-k] + WORTH * (x[k:] - COST)
    target[k:] = where[:-k]
    return value, target
