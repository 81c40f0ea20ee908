"""Convex quadratic programs as linear complementarity problems.

    min ½xᵀPx + qᵀx   subject to   Ax = b,  Fx ≤ g

is solved by x if and only if there are multipliers ν and λ with

    Px + q + Fᵀλ + Aᵀν ≥ 0  ⟂  x ≥ l,       g − Fx ≥ 0  ⟂  λ ≥ 0,       b − Ax = 0  (ν has no sign),

l being the lower bounds, −∞ where there are none. That is an ICP with the positive semidefinite matrix
[[P, Fᵀ, Aᵀ], [−F, 0, 0], [−A, 0, 0]] and ψ = (l, 0, −∞). A row of F with one entry is a bound and no row, so that a
program with bounds only is an LCP in x alone. A variable with an upper bound only is turned round; where there are
both, the upper one is a row.
Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (2009), section 1.2; Curtis and Reid, J. Inst.
Maths Applics 10 (1972), for the units.
"""

from __future__ import annotations

import time
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...icp import ICP
from ...numerics.arrays import Vector, row_of
from ...solve.solution import Status
from ...theory.certificates.infeasible import infeasible
from .proximal import points

Columns = NDArray[np.int_]

#: steps of conjugate gradients for the scaling; the largest power of two in it
_SCALINGS, _LARGEST = 200, 400
#: how far a numerical proof of infeasibility may be off, and what it must show, for entries of about 1
_ZERO, _NEGATIVE = 1e-10, -1e-7
#: so many numerical proofs are tried for one in exact arithmetic
_PROOFS = 4
#: so many proximal points without a smaller residual are the last ones
_PATIENCE = 30
#: the residual up to which an answer is called inaccurate and not an error
_INACCURATE = 1e-6


@dataclass(frozen=True, eq=False)
class Program:
    """min ½xᵀPx + qᵀx subject to Ax = b, Fx ≤ g, P positive semidefinite.

    `P` (n, n), `A` (m, n), `F` (k, n) sparse; `q` (n,), `b` (m,), `g` (k,), with +inf where a row says nothing.
    """

    P: sp.csr_array
    q: Vector
    A: sp.csr_array
    b: Vector
    F: sp.csr_array
    g: Vector

    @property
    def contradicts_itself(self) -> bool:
        """Whether an infinite right-hand side leaves no x at all."""
        return bool(not np.isfinite(self.b).all() or np.isneginf(self.g).any())


@dataclass(frozen=True, eq=False)
class Answer:
    """What `solve_program` found: `status` in CVXPY's words and `message`, what it rests on; `x`, `equality` = ν and
    `inequality` = λ, None where there is no optimum; the `objective` there; the `residual` in handy units; Newton's
    `steps`; `seconds`.

    >>> Answer("infeasible", "the rows contradict each other").x is None
    True
    """

    status: str
    message: str
    x: Vector | None = None
    equality: Vector | None = None
    inequality: Vector | None = None
    objective: float = np.nan
    residual: float = np.nan
    steps: int = 0
    seconds: float = 0.0


class Complementary:
    """The LCP of a `Program` in handy units, and the way back.

    `problem`, the ICP in y with (x, λ, ν) = `unit`·y, its entries made about 1 by powers of two; `only_bounds` whether
    it has no multipliers.
    """

    def __init__(self, program: Program) -> None:
        n = program.q.size
        F = sp.csr_array(program.F)
        F.eliminate_zeros()
        self._program, self._n = program, n
        single = (np.diff(F.indptr) == 1) & np.isfinite(program.g)
        rows = np.flatnonzero(single)
        a, column = F.data[F.indptr[rows]], F.indices[F.indptr[rows]]
        with np.errstate(over="ignore"):
            value = program.g[rows] / a
        up, down = a > 0, a < 0
        upper, self._upper_row = _tightest(n, column[up], value[up], rows[up])
        lower, self._lower_row = _tightest(n, column[down], -value[down], rows[down])
        lower = -lower
        self._factor = np.zeros(F.shape[0])
        self._factor[rows] = np.abs(a)
        turned = np.isneginf(lower) & (upper < np.inf)
        self._sign = np.where(turned, -1.0, 1.0)
        self._general = np.flatnonzero(~single & (program.g < np.inf))
        self._both = np.flatnonzero(np.isfinite(lower) & (upper < np.inf))
        self._m = self._general.size + self._both.size
        S = sp.diags_array(self._sign)
        E = sp.vstack([F[self._general], sp.eye_array(n, format="csr")[self._both]]) @ S
        A = program.A @ S
        self.only_bounds = self._m + A.shape[0] == 0
        M = sp.csr_array(sp.block_array([[S @ program.P @ S, E.T, A.T], [-E, None, None], [-A, None, None]]))
        q = np.concatenate([self._sign * program.q, program.g[self._general], upper[self._both], program.b])
        bound = np.where(turned, -upper, lower)
        c = np.concatenate([bound, np.zeros(self._m), np.full(A.shape[0], -np.inf)])
        D, size = _units(M, q, c, n)
        with np.errstate(over="ignore", under="ignore"):
            M = sp.csr_array((D[row_of(M)] * M.data * D[M.indices], M.indices, M.indptr), shape=M.shape)
            self.problem = ICP(M, D * q / size, c / D / size)
            self.unit, self._force = size * D, size / D

    def back(self, y: Vector) -> tuple[Vector, Vector, Vector]:
        """x, ν and λ that belong to `y`."""
        values = self.unit * y
        n, m = self._n, self._m
        x, multipliers = self._sign * values[:n], values[n : n + m]
        force = np.maximum(self._force * self.problem.p(y), 0.0)[:n]
        inequality = np.zeros(self._factor.size)
        inequality[self._general] = multipliers[: self._general.size]
        of_upper = np.where(self._sign < 0, force, 0.0)
        of_upper[self._both] = multipliers[self._general.size :]
        for row, part in ((self._lower_row, np.where(self._sign > 0, force, 0.0)), (self._upper_row, of_upper)):
            from_row = row >= 0
            inequality[row[from_row]] += part[from_row] / self._factor[row[from_row]]
        return x, values[n + m :], inequality

    def contradiction(self, direction: Vector) -> tuple[str, bool] | None:
        """What `direction`, in which the proximal points run off, proves: ("primal" or "dual", in exact arithmetic?).

        "primal": the constraints contradict each other; "dual": the objective falls for ever along x, if there is a
        feasible x. None where it proves neither, even numerically.
        """
        of_x = np.arange(self.problem.n) < self._n
        # without a part in the rows of x neither P nor q has a say
        for kind, y in (("primal", np.where(of_x, 0.0, direction)), ("dual", np.where(of_x, direction, 0.0))):
            if _proves(self.problem, y):
                return kind, infeasible(self.problem, y).holds is True
        return None


def _tightest(n: int, column: Columns, value: Vector, rows: Columns) -> tuple[Vector, Columns]:
    """The least of the `value`s given for each entry, +inf if none is, and the row that gave it, else −1."""
    least, row = np.full(n, np.inf), np.full(n, -1)
    np.minimum.at(least, column, value)
    tight = value == least[column]
    row[column[tight]] = rows[tight]
    return least, row


def _units(M: sp.csr_array, q: Vector, c: Vector, n: int) -> tuple[Vector, float]:
    """Powers of two D and size: DMD has entries of about 1, Dq/size and D⁻¹c/size of at most that.

    log D minimises the sum of (log|m_ij| + log d_i + log d_j)² over the entries, so that the result does not depend on
    the units of the program. Where P = 0 they leave the unit of the objective open, in which the n rows of x are
    measured; it then makes the largest entries of Dq for x as large as what stands in the other rows and in D⁻¹c.
    """
    from scipy.sparse.linalg import cg

    rows, columns = row_of(M), M.indices
    entries = M.data != 0
    rows, columns, logs = rows[entries], columns[entries], np.log2(np.abs(M.data[entries]))
    pattern = sp.csr_array((np.ones(rows.size), (rows, columns)), shape=M.shape)
    count = np.bincount(rows, minlength=M.shape[0])
    normal = pattern + sp.diags_array(np.maximum(count, 1.0))
    D, _ = cg(normal, -np.bincount(rows, logs, M.shape[0]), rtol=1e-6, maxiter=_SCALINGS)
    with np.errstate(divide="ignore", invalid="ignore"):
        of_q, of_c = np.log2(np.abs(q)), np.log2(np.abs(np.where(np.isfinite(c), c, 0.0)))
        gap = (of_q + D)[:n].max() - max((of_q + D)[n:].max(initial=-np.inf), (of_c - D).max())
    if np.isfinite(gap) and not ((rows < n) & (columns < n)).any():
        D += 0.5 * np.where(np.arange(M.shape[0]) < n, -gap, gap)
    D = np.rint(np.clip(D, -_LARGEST, _LARGEST))
    size = max((of_q + D).max(), (of_c - D).max())
    return np.exp2(D), float(np.exp2(np.clip(np.floor(size), -_LARGEST, _LARGEST))) if np.isfinite(size) else 1.0


def _proves(problem: ICP, y: Vector) -> bool:
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
    number, terms = problem.q @ y + columns @ offset, np.abs(problem.q) @ np.abs(y) + np.abs(columns) @ np.abs(offset)
    small = (wrong <= _ZERO * np.minimum(problem.matrix.absolute.T @ np.abs(y), 1.0)).all()
    return bool(small and number < _NEGATIVE * max(terms, 1.0))


def solve_program(program: Program, *, tolerance: float = 1e-9, time_limit: float = np.inf) -> Answer:
    """Solve a convex quadratic program: a program with bounds only as an LCP by `icpmodel.solve`, others by `points`.

    Parameters: `tolerance` of ‖min(p, r)‖₂ of the LCP in units in which its data are about 1; `time_limit` in seconds.
    Returns an `Answer`. "optimal": the residual is below the tolerance; "optimal_inaccurate": below 1e-6. "infeasible"
    and "unbounded" are proved in exact arithmetic (for the latter a feasible x was found, too), with "_inaccurate" they
    are proved up to rounding. "user_limit": the time is over; "solver_error": none of these.
    """
    begin = time.perf_counter()
    if program.contradicts_itself:
        return Answer("infeasible", "a right-hand side is infinite")
    lcp = Complementary(program)
    steps, best, residual, waited, proofs = 0, None, np.inf, 0, 0
    if lcp.only_bounds:
        limit = None if np.isinf(time_limit) else time_limit
        found = lcp.problem.solve(rtol=0.0, atol=tolerance, time_limit=limit, raise_on_failure=False)
        steps, best, residual = found.iterations, found.z, found.residual
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if found.status is Status.INFEASIBLE:
            return _unbounded(True, steps, time.perf_counter() - begin)
    if residual > tolerance:
        for point in points(lcp.problem, tolerance, time_limit - (time.perf_counter() - begin)):
            steps += point.steps
            waited += 1
            if point.residual < residual:
                best, residual, waited = point.z, point.residual, 0
            if residual <= tolerance or waited >= _PATIENCE:
                break
            proof = lcp.contradiction(point.direction)
            proofs += proof is not None
            if proof is not None and (proof[1] or proofs >= _PROOFS):
                left = time_limit - (time.perf_counter() - begin)
                answer = _unsolvable(program, *proof, tolerance, left)
                return replace(answer, steps=steps + answer.steps, seconds=time.perf_counter() - begin)
    seconds = time.perf_counter() - begin
    if residual <= tolerance:
        status, message = "optimal", "solved"
    elif residual <= _INACCURATE:
        status, message = "optimal_inaccurate", f"the residual is {residual:.3g}, not {tolerance:.3g}"
    else:
        status = "user_limit" if seconds >= time_limit else "solver_error"
        message = f"no solution and no proof that there is none was found; the best residual is {residual:.3g}"
    if best is None:
        return Answer("solver_error", f"no proximal point was found in {seconds:.3g} s", steps=steps, seconds=seconds)
    x, equality, inequality = lcp.back(best)
    value = float(0.5 * x @ (program.P @ x) + program.q @ x)
    return Answer(status, message, x, equality, inequality, value, residual, steps, seconds)


def _unsolvable(program: Program, kind: str, exact: bool, tolerance: float, time_limit: float) -> Answer:
    """What follows from a proof; an objective that falls for ever needs a feasible point as well."""
    how = "in exact arithmetic" if exact else "up to rounding"
    if kind == "primal":
        status = "infeasible" if exact else "infeasible_inaccurate"
        return Answer(status, f"a combination of the constraints says 0 < 0, {how}")
    nearest = replace(program, P=sp.eye_array(program.q.size, format="csr"), q=np.zeros(program.q.size))
    feasible = solve_program(nearest, tolerance=tolerance, time_limit=time_limit)
    if feasible.status == "optimal":
        return _unbounded(exact, feasible.steps)
    if feasible.status.startswith("infeasible"):
        return feasible
    return Answer("infeasible_or_unbounded", f"no multipliers exist, {how}; no feasible point was found")


def _unbounded(exact: bool, steps: int, seconds: float = 0.0) -> Answer:
    how = "in exact arithmetic" if exact else "up to rounding"
    status = "unbounded" if exact else "unbounded_inaccurate"
    message = f"there is a feasible point, and a direction along which the objective falls for ever, {how}"
    return Answer(status, message, steps=steps, seconds=seconds)
