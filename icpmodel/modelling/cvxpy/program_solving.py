"""Convex quadratic programs solved as LCPs, with proofs where there is no answer."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace

import numpy as np
import scipy.sparse as sp

from ...icp import ICP
from ...numerics.arrays import Vector
from ...solve.solution import Status
from .proximal import ProximalPoint, proximal_points
from .quadratic import Program, ProgramLcp

#: so many numerical proofs are tried for one in exact arithmetic
_PROOFS = 4
#: so many proximal points without a smaller residual are the last ones
_PATIENCE = 30
#: the residual up to which an answer is called inaccurate and not an error
_INACCURATE = 1e-6

Points = Callable[[ICP, float, float], Iterator[ProximalPoint]]


@dataclass(frozen=True, eq=False)
class ProgramOutcome:
    """What `solve_program` found: `status` in CVXPY's words and `message`, what it rests on; `x`, `equality` = ν and
    `inequality` = λ, None where there is no optimum; the `objective` there; the `residual` in handy units; Newton's
    `steps`; `seconds`.
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


def solve_program(
    program: Program, *, tolerance: float = 1e-9, time_limit: float = np.inf, points: Points = proximal_points
) -> ProgramOutcome:
    """Solve a convex quadratic program: one with bounds only as an LCP by `icpmodel.solve`, others by proximal points.

    Parameters: `tolerance` of ‖min(p, r)‖₂ of the LCP in units in which its data are about 1; `time_limit` in seconds.
    "optimal": the residual is below the tolerance; "optimal_inaccurate": below 1e-6. "infeasible" and "unbounded" are
    proved in exact arithmetic (for the latter a feasible x was found, too), with "_inaccurate" they are proved up to
    rounding. "user_limit": the time is over; "solver_error": none of these.
    """
    begin = time.perf_counter()
    if program.contradicts_itself:
        return ProgramOutcome("infeasible", "a right-hand side is infinite")
    outcome = _outcome(program, ProgramLcp(program), tolerance, begin + time_limit, points)
    return replace(outcome, seconds=time.perf_counter() - begin)


def _outcome(program: Program, lcp: ProgramLcp, tolerance: float, end: float, points: Points) -> ProgramOutcome:
    begin, steps, best, residual, waited, proofs = time.perf_counter(), 0, None, np.inf, 0, 0
    if lcp.only_bounds:
        limit = None if np.isinf(end) else max(end - time.perf_counter(), 0.0)
        found = lcp.problem.solve(rtol=0.0, atol=tolerance, time_limit=limit, raise_on_failure=False)
        steps, best, residual = found.iterations, found.z, found.residual
        if found.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        if found.status is Status.INFEASIBLE:
            return _unbounded(True, steps)
    if residual > tolerance:
        for point in points(lcp.problem, tolerance, end - time.perf_counter()):
            steps += point.steps
            waited += 1
            if point.residual < residual:
                best, residual, waited = point.z, point.residual, 0
            if residual <= tolerance or waited >= _PATIENCE:
                break
            proof = lcp.contradiction(point.direction)
            proofs += proof is not None
            if proof is not None and (proof[1] or proofs >= _PROOFS):
                outcome = without_solution(program, *proof, tolerance, end - time.perf_counter())
                return replace(outcome, steps=steps + outcome.steps)
    if best is None:
        seconds = time.perf_counter() - begin
        return ProgramOutcome("solver_error", f"no proximal point was found in {seconds:.3g} s", steps=steps)
    if residual <= tolerance:
        status, message = "optimal", "solved"
    elif residual <= _INACCURATE:
        status, message = "optimal_inaccurate", f"the residual is {residual:.3g}, not {tolerance:.3g}"
    else:
        status = "user_limit" if time.perf_counter() >= end else "solver_error"
        message = f"no solution and no proof that there is none was found; the best residual is {residual:.3g}"
    x, equality, inequality = lcp.back(best)
    value = float(0.5 * x @ (program.P @ x) + program.q @ x)
    return ProgramOutcome(status, message, x, equality, inequality, value, residual, steps)


def without_solution(
    program: Program, kind: str, exact: bool, tolerance: float = 1e-9, time_limit: float = np.inf
) -> ProgramOutcome:
    """What follows from a proof, see `ProgramLcp.contradiction`; a falling objective needs a feasible point as well."""
    how = "in exact arithmetic" if exact else "up to rounding"
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
    how = "in exact arithmetic" if exact else "up to rounding"
    status = "unbounded" if exact else "unbounded_inaccurate"
    message = f"there is a feasible point, and a direction along which the objective falls for ever, {how}"
    return ProgramOutcome(status, message, steps=steps)
