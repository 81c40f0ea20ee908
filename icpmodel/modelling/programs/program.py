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

from ...algebra.redundant import MAX_CROSSING
from ...icp import ICP
from ...numerics.arrays import Vector
from ...numerics.rounding import UNIT_ROUNDOFF


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

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether H = Hᵀ, up to rounding."""
        skew = np.abs((self.H - self.H.T).data).max(initial=0.0)
        return bool(skew <= self.g.size * UNIT_ROUNDOFF * np.abs(self.H.data).max(initial=0.0))


class Presolve:
    """A program whose rows of G with one entry are bounds, and the way back.

    Bounds that cross by no more than quotients and data are rounded are made to touch.
    """

    def __init__(self, original: Program) -> None:
        self.original = original
        count = np.diff(original.G.indptr)
        single = np.flatnonzero(count == 1)
        self.rows = np.flatnonzero(count != 1)
        one_entry = original.G[single]
        column = one_entry.indices
        with np.errstate(over="ignore"):
            value = original.h[single] / one_entry.data
        bounds = []
        #: for the bounds above and below, the row of G that gives each, -1 where none does
        self.origins = []
        for sign, own in ((1.0, original.high), (-1.0, original.low)):
            on_side = sign * one_entry.data > 0
            bound = sign * own
            np.minimum.at(bound, column[on_side], sign * value[on_side])
            bound *= sign
            defines_bound = on_side & (value == bound[column]) & (value != own[column])
            origin = np.full(own.size, -1)
            origin[column[defines_bound]] = single[defines_bound]
            bounds.append(bound)
            self.origins.append(origin)
        high, low = bounds
        with np.errstate(invalid="ignore"):
            nearly_cross = (low > high) & (low - high <= MAX_CROSSING * (np.abs(low) + np.abs(high)))
        low = np.where(nearly_cross, high, low)
        self.crossed = bool((low > high).any())
        self.program = replace(original, G=original.G[self.rows], h=original.h[self.rows], low=low, high=high)

    def postsolve(self, values: Values) -> Values:
        """The multipliers of the program that was given."""
        inequality = np.zeros(self.original.h.size)
        inequality[self.rows] = values.inequality
        box = values.box.copy()
        for origin, sign in zip(self.origins, (1.0, -1.0), strict=True):
            moved = np.flatnonzero((origin >= 0) & (sign * box > 0))
            inequality[origin[moved]] = box[moved] / self.original.G[origin[moved]].data
            box[moved] = 0.0
        return values._replace(inequality=inequality, box=box)


def conditions_of(program: Program, last: ICP | None = None) -> ICP:
    """The conditions of `program` in (x, ν, λ), made from `last` where that has the same matrix; λ_i = 0 if h_i = ∞."""
    A = matrix_of(program)
    absent = np.isposinf(program.h)
    q = np.concatenate([program.g, program.b, np.where(absent, 0.0, program.h)])
    free = np.full(program.b.size, np.inf)
    low = np.concatenate([program.low, -free, np.zeros(program.h.size)])
    high = np.concatenate([program.high, free, np.where(absent, 0.0, np.inf)])
    reused = last if last is not None and last.A.shape == A.shape and not (last.A != A).nnz else None
    problem = ICP(A, q) if reused is None else reused.with_q(q)
    return problem.with_sides(low, None if np.isposinf(high).all() else high)


def matrix_of(program: Program) -> sp.csr_array:
    """[[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]]."""
    C = sp.csr_array(sp.vstack([program.E, program.G]))
    rows, n = C.shape
    if not rows:
        return program.H
    # stacks of rows take a quarter of the time of `block_array`
    upper = sp.vstack([program.H.T.tocsr(), C]).T.tocsr()
    lower = sp.csr_array((-C.data, C.indices, C.indptr), shape=(rows, n + rows))
    return sp.csr_array(sp.vstack([upper, lower]))
