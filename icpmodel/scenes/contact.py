"""Contact: membranes over obstacles, and a block that slips or stays."""

from __future__ import annotations

from functools import partial

import numpy as np
from scipy.special import lambertw

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..problem.affine import Affine
from ..problem.by_rows import ByRows
from .grid import index, points, rows_on_grid, side, square_points
from .registry import Quantity, Scene, assembles, distance_to, register, size

#: s, half the side of the square of the scene `ball`
HALF = 2.0
#: the contact radius a of the scene `obstacle_3d`; outside of it u = a/r − a
RADIUS_3D = 0.5

#: the names of the coordinates in pictures
_AXES = ("x, radii", "y, radii")


@assembles("membrane")
def _membrane(n: int, mu: float, skew: float) -> ByRows:
    m = side(n)
    mu = as_number(mu, "mu", minimum=0)
    skew = as_number(skew, "skew", minimum=-1, maximum=1)
    return ByRows((m, m), partial(rows_on_grid, (m, m), 0.0, 1.0, _paraboloid, None, (4.0 + mu, skew)))


@register
def membrane(n: int = 900, mu: float = 0.0, skew: float = 0.0) -> Scene:
    """A membrane stretched over a paraboloid.

    −Δu ≥ 0, u ≥ ψ, (−Δu)(u − ψ) = 0 on the unit square, u = 0 on its edge. The obstacle is ψ(x, y)
    = ½ − 4((x−½)² + (y−½)²).

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.
    mu : float, default 0
        Number μ ≥ 0 added to the diagonal: an elastic bed of stiffness μ/h².
    skew : float, default 0
        Number in [−1, 1] that tilts the stencil and makes A nonsymmetric: a flow of velocity (b,
        b), b = 2·skew/h.

    Returns
    -------
    Scene
        The discrete problem; no reference solution is known.

    Notes
    -----
    Discretised by the 5-point stencil on m × m interior points, h = 1/(m + 1). Rows are multiplied
    by h², so that A has 4 and −1. Units: lengths in sides of the square; p is h² times the force
    per area that the obstacle exerts.

    References
    ----------
    Rodrigues, Obstacle Problems in Mathematical Physics (1987).
    """
    rows = _membrane(n, mu, skew)
    return Scene(
        problem=ICP(*rows.local_rows(0, rows.n)),
        models="A membrane held at height 0 along the edge of a square and lifted by a paraboloid from below.",
        h=1.0 / (rows.shape[0] + 1),
        why_no_reference="The square has no closed form for the curve along which the membrane leaves the obstacle.",
        points=square_points(rows.shape[0]),
    )


@assembles("ball")
def _ball(n: int) -> ByRows:
    m = side(size(n, 16))
    return ByRows((m, m), partial(rows_on_grid, (m, m), -HALF, HALF, _ball_obstacle, ball_solution, (4.0,)))


@register
def ball(n: int = 900) -> Scene:
    """A membrane over a ball, with a known contact circle.

    −Δu ≥ 0, u ≥ ψ, (−Δu)(u − ψ) = 0 on [−2, 2]², ψ = √(1 − r²) for r < 1. Boundary values come from
    the solution: u = √(1 − r²) for r ≤ a, and u = −.680259… ln r + .471519… for r > a. Here a =
    .697965…, such that u and u′ are continuous at a, and u = 0 at 2.

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.

    Returns
    -------
    Scene
        With two quantities. "u" is the largest |z − u| over the grid. "contact radius" follows from
        the force Σp = 2πa²/√(1 − a²).

    Raises
    ------
    InputError
        For n < 16.

    Notes
    -----
    Smooth fit requires a²(1 + ln(2/a)) = 1, which Lambert's W solves: a² = −2/W₋₁(−1/2e²).

    Discretised by the 5-point stencil on m × m interior points, h = 4/(m + 1), rows multiplied by
    h². Units: lengths in radii of the ball; p is h² times force per area over tension, so Σp is
    force over tension.

    For r ≥ 1 the obstacle is −1, which is never touched. By the maximum principle u is nowhere
    below its boundary values, and they are above −.24. Unlike −∞, −1 is accepted by every solver.

    The force averages over the contact circle; the number of contact points would jump with h. Both
    quantities are O(h²), u up to a factor ln h. The factor depends on where the circle cuts the
    cells: measured at most .4h² and .06h².

    References
    ----------
    Bueler, PETSc for Partial Differential Equations (2020), chapter 12,
    doi:10.1137/1.9781611976311.
    """
    rows = _ball(n)
    h = 2 * HALF / (rows.shape[0] + 1)
    points = square_points(rows.shape[0], -HALF, HALF)
    problem = ICP(*rows.local_rows(0, rows.n))
    known = {
        "u": distance_to(ball_solution(points)),
        "contact radius": Quantity(contact_radius(), partial(_radius, problem), order=2.0),
    }
    models = "A membrane held along the edge of a square and lifted by a ball from below."
    return Scene(problem=problem, models=models, quantities=known, h=h, points=points, axes=_AXES, unknown="height z")


@assembles("obstacle-3d")
def _obstacle_3d(n: int) -> ByRows:
    shape = (side(size(n, 27), 3),) * 3
    return ByRows(shape, partial(rows_on_grid, shape, -1.0, 1.0, _paraboloid_3d, obstacle_3d_solution, (6.0,)))


@register
def obstacle_3d(n: int = 1000) -> Scene:
    """An obstacle in space, with a known contact sphere.

    −Δu ≥ 0, u ≥ ψ, (−Δu)(u − ψ) = 0 on [−1, 1]³, ψ = 1 − 2r². Boundary values come from the
    solution: u = ψ for r ≤ ½, and u = 1/(2r) − ½ for r > ½. There u and u′ are continuous.

    Parameters
    ----------
    n : int, default 1000
        Number of unknowns; the nearest m³ is taken.

    Returns
    -------
    Scene
        With the quantity "u", the largest |z − u| over the grid.

    Raises
    ------
    InputError
        For n < 27.

    Notes
    -----
    Discretised by the 7-point stencil on m × m × m interior points, h = 2/(m + 1), rows multiplied
    by h². Units: lengths in halves of an edge; p is h² times the sources per volume. "u" is O(h²)
    up to a factor ln h. The factor depends on where the sphere cuts the cells: measured at most
    .78h² for m ≤ 35.
    """
    rows = _obstacle_3d(n)
    at = index(rows.shape, 0, rows.n)
    h = 2.0 / (rows.shape[0] + 1)
    places = points(-1.0, 1.0, rows.shape, at)
    u = distance_to(obstacle_3d_solution(places))
    models = "A cube that sources keep at least as warm as a given profile: where they must heat, and how much."
    return Scene(problem=ICP(*rows.local_rows(0, rows.n)), models=models, quantities={"u": u}, h=h, points=places)


@register
def coulomb(alpha: float = 30.0, mu: float = 0.3, mass: float = 1.0, g: float = 9.81, dt: float = 0.1) -> Scene:
    """A block on a slope with dry friction.

    One time step from rest of a block on a plane of slope α, which can slip downhill only. The
    unknowns are the impulses z = (λ_n, λ_t) of contact and friction. The velocities off the plane and
    downhill are p = z/m + gΔt(−cos α, sin α). Contact requires λ_n ≥ 0. Coulomb's law bounds friction
    by the normal impulse: λ_t ≥ −μλ_n, so ψ(z) = (0, −μλ_n).

    Parameters
    ----------
    alpha : float, default 30
        Slope α in degrees, 0 ≤ α ≤ 89.
    mu : float, default 0.3
        Coefficient of friction μ ≥ 0 (no unit).
    mass : float, default 1
        Mass m in kg.
    g : float, default 9.81
        Acceleration of gravity in m/s².
    dt : float, default 0.1
        Time step Δt in s.

    Returns
    -------
    Scene
        With z in N s, p in m/s, and the quantity "slip speed" in m/s, which is exact.

    Notes
    -----
    The solution is λ_n = m g Δt cos α. The block slips if and only if tan α > μ. Then λ_t = −μλ_n,
    else λ_t = −m g Δt sin α (z is negative).

    References
    ----------
    Acary and Brogliato, Numerical Methods for Nonsmooth Dynamical Systems (2008).
    """
    slope = np.deg2rad(as_number(alpha, "alpha", minimum=0, maximum=89))
    mu = as_number(mu, "mu", minimum=0)
    mass = as_number(mass, "mass", above=0)
    push = as_number(g, "g", above=0) * as_number(dt, "dt", above=0)
    sine = float(np.sin(slope))
    cosine = float(np.cos(slope))
    normal = mass * push * cosine
    z = np.array([normal, -min(mass * push * sine, mu * normal)])
    problem = ICP(np.eye(2) / mass, push * np.array([-cosine, sine]), Affine([[0.0, 0.0], [-mu, 0.0]]))
    speed = Quantity(max(0.0, push * (sine - mu * cosine)), partial(_slip, problem), order=None)
    models = "Whether a block put on a slope stays or slips within one time step, and the impulses that decide it."
    return Scene(problem=problem, models=models, z_exact=z, quantities={"slip speed": speed})


def _paraboloid(x: Vector) -> Vector:
    return 0.5 - 4.0 * ((x - 0.5) ** 2).sum(axis=1)


def _ball_obstacle(x: Vector) -> Vector:
    r = np.hypot(x[:, 0], x[:, 1])
    return np.where(r < 1.0, np.sqrt(np.maximum(1.0 - r**2, 0.0)), -1.0)


def contact_radius() -> float:
    """The contact radius a of the scene `ball`: a²(1 + ln(s/a)) = 1."""
    return float(np.sqrt(-2.0 / lambertw(-2.0 / (np.e * HALF) ** 2, -1).real))


def ball_solution(x: Vector) -> Vector:
    """u of the scene `ball` at points x of shape (k, 2), shape (k,): −a²/√(1 − a²)·ln(r/s) for r > a."""
    a = contact_radius()
    r = np.hypot(x[:, 0], x[:, 1])
    inside = np.sqrt(np.maximum(1.0 - r**2, 0.0))
    return np.where(r <= a, inside, a * np.tan(np.arcsin(a)) * np.log(HALF / np.maximum(r, a)))


def _paraboloid_3d(x: Vector) -> Vector:
    return 1.0 - 2.0 * (x**2).sum(axis=1)


def obstacle_3d_solution(x: Vector) -> Vector:
    """u of the scene `obstacle_3d` at points x of shape (k, 3), shape (k,)."""
    r = np.sqrt((x**2).sum(axis=1))
    return np.where(r <= RADIUS_3D, _paraboloid_3d(x), RADIUS_3D / np.maximum(r, RADIUS_3D) - RADIUS_3D)


def _slip(problem: ICP, z: Vector) -> float:
    return float(problem.p(z)[1])


def _radius(problem: ICP, z: Vector) -> float:
    """a from 2πa²/√(1 − a²) = Σp: with f = Σp/2π, a⁴ + f²a² − f² = 0."""
    f = float(problem.p(z).sum()) / (2.0 * np.pi)
    # f·(√(f² + 4) − f)/2 without the cancellation for large f
    return float(np.sqrt(2.0 * f / (np.sqrt(f * f + 4.0) + f))) if f >= 0 else float("nan")
