"""Lubrication: oil films that tear where their pressure would be negative."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.optimize import brentq

from ..icp import ICP
from ..numerics.arrays import Vector
from ..problem.by_rows import ByRows, LocalRows
from .grid import rows_of
from .registry import Quantity, Scene, assembles, register, size

#: eccentricity ε
ECCENTRICITY = 0.5


@assembles("bearing")
def _bearing(n: int) -> ByRows:
    return ByRows((size(n, 10),), partial(_film_rows, n))


def _film_rows(n: int, lo: int, hi: int) -> LocalRows:
    """Rows lo ≤ i < hi of the scene `bearing`."""
    h = 2.0 * np.pi / (n + 1)
    H = 1.0 + ECCENTRICITY * np.cos((np.arange(lo, hi + 1) + 0.5) * h)
    cubes = H**3
    A = rows_of(n, lo, hi, {-1: -cubes[:-1], 0: cubes[:-1] + cubes[1:], 1: -cubes[1:]})
    return LocalRows(A, h * np.diff(H), np.zeros(hi - lo))


@register
def bearing(n: int = 300) -> Scene:
    """The oil film of a journal bearing, torn by cavitation.

    −(H³p′)′ + H′ ≥ 0, p ≥ 0, complementary, on 0 < θ < 2π, p(0) = p(2π) = 0. The film thickness is
    H = 1 + ε cos θ, ε = .5. This is Reynolds' equation of the infinitely long bearing.

    Parameters
    ----------
    n : int, default 300
        Number of interior points.

    Returns
    -------
    Scene
        With two quantities. "p_max" is the top of the parabola through the three highest points.
        "cavitation angle" is the θ_c where the film tears.

    Raises
    ------
    InputError
        For n < 10.

    Notes
    -----
    Discretised on n interior points, h = 2π/(n + 1), with H at the midpoints; rows are multiplied
    by h², ψ = 0. Row i is −H³₋(p_{i−1} − p_i) − H³₊(p_{i+1} − p_i) + h(H₊ − H₋). Units: θ in
    radians, H in radial clearances. Pressure is made dimensionless by
    6·viscosity·speed·radius/clearance².

    In Sommerfeld's variable γ, H = (1 − ε²)/(1 − ε cos γ), the film tears where (2 + ε cos γ) sin γ
    = (2 cos γ + ε)γ, π < γ < 3π/2. There p_max = −πε(2 cos γ + ε)/((1 − ε cos γ)(1 − ε²)^1.5).

    Within the film the flow H − H³p′ is constant. Where the film tears p′ = 0, so the flow in the
    first cell gives H(θ_c). Both quantities are O(h²). The factor depends on where θ_c falls between
    two grid points: measured at most .08h² and .015h².

    References
    ----------
    Hamrock, Schmid and Jacobson, Fundamentals of Fluid Film Lubrication (2004), for γ. Cryer, Math.
    Comp. 25 (1971), doi:10.1090/S0025-5718-1971-0298961-7.
    """
    rows = _bearing(n)
    h = 2.0 * np.pi / (n + 1)
    first = 1.0 + ECCENTRICITY * np.cos(np.pi / (n + 1))
    p_max, cavitation = film_solution()
    known = {
        "p_max": Quantity(p_max, _top, order=2.0),
        "cavitation angle": Quantity(cavitation, partial(_angle, first, first**3 / h), order=2.0),
    }
    models = "The pressure of the oil between a shaft and its bearing, and where the oil film tears."
    points = np.linspace(0.0, 2.0 * np.pi, n + 2)[1:-1]
    problem = ICP(*rows.local_rows(0, n))
    return Scene(
        problem=problem,
        models=models,
        quantities=known,
        h=h,
        points=points,
        axes=("angle θ, rad",),
        unknown="pressure z, dimensionless",
    )


def film_solution() -> tuple[float, float]:
    """The greatest pressure p_max, and the angle θ_c where the film tears."""
    e = ECCENTRICITY
    c = np.cos(brentq(lambda g: (2.0 + e * np.cos(g)) * np.sin(g) - (2.0 * np.cos(g) + e) * g, np.pi, 1.5 * np.pi))
    p_max = -np.pi * e * (2.0 * c + e) / ((1.0 - e * c) * (1.0 - e * e) ** 1.5)
    return float(p_max), float(2.0 * np.pi - np.arccos((c - e) / (1.0 - e * c)))


def _top(z: Vector) -> float:
    """The maximum of the parabola through the highest point and its two neighbours."""
    i = min(max(int(np.argmax(z)), 1), z.size - 2)
    slope = (z[i + 1] - z[i - 1]) / 2.0
    bend = z[i + 1] - 2.0 * z[i] + z[i - 1]
    return float(z[i] - slope**2 / (2.0 * bend)) if bend != 0 else float(z[i])


def _angle(thickness: float, drag: float, z: Vector) -> float:
    """The θ > π with H(θ) = `thickness` − `drag`·z_0, the flow, or NaN: the film tears where the gap widens."""
    cosine = float(thickness - drag * z[0] - 1.0) / ECCENTRICITY
    return float(2.0 * np.pi - np.arccos(cosine)) if abs(cosine) <= 1 else float("nan")
