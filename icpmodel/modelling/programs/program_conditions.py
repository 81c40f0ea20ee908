"""The conditions of a program as an ICP in balanced units."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ...icp import ICP
from ...numerics.arrays import Mask, Vector, row_of
from ...numerics.equilibration import balanced, in_units
from .program import Program, Values, matrix_of, sides_of
from .program_judge import Judge, Violation

#: the share of its terms up to which a row is tight at a start
_TIGHT = 1e-6
#: the share of the largest unknown up to which the distance to an obstacle may be rounding
_NOISE = 1e-13
#: log₂ of the quotient of entries that are far apart
_FAR = 60
#: the largest exponent by which units are moved
_LARGEST = 400


class Conditions:
    """The conditions of a program as an ICP in z = (x, ν, λ), in `units`, powers of two, in which A is balanced.

    Parameters
    ----------
    given
        The program, tightened.
    like
        The conditions of a program that has the same matrices, of which all that is known of A is taken over.

    Attributes
    ----------
    problem
        The ICP.
    """

    def __init__(self, given: Program, like: Conditions | None = None) -> None:
        self.given = given
        self.n = given.g.size
        if like is None or not given.has_matrices_of(like.given):
            A = matrix_of(given)
            self.units = _units(A)
            if not given.H.nnz:
                self.units += self._shift()
            base = ICP(in_units(A, self.units, self.units), np.zeros(A.shape[0]))
        else:
            self.units = like.units
            base = like.problem
            if "judge" in like.__dict__:
                self.judge = like.judge
        self.q = np.ldexp(np.concatenate([given.g, given.b, given.h]), self.units)
        low, high = sides_of(given)
        self.low = np.ldexp(low, -self.units)
        self.high = np.full(self.low.size, np.inf) if high is None else np.ldexp(high, -self.units)
        self.problem: ICP = base.with_q(self.q).with_sides(self.low, None if high is None else self.high)

    def _shift(self) -> Vector:
        """What makes g as large as the right-hand sides: without H the units of x and of the multipliers are free."""
        given = self.given
        n = self.n
        ends = [np.where(np.isfinite(side), side, 0.0) for side in (given.low, given.high)]
        of_g = np.ldexp(np.abs(given.g), self.units[:n]).max()
        of_rows = np.ldexp(np.abs(np.append(given.b, given.h)), self.units[n:]).max(initial=0.0)
        of_rows = max(of_rows, np.ldexp(np.maximum(*np.abs(ends)), -self.units[:n]).max())
        if not (0.0 < of_g < np.inf and 0.0 < of_rows < np.inf):
            return np.zeros(self.units.size, np.int64)
        by = int(np.clip(np.rint(0.5 * np.log2(of_rows / of_g)), -_LARGEST, _LARGEST))
        return np.where(np.arange(self.units.size) < n, by, -by)

    @cached_property
    def judge(self) -> Judge:
        """The judge, one for all conditions with this matrix."""
        return Judge(self.problem.A, self.n)

    def violation(self, z: Vector) -> Violation:
        """How far `z` is from the conditions: see `Judge`."""
        return self.judge.violation(self.problem, self.low, self.high, self.clipped(z))

    def near(self, x: Vector) -> Vector:
        """z of an `x` as it was given, with multipliers of the rows that are tight there by least squares."""
        from scipy.sparse.linalg import lsmr

        z = np.zeros(self.q.size)
        z[: self.n] = np.ldexp(x, -self.units[: self.n])
        p = self.problem.p(z)
        free = np.flatnonzero((self.low < z)[: self.n] & (z < self.high)[: self.n])
        terms = abs(self.problem.A) @ np.abs(z) + np.abs(self.q)
        tight = np.flatnonzero((np.abs(p) <= _TIGHT * terms) & (np.arange(z.size) >= self.n))
        z[tight] = lsmr(self.problem.A[free][:, tight], -p[free], atol=_TIGHT, btol=_TIGHT)[0]
        return self.clipped(z)

    def clipped(self, z: Vector) -> Vector:
        """z between its obstacles."""
        return np.minimum(np.maximum(z, self.low), self.high)

    def snapped(self, z: Vector) -> Vector:
        """z on its obstacles, and 0, where the distance to them may be rounding."""
        z = z.copy()
        for part in (slice(None, self.n), slice(self.n, None)):
            noise = _NOISE * np.abs(z[part]).max(initial=0.0)
            for side in (self.low[part], self.high[part], np.zeros(z[part].size)):
                z[part] = np.where(np.abs(z[part] - side) <= noise, side, z[part])
        return z

    def pressed(self, z: Vector, held: Mask) -> Vector:
        """z on the obstacle to which p presses it in the rows that are `held`."""
        return np.where(held, np.where(self.problem.p(self.clipped(z)) > 0, self.low, self.high), z)

    def values(self, z: Vector) -> Values:
        """The values that belong to `z` in the units of the program; multipliers of bounds are p where z is held."""
        z = self.clipped(z)
        box = np.where(self.violation(z).held, -self.problem.p(z), 0.0)[: self.n]
        x, nu, multiplier = np.split(np.ldexp(z, self.units), [self.n, self.n + self.given.b.size])
        return Values(x, nu, multiplier, np.ldexp(box, -self.units[: self.n]))


def _units(A: sp.csr_array) -> Vector:
    """Whole exponents e: the entries 2^(e_i + e_j)a_ij are about 1.

    By `balanced`; where that leaves them far apart, by least squares of log₂|a_ij| + e_i + e_j if these do not.
    """
    from scipy.sparse.linalg import lsmr

    sizes = np.frexp(A.data)[1].astype(np.float64)
    row = row_of(A)

    def spread(e: Vector) -> float:
        return float(np.ptp(sizes + e[row] + e[A.indices]))

    e = np.rint(-0.5 * np.log2(balanced(A)))
    if A.nnz and spread(e) > _FAR:
        ones = np.ones(2 * row.size)
        each = np.arange(row.size)
        pairs = sp.csr_array((ones, (np.tile(each, 2), np.append(row, A.indices))), shape=(row.size, e.size))
        by_logarithms = np.rint(lsmr(pairs, -sizes)[0])
        e = by_logarithms if spread(by_logarithms) <= _FAR else e
    return e.astype(np.int64)
