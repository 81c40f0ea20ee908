"""How far an answer is from the conditions of a program, in shares on which units have no influence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Mask, Vector, row_of
from ...numerics.rounding import gamma
from ...problem.data import ProblemData

#: the share of the largest entry of g, and of the largest side, up to which rounding is what is wrong
_SAID = 1e-3


class Violation(NamedTuple):
    """The largest share that is wrong, strictly and up to rounding, inf where it is not a number; and the rows in which
    z is to be on the obstacle, and p is what presses it there."""

    strict: float
    rounded: float
    held: Mask


class Judge:
    """The judge of conditions with the matrix A = [[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]], x having n entries.

    In row i either p_i is 0, or z_i is on the obstacle to which p_i presses it. What is wrong is the lesser of two
    shares: |p_i| of the sum of the |terms| of p_i; and what z_i on the obstacle would change in a row, of the terms of
    that row. By the gap large entries of H do not hide what is wrong with g: where y = x + Δ is in C, (Hx + g)ᵀ(y − x)
    is at least −Σ|p_i|d_i, d_i being the distance to the obstacle or, if less, |z_i|. For x (|H||x|)_i/h_ii stands for
    that, which moves row i by as much as is in it. The gap is a share of its own terms.

    What rounding explains is left out: strictly of a row what sums of its own terms lose, and of the gradient what sums
    of the largest unknowns do. Up to rounding the latter is left out of rows as well: where a side is 1e-16 and 0 was
    meant, no other answer need exist.
    """

    def __init__(self, A: sp.csr_array, n: int) -> None:
        self.size = abs(A)
        self.size.eliminate_zeros()
        self.columns = sp.csr_array(self.size.T)
        self.column = row_of(self.columns)
        self.H = A[:n, :n]
        self.of_H = abs(self.H)
        self.diagonal = self.of_H.diagonal()
        self.loss = float(gamma(3 + np.diff(A.indptr).max(initial=0)))
        self.is_x = np.arange(A.shape[0]) < n
        self.of_x, self.of_rows = (self.loss * (self.size @ part) for part in (1.0 * self.is_x, 1.0 * ~self.is_x))

    @np.errstate(all="ignore")
    def violation(self, problem: ProblemData, low: Vector, high: Vector, z: Vector) -> Violation:
        """What is wrong at `z`, shape (n,), between its obstacles."""
        is_x = self.is_x
        size = np.abs(z)
        p = problem.p(z)
        wrong = np.abs(p)
        terms = self.size @ size + np.abs(problem.q)
        room = np.where(p > 0, z - low, high - z)
        room = np.maximum(room - 2.0 * self.loss * size, 0.0)
        sides = np.abs(np.concatenate([problem.q[~is_x], low[is_x], high[is_x]]))
        most_of_rows = sides[np.isfinite(sides)].max(initial=0.0)
        cap = _SAID * np.where(is_x, np.abs(problem.q[is_x]).max() or np.inf, most_of_rows or np.inf)
        noise = np.minimum(size[is_x].max() * self.of_x + size[~is_x].max(initial=0.0) * self.of_rows, cap)
        own = self.loss * terms
        gap = self._gap(problem, z, p, room, np.where(is_x, np.minimum(own, cap), own), noise)
        worst = []
        for rounding in (noise, np.where(is_x, noise, own)):
            of_p = _shares(wrong - rounding, terms)
            of_z = self._changes(room, rounding, terms)
            share = max(float(np.minimum(of_p, of_z).max()), gap)
            worst.append(share if share < np.inf else np.inf)
        return Violation(worst[1], worst[0], of_z < of_p)

    def _changes(self, room: Vector, rounding: Vector, terms: Vector) -> Vector:
        """The largest share of its terms by which a row changes where z_j moves by `room`; inf where no row does."""
        columns = self.columns
        row = columns.indices
        shares = _shares(columns.data * room[self.column] - rounding[row], terms[row])
        changes = np.where(room > 0, np.inf, 0.0)
        stored = np.flatnonzero(np.diff(columns.indptr))
        changes[stored] = np.maximum.reduceat(shares, columns.indptr[stored])
        return changes

    def _gap(self, problem: ProblemData, z: Vector, p: Vector, room: Vector, rounding: Vector, noise: Vector) -> float:
        """The gap as a share of its terms; of multipliers that are large and cancel each other what is left counts."""
        is_x = self.is_x
        x = z[is_x]
        size = np.abs(z)
        reach = size.copy()
        reach[is_x] = np.where(self.diagonal > 0, (self.of_H @ size[is_x]) / self.diagonal, size[is_x])
        gap = np.maximum(np.abs(p) - rounding, 0.0) @ np.minimum(room, reach)
        held = is_x & (np.abs(p) > room)
        bound = np.where(p > 0, z - room, z + room)
        of_sides = problem.q[~is_x] @ z[~is_x] - p[held] @ bound[held]
        terms = max(x @ (self.H @ x), 0.0) + size[is_x] @ (np.abs(problem.q) + noise)[is_x] + abs(of_sides)
        return float(gap / terms) if gap > 0 else 0.0


def _shares(wrong: Vector, size: Vector) -> Vector:
    """wrong/size, 0 where nothing is wrong."""
    return np.where(wrong <= 0, 0.0, wrong / size)
