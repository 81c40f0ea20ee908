"""The tangent problem: the first-order change of z* in one direction solves a complementarity problem.

In the rows with p_i = r_i = 0 it is 0 ≤ (A dz + dA z + dq)_i ⟂ dz_i − (ψ′(z; dz) + dψ)_i ≥ 0. In
the free rows A dz + dA z + dq = 0: they have no obstacle. In the active rows dz = ψ′ dz + dψ: their
lower and upper obstacles coincide. Where jumps tie, ψ′(z; ·) is the best of them.

References
----------
Robinson, Math. Program. Study 30 (1987). Facchinei and Pang, Finite-Dimensional Variational
Inequalities and Complementarity Problems (2003), section 5.4.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ..algebra.equations import Pattern
from ..numerics.arrays import Mask, Vector
from ..numerics.equilibration import in_units
from ..problem.affine import Affine, Constant
from ..problem.data import ProblemData
from ..problem.map import Map
from ..problem.two_sided import Rowwise
from .direction import Direction, linear_value


class Ties(NamedTuple):
    """The rows, masks of shape (n,), in which p = r = 0 is possible at the obstacle `below` or at the one `above`.

    `delta`, shape (n,), bounds |z − z*|.
    """

    below: Mask
    above: Mask
    delta: Vector


def tangent_problem(z: Vector, pattern: Pattern, ties: Ties, direction: Direction) -> ProblemData:
    """The problem that dz solves; its p has the units of z, as the residual that is judged by `atol` mixes p and r."""
    sides = direction.sides()
    maps: list[Map] = [_tangent(name, psi, change, z, ties.delta) for name, psi, change in sides]
    tied = ties.below | ties.above
    certain = [rows & ~tied for rows in pattern.sides()]
    obstacles = []
    for k, (rows, none) in enumerate(((ties.below, -np.inf), (ties.above, np.inf))):
        # an active row has the same obstacle below and above
        map_of_row = np.zeros(z.size, dtype=np.intp)
        for side, at_side in enumerate(certain, 1):
            map_of_row[at_side] = side
        if k < len(maps):
            map_of_row[rows] = k + 1
        obstacles.append(Rowwise((Constant(none).bind(z.size), *maps), map_of_row) if map_of_row.any() else None)
    below, above = obstacles
    matrix = direction.problem.matrix
    # one unit for all rows, so that symmetry is kept, and a power of two, so that nothing is rounded
    exponents = np.full(z.size, -np.frexp(np.median(matrix.weights))[1])
    with np.errstate(over="ignore"):
        A = in_units(matrix.sparse, exponents)
        q = np.ldexp(direction.p_change(z), exponents)
    return ProblemData(A, q).with_sides(-np.inf if below is None else below, above)


def _tangent(name: str, psi: Map, change: object, z: Vector, delta: Vector) -> Map:
    """ψ′(z; dz) + dψ as a map of dz."""
    change = 0.0 if change is None else change
    one_sided = psi.directional_derivative(z, delta, change, name)
    if one_sided is not None:
        return one_sided
    return Affine(psi.jacobian(z), linear_value(*psi.data_change(z, change, name), z)).bind(z.size)
