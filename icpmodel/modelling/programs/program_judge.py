"""The error of an answer to a program, in shares on which units have no influence."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Vector, row_of
from ...numerics.rounding import gamma
from ...problem.data import ProblemData

#: the share of the largest entry of g up to which what is wrong with the gradient may be rounding
_SAID = 1e-3


#: the share of the largest unknown up to which one may be rounding
_NOISE = 1e-13
#: an entry counts for the units above this share of the largest of its row or of its column
_NEXT_TO_NOTHING = 1e-12
#: steps to the units, and the largest of their exponents
_MEANS = 50
_LARGEST = 500


class Violation(NamedTuple):
    """The largest share that is wrong, inf where it is not a number: strictly, and up to rounding."""

    strict: float
    rounded: float


class Judge:
    """The judge of conditions with the matrix [[H, Eᵀ, Gᵀ], [−E, 0, 0], [−G, 0, 0]], x having n entries.

    Where z_i is on an obstacle to which p_i presses it, nothing is wrong in row i. Elsewhere |p_i| is, as a share of
    the sum of the |terms| of p_i. The gap is the second criterion, so that large entries of H do not hide g. Where
    y = x + Δ is in C, (Hx + g)ᵀ(y − x) is at least −Σ|p_i|d_i. Here d_i is the distance to the obstacle or, if less,
    |z_i|; for x (|H||x|)_i/h_ii stands for that, which moves row i by as much as is in it. The gap is a share of its
    own terms.

    Rounding is left out: strictly of a row what sums of its own terms lose, and of the gradient what sums of the
    largest unknowns do. Up to rounding the latter is left out of rows as well: where a side is 1e-16 and 0 was meant,
    no other answer need exist.
    """

    def __init__(self, A: sp.csr_array, n: int) -> None:
        self.size = abs(A)
        self.H = A[:n, :n]
        self.of_H = abs(self.H)
        self.diagonal = self.of_H.diagonal()
        self.loss = float(gamma(3 + np.diff(A.indptr).max(initial=0)))
        self.is_x = np.arange(A.shape[0]) < n
        self.parts = self.is_x, ~self.is_x
        #: what brings z and p/unit into units in which the entries of A are about 1
        self.unit = _units(A)
        self.of_parts = [self.loss * (self.size @ (part / self.unit)) for part in self.parts]

    @np.errstate(all="ignore")
    def violation(self, problem: ProblemData, z: Vector) -> Violation:
        """What is wrong at `z`, shape (n,), between its obstacles."""
        size = np.abs(z)
        p = problem.p(z)
        terms = self.size @ size + np.abs(problem.q)
        room = room_of(problem, z, p)
        wrong = np.where(room > 0, np.abs(p), 0.0)
        most_of_g = (np.abs(problem.q) / self.unit)[self.is_x].max() or np.inf
        cap = np.where(self.is_x, _SAID * self.unit * most_of_g, np.inf)
        noise = np.minimum(sum(most * of for most, of in zip(self.largest(z), self.of_parts, strict=True)), cap)
        own = self.loss * terms
        gap = self._gap(problem, z, p, room, np.minimum(own, cap), noise)
        shares = []
        for rounding in (own, noise):
            left = wrong - rounding
            share = max(float(np.where(left > 0, left / terms, 0.0).max()), gap)
            shares.append(share if share < np.inf else np.inf)
        return Violation(*shares)

    def largest(self, z: Vector) -> list[float]:
        """The largest |entry| of x, and of the multipliers, in units in which they are alike."""
        return [float((np.abs(z) * self.unit)[part].max(initial=0.0)) for part in self.parts]

    def snapped(self, z: Vector) -> Vector:
        """z without what may be rounding."""
        noise = np.where(self.is_x, *self.largest(z))
        return np.where(np.abs(z) * self.unit <= _NOISE * noise, 0.0, z)

    def _gap(self, problem: ProblemData, z: Vector, p: Vector, room: Vector, rounding: Vector, noise: Vector) -> float:
        """The gap as a share of its terms; of multipliers that are large and cancel each other what is left counts."""
        is_x = self.is_x
        x = z[is_x]
        size = np.abs(z)
        reach = size.copy()
        reach[is_x] = np.where(self.diagonal > 0, (self.of_H @ size[is_x]) / self.diagonal, size[is_x])
        gap = np.maximum(np.abs(p) - rounding, 0.0) @ np.minimum(room, reach)
        held = is_x & (room == 0)
        of_sides = problem.q[~is_x] @ z[~is_x] - p[held] @ z[held]
        terms = max(x @ (self.H @ x), 0.0) + size[is_x] @ (np.abs(problem.q) + noise)[is_x] + abs(of_sides)
        return float(gap / terms) if gap > 0 else 0.0


def room_of(problem: ProblemData, z: Vector, p: Vector) -> Vector:
    """The distance of z to the obstacle to which p presses it."""
    above = problem.r_upper(z)
    return np.where(p > 0, problem.r(z), np.inf if above is None else -above)


def _units(A: sp.csr_array) -> Vector:
    """2^e such that log₂|a_ij| − e_i − e_j is 0 in the mean of the entries of a row that count."""
    largest = abs(A).max(axis=1).toarray().ravel()
    there = np.abs(A.data) > _NEXT_TO_NOTHING * np.minimum(largest[row_of(A)], largest[A.indices])
    logarithm = A.copy()
    logarithm.data = np.log2(np.abs(A.data), out=np.zeros(A.nnz), where=there)
    pattern = A.copy()
    pattern.data = 1.0 * there
    sums = logarithm.sum(axis=1)
    count = np.maximum(pattern.sum(axis=1), 1.0)
    e = np.zeros(A.shape[0])
    for _ in range(_MEANS):
        e = 0.5 * (e + (sums - pattern @ e) / count)
    return np.exp2(np.clip(e, -_LARGEST, _LARGEST))
