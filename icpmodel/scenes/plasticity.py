"""Plasticity: bars that yield."""

from __future__ import annotations

from functools import partial

import numpy as np

from ..icp import ICP
from ..numerics.arrays import Vector
from ..problem.by_rows import ByRows, LocalRows
from .grid import difference_rows, index, points, side, square_points
from .registry import Quantity, Scene, assembles, register, size

#: 2·shear modulus·twist per length/yield stress, times the side
TWIST = 5.0
#: torque/(yield stress · side³), 1/3 for the fully plastic bar; extrapolated by another code from 22 grids of 200 to
#: 640 cells a side, on which error/h² lies between .52 and .54
TORQUE = 0.2920921


@assembles("torsion")
def _torsion(n: int) -> ByRows:
    m = side(size(n, 25))
    return ByRows((m, m), partial(_twisted_rows, m))


def _twisted_rows(m: int, lo: int, hi: int) -> LocalRows:
    """Rows lo ≤ i < hi of the scene `torsion`."""
    at = index((m, m), lo, hi)
    x = points(0.0, 1.0, (m, m), at)
    distance = np.minimum(x, 1.0 - x).min(axis=1)
    q = np.full(hi - lo, -TWIST * (1.0 / (m + 1)) ** 2)
    return LocalRows(difference_rows((m, m), at, lo, 4.0), q, -distance, distance)


@register
def torsion(n: int = 900) -> Scene:
    """Elastic-plastic torsion of a square bar.

    The unknown is the stress function u of the unit square, in units of yield stress times side.
    The shear stress |∇u| is at most 1, which is equivalent to |u| ≤ d, the distance to the edge.
    −Δu = c where |u| < d (elastic), −Δu ≤ c where u = d, ≥ c where u = −d (plastic), u = 0 on the
    edge. For the twist c = 5 no row is at −d. With −q, the twist in the other direction, the solution
    is −u.

    Parameters
    ----------
    n : int, default 900
        Number of unknowns; the nearest m² is taken.

    Returns
    -------
    Scene
        With the quantity "torque", 2∫u by the trapezoidal rule, in yield stress times side³.

    Raises
    ------
    InputError
        For n < 25.

    Notes
    -----
    Discretised by the 5-point stencil on m × m interior points, h = 1/(m + 1), rows multiplied by
    h². "torque" is O(h²): measured .39 to .57 h².

    References
    ----------
    Glowinski, Numerical Methods for Nonlinear Variational Problems (1984).
    """
    rows = _torsion(n)
    m = rows.shape[0]
    h = 1.0 / (m + 1)
    problem = ICP(*rows.local_rows(0, rows.n))
    known = {"torque": Quantity(TORQUE, partial(_torque, h), order=2.0)}
    models = "A square bar twisted until parts of it yield: where they are, and the torque that it takes."
    points = square_points(m)
    return Scene(problem=problem, models=models, quantities=known, h=h, points=points, unknown="stress function z")


def _torque(h: float, z: Vector) -> float:
    return float(2.0 * h**2 * z.sum())
