"""icpmodel as a solver of CVXPY: convex quadratic programs as ICPs, with proofs where there is no answer.

The obstacles of such an ICP are constant. Its matrix M is positive semidefinite and mostly singular, while Newton's
method wants systems that can be solved. M + σI is positive definite, so

    z⁺ solves the ICP with M + σI and q − σz        (σ > 0; the obstacles are the same)

has exactly one solution, the proximal point. The residual of z⁺ in the ICP itself is at most σ|z⁺ − z|, and z converges
wherever there is a solution. Where there is none, z⁺ − z tends to the direction of a proof. σ falls where Newton's
method needs few steps, and rises where it fails.
Reference: Rockafellar, SIAM J. Control Optim. 14 (1976); Liao-McPherson and Kolmanovsky, FBstab, Automatica 113 (2020).
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import cache
from typing import Any, NamedTuple

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy import settings as s
from cvxpy.reductions.solution import Solution as CvxpySolution
from cvxpy.reductions.solution import failure_solution
from cvxpy.reductions.solvers import utilities
from cvxpy.reductions.solvers.qp_solvers.qp_solver import QpSolver

from ...errors import InputError
from ...icp import ICP
from ...methods.newton import Newton
from ...numerics.arrays import Vector, as_number
from ...solve.solution import Solution, Status
from .quadratic import Program, ProgramLcp

_OPTIONS = ("tolerance", "time_limit")
#: the first σ, how it changes, and its range, for a matrix with entries of about 1
_FIRST, _CHANGE, _LEAST, _MOST = 1e-2, 10.0, 1e-10, 1e2
#: Newton's steps for one proximal point, at the most and where they are few
_STEPS, _FEW = 100, 20
#: so many numerical proofs are tried for one in exact arithmetic
_PROOFS = 4
#: so many proximal points without a smaller residual are the last ones
_PATIENCE = 30
#: what a proof holds by, exact or not
_HOW = {True: "in exact arithmetic", False: "up to rounding"}
#: what may be wrong in the units of the program, as a multiple of the tolerance in those of the ICP, and up to what an
#: answer is called inaccurate and not an error
_USERS, _INACCURATE = 1e2, 1e-4
#: shares of the tolerance that are tried one after the other, and what may be noise beside 1
_SHARES, _NOISE = (1.0, 1e-4, 1e-8, 1e-14), (0.0, 1e-13)


class ProximalPoint(NamedTuple):
    """`z`, the step `direction` = z⁺ − z that led to it, its `residual` and Newton's `steps`."""

    z: Vector
    direction: Vector
    residual: float
    steps: int


def proximal_points(problem: ICP, tolerance: float, time_limit: float = np.inf) -> Iterator[ProximalPoint]:
    """The proximal points of `problem`, constant obstacles and a positive semidefinite A of entries about 1, from its
    lower obstacle on. It ends when the time is over, or no σ lets Newton's method succeed. Raises KeyboardInterrupt
    after Ctrl-C."""
    end = time.perf_counter() + time_limit
    c = problem.psi.value(np.zeros(problem.n))
    z = np.where(np.isneginf(c), 0.0, c)
    sigma, shifted = _FIRST, _shifted(problem, _FIRST)
    while (left := end - time.perf_counter()) > 0:
        following, of_z = sigma, shifted.with_q(problem.q - sigma * z)
        found = _run(of_z, Newton(), 0.1 * tolerance, left, z0=z, max_iter=_STEPS)
        if found.status in (Status.SOLVED, Status.PRECISION_LIMIT):
            yield ProximalPoint(found.z, found.z - z, problem.residual(found.z), found.iterations)
            z = found.z
            if found.iterations <= _FEW:
                following = max(sigma / _CHANGE, _LEAST)
        elif sigma < _MOST:
            following = sigma * _CHANGE
        else:
            return
        if following != sigma:
            sigma, shifted = following, _shifted(problem, following)


def _shifted(problem: ICP, sigma: float) -> ICP:
    return ICP(problem.A + sigma * sp.eye_array(problem.n), problem.q, problem.psi)


def _run(problem: ICP, method: Newton | None, tolerance: float, left: float, **options: Any) -> Solution:
    """`solve` with an absolute tolerance and what is left of the time. Raises KeyboardInterrupt after Ctrl-C."""
    limit = None if np.isinf(left) else max(left, 0.0)
    found = problem.solve(method, rtol=0.0, atol=tolerance, time_limit=limit, raise_on_failure=False, **options)
    if found.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return found


Points = Callable[[ICP, float, float], Iterator[ProximalPoint]]


@dataclass(frozen=True, eq=False)
class ProgramOutcome:
    """`status` in CVXPY's words and `message`, what it rests on; `x`, `equality` = ν and `inequality` = λ, None where
    there is no optimum; the `objective` there; the `residual` in handy units; Newton's `steps`."""

    status: str
    message: str
    x: Vector | None = None
    equality: Vector | None = None
    inequality: Vector | None = None
    objective: float = np.nan
    residual: float = np.nan
    steps: int = 0
    seconds: float = 0.0


def solve_program(
    program: Program, *, tolerance: float = 1e-9, time_limit: float = np.inf, points: Points = proximal_points
) -> ProgramOutcome:
    """Solve a convex quadratic program: one with bounds only as an ICP by `icpmodel.solve`, others by proximal points.

    Parameters: `tolerance` of the residual of the ICP in units in which its data are about 1; `time_limit` in seconds.
    "optimal": the residual is below the tolerance; "optimal_inaccurate": below 1e-6. "infeasible" and "unbounded" are
    proved in exact arithmetic (for the latter a feasible x was found, too), with "_inaccurate" they are proved up to
    rounding. "user_limit": the time is over; "solver_error": none of these."""
    begin = time.perf_counter()
    if not np.isfinite(program.b).all() or np.isneginf(program.g).any():
        return ProgramOutcome("infeasible", "a right-hand side is infinite")
    outcome = _outcome(program, ProgramLcp(program), tolerance, begin + time_limit, points)
    return replace(outcome, seconds=time.perf_counter() - begin)


class _Answer(NamedTuple):
    """How far it is from optimal in the units of the program, its `residual` in those of the ICP; x, ν and λ."""

    violation: float = np.inf
    residual: float = np.inf
    values: tuple[Vector, Vector, Vector] | None = None

    def or_better(self, lcp: ProgramLcp, z: Vector, residual: float) -> _Answer:
        """`z`, or what is left of it without what may be noise, if it is better."""
        for noise in _NOISE:
            values = lcp.back(np.where(np.abs(z) <= noise, 0.0, z))
            self = min(self, _Answer(lcp.program.violation(*values), residual, values), key=lambda one: one[:2])
        return self


def _outcome(program: Program, lcp: ProgramLcp, tolerance: float, end: float, points: Points) -> ProgramOutcome:
    begin, steps, best, least = time.perf_counter(), 0, _Answer(), np.inf
    if lcp.bounds_cross:
        return ProgramOutcome("infeasible", f"the bounds of a variable contradict each other, {_HOW[True]}")
    for share in _SHARES:  # units in which a row hides behind the others ask for less
        inner, residual, waited, proofs = share * tolerance, np.inf, 0, 0
        if lcp.only_bounds:
            found = _run(lcp.problem, None, inner, end - time.perf_counter())
            steps, residual = steps + found.iterations, found.residual
            if found.status is Status.INFEASIBLE:
                return _unbounded(True, steps)
            best = best.or_better(lcp, found.z, residual)
        for point in points(lcp.problem, inner, end - time.perf_counter()) if residual > inner else ():
            steps += point.steps
            waited += 1
            if point.residual < residual:
                residual, waited = point.residual, 0
                best = best.or_better(lcp, point.z, residual)
            if residual <= inner or waited >= _PATIENCE:
                break
            proof = lcp.contradiction(point.direction)
            proofs += proof is not None
            if proof is not None and (proof[1] or proofs >= _PROOFS):
                outcome = without_solution(program, *proof, tolerance, end - time.perf_counter())
                return replace(outcome, steps=steps + outcome.steps)
        least = min(least, residual)
        if residual > inner or (best.violation <= _USERS * tolerance and least <= tolerance):
            break
    if best.values is None:
        seconds = time.perf_counter() - begin
        return ProgramOutcome("solver_error", f"no proximal point was found in {seconds:.3g} s", steps=steps)
    x, equality, inequality = best.values
    told = f"a residual of {least:.3g}, and rows or multipliers are wrong by {best.violation:.3g} of their terms"
    status, message = "user_limit" if time.perf_counter() >= end else "solver_error", f"no answer was found: {told}"
    if best.violation <= _USERS * tolerance and least <= tolerance:
        status, message = "optimal", "solved"
    elif best.violation <= _INACCURATE:
        status, message = "optimal_inaccurate", told
    value = float(0.5 * x @ (program.P @ x) + program.q @ x)
    return ProgramOutcome(status, message, x, equality, inequality, value, least, steps)


def without_solution(
    program: Program, kind: str, exact: bool, tolerance: float = 1e-9, time_limit: float = np.inf
) -> ProgramOutcome:
    """What follows from a proof, see `ProgramLcp.contradiction`; a falling objective needs a feasible point as well."""
    how = _HOW[exact]
    if kind == "primal":
        status = "infeasible" if exact else "infeasible_inaccurate"
        return ProgramOutcome(status, f"a combination of the constraints says 0 < 0, {how}")
    nearest = replace(program, P=sp.eye_array(program.q.size, format="csr"), q=np.zeros(program.q.size))
    feasible = solve_program(nearest, tolerance=tolerance, time_limit=time_limit)
    if feasible.status == "optimal":
        return _unbounded(exact, feasible.steps)
    if feasible.status.startswith("infeasible"):
        return feasible
    return ProgramOutcome("infeasible_or_unbounded", f"no multipliers exist, {how}; no feasible point was found")


def _unbounded(exact: bool, steps: int) -> ProgramOutcome:
    message = f"there is a feasible point, and a direction along which the objective falls for ever, {_HOW[exact]}"
    return ProgramOutcome("unbounded" if exact else "unbounded_inaccurate", message, steps=steps)


class IcpSolver(QpSolver):
    """CVXPY's interface to `solve_program`; `cvxpy_solver` makes one."""

    #: bounds come as rows: CVXPY 1.9.3 hands some expressions wrong ones, as NaN counts as a bound (0 times infinity)
    BOUNDED_VARIABLES = False

    def name(self) -> str:
        return "ICPMODEL"

    def import_solver(self) -> None:
        """Nothing is left to import."""

    def cite(self, data: Any) -> str:
        return ""

    def solve_via_data(
        self, data: Any, warm_start: bool, verbose: bool, solver_opts: Any, solver_cache: Any = None
    ) -> ProgramOutcome:
        """Solve what CVXPY has compiled. Raises InputError for a wrong option, SolverError where nothing is found."""
        for option in solver_opts:
            if option not in _OPTIONS:
                raise InputError(f"the solver ICPMODEL has no option {option}; it takes {', '.join(_OPTIONS)}")
        limits: dict[str, Any] = {name: as_number(value, name, above=0) for name, value in solver_opts.items()}
        outcome = solve_program(program_of(data), **limits)
        if verbose:
            print(f"icpmodel: {outcome.status} after {outcome.steps} steps: {outcome.message}")
        if outcome.status == s.SOLVER_ERROR:
            raise cp.SolverError(f"icpmodel: {outcome.message}")
        return outcome

    def invert(self, solution: ProgramOutcome, inverse_data: Any) -> CvxpySolution:
        attributes = {s.SOLVE_TIME: solution.seconds, s.NUM_ITERS: solution.steps, s.EXTRA_STATS: solution}
        if solution.x is None:
            return failure_solution(solution.status, attributes)
        duals: dict[Any, Any] = {}
        for values, key in ((solution.equality, self.EQ_CONSTR), (solution.inequality, self.NEQ_CONSTR)):
            duals |= utilities.get_dual_values(values, utilities.extract_dual_value, inverse_data[key])
        value = solution.objective + inverse_data[s.OFFSET]
        return CvxpySolution(solution.status, value, {self.VAR_ID: solution.x}, duals, attributes)


@cache
def cvxpy_solver() -> IcpSolver:
    """icpmodel as a solver for CVXPY's `Problem.solve(solver=…)`: convex quadratic and linear programs.

    Bounds only: the ICP goes to `icpmodel.solve`; with other constraints the KKT system is a monotone one, for which
    see `icpmodel.modelling.cvxpy.quadratic`. P is taken as semidefinite, which CVXPY has checked. Duals are returned.
    "infeasible" and "unbounded" are proved in exact arithmetic; "infeasible_inaccurate" and "unbounded_inaccurate" up
    to rounding. `Problem.solve` takes the options `tolerance` (1e-9, of the residual of the ICP, in units in which its
    data are about 1) and `time_limit` in seconds.
    Returns always the same object, by which CVXPY knows that a problem with parameters need not be compiled again.

    >>> import cvxpy as cp
    >>> x = cp.Variable(2)
    >>> problem = cp.Problem(cp.Minimize(cp.sum_squares(x - [3, 0])), [cp.sum(x) == 1, x >= 0])
    >>> round(problem.solve(solver=icp.cvxpy_solver()), 6), x.value.round(6) + 0.0
    (4.0, array([1., 0.]))
    """
    return IcpSolver()


def program_of(data: Any) -> Program:
    """What CVXPY has compiled, by its own names for the parts."""
    matrices = (sp.csr_array(data[key]) for key in (s.P, s.A, s.F))
    vectors = (np.asarray(data[key], dtype=np.float64) for key in (s.Q, s.B, s.G))
    (P, A, F), (q, b, g) = matrices, vectors
    return Program(P, q, A, b, F, g)
