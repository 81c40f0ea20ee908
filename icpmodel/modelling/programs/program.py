"""Affine variational inequalities over a polyhedron, and their conditions as an ICP.

Find x in C = {low ≤ x ≤ high, Ex = b, Gx ≤ h} with (Hx + g)ᵀ(y − x) ≥ 0 for all y in C.

A solution x, and no other, has multipliers ν and λ:

    Hx + g + Eᵀν + Gᵀλ  ⟂  low ≤ x ≤ high,       b − Ex = 0  (ν of any sign),       h − Gx ≥ 0  ⟂  λ ≥ 0.

These conditions are an ICP in (x, ν, λ). If H is symmetric and positive semidefinite, x minimises ½xᵀHx + gᵀx over C.

Reference: Facchinei and Pang, Finite-Dimensional Variational Inequalities (2003), section 1.2.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...algebra.subproblems import MAX_CROSSING
from ...icp import ICP
from ...numerics.arrays import Vector, inner, row_of
from ...numerics.equilibration import times_rows
from ...numerics.rounding import UNIT_ROUNDOFF
from ...numerics.sparse_structure import is_symmetric

#: a matrix and the right-hand side of its rows
Rows = tuple[sp.csr_array, Vector]


@dataclass(frozen=True, eq=False)
class Program:
    """The data of an affine variational inequality, which is a quadratic program if H = Hᵀ.

    The first `equations` rows of Cx ≤ d are the equations Ex = b.
    """

    H: sp.csr_array
    g: Vector
    C: sp.csr_array
    d: Vector
    equations: int
    low: Vector
    high: Vector
    #: the indices of the rows of C in the original program, and its other constraints, in words for messages
    numbers: NDArray[np.intp]
    bounds: str = "lb <= x <= ub"

    @classmethod
    def of_rows(
        cls, H: sp.csr_array, g: Vector, equations: Rows, inequalities: Rows, low: Vector, high: Vector
    ) -> Program:
        """The program with Ex = b and Gx ≤ h; a row with the right-hand side ±∞ is replaced by 0 ≤ ±1."""
        C = sp.csr_array(sp.vstack([equations[0], inequalities[0]]))
        d = np.concatenate([equations[1], inequalities[1]])
        finite = np.isfinite(d)
        if not finite.all():
            C = times_rows(1.0 * finite, C)
            C.eliminate_zeros()
            d = np.where(finite, d, np.sign(d))
        return cls(H, g, C, d, equations[1].size, low, high, np.arange(d.size))

    def objective(self, x: Vector) -> float:
        """½xᵀHx + gᵀx; NaN where H is not symmetric."""
        return inner(0.5 * (self.H @ x) + self.g, x) if self.is_symmetric else np.nan

    def row_name(self, i: int) -> str:
        """The name in messages of row `i` of the conditions, which must be a row of Cx ≤ d."""
        number = int(self.numbers[i - self.g.size])
        return f"row {number} of A" if number < self.equations else f"row {number - self.equations} of G"

    @property
    def vectors(self) -> tuple[Vector, Vector, Vector]:
        """q of the conditions, and the lower and the upper obstacle."""
        free = np.full(self.d.size, np.inf)
        least = np.where(np.arange(self.d.size) < self.equations, -np.inf, 0.0)
        q = np.concatenate([self.g, self.d])
        return q, np.concatenate([self.low, least]), np.concatenate([self.high, free])

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether H = Hᵀ, up to rounding."""
        H = self.H
        return is_symmetric(H) or bool(abs(H - H.T).max() <= self.g.size * UNIT_ROUNDOFF * abs(H).max())


class Presolve:
    """Turn the inequalities with one entry into bounds, and map solutions back.

    An inequality remains a row if its bound is not a finite float. A lower bound that exceeds the upper one only by
    rounding errors is set to it. `contradiction` is a sentence on bounds that cross by more, empty if none do.
    """

    def __init__(self, original: Program) -> None:
        self.original = original
        C = original.C
        single = np.flatnonzero(np.diff(C.indptr) == 1)
        single = single[single >= original.equations]
        value = original.d[single] / np.abs(C.data[C.indptr[single]])
        is_float = np.isfinite(value)
        value = value[is_float]
        self.singles = single[is_float]
        self.rows = np.delete(np.arange(original.d.size), self.singles)
        place = C.indptr[self.singles]
        self.column = C.indices[place]
        self.entry = C.data[place]
        n = original.g.size
        # −x ≤ −low and x ≤ high
        ends = np.concatenate([-original.low, original.high])
        self.side = self.column + n * (self.entry > 0)
        before = ends[self.side]
        np.minimum.at(ends, self.side, value)
        self.gives_bound = (value == ends[self.side]) & (value != before)
        low = 0.0 - ends[:n]
        high = ends[n:]
        crossed = low - high > MAX_CROSSING * np.abs(low) + MAX_CROSSING * np.abs(high)  # low − high may overflow
        self.contradiction = self._contradiction(int(np.argmax(crossed)), low, high) if crossed.any() else ""
        low = np.minimum(low, high)
        bounds = f"{original.bounds} and the rows of G with one entry hold" if self.singles.size else original.bounds
        self.program = replace(
            original, C=C[self.rows], d=original.d[self.rows], low=low, high=high, numbers=self.rows, bounds=bounds
        )

    def _contradiction(self, i: int, low: Vector, high: Vector) -> str:
        """The sentence that the bounds of x_i exclude each other."""
        ends = []
        for relation, values, argument, side in ((">=", low, "lb", i), ("<=", high, "ub", i + low.size)):
            rows = self.singles[self.gives_bound & (self.side == side)]
            owner = self.original.row_name(low.size + rows[0]) if rows.size else argument
            ends.append(f"x[{i}] {relation} {float(values[i])!r} by {owner}")
        return f"{' and '.join(ends)} exclude each other"

    def postsolve(self, z: Vector, box: Vector) -> tuple[Vector, Vector]:
        """x with the multipliers of rows, and those of bounds, of the original program. Changes `box`."""
        n = box.size
        rows = np.zeros(self.original.d.size)
        rows[self.rows] = z[n:]
        moves = np.flatnonzero(self.gives_bound & (self.entry * box[self.column] > 0))
        column, first = np.unique(self.column[moves], return_index=True)
        single = moves[first]
        rows[self.singles[single]] = box[column] / self.entry[single]
        box[column] = 0.0
        return np.concatenate([z[:n], rows]), box


def conditions_of(program: Program) -> ICP:
    """The conditions of `program` as an ICP in (x, ν, λ)."""
    q, low, high = program.vectors
    return with_bounds(ICP(saddle_matrix(program.H, program.C), q), low, high)


def with_bounds(problem: ICP, low: Vector, high: Vector) -> ICP:
    """`problem` with the obstacles `low` and `high`; there is no upper obstacle if `high` is +inf in all rows."""
    return problem.with_sides(low, None if np.isposinf(high).all() else high)


def saddle_matrix(H: sp.csr_array, C: sp.csr_array) -> sp.csr_array:
    """[[H, Cᵀ], [−C, 0]]."""
    rows, n = C.shape
    if not rows:
        return H
    multiplier = (n + row_of(C)).astype(C.indices.dtype)
    data = np.concatenate([H.data, C.data, -C.data])
    row = np.concatenate([row_of(H), C.indices, multiplier])
    column = np.concatenate([H.indices, multiplier, C.indices])
    return sp.csr_array((data, (row, column)), shape=(n + rows, n + rows))
