"""Convex quadratic programs as linear complementarity problems.

    min ½xᵀPx + qᵀx   subject to   Ax = b,  Fx ≤ g

is solved by x if and only if there are multipliers ν and λ with

    Px + q + Fᵀλ + Aᵀν  ⟂  l ≤ x ≤ u,       g − Fx ≥ 0  ⟂  λ ≥ 0,       b − Ax = 0  (ν has no sign),

l and u being the bounds, −∞ and ∞ where there are none. That is an ICP with the positive semidefinite matrix
[[P, Fᵀ, Aᵀ], [−F, 0, 0], [−A, 0, 0]], ψ = (l, 0, −∞) and ψ̄ = (u, ∞, ∞). A row of F with one entry is a bound and no
row, so that a program with bounds only is an ICP in x alone. A variable with an upper bound only is turned round, so
that there is no ψ̄ where no variable has both.
Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (2009), section 1.2; Curtis and Reid, J. Inst.
Maths Applics 10 (1972), for the units.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...icp import ICP
from ...numerics.arrays import Vector, row_of
from ...numerics.equilibration import in_units
from ...theory.certificates.infeasible import Known, infeasible

Columns = NDArray[np.int_]

#: steps of conjugate gradients for the scaling; the largest power of two in it
_SCALINGS, _LARGEST = 200, 400
#: how far a numerical proof of infeasibility may be off, and what it must show, for entries of about 1
_ZERO, _NEGATIVE = 1e-10, -1e-7


@dataclass(frozen=True, eq=False)
class Program:
    """min ½xᵀPx + qᵀx subject to Ax = b, Fx ≤ g, P positive semidefinite; g = +inf where a row says nothing."""

    P: sp.csr_array
    q: Vector
    A: sp.csr_array
    b: Vector
    F: sp.csr_array
    g: Vector

    @np.errstate(over="ignore", invalid="ignore", divide="ignore")
    def violation(self, x: Vector, equality: Vector, inequality: Vector) -> float:
        """How far x, ν and λ ≥ 0 are from being optimal, whatever the units: the largest of what is wrong in a row, of
        Ax = b, Fx ≤ g, or Px + q + Fᵀλ + Aᵀν = 0, as a share of the sum of its |terms|, of what λᵀ(g − Fx) is of those
        of the objectives, and of the lesser share that a λ_i and its slack have; inf where one is not a number."""
        P, A, F, g = abs(self.P), abs(self.A), sp.csr_array(abs(self.F)), np.where(self.g < np.inf, self.g, 0.0)
        gradient = self.P @ x + self.q + self.F.T @ inequality + self.A.T @ equality
        of_gradient = P @ np.abs(x) + np.abs(self.q) + F.T @ inequality + A.T @ np.abs(equality)
        of_rows = np.abs(g) + F @ np.abs(x)
        slack = np.where(self.g < np.inf, g - self.F @ x, 0.0)
        terms = np.abs(x) @ (P @ np.abs(x) + np.abs(self.q)) + np.abs(self.b) @ np.abs(equality)
        pull = np.zeros(g.size)
        np.maximum.at(pull, row_of(F), F.data / np.where(of_gradient > 0, of_gradient, 1.0)[F.indices])
        shares = (
            _shares(gradient, of_gradient),
            _shares(self.A @ x - self.b, np.abs(self.b) + A @ np.abs(x)),
            _shares(np.minimum(slack, 0.0), of_rows),
            np.minimum(_shares(slack, of_rows), inequality * pull),
            _shares(np.array([inequality @ slack]), np.array([terms + np.abs(g) @ inequality])),
        )
        largest = float(np.concatenate(shares).max(initial=0.0))
        return largest if largest < np.inf else np.inf


def _shares(wrong: Vector, size: Vector) -> Vector:
    """|wrong|/size, 0 where nothing is wrong."""
    return np.where(wrong == 0, 0.0, np.abs(wrong) / size)


class ProgramLcp:
    """The conditions of a `Program` as the ICP `problem` in y, (x, λ, ν) = `unit`·y, its entries about 1 by powers of
    two, and the way back; `only_bounds` tells whether there are no multipliers, `bounds_cross` whether no x is in its
    bounds."""

    def __init__(self, program: Program) -> None:
        self.program, n = program, program.q.size
        F = sp.csr_array(program.F)
        F.eliminate_zeros()
        single = (np.diff(F.indptr) == 1) & np.isfinite(program.g)
        rows = np.flatnonzero(single)
        a, column = F.data[F.indptr[rows]], F.indices[F.indptr[rows]]
        with np.errstate(over="ignore"):
            value = program.g[rows] / a
        up, down = a > 0, a < 0
        upper, self._upper_row = _tightest(n, column[up], value[up], rows[up])
        lower, self._lower_row = _tightest(n, column[down], -value[down], rows[down])
        lower = -lower
        # the quotients are rounded once each, which does not make bounds cross
        self.bounds_cross = bool((lower > upper).any())
        self._factor = np.zeros(F.shape[0])
        self._factor[rows] = np.abs(a)
        turned = np.isneginf(lower) & (upper < np.inf)
        self._sign = np.where(turned, -1.0, 1.0)
        self._general = np.flatnonzero(~single & (program.g < np.inf))
        self._both = np.isfinite(lower) & (upper < np.inf)
        S = sp.diags_array(self._sign)
        E, A = F[self._general] @ S, program.A @ S
        self._n, self._m = n, E.shape[0]
        self.only_bounds = self._m + A.shape[0] == 0
        M = sp.csr_array(sp.block_array([[S @ program.P @ S, E.T, A.T], [-E, None, None], [-A, None, None]]))
        q = np.concatenate([self._sign * program.q, program.g[self._general], program.b])
        bound = np.where(turned, -upper, lower)
        c = np.concatenate([bound, np.zeros(self._m), np.full(A.shape[0], -np.inf)])
        above = np.full(c.size, np.inf)
        above[:n][self._both] = np.maximum(lower, upper)[self._both]
        D, size = _units(M, q, np.stack([c, above]), n)
        with np.errstate(over="ignore", under="ignore"):
            c, above = (np.ldexp(one, -D - size) for one in (c, above))
            self._below = ICP(in_units(M, D, D), np.ldexp(q, D - size), c)
        self._known = Known(np.full(c.size, -np.inf), above, "bounds") if self._both.any() else None
        self.problem = self._below if self._known is None else self._below.with_upper(above)
        self.unit, self._force = np.exp2(size + D), np.exp2(size - D)

    def back(self, y: Vector) -> tuple[Vector, Vector, Vector]:
        """x, ν and λ that belong to `y`."""
        values = self.unit * y
        n, m = self._n, self._m
        x, multipliers = self._sign * values[:n], np.maximum(values[n : n + m], 0.0)
        force = self._sign * (self._force * self.problem.p(y))[:n]
        inequality = np.zeros(self._factor.size)
        inequality[self._general] = multipliers
        for row, part in ((self._lower_row, np.maximum(force, 0.0)), (self._upper_row, np.maximum(-force, 0.0))):
            from_row = row >= 0
            inequality[row[from_row]] += part[from_row] / self._factor[row[from_row]]
        return x, values[n + m :], inequality

    def contradiction(self, direction: Vector) -> tuple[str, bool] | None:
        """What `direction` proves, and whether in exact arithmetic: "primal", that the constraints contradict each
        other; "dual", that the objective falls for ever along x, if there is a feasible x. None: not even numerically.
        """
        of_x = np.arange(self.problem.n) < self._n
        # without a part in the rows of x neither P nor q has a say; with two bounds p_i may have any sign
        of_one = of_x & ~np.pad(self._both, (0, of_x.size - self._n))
        for kind, y in (("primal", np.where(of_x, 0.0, direction)), ("dual", np.where(of_one, direction, 0.0))):
            if _proves(self._below, y, self._known):
                return kind, infeasible(self._below, y, self._known).holds is True
        return None


def _tightest(n: int, column: Columns, value: Vector, rows: Columns) -> tuple[Vector, Columns]:
    """The least of the `value`s given for each entry, +inf if none is, and the row that gave it, else −1."""
    least, row = np.full(n, np.inf), np.full(n, -1)
    np.minimum.at(least, column, value)
    tight = value == least[column]
    row[column[tight]] = rows[tight]
    return least, row


def _units(M: sp.csr_array, q: Vector, c: NDArray[np.float64], n: int) -> tuple[NDArray[np.int64], int]:
    """Whole exponents D and size: 2^D M 2^D has entries of about 1, 2^D q and both 2^−D c of at most about 2^size. D
    minimises the sum of (log₂|m_ij| + d_i + d_j)² over the entries, whatever the units of the program. Where P = 0 the
    unit of the n rows of x is open; it makes the largest entries of 2^D q for x as large as the others."""
    from scipy.sparse.linalg import cg

    rows, columns = row_of(M), M.indices
    entries = M.data != 0
    rows, columns, logs = rows[entries], columns[entries], np.log2(np.abs(M.data[entries]))
    pattern = sp.csr_array((np.ones(rows.size), (rows, columns)), shape=M.shape)
    count = np.bincount(rows, minlength=M.shape[0])
    normal = pattern + sp.diags_array(np.maximum(count, 1.0))
    D, _ = cg(normal, -np.bincount(rows, logs, M.shape[0]), rtol=1e-6, maxiter=_SCALINGS)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_q, of_c = np.log2(np.abs(q)), np.log2(np.abs(np.where(np.isfinite(c), c, 0.0)).max(axis=0))
        gap = (of_q + D)[:n].max() - max((of_q + D)[n:].max(initial=-np.inf), (of_c - D).max())
    if np.isfinite(gap) and not ((rows < n) & (columns < n)).any():
        D += 0.5 * np.where(np.arange(M.shape[0]) < n, -gap, gap)
    D = np.rint(np.clip(D, -_LARGEST, _LARGEST))
    size = np.floor(max((of_q + D).max(), (of_c - D).max()))
    return D.astype(np.int64), int(np.clip(size, -_LARGEST, _LARGEST)) if np.isfinite(size) else 0


def _proves(problem: ICP, y: Vector, known: Known | None) -> bool:
    """Whether y shows, up to rounding, that no z has p ≥ 0 and r ≥ 0: see `infeasible`."""
    c = problem.psi.value(y)
    free = np.isneginf(c)
    size = np.abs(y).max()
    if not 0.0 < size < np.inf:
        return False
    y = np.where(np.abs(y) > _ZERO * size, y / size, 0.0)
    if (y[~free] < 0).any():
        return False
    columns, offset = problem.A.T @ y, np.where(free, 0.0, c)
    wrong = np.where(free, np.abs(columns), columns)
    if known is not None:
        at_upper = np.isfinite(known.high) & (columns > 0)
        offset, wrong = np.where(at_upper, known.high, offset), np.where(at_upper, 0.0, wrong)
    number, terms = problem.q @ y + columns @ offset, np.abs(problem.q) @ np.abs(y) + np.abs(columns) @ np.abs(offset)
    small = (wrong <= _ZERO * np.minimum(problem.matrix.absolute.T @ np.abs(y), 1.0)).all()
    return bool(small and number < _NEGATIVE * max(terms, 1.0))
