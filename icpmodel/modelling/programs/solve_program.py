"""Conditions → ICP → `solve()` → judge in the units of the program; and what is proved where that fails."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...algebra.equations import Pattern, solve_on
from ...algebra.proximal_steps import ProximalSteps
from ...errors import IcpError
from ...icp import ICP
from ...numerics.arrays import Vector
from ...numerics.threads import one_blas_thread
from ...solve.progress import Progress
from ...solve.solution import Solution, Status
from ...theory.certificates.bounds import limited
from ...theory.certificates.infeasible import infeasible
from ...theory.certificates.recession import contradicts, least_violation
from .program import Program, Tightened, Values
from .program_conditions import Conditions
from .program_judge import Violation

#: what may be wrong for an answer to be called inaccurate and not an error
_INACCURATE = 1e-4
_LIMITS = Status.TIME_LIMIT, Status.MEMORY_LIMIT
#: iterations after which another method is tried, and after which there is no other
_ITERATIONS = 1000
_MANY = 100_000
#: steps of the refinement, and what of W is added to A in them
_REFINEMENTS = 3
_STEADY = 1e-9
#: what may be wrong at an iterate for it to be put on its obstacles
_WORTH = 1e-2
#: iterates that are good up to rounding, but not strictly, after which a run ends
_PATIENCE = 3
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
        best = _Best(conditions, self.tolerance)
        z0 = None
        if before is not None and before.solution is not None and before.solution.z.size == conditions.q.size:
            z0 = before.solution.z
        elif start is not None:
            z0 = conditions.near(start)
        proof = None
        first = "interior" if z0 is None and np.isfinite(np.append(conditions.low, conditions.high)).any() else None
        for method, most in ((first, _ITERATIONS), (None if first else "interior", _ITERATIONS), (None, _MANY)):
            solution = self._solved(conditions.problem, method, z0, best.judged, most)
            limited = solution.status in _LIMITS
            if best.ends(solution.z):
                self._polish(best)
                break
            if limited or self._refined(best, solution.z) or best.is_good():
                break
            if method == first or solution.infeasible is not None:
                proof = self._without_solution(conditions, solution) or proof
                if proof is not None and proof.status in ("infeasible", "unbounded"):
                    break
            z0 = None if method else solution.z
        good = best.is_good()
        if proof is not None and not good:
            return replace(proof, iterations=self.iterations)
        values = tightened.back(conditions.values(best.z))
        status = "optimal"
        message = "solved"
        if not good:
            message = f"rows or multipliers are wrong by {best.violation:.3g} of their terms; {solution.message}"
            status = "optimal_inaccurate" if best.violation <= _INACCURATE else "solver_error"
            if solution.status in _LIMITS or self.left() == 0.0:
                status = "user_limit"
        value = self.program.objective(values.x)
        return Outcome(
            status, message, values, value, best.violation, self.iterations, conditions=conditions, solution=solution
        )

    def _polish(self, best: _Best) -> None:
        """One linear solve on the active set of a good iterate, which counts where it is better."""
        problem = best.conditions.problem
        pattern = Pattern.at(problem, best.z, problem.p(best.z), problem.matrix.proximal_weights)
        with suppress(IcpError, MemoryError), limited(self.left(), None):
            best.improves(solve_on(problem, best.z, pattern.active, pattern.above))

    def _refined(self, best: _Best, z: Vector) -> bool:
        """Whether steps with the signs at `z` make it good: each row comes to the rounding of its own terms."""
        problem = best.conditions.problem
        weights = problem.matrix.proximal_weights
        pattern = Pattern.at(problem, z, problem.p(z), weights)
        with suppress(IcpError, MemoryError):
            if best.takes(solve_on(problem, z, pattern.active, pattern.above)):
                return True
        steps = ProximalSteps(problem, z)
        for _ in range(_REFINEMENTS):
            found = steps.step(z, problem.p(z), pattern, z, _STEADY * weights)
            if found is None or not np.isfinite(found[0]).all():
                break
            z = found[0]
            if best.takes(z):
                return True
        return False

    def _solved(
        self, problem: ICP, method: str | None = None, z0: Vector | None = None, judged: Any = None, most: int = _MANY
    ) -> Solution:
        solution = problem.solve(
            method, z0=z0, rtol=0.0, callback=judged, max_iter=most, time_limit=self.left(), raise_on_failure=False
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
        n = conditions.n
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


class _Best:
    """The best iterate of a program: strictly, and up to rounding, which counts where no run leads further.

    Parameters
    ----------
    conditions, tolerance
        What is judged, and what may be wrong.
    """

    def __init__(self, conditions: Conditions, tolerance: float) -> None:
        self.conditions = conditions
        self.tolerance = tolerance
        self.z = conditions.clipped(np.zeros(conditions.q.size))
        self.violation = np.inf
        self.rounded = np.inf, self.z
        self.largest = 0.0
        self.count = 0

    def judged(self, progress: Progress) -> bool:
        """Whether a run has come far enough."""
        self.largest = max(self.largest, progress.residual)
        if progress.iteration and progress.residual > _NEAR * self.largest:
            return False
        return self.takes(progress.z) or self.count >= _PATIENCE

    def ends(self, z: Vector) -> bool:
        """Whether the run has come to a strictly good iterate, or ends with one at `z`."""
        return self.violation <= self.tolerance or self.takes(z)

    def improves(self, z: Vector) -> None:
        """Take `z` where it is at least as good."""
        judged = self.conditions.violation(z)
        if judged.strict <= self.violation:
            self.violation = judged.strict
            self.z = z

    def takes(self, z: Vector) -> bool:
        """Whether `z` is strictly good: on its obstacles, as it is, or without what may be rounding."""
        judged = self._judged(z)
        if judged.rounded <= _WORTH:
            self._judged(self.conditions.pressed(z, judged.held))
            if self.violation <= self.tolerance:
                self._judged(self.conditions.snapped(self.z))
            elif self.rounded[0] <= self.tolerance:
                self.count += 1
                self._judged(self.conditions.snapped(self.rounded[1]))
        return self.violation <= self.tolerance

    def _judged(self, z: Vector) -> Violation:
        judged = self.conditions.violation(z)
        # of several that are good the last one counts, which is on its obstacles
        if judged.strict <= max(self.violation, self.tolerance):
            self.violation, self.z = judged.strict, z
        if judged.rounded <= max(self.rounded[0], self.tolerance):
            self.rounded = judged.rounded, z
        return judged

    def is_good(self) -> bool:
        """Whether there is an answer, which is then `z`; up to rounding if there is no other."""
        if self.violation > self.tolerance >= self.rounded[0]:
            self.violation, self.z = self.rounded
        return self.violation <= self.tolerance
