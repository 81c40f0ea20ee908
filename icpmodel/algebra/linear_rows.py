"""The dense rows of a problem with affine obstacles, and its linear pieces.

A piece chooses one equation for every row: p_i = 0, z_i = ψ_i(z) or z_i = ψ̄_i(z). Together these
are a linear system. A solution of the problem solves the system of some piece, and has the right
signs in the expressions that are not chosen. So going through all pieces finds all solutions.
"""

from __future__ import annotations

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from enum import IntEnum, auto
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..numerics import work
from ..numerics.arrays import Vector, largest_size
from ..numerics.fill import dense_cost
from ..numerics.rounding import SMALLEST, gamma
from ..problem.data import ProblemData
from ..problem.map import Map
from .equations import linearised

#: the largest number of matrix entries in a batch of several pieces; larger batches do not fit into a cache
_BATCH_ENTRIES = 200_000

SideChoices = NDArray[np.int8]
Dense = NDArray[np.float64]


class RowEquation(IntEnum):
    """The equation of a row: p_i = 0, z_i = ψ_i(z) or z_i = ψ̄_i(z)."""

    FREE = auto()
    LOWER = auto()
    UPPER = auto()


class PieceBatch(NamedTuple):
    """A batch of m pieces.

    `sides`, shape (m, n), are their equations. `z`, shape (m, n), are their solutions, NaN where a system is singular.
    `empty`, shape (m,): whether it is certain, rounding included, that a sign is wrong in the only solution.
    """

    sides: SideChoices
    z: Dense
    empty: NDArray[np.bool_]


@dataclass(frozen=True, eq=False)
class LinearRows:
    """p = Az + q, r = Rz − c ≥ 0 and s = d − Sz ≥ 0 with dense matrices.

    c_i = −∞ and d_i = ∞ where there is no obstacle. Every row of (A, q) is multiplied by a power of
    two, so that its largest |entry| of A is about 1.
    """

    A: Dense
    q: Vector
    R: Dense
    c: Vector
    S: Dense
    d: Vector

    @classmethod
    def of(cls, problem: ProblemData, z: Vector) -> LinearRows:
        """The rows of `problem`; obstacles that are not affine are linearised at `z`.

        Raises MapError where an obstacle has no value or no finite derivative at `z`.
        """
        A = problem.dense()
        exponents = np.frexp(np.abs(A).max(axis=1))[1]
        R, c = _linearise(problem.psi, z)
        S, d = (R, np.full(problem.n, np.inf)) if problem.upper is None else _linearise(problem.upper, z)
        return cls(np.ldexp(A, -exponents[:, None]), np.ldexp(problem.q, -exponents), R, c, S, d)

    @property
    def scale(self) -> float:
        """The largest |entry| of q, c and d, 1 where all are 0."""
        return largest_size(self.q, self.c, self.d)

    def in_units(self, scale: float) -> LinearRows:
        """The same rows in the unknowns z/`scale`."""
        return replace(self, q=self.q / scale, c=self.c / scale, d=self.d / scale)

    @property
    def n(self) -> int:
        """The number of unknowns."""
        return int(self.q.size)

    @property
    def choices(self) -> list[tuple[int, ...]]:
        """The equations that each row may take."""
        sides = (
            (RowEquation.FREE, RowEquation.LOWER, RowEquation.UPPER),
            (RowEquation.FREE, RowEquation.LOWER),
            (RowEquation.FREE, RowEquation.UPPER),
            (RowEquation.FREE,),
        )
        return [sides[2 * int(c == -np.inf) + int(d == np.inf)] for c, d in zip(self.c, self.d, strict=True)]

    def batches(self) -> Iterator[PieceBatch]:
        """Yield all pieces in batches. Raises OutOfTime where the next batch does not fit into the time left."""
        size = max(_BATCH_ENTRIES // self.n**2, 1)
        pieces = itertools.product(*self.choices)
        while chosen := list(itertools.islice(pieces, size)):
            work.charge(len(chosen) * (work.COSTS.call + 8.0 * dense_cost(self.n)))
            yield self._solve_pieces(np.array(chosen, dtype=np.int8))

    @np.errstate(all="ignore")
    def _solve_pieces(self, sides: SideChoices) -> PieceBatch:
        """Solve the pieces `sides` by approximate inverses, with bounds on the errors."""
        lower = sides == RowEquation.LOWER
        upper = sides == RowEquation.UPPER
        B = np.where(lower[:, :, None], self.R, np.where(upper[:, :, None], self.S, self.A))
        b = np.where(lower, self.c, np.where(upper, self.d, -self.q))
        inverse = _inverses(B)
        z = _times(inverse, b)
        z += _times(inverse, b - _times(B, z))
        # with C the approximate inverse and e = ‖I − CB‖ < 1: ‖z* − z‖ ≤ ‖C(b − Bz)‖/(1 − e), in maximum norms
        n = self.n
        off = np.abs(np.eye(n) - inverse @ B).sum(axis=2) + gamma(2 * n) * (np.abs(inverse) @ np.abs(B)).sum(axis=2)
        contraction = off.max(axis=1)
        defect = np.abs(b - _times(B, z)) + _rounding(_times(np.abs(B), np.abs(z)) + np.abs(b), z)
        error = _times(np.abs(inverse), defect).max(axis=1) / (1.0 - contraction)
        error = np.where(contraction < 1.0, 2.0 * error, np.inf)[:, None] + _rounding(0.0, z)
        empty = np.zeros(len(sides), dtype=bool)
        for M, offset, sign, rows in self._signs(sides):
            value = sign * (z @ M.T + offset)
            rounding = _rounding(np.abs(z) @ np.abs(M).T + np.abs(offset), z)
            empty |= (rows & (value < -(np.abs(M).sum(axis=1) * error + rounding))).any(axis=1)
        return PieceBatch(sides, z, empty)

    def _signs(self, sides: SideChoices) -> Iterator[tuple[Dense, Vector, float, NDArray[np.bool_]]]:
        """Yield (M, v, ±1, rows): ±(Mz + v)_i ≥ 0 must hold in these rows, a mask of the shape of `sides`."""
        below = np.isfinite(self.c)
        above = np.isfinite(self.d)
        yield self.A, self.q, 1.0, sides == RowEquation.LOWER
        yield self.A, self.q, -1.0, sides == RowEquation.UPPER
        yield self.R, np.where(below, -self.c, 0.0), 1.0, (sides != RowEquation.LOWER) & below
        yield self.S, np.where(above, -self.d, 0.0), -1.0, (sides != RowEquation.UPPER) & above


def has_linear_pieces(problem: ProblemData) -> bool:
    """Whether every obstacle of `problem` is constant or affine; of two, `linear` is known only if both are."""
    return problem.psi.linear is not None


def piece_count(problem: ProblemData) -> float:
    """The number of linear pieces of `problem`, infinite where it overflows."""
    zero = np.zeros(problem.n)
    sides = 1.0 + (problem.psi.value(zero) > -np.inf)
    if problem.upper is not None:
        sides += problem.upper.value(zero) < np.inf
    with np.errstate(over="ignore"):
        return float(np.prod(sides))


def _linearise(psi: Map, z: Vector) -> tuple[Dense, Vector]:
    """(I − G, c) with ψ(z) = Gz + c, or its linearisation at `z`."""
    G, c = linearised(psi, z)
    return np.eye(z.size) - G.toarray(), c


def _rounding(terms: Vector | float, z: Vector) -> Vector:
    """A bound on the rounding errors of sums with Σ|terms| = `terms` at the points `z`; scaled rows may underflow."""
    n = z.shape[1]
    return np.asarray(gamma(2 * n) * terms + 4 * n * SMALLEST * (1.0 + np.abs(z).max(axis=1, keepdims=True)))


def _inverses(B: Dense) -> Dense:
    """The inverses of the matrices B[k], NaN for those that are singular as floats."""
    try:
        return np.asarray(np.linalg.inv(B), dtype=np.float64)
    except np.linalg.LinAlgError:
        if len(B) == 1:
            return np.full_like(B, np.nan)
        half = len(B) // 2
        return np.concatenate([_inverses(B[:half]), _inverses(B[half:])])


def _times(M: Dense, x: Dense) -> Dense:
    """M[k] @ x[k] for every k."""
    return np.matmul(M, x[:, :, None])[:, :, 0]
