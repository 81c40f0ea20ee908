"""Uniqueness and error bound for a few unknowns: all linear pieces of the problem are examined in rational arithmetic.

With constant and affine obstacles each row satisfies p_i = 0, z_i = ψ_i(z) or z_i = ψ̄_i(z). Each
choice leaves a linear system. If exactly one point solves such a system with the right signs, it is
the unique solution. Its distance to z is known up to rounding.

Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 1.3.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...algebra.linear_rows import piece_count
from ...numerics.arrays import Vector
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData
from ..solution_set import ExactRows, listed, plausible
from .proof import Proof, norm_up

#: the largest number of linear pieces; examining them in floats takes a tenth of a second
MAX_PIECES = 4_096
#: the largest number of pieces that are solved in fractions, in a few milliseconds each
MAX_EXACT_PIECES = 200


@dataclass(frozen=True, eq=False)
class EnumeratedProof(Proof):
    """The `solution`, shape (n,), each entry rounded once."""

    solution: Vector

    def bound(self, problem: ProblemData, z: Vector, rounding_p: Vector, rounding_r: Vector) -> tuple[Vector, float]:
        with np.errstate(over="ignore", invalid="ignore"):
            step = np.abs(z - self.solution) * (1 + 4 * UNIT_ROUNDOFF)
            delta = np.nextafter(step + UNIT_ROUNDOFF * np.abs(self.solution) + SMALLEST, np.inf)
        return delta, norm_up(delta)


class Disproof(str):
    """A sentence that there are several solutions, or none."""


class NoSolution(Disproof):
    """A sentence that there is no solution."""


@np.errstate(all="ignore")  # what overflows proves nothing
def prove(problem: ProblemData) -> EnumeratedProof | str:
    """Examine all pieces: the proof, a `Disproof`, or why neither was reached; it depends on q as well."""
    count = piece_count(problem)
    if count > MAX_PIECES:
        return f"there are too many linear pieces (more than {MAX_PIECES})"
    exact = ExactRows(problem)
    point = None
    for k, sides in enumerate(exact.consistent(plausible(problem))):
        if k == MAX_EXACT_PIECES:
            return f"more than {MAX_EXACT_PIECES} linear pieces may hold a solution"
        solutions = exact.solve(sides)
        if solutions is None:
            continue
        face = solutions.rounded()
        if solutions.directions:
            along = listed(face.directions[0])
            return Disproof(f"there are many solutions: z may move from {listed(face.point)} along {along}")
        if point is not None and solutions.point != point.point:
            first = listed(point.rounded().point)
            return Disproof(f"there are two solutions or more: {first} and {listed(face.point)}")
        point = solutions
    if point is None:
        return NoSolution(f"there is no solution: all {count:.0f} linear pieces were examined")
    sentence = f"one solution was found in fractions, and no other: all {count:.0f} linear pieces were examined"
    return EnumeratedProof(sentence, point.rounded().point)
