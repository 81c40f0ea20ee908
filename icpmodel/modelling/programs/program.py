"""Affine variational inequalities over a polyhedron, and their conditions as an ICP.

Find x in C = {low ≤ x ≤ high, Ex = b, Gx ≤ h} with (Hx + g)ᵀ(y − x) ≥ 0 for all y in C.

There must be multipliers ν and λ with

    Hx + g + Eᵀν + Gᵀλ  ⟂  low ≤ x ≤ high,       b − Ex = 0  (ν of any sign),       h − Gx ≥ 0  ⟂  λ ≥ 0.

These conditions are necessary and sufficient, and an ICP in (x, ν, λ). Where H is symmetric and positive
semidefinite, x minimises ½xᵀHx + gᵀx over C.

Reference: Facchinei and Pang, Finite-Dimensional Variational Inequalities (2003), section 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...icp import ICP
from ...numerics.arrays import Vector
from ...numerics.rounding import UNIT_ROUNDOFF

#: the share of their sizes by which bounds may cross as data and quotients are rounded
_TOUCH = 4.0 * UNIT_ROUNDOFF


class Values(NamedTuple):
    """x, the multipliers ν of Ex = b and λ of Gx ≤ h, and those of the bounds: ≥ 0 at the upper, ≤ 0 at the lower."""

    x: Vector
    equality: Vector
    inequality: Vector
    box: Vector


@dataclass(frozen=True, eq=False)
class Program:
    """The data of an affine variational inequality, CSR matrices and vectors; a quadratic program where H = Hᵀ."""

    H: sp.csr_array
    g: Vector
    G: sp.csr_array
    h: Vector
    E: sp.csr_array
    b: Vector
    low: Vector
    high: Vector

    def objective(self, x: Vector) -> float:
        """½xᵀHx + gᵀx."""
        return float(0.5 * x @ (self.H @ x) + self.g @ x)

    def has_matrices_of(self, other: Program) -> bool:
        """Whether H, G and E are those of `other`, in the same storage."""
        return all(map(_same, (self.H, self.G, self.E), (other.H, other.G, other.E)))

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether H = Hᵀ, up to rounding."""
        skew = np.abs((self.H - self.H.T).data).max(initial=0.0)
        return bool(skew <= self.g.size * UNIT_ROUNDOFF * np.abs(self.H.data).max(initial=0.0))


def _same(one: sp.csr_array, other: sp.csr_array) -> bool:
    parts = ("data", "indices", "indptr")
    return one.shape == other.shape and all(np.array_equal(getattr(one, name), getattr(other, name)) for name in parts)


class Presolve:
    """A program whose rows of G with one entry are bounds, without rows with h = ∞, and the way back.

    Bounds that cross by no more than quotients and data are rounded are made to touch.
    """

    def __init__(self, given: Program) -> None:
        self.given = given
        G = given.G
        count = np.diff(G.indptr)
        finite = given.h < np.inf
        single = np.flatnonzero((count == 1) & finite)
        self.rows = np.flatnonzero((count != 1) & finite)
        column = G.indices[G.indptr[single]]
        self.entry = np.ones(given.h.size)
        self.entry[single] = G.data[G.indptr[single]]
        with np.errstate(over="ignore"):
            value = given.h[single] / self.entry[single]
        rises = self.entry[single] > 0
        low = given.low.copy()
        high = given.high.copy()
        np.minimum.at(high, column[rises], value[rises])
        np.maximum.at(low, column[~rises], value[~rises])
        #: for the bounds above and below, the row of G that gives each, -1 where none does
        self.origins = []
        for side, tight, own in ((rises, high, given.high), (~rises, low, given.low)):
            gives = side & (value == tight[column]) & (value != own[column])
            origin = np.full(low.size, -1)
            origin[column[gives]] = single[gives]
            self.origins.append(origin)
        with np.errstate(invalid="ignore"):
            touch = (low > high) & (low - high <= _TOUCH * (np.abs(low) + np.abs(high)))
        low = np.where(touch, high, low)
        self.crossed = bool((low > high).any())
        self.program = replace(given, G=G[self.rows], h=given.h[self.rows], low=low, high=high)

    def postsolve(self, values: Values) -> Values:
        """The multipliers of the program that was given."""
        inequality = np.zeros(self.given.h.size)
        inequality[self.rows] = values.inequality
        box = values.box.copy()
        for origin, sign in zip(self.origins, (1.0, -1.0), strict=True):
            moved = np.flatnonzero((origin >= 0) & (sign * box > 0))
            inequality[origin[moved]] = box[moved] / self.entry[origin[moved]]
            box[moved] = 0.0
        return values._replace(inequality=inequality, box=box)


def conditions_of(program: Program, base: ICP | None = None) -> ICP:
    """The conditions of `program` in (x, ν, λ); `base` is an ICP with the same matrix. Raises InputError for h = ∞."""
    q = np.concatenate([program.g, program.b, program.h])
    low, high = sides_of(program)
    problem = ICP(matrix_of(program), q) if base is None else base.with_q(q)
    return problem.with_sides(low, None if np.isposinf(high).all() else high)


def sides_of(program: Program) -> tuple[Vector, Vector]:
    """The obstacles of the conditions below and above."""
    free = np.full(program.b.size, np.inf)
    low = np.concatenate([program.low, -free, np.zeros(program.h.size)])
    return low, np.concatenate([program.high, free, np.full(program.h.size, np.inf)])


def matrix_of(program: Program) -> sp.csr_array:
    """[[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]]."""
    C = sp.csr_array(sp.vstack([program.E, program.G]))
    if not C.shape[0]:
        return program.H
    return sp.csr_array(sp.block_array([[program.H, C.T], [-C, None]]))
