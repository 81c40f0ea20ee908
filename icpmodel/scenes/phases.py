"""Phases that separate: an order parameter that cannot leave [−1, 1]."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..icp import ICP
from ..numerics.arrays import Vector
from .grid import tridiagonal
from .registry import Quantity, Scene, distance_to, register, size

#: the interface is πε wide
EPSILON = 0.2
#: with a time step of at most 1 the solution is unique
STEP = 0.5


@register
def phase_step(n: int = 201) -> Scene:
    """A time step of the Allen-Cahn equation between two obstacles, at rest.

    u_t = ε²u″ + u where −1 < u < 1, u_t ≤ ε²u″ + u where u = 1, and ≥ where u = −1, on [−1, 1] with
    u′ = 0 at its ends. This is the double obstacle potential, ε = .2. The stationary state is u =
    sin(x/ε) for |x| ≤ πε/2, ±1 beyond. One implicit step of length τ = ½ from it must return to it:
    p = (1/τ − 1)z − ε²z″ − u/τ, ψ = −1, ψ̄ = 1.

    Parameters
    ----------
    n : int, default 201
        Number of points.

    Returns
    -------
    Scene
        With two quantities. "u" is the largest |z − u| over the grid. "energy" is ∫ ½ε u′² + (1 −
        u²)/2ε = π/2, the tension of the interface.

    Raises
    ------
    InputError
        For n < 33.

    Notes
    -----
    Discretised on n points by central differences, h = 2/(n − 1), with ghost points at the ends.
    The rows of the ends are halved so that A is symmetric. Both quantities are O(h²). "u" is
    measured at most 3.1h², which depends on where the interface ends between two points. "energy"
    is measured 1.5 to 1.8 h².

    References
    ----------
    Blowey and Elliott, Eur. J. Appl. Math. 2 (1991), doi:10.1017/S095679250000053X.
    """
    n = size(n, 33)
    x = np.linspace(-1.0, 1.0, n)
    h = 2.0 / (n - 1)
    u = np.sin(np.clip(x / EPSILON, -np.pi / 2, np.pi / 2))
    stiff = EPSILON**2 / h**2
    share = np.where((x == x[0]) | (x == x[-1]), 0.5, 1.0)
    A = tridiagonal(n, -stiff, share * (1.0 / STEP - 1.0 + 2.0 * stiff), -stiff)
    known = {"u": distance_to(u), "energy": Quantity(np.pi / 2, partial(_energy, h), order=2.0)}
    models = "Two phases of an alloy side by side, and the interface between them."
    problem = ICP(A, -share * u / STEP, -1.0, 1.0)
    return Scene(problem=problem, models=models, quantities=known, h=h, points=x, unknown="order parameter z")


def _energy(h: float, z: Vector) -> float:
    bent = float((np.diff(z) ** 2).sum()) / h
    return 0.5 * EPSILON * bent + 0.5 / EPSILON * float(np.trapezoid(1.0 - z**2, dx=h))
