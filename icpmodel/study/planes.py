"""Planes of two parameters, of a method or of a problem, on which a stability map runs methods."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from functools import partial

import numpy as np

from ..errors import InputError, check_arguments
from ..icp import ICP
from ..methods.aor import MNMAOR, MNMGS
from ..methods.contract import Method, named
from ..numerics.arrays import Vector
from ..present.display import Displayable
from ..problem.affine import Affine
from ..problem.data import ProblemData
from ..scenes import scene
from ..scenes.grid import adjacency, five_point, side
from ..scenes.manufactured import random_complementary
from ..scenes.registry import title


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Axis(Displayable):
    """One parameter of a plane.

    Parameters
    ----------
    name : str
        Its name.
    label : str
        Its label in a chart.
    values : array
        Its values.
    log : bool, default False
        Whether they are spaced logarithmically.

    Examples
    --------
    >>> icp.study.Axis("mu", "shift of the diagonal", np.array([0.0, 1.0])).log
    False
    """

    name: str
    label: str
    values: Vector
    log: bool = False


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Plane(Displayable):
    """Two parameters, and the problem and method that belong to each pair of values.

    Parameters
    ----------
    title : str
        The title.
    x, y : Axis
        The axes.
    at : callable
        `at(x, y)` gives (problem, method).
    default : tuple of two float, optional
        The (x, y) of the method's defaults; None where the problem varies.

    Examples
    --------
    >>> x = icp.study.Axis("theta1", "θ₁", np.array([1.0, 2.0]))
    >>> y = icp.study.Axis("a", "a", np.array([1.0, 3.0]))
    >>> plane = icp.study.Plane(
    ...     "one", x, y, lambda theta, a: (ICP([[a]], [-1.0]), icp.MNMAOR(theta1=theta))
    ... )
    >>> icp.stability(plane).ends
    array([['solved', 'solved'],
           ['solved', 'solved']], dtype='<U15')
    """

    title: str
    x: Axis
    y: Axis
    at: Callable[[float, float], tuple[ProblemData, Method]]
    default: tuple[float, float] | None = None


#: the largest θ₁ and θ₂: on eight scenes with n from 49 to 400 the fewest steps are at θ₂ from 2 to 4.7; larger
#: problems were not tested
_LARGEST = (2.5, 6.0)
#: the planes of a method's parameters, and those of a problem's
_METHOD_PLANES = ("relaxation", "shift")
_PROBLEM_PLANES = ("coupling", "transport", "units")
PLANES = (*_METHOD_PLANES, *_PROBLEM_PLANES)


def relaxation_plane(points: int, one: ProblemData) -> Plane:
    """The plane θ₁, θ₂ of MNMAOR on `one`; θ₂ has the larger range, as steps are fewest at θ₂ from 2θ₁ to 3θ₁."""
    theta1 = Axis("theta1", "relaxation θ₁", np.linspace(0.1, _LARGEST[0], points))
    theta2 = Axis("theta2", "acceleration θ₂", np.linspace(0.0, _LARGEST[1], points))
    return Plane(f"MNMAOR on {title(one)}", theta1, theta2, partial(_with_relaxation, one), default=(1.0, 1.0))


def _shift_plane(points: int, one: ProblemData) -> Plane:
    """The plane φ/D, Ω/D of MNMGS on `one`. Raises InputError unless D > 0."""
    D = one.A.diagonal()
    if not (D > 0).all():
        i = int(np.argmax(D <= 0))
        raise InputError(f"problem has A[{i}, {i}] = {D[i]:g}; the plane shift needs a positive diagonal")
    phi = Axis("phi / D", "shift φ / D", np.linspace(-1.0, 3.0, points))
    omega = Axis("Omega / D", "weight of the modulus Ω / D", np.geomspace(0.05, 20.0, points), log=True)
    return Plane(f"MNMGS on {title(one)}", phi, omega, partial(_with_shift, one, D), default=(0.0, 1.0))


def _problem_plane(name: str, points: int, n: int, sweep: Method) -> Plane:
    """The plane `name` of problems on a grid, for the method `sweep`.

    Its axes are two of: shift μ, skewness or scale of A, and ‖G‖∞. The scale changes no step with Ω = D.
    """
    norm = Axis("norm of G", "‖G‖∞ of ψ(z) = Gz + c", np.linspace(0.0, 4.0 if name == "units" else 2.0, points))
    if name == "coupling":
        mu = np.geomspace(0.01, 10.0, points)
        axes = Axis("mu", "shift μ of the diagonal (A = 5-point matrix + μI)", mu, log=True), norm
        about = "dominance against coupling of the obstacle"
    elif name == "transport":
        skew = Axis("skew", "skewness s (neighbours −1 − s and −1 + s)", np.linspace(0.0, 6.0, points))
        axes = skew, Axis("mu", "shift μ of the diagonal", np.geomspace(0.01, 30.0, points), log=True)
        about = "transport against dominance"
    else:
        axes = Axis("scale of A", "diagonal of A", np.geomspace(0.1, 10.0, points), log=True), norm
        about = "a change of units against coupling of the obstacle"
    method = repr(sweep).removesuffix("()")
    return Plane(f"{method}: {about}", *axes, partial(_on_a_grid, name, side(n), sweep))


# functions of the module, so that a plane can be pickled for another process


def _with_relaxation(one: ProblemData, x: float, y: float) -> tuple[ProblemData, Method]:
    return one, MNMAOR(theta1=x, theta2=y)


def _with_shift(one: ProblemData, D: Vector, x: float, y: float) -> tuple[ProblemData, Method]:
    return one, MNMGS(phi=x * D, phi2=y * D)


def _on_a_grid(name: str, m: int, sweep: Method, x: float, y: float) -> tuple[ProblemData, Method]:
    """`sweep`, and a problem with random complementary z*, ψ(z) = Gz + c, G = (norm/4)·adjacency of the m × m grid."""
    if name == "coupling":
        A, norm = five_point(m, x), y
    elif name == "transport":
        A, norm = five_point(m, y, x), 0.5
    else:
        A, norm = (x / 8.0) * five_point(m, 4.0), -y
    z, p, r = random_complementary(m * m, seed=0)
    G = (norm / 4.0) * adjacency(m)
    return ICP(A, float(A.diagonal().mean()) * p - A @ z, Affine(G, z - r - G @ z)), sweep


def plane(name: str, points: int, n: int, problem: ProblemData | None, method: str | None) -> Plane:
    """The plane called `name`, one of `PLANES`, on `problem` or with `method`, None for defaults. Raises InputError."""
    if name in _PROBLEM_PLANES:
        if problem is not None:
            raise InputError("problem: this plane makes its own; only the planes relaxation and shift take one")
        return _problem_plane(name, points, n, named(method or "mnmgs"))
    if method is not None:
        raise InputError(f"method is {method!r}; this plane varies the parameters of its own method: leave it out")
    one = problem or scene("manufactured-affine", n, mu=0.5).problem
    return relaxation_plane(points, one) if name == "relaxation" else _shift_plane(points, one)
