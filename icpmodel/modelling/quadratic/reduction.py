"""Convex quadratic programs as linear complementarity problems.

    min ½xᵀPx + qᵀx   subject to   Ax = b,  Fx ≤ g

is solved by x if and only if there are multipliers ν and λ with

    Px + q + Fᵀλ + Aᵀν  ⟂  l ≤ x ≤ u,       g − Fx ≥ 0  ⟂  λ ≥ 0,       b − Ax = 0  (ν has no sign),

l and u being the bounds, −∞ and ∞ where there are none. That is an ICP with the positive semidefinite matrix
[[P, Fᵀ, Aᵀ], [−F, 0, 0], [−A, 0, 0]], ψ = (l, 0, −∞) and ψ̄ = (u, ∞, ∞). A row of F with one entry is a bound and no
row, so that a program with bounds only is an ICP in x alone. A variable with an upper bound only is turned round, so
that there is no ψ̄ where no variable has both.
Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (2009), section 1.2.
"""

from __future__ import annotations

from copy import copy
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...icp import ICP
from ...numerics import work
from ...numerics.arrays import Mask, Vector, norm, row_of
from ...numerics.equilibration import balanced, in_units
from ...numerics.rounding import UNIT_ROUNDOFF
from ...problem.between import mid
from ...theory.certificates.infeasible import Known
from .kkt import KktBlocks, Systems, systems_of
from .program import Matrices, Program, handy

Columns = NDArray[np.int_]

#: the largest power of two in the scaling
_LARGEST = 400
#: the share of their sizes by which bounds may cross as data and quotients are rounded
_TOUCH = 4.0 * UNIT_ROUNDOFF


class Frame:
    """What does not depend on q, b and g, but on where g is finite: which rows are bounds, which variables are turned
    round, and the other rows, E, with P and A in units 2^D, a power of two for every x, λ and ν."""

    def __init__(self, matrices: Matrices, says: Mask) -> None:
        self.matrices, self.says = matrices, says
        P, A, F = matrices.P, matrices.A, matrices.F
        there = F != 0
        single = (np.asarray(there.sum(axis=1)).reshape(-1) == 1) & says
        self.rows = np.flatnonzero(single)
        self.general = np.flatnonzero(~single & says)
        if sp.issparse(F):
            rows = sp.csr_array(F[self.rows])
            rows.eliminate_zeros()
            self.columns, self.entries = rows.indices, rows.data
        else:
            self.columns = there[self.rows].argmax(axis=1) if self.rows.size else np.zeros(0, np.intp)
            self.entries = F[self.rows, self.columns]
        n, up = P.shape[0], self.entries > 0
        below, above = np.zeros(n, bool), np.zeros(n, bool)
        below[self.columns[~up]], above[self.columns[up]] = True, True
        self.turned, self.both = above & ~below, above & below
        self.sign = np.where(self.turned, -1.0, 1.0)
        E = F[self.general]
        self.n, self.m, self.k = n, E.shape[0], A.shape[0]
        self.D = _units(P, E, A)
        x, of_rows, of_equations = np.split(self.D, [n, n + self.m])
        self.P = _scaled(P, x, x, self.sign, self.sign)
        self.E = _scaled(E, of_rows, x, None, self.sign)
        self.A = _scaled(A, of_equations, x, None, self.sign)

    def is_of(self, program: Program) -> bool:
        """Whether `program` has its matrices, and says nothing in the same rows."""
        return program.matrices is self.matrices and np.array_equal(program.g < np.inf, self.says)

    def shifted(self, by: int) -> Frame:
        """With 2^−by for the unit of x and 2^by for that of λ and ν."""
        other = copy(self)
        other.D = self.D + np.where(np.arange(self.D.size) < self.n, -by, by)
        if not self.is_linear:
            other.P = in_units(self.P, np.full(self.n, -2 * by))
            for known in ("conditions", "systems"):
                other.__dict__.pop(known, None)
        return other

    @property
    def blocks(self) -> KktBlocks:
        return KktBlocks(self.P, self.E, self.A)

    @cached_property
    def systems(self) -> Systems:
        """The linear systems of all steps of all programs that share this frame: in which order, is found out once."""
        return systems_of(self.blocks)

    @cached_property
    def is_linear(self) -> bool:
        """Whether P = 0."""
        return not (self.P.data if sp.issparse(self.P) else self.P).any()

    @cached_property
    def conditions(self) -> ICP:
        """The ICP for q = 0 and without bounds, from which programs that share this frame have all that is of A."""
        P, E, A = map(sp.csr_array, (self.P, self.E, self.A))
        M = sp.csr_array(sp.block_array([[P, E.T, A.T], [-E, None, None], [-A, None, None]]))
        return ICP(M, np.zeros(M.shape[0]), np.repeat([-np.inf, 0.0, -np.inf], [self.n, self.m, self.k]))


def _scaled(M: Any, rows: Any, columns: Any, left: Vector | None, right: Vector) -> Any:
    M = in_units(handy(M), rows, columns)
    if sp.issparse(M):
        M.data = M.data * right[M.indices] * (1.0 if left is None else left[row_of(M)])
        return M
    return M * right * (1.0 if left is None else left[:, None])


class ProgramLcp:
    """The conditions of a `Program` as the ICP `problem` in y, (x, λ, ν) = `unit`·y, its entries about 1 by powers of
    two, and the way back; `only_bounds` tells whether there are no multipliers, `bounds_cross` whether no x is in its
    bounds. Its blocks are `frame.P`, `frame.E` and `frame.A`, and `q`, `low`, `high`, the latter two for x alone."""

    def __init__(
        self, program: Program, frame: Frame | None = None, *, by_bounds: bool = True, as_linear: bool = False
    ) -> None:
        self.program = program
        self.frame = frame = Frame(program.matrices, program.g < np.inf) if frame is None else frame
        n, m = frame.n, frame.m
        self.only_bounds = m + frame.k == 0
        up = frame.entries > 0
        with np.errstate(over="ignore"):
            value = program.g[frame.rows] / frame.entries
        upper, self._upper_row = _tightest(n, frame.columns[up], value[up], frame.rows[up])
        lower, self._lower_row = _tightest(n, frame.columns[~up], -value[~up], frame.rows[~up])
        lower = -lower
        # data and quotients are rounded once each
        with np.errstate(invalid="ignore"):
            touch = (lower > upper) & (lower - upper <= _TOUCH * (np.abs(lower) + np.abs(upper)))
        lower = np.where(touch, upper, lower)
        self.bounds_cross = bool((lower > upper).any())
        low = np.where(frame.turned, -upper, lower)
        high = np.where(frame.both, np.maximum(lower, upper), np.inf)
        q = np.concatenate([frame.sign * program.q, program.g[frame.general], program.b])
        D, size = self._units(q, low, high, by_bounds, as_linear)
        with np.errstate(over="ignore", under="ignore"):
            self.q = np.ldexp(q, D - size)
            self.low, self.high = (np.ldexp(one, -D[:n] - size) for one in (low, high))
        self.unit, self._force = np.exp2(size + D), np.exp2(size - D[:n])

    def _units(self, q: Vector, low: Vector, high: Vector, by_bounds: bool, as_linear: bool) -> tuple[Any, int]:
        """Whole exponents D and size: 2^D q and, `by_bounds`, both 2^−D c are of at most about 2^size. Where P = 0 the
        unit of x is open; it makes the largest entries of 2^D q for x as large as the others, and `as_linear` as well
        where P is not."""
        frame, n, D = self.frame, self.frame.n, self.frame.D
        c = np.maximum(*(np.abs(np.where(np.isfinite(one) & by_bounds, one, 0.0)) for one in (low, high)))
        with np.errstate(divide="ignore", invalid="ignore"):
            of_q, of_c = np.log2(np.abs(q)), np.log2(c)
            gap = (of_q + D)[:n].max() - max((of_q + D)[n:].max(initial=-np.inf), (of_c - D[:n]).max())
        if (frame.is_linear or as_linear) and np.isfinite(gap):
            shift = int(np.clip(np.rint(0.5 * gap), -_LARGEST, _LARGEST))
            self.frame = frame.shifted(shift)
            D = self.frame.D
        size = np.floor(max((of_q + D).max(), (of_c - D[:n]).max()))
        return D, int(np.clip(size, -_LARGEST, _LARGEST)) if np.isfinite(size) else 0

    def is_as(self, other: ProgramLcp) -> bool:
        """Whether it is the same in the same units as an `other` one of the same program."""
        return np.array_equal(self.unit, other.unit) and np.array_equal(self._force, other._force)

    @cached_property
    def below(self) -> ICP:
        """The ICP without the obstacle above."""
        frame, problem = self.frame, self.frame.conditions.with_q(self.q)
        if np.isneginf(self.low).all():
            return problem
        return problem.with_psi(np.concatenate([self.low, np.zeros(frame.m), np.full(frame.k, -np.inf)]))

    @cached_property
    def problem(self) -> ICP:
        if not self.frame.both.any():
            return self.below
        return self.below.with_upper(self._above)

    @property
    def _above(self) -> Vector:
        return np.concatenate([self.high, np.full(self.frame.m + self.frame.k, np.inf)])

    @cached_property
    def known(self) -> Known | None:
        above = self._above
        return Known(np.full(above.size, -np.inf), above, "bounds") if self.frame.both.any() else None

    def p(self, y: Vector) -> Vector:
        """What is complementary to y."""
        frame = self.frame
        x, of_rows, of_equations = np.split(y, [frame.n, frame.n + frame.m])
        pull = frame.P @ x + frame.E.T @ of_rows + frame.A.T @ of_equations
        return np.concatenate([pull, -(frame.E @ x), -(frame.A @ x)]) + self.q

    def residual(self, y: Vector) -> float:
        """Res(y), that of `problem`."""
        frame, p = self.frame, self.p(y)
        n, m = frame.n, frame.m
        r = np.concatenate([y[:n] - self.low, y[n : n + m], np.full(frame.k, np.inf)])
        return norm(mid(p, r, y - self._above if frame.both.any() else None))

    def back(self, y: Vector) -> tuple[Vector, Vector, Vector]:
        """x, ν and λ that belong to `y`."""
        frame, values = self.frame, self.unit * y
        n, m = frame.n, frame.m
        x, multipliers = frame.sign * values[:n], np.maximum(values[n : n + m], 0.0)
        p = self.p(y)[:n]
        # where p is less than the way to the bound it is rounding and no multiplier
        p = np.where(p > 0, np.where(p > y[:n] - self.low, p, 0.0), np.where(-p > self.high - y[:n], p, 0.0))
        force = frame.sign * (self._force * p)
        inequality = np.zeros(self.program.g.size)
        inequality[frame.general] = multipliers
        factor = np.zeros(self.program.g.size)
        factor[frame.rows] = np.abs(frame.entries)
        for row, part in ((self._lower_row, np.maximum(force, 0.0)), (self._upper_row, np.maximum(-force, 0.0))):
            from_row = row >= 0
            inequality[row[from_row]] += part[from_row] / factor[row[from_row]]
        return x, values[n + m :], inequality


def _tightest(n: int, column: Columns, value: Vector, rows: Columns) -> tuple[Vector, Columns]:
    """The least of the `value`s given for each entry, +inf if none is, and the row that gave it, else −1."""
    least, row = np.full(n, np.inf), np.full(n, -1)
    np.minimum.at(least, column, value)
    tight = value == least[column]
    row[column[tight]] = rows[tight]
    return least, row


def _units(P: Any, E: Any, A: Any) -> NDArray[np.int64]:
    """Whole exponents D: 2^D M 2^D has entries of about 1, M = [[P, Eᵀ, Aᵀ], [E, 0, 0], [A, 0, 0]], whatever the units
    of the program."""
    n, rest = P.shape[0], E.shape[0] + A.shape[0]
    if not any(map(sp.issparse, (P, E, A))) and work.COSTS.entry * rest**2 <= work.COSTS.call:
        M = np.zeros((n + rest, n + rest))
        M[:n, :n], M[n:, :n] = P, np.concatenate([E, A])
        M[:n, n:] = M[n:, :n].T
    else:
        M = sp.csr_array(sp.block_array([[P, E.T, A.T], [E, None, None], [A, None, None]]))
    return np.rint(np.clip(-0.5 * np.log2(balanced(M)), -_LARGEST, _LARGEST)).astype(np.int64)
