"""Conditions → ICP → `solve()` → judge in the units of the program; and what is proved where that fails."""

from __future__ import annotations

import time
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...icp import ICP
from ...numerics.arrays import Vector
from ...numerics.threads import one_blas_thread
from ...solve.progress import Progress
from ...solve.solution import Solution, Status
from ...theory.certificates.infeasible import contradicts, infeasible, least_violation
from .program import Conditions, Program, Tightened, Values

#: what may be wrong for an answer to be called inaccurate and not an error
_INACCURATE = 1e-4
_LIMITS = Status.TIME_LIMIT, Status.MEMORY_LIMIT
#: iterations after which proofs that there is no solution are tried, and what may be rounding beside the largest entry
_ITERATIONS, _NOISE = 1000, 1e-13
#: the share of the largest residual from which on the judge is asked
_NEAR = 1e-4


@dataclass(frozen=True, eq=False)
class Outcome:
    """`status` in CVXPY's words and `message`, what it rests on; `values`, None where there is no solution; `objective`
    there; `violation` in the units of the program; `iterations`; `conditions` and their `solution`, for one like it."""

    status: str
    message: str
    values: Values | None = None
    objective: float = np.nan
    violation: float = np.nan
    iterations: int = 0
    seconds: float = 0.0
    conditions: Conditions | None = None
    solution: Solution | None = None


def solve_program(
    program: Program,
    *,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    before: Outcome | None = None,
    start: Vector | None = None,
) -> Outcome:
    """Solve a monotone variational inequality.

    Parameters
    ----------
    program
        H positive semidefinite, symmetric or not.
    tolerance
        In the units of the program nothing is wrong by more than that.
    time_limit
        In seconds.
    before
        The outcome of a program with the same matrices, from which the run begins.
    start
        An x near the solution.

    Returns
    -------
    Outcome
        "optimal" where the judge takes the answer, "optimal_inaccurate" where it would with 1e-4; "infeasible" and
        "unbounded", which are proved (for the latter a feasible x was computed), or with "_inaccurate" proved up to
        rounding; "infeasible_or_unbounded"; "user_limit"; "solver_error".
    """
    begin = time.perf_counter()
    if not np.isfinite(program.b).all() or np.isneginf(program.h).any():
        return Outcome("infeasible", "a right-hand side is infinite")
    with one_blas_thread():
        outcome = _ProgramRun(program, tolerance, time_limit, begin).outcome(before, start)
    return replace(outcome, seconds=time.perf_counter() - begin)


class _ProgramRun:
    """One program on its way to an outcome."""

    def __init__(self, program: Program, tolerance: float, time_limit: float | None, begin: float) -> None:
        self.program = program
        self.tolerance = tolerance
        self.end = None if time_limit is None else begin + time_limit
        self.iterations = 0

    def left(self) -> float | None:
        """The seconds that are left, None for no limit."""
        return None if self.end is None else max(self.end - time.perf_counter(), 0.0)

    def outcome(self, before: Outcome | None, start: Vector | None) -> Outcome:
        tightened = Tightened(self.program)
        if tightened.crossed:
            return Outcome("infeasible", "the lower bound of a variable is above its upper bound")
        conditions = Conditions(tightened.program, None if before is None else before.conditions)
        problem = conditions.problem
        best: tuple[float, Values | None] = np.inf, None

        def is_good(z: Vector) -> bool:
            nonlocal best
            values = conditions.values(z)
            violation = conditions.program.violation(values)
            if violation < best[0] or best[1] is None:
                best = violation, values
            return violation <= self.tolerance

        def is_good_up_to_rounding(z: Vector) -> bool:
            nonlocal best
            values = conditions.values(z)
            violation = conditions.program.violation(values, normwise=True)
            if violation <= self.tolerance:
                best = violation, values
                return True
            return False

        largest = 0.0

        def judged(progress: Progress) -> bool:
            nonlocal largest
            largest = max(largest, progress.residual)
            return (progress.residual <= _NEAR * largest or not progress.iteration) and is_good(progress.z)

        z0 = None
        if before is not None and before.solution is not None and before.solution.z.size == problem.n:
            z0 = before.solution.z
        elif start is not None:
            z0 = conditions.near(start)
        solution = self._solved(problem, z0, judged, _ITERATIONS)
        good = best[0] <= self.tolerance
        if not good:
            good = is_good(solution.z) or is_good(_without_noise(solution.z))
        proof = None
        if not good and solution.status not in _LIMITS:
            polished = solution.polish().z
            good = is_good(polished) or is_good_up_to_rounding(polished) or is_good_up_to_rounding(solution.z)
            proof = None if good else self._without_solution(conditions, solution)
            if not good and proof is None and solution.status is Status.ITERATION_LIMIT:
                solution = self._solved(problem, solution.z, judged)
                good = best[0] <= self.tolerance or is_good(solution.z)
        if proof is not None:
            return replace(proof, iterations=self.iterations)
        values = None if best[1] is None else tightened.back(conditions.back(best[1]))
        value = np.nan if values is None else self.program.objective(values.x)
        status, message = "optimal", "solved"
        if not good:
            message = f"rows or multipliers are wrong by {best[0]:.3g} of their terms; {solution.message}"
            status = "optimal_inaccurate" if best[0] <= _INACCURATE else "solver_error"
            if solution.status in _LIMITS or self.left() == 0.0:
                status = "user_limit"
        return Outcome(
            status, message, values, value, best[0], self.iterations, conditions=conditions, solution=solution
        )

    def _solved(self, problem: ICP, z0: Vector | None = None, judged: Any = None, most: int = 100_000) -> Solution:
        solution = problem.solve(
            z0=z0, rtol=0.0, callback=judged, max_iter=most, time_limit=self.left(), raise_on_failure=False
        )
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        self.iterations += solution.iterations
        return solution

    def _without_solution(self, conditions: Conditions, solution: Solution) -> Outcome | None:
        """What is proved by the directions in which the run ended, and by the least violation of the conditions."""
        problem = conditions.problem
        if solution.infeasible is not None:
            y = np.array([float(weight) for weight in solution.infeasible.witness])
        else:
            nearest, asked = least_violation(problem)
            found = self._solved(ICP(nearest.A, nearest.q, nearest.psi)).polish()
            y = np.zeros(problem.n)
            y[asked] = found.z[problem.n :]
        n = conditions.program.g.size
        rows = np.arange(problem.n) >= n
        for direction, primal in ((np.where(rows, y, 0.0), True), (y, False)):
            inaccurate = ""
            answer = infeasible(problem, direction)
            if not answer.holds:
                if not contradicts(problem, direction):
                    continue
                inaccurate = "_inaccurate"
            how = "up to rounding" if inaccurate else answer.reason
            if primal:
                return Outcome(f"infeasible{inaccurate}", f"a combination of the constraints says 0 < 0: {how}")
            return self._falls(inaccurate, how)
        return None

    def _falls(self, inaccurate: str, how: str) -> Outcome:
        """What follows where no multipliers exist: it needs a feasible point as well."""
        if not self.program.is_symmetric:
            return Outcome(f"infeasible{inaccurate}", f"no x and multipliers meet the conditions: {how}")
        n = self.program.g.size
        nearest = replace(self.program, H=sp.eye_array(n, format="csr"), g=np.zeros(n))
        feasible = solve_program(nearest, tolerance=self.tolerance, time_limit=self.left())
        self.iterations += feasible.iterations
        if feasible.status == "optimal":
            told = "there is a feasible point, and a direction along which the objective falls for ever"
            return Outcome(f"unbounded{inaccurate}", f"{told}: {how}")
        if feasible.status.startswith("infeasible"):
            return feasible
        return Outcome("infeasible_or_unbounded", f"no multipliers exist: {how}; no feasible point was computed")


def _without_noise(z: Vector) -> Vector:
    return np.where(np.abs(z) <= _NOISE * np.abs(z).max(), 0.0, z)
