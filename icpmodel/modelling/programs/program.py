"""Affine variational inequalities over a polyhedron, and their conditions as an ICP.

Find x in C = {low ≤ x ≤ high, Ex = b, Gx ≤ h} with (Hx + g)ᵀ(y − x) ≥ 0 for all y in C. x solves this if and only if
there are multipliers ν and λ with

    Hx + g + Eᵀν + Gᵀλ  ⟂  low ≤ x ≤ high,       b − Ex = 0  (ν of any sign),       h − Gx ≥ 0  ⟂  λ ≥ 0,

which is an ICP in (x, ν, λ). Where H is symmetric and positive semidefinite, x minimises ½xᵀHx + gᵀx over C.
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


class Tightened:
    """A program whose rows of G with one entry are bounds, and without rows with h = ∞; and the multipliers back.

    Bounds that cross by no more than quotients and data are rounded are made to touch.
    """

    def __init__(self, program: Program) -> None:
        self.of = program
        G = program.G
        h = program.h
        n = program.g.size
        count = np.diff(G.indptr)
        finite = h < np.inf
        self.single = np.flatnonzero((count == 1) & finite)
        self.general = np.flatnonzero((count != 1) & finite)
        first = G.indptr[self.single]
        self.column = G.indices[first]
        self.entry = G.data[first]
        with np.errstate(over="ignore"):
            value = h[self.single] / self.entry
        up = self.entry > 0
        high = program.high.copy()
        low = program.low.copy()
        np.minimum.at(high, self.column[up], value[up])
        np.maximum.at(low, self.column[~up], value[~up])
        #: of the single rows those that give the tightest bound of their variable, one for each side
        self.binding = np.zeros(self.single.size, dtype=bool)
        for side, tight, own in ((up, high, program.high), (~up, low, program.low)):
            at = np.flatnonzero(side & (value == tight[self.column]) & (value != own[self.column]))
            _, one = np.unique(self.column[at], return_index=True)
            self.binding[at[one]] = True
        with np.errstate(invalid="ignore"):
            touch = (low > high) & (low - high <= _TOUCH * (np.abs(low) + np.abs(high)))
        low = np.where(touch, high, low)
        self.program = replace(program, G=G[self.general], h=h[self.general], low=low, high=high)
        self.crossed = bool((low > high).any())
        self.n = n

    def back(self, values: Values) -> Values:
        """The multipliers of the program that was given."""
        inequality = np.zeros(self.of.h.size)
        inequality[self.general] = values.inequality
        box = values.box.copy()
        force = box[self.column] / self.entry  # positive where the row binds on its side
        taken = self.binding & (force > 0)
        inequality[self.single[taken]] = force[taken]
        box[self.column[taken]] = 0.0
        return values._replace(inequality=inequality, box=box)


def conditions_of(program: Program) -> ICP:
    """The conditions of `program`, as they are, in (x, ν, λ). Raises InputError where bounds cross or h is infinite."""
    return ICP(matrix_of(program), np.concatenate([program.g, program.b, program.h])).with_sides(*sides_of(program))


def matrix_of(program: Program) -> sp.csr_array:
    """[[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]]."""
    H = program.H
    E = program.E
    G = program.G
    use = [True, E.shape[0] > 0, G.shape[0] > 0]
    blocks = [[H, E.T, G.T], [-E, None, None], [-G, None, None]]
    rows = [[block for block, used in zip(row, use, strict=True) if used] for row in blocks]
    return sp.csr_array(sp.block_array([row for row, used in zip(rows, use, strict=True) if used], format="csr"))


def sides_of(program: Program) -> tuple[Vector, Vector | None]:
    """The obstacles of the conditions below and above, None where there is none above."""
    none = np.full(program.b.size, np.inf)
    low = np.concatenate([program.low, -none, np.zeros(program.h.size)])
    if np.isposinf(program.high).all():
        return low, None
    return low, np.concatenate([program.high, none, np.full(program.h.size, np.inf)])
