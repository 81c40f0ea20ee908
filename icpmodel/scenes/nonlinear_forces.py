"""Bodies with forces that are not linear in z: radiation, an explosion, a soft contact."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np
from scipy.optimize import brentq

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..problem.elementwise import Elementwise
from ..problem.function import Function
from .grid import five_point, side, square_points, tridiagonal
from .registry import Quantity, Scene, register

#: the largest temperature of `bratu`
CEILING = 5.0


@register
def radiating_membrane(n: int = 900, kappa: float = 10.0) -> Scene:
    """A hot plate that radiates, kept at least as warm as a heater.

    −Δu + κ|u|u³ ≥ g, u ≥ ψ, complementary on the unit square, u the temperature. By choice of g and ψ the solution is
    u = 1 + sin πx sin πy, with contact where r² = (x − ½)² + (y − ½)² ≤ 1/16: ψ = u − max(r² − 1/16, 0), and the heater
    gives max(1 − 16r², 0).

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    kappa : float, default 10
        Strength κ ≥ 0 of the radiation.

    Returns
    -------
    Scene
        With z_exact; f has the slopes 4h²κ|u|³ ≥ 0, so that the solution is the only one.

    Raises
    ------
    InputError
        Where κ is negative.

    Notes
    -----
    The 5-point stencil on m × m interior points, h = 1/(m + 1), rows multiplied by h².

    References
    ----------
    Rodrigues, Obstacle Problems in Mathematical Physics (1987), for monotone operators.
    """
    m = side(n)
    h2 = (m + 1.0) ** -2
    strength = as_number(kappa, "kappa", minimum=0) * h2
    xy = square_points(m)
    u = 1.0 + np.sin(np.pi * xy).prod(axis=1)
    beyond = ((xy - 0.5) ** 2).sum(axis=1) - 1.0 / 16.0
    A = five_point(m)
    f = Elementwise(partial(_radiation, strength), partial(_radiation_slope, strength), slope_range=(0.0, np.inf))
    q = h2 * np.maximum(-16.0 * beyond, 0.0) - A @ u - _radiation(strength, u)
    return Scene(
        problem=ICP(A, q, u - np.maximum(beyond, 0.0), f=f),
        models="A plate that loses heat by radiation, kept above a temperature by a heater below.",
        z_exact=u,
        h=h2**0.5,
        points=xy,
        unknown="temperature z",
    )


def _radiation(strength: float, z: Vector) -> Vector:
    return strength * np.abs(z) * z * (z * z)


def _radiation_slope(strength: float, z: Vector) -> Vector:
    return 4.0 * strength * np.abs(z) * (z * z)


@register
def bratu(n: int = 100, heat: float = 1.0) -> Scene:
    """Bratu's equation of an explosion under a ceiling: up to three solutions.

    −u″ − λe^u ≤ 0 at the ceiling u = 5, = 0 below it, u(0) = u(1) = 0. In the half next to 0 a solution is u = c − 2 ln
    cosh(√(λe^c/2)(x_c − x)), with its top c at x_c = arcosh(e^(c/2))/√(λe^c/2). For λ < 3.5138… two values of c give
    x_c = ½, which is the top of a free solution; a fold joins the two. A third solution lies at the ceiling c = 5.

    Parameters
    ----------
    n : int, default 100
        Number of interior points.
    heat : float, default 1
        λ > 0.

    Returns
    -------
    Scene
        The quantity "top" is the distance of the largest z to the nearest top, O(h²).

    Raises
    ------
    InputError
        Unless λ > 0.

    References
    ----------
    Doedel, Keller and Kernévez, Int. J. Bifurcation Chaos 1 (1991), doi:10.1142/S0218127491000397.
    """
    heat = as_number(heat, "heat", above=0)
    h2 = (n + 1.0) ** -2
    tops = [top for top in free_tops(heat) if top < CEILING]
    tops += [CEILING] * (_half_width(CEILING, heat) < 0.5)
    steepest = heat * h2 * np.exp(CEILING)
    f = Elementwise(partial(_heating, heat * h2), partial(_heating_slope, heat * h2), slope_range=(-steepest, 0.0))
    return Scene(
        problem=ICP(tridiagonal(n), np.zeros(n), -np.inf, CEILING, f=f),
        models="The temperature of a reaction that heats itself, in a slab with cold sides, up to a ceiling.",
        quantities={"top": Quantity(0.0, partial(_from_tops, tops), order=2.0)},
        h=h2**0.5,
        points=np.linspace(0.0, 1.0, n + 2)[1:-1],
        unknown="temperature z",
    )


def _from_tops(tops: list[float], z: Vector) -> float:
    return min(abs(float(z.max()) - top) for top in tops)


def _heating(strength: float, z: Vector) -> Vector:
    return -strength * np.exp(np.minimum(z, CEILING))


def _heating_slope(strength: float, z: Vector) -> Vector:
    return np.where(z > CEILING, 0.0, _heating(strength, z))


def _half_width(top: float, heat: float) -> float:
    """The x_c of a solution of Bratu's equation with the top c = `top`."""
    return float(np.arccosh(np.exp(top / 2.0)) / np.sqrt(heat * np.exp(top) / 2.0))


def free_tops(heat: float) -> list[float]:
    """The values of c with x_c = ½, two or, beyond the fold, none; x_c is largest at c = 1.1868…."""
    widest = 1.18684216
    if _half_width(widest, heat) < 0.5:
        return []
    return [float(brentq(lambda c: _half_width(c, heat) - 0.5, *ends)) for ends in ((1e-12, widest), (widest, 60.0))]


@register
def soft_contact(mu: float = 0.5) -> Scene:
    """A weight on a soft, Hertzian contact, pushed sideways.

    z = (d, t): the depth d ≥ 0 and the force of friction |t| ≤ μN(d), N(d) = 8d^(3/2). Under the weight 1 row 1 is
    N(d) − 1 ≥ 0. A push of .7 moves the weight by p₂ = t − .7, unless friction holds it.

    Parameters
    ----------
    mu : float, default 0.5
        The friction μ ≥ 0.

    Returns
    -------
    Scene
        With z_exact = (¼, min(.7, μ)): it slides where μ < .7.

    Raises
    ------
    InputError
        Where μ is negative.

    References
    ----------
    Johnson, Contact Mechanics (1985), chapter 4.
    """
    mu = as_number(mu, "mu", minimum=0)
    f = Function(_hertz, _hertz_slope)
    low, high = (Function(partial(_friction, side), partial(_friction_slope, side)) for side in (-mu, mu))
    problem = ICP(np.diag([0.0, 1.0]), [-1.0, -0.7], low, high, f=f)
    models = "A weight that sinks into a soft ground and is pushed: friction grows with the force of the ground."
    start = np.array([1.0, 0.0])
    return Scene(problem=problem, models=models, z_exact=np.array([0.25, min(0.7, mu)]), z0=start)


def _hertz(z: Vector) -> Vector:
    return np.array([8.0 * np.maximum(z[0], 0.0) ** 1.5, 0.0])


def _hertz_slope(z: Vector) -> Any:
    return np.diag([12.0 * np.maximum(z[0], 0.0) ** 0.5, 0.0])


def _friction(mu: float, z: Vector) -> Vector:
    return np.array([0.0 if mu < 0.0 else np.inf, mu * _hertz(z)[0]])


def _friction_slope(mu: float, z: Vector) -> Any:
    return np.array([[0.0, 0.0], [mu * _hertz_slope(z)[0, 0], 0.0]])
