"""Conditions → ICP → `solve()` → judge in the units of the program; and what is proved where that fails."""

from __future__ import annotations

import time
from contextlib import suppress
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...algebra.affine_lcp import PIVOT_UP_TO
from ...algebra.equations import Pattern
from ...algebra.proximal_steps import ProximalSteps
from ...errors import IcpError, SingularOperator
from ...icp import ICP
from ...numerics.arrays import Vector
from ...numerics.threads import one_blas_thread
from ...solve.progress import Progress
from ...solve.solution import Solution, Status
from ...theory.certificates.bounds import enforce_limits
from ...theory.certificates.infeasible import infeasible
from ...theory.certificates.recession import contradicts, least_violation
from .program import Presolve, Program, Values, conditions_of
from .program_arguments import check_limits
from .program_judge import Judge, room_of

#: the largest violation of an answer that is called inaccurate rather than an error
_MAX_INACCURATE_VIOLATION = 1e-4
#: steps of the refinement, and what of W is added to A in them
_REFINEMENTS = 3
_REGULARISATION = 1e-9
#: the share of the terms of a row up to which it is tight at a start
_TIGHT_SLACK = 1e-6


@dataclass(frozen=True, eq=False)
class Outcome:
    """What `solve_program` returns.

    Attributes
    ----------
    status : str
        In CVXPY's words.
    message : str
        What the status rests on.
    values : Values or None
        None where there is no solution.
    objective, violation : float
        At these values; NaN where there are none.
    iterations : int
    seconds : float
    incumbent : Incumbent or None
        The start for a program with the same matrices.
    """

    status: str
    message: str
    values: Values | None = None
    objective: float = np.nan
    violation: float = np.nan
    iterations: int = 0
    seconds: float = 0.0
    incumbent: Incumbent | None = None


def solve_program(
    program: Program,
    *,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    before: Outcome | None = None,
    start: Vector | None = None,
    begin: float | None = None,
) -> Outcome:
    """Solve a monotone variational inequality.

    Parameters
    ----------
    program
        H positive semidefinite, symmetric or not.
    tolerance
        In the units of the program nothing is wrong by more than that.
    time_limit
        In seconds from `begin`.
    before
        The outcome of a program of the same size, from which the run begins.
    start
        An x near the solution.
    begin
        When the clock began, by default now.

    Returns
    -------
    Outcome
        Its status is "optimal" if the answer has the tolerance, and "optimal_inaccurate" if it has 1e-4. "infeasible"
        and "unbounded" are proved; for the latter a feasible x was computed. With "_inaccurate" they are proved up to
        rounding. The others are "infeasible_or_unbounded", "user_limit" and "solver_error".
    """
    begin = time.perf_counter() if begin is None else begin
    check_limits(tolerance, time_limit)
    if not np.isfinite(program.b).all() or np.isneginf(program.h).any():
        return Outcome("infeasible", "a right-hand side is infinite")
    presolve = Presolve(program)
    if presolve.crossed:
        return Outcome("infeasible", "the lower bound of a variable is above its upper bound")
    with one_blas_thread():
        outcome = _ProgramRun(presolve.program, tolerance, time_limit, begin).outcome(before, start)
    values = outcome.values
    if values is not None:
        values = presolve.postsolve(values)
        outcome = replace(outcome, values=values, objective=program.objective(values.x))
    return replace(outcome, seconds=time.perf_counter() - begin)


class _ProgramRun:
    """A run on one program."""

    def __init__(self, program: Program, tolerance: float, time_limit: float | None, begin: float) -> None:
        self.program = program
        self.tolerance = tolerance
        self.end = None if time_limit is None else begin + time_limit
        self.iterations = 0

    def seconds_left(self) -> float | None:
        """The seconds that are left, None for no limit."""
        return None if self.end is None else max(self.end - time.perf_counter(), 0.0)

    def outcome(self, before: Outcome | None, start: Vector | None) -> Outcome:
        last = None if before is None else before.incumbent
        best = Incumbent(self.program, self.tolerance, last)
        z0 = last.z if last is not None and last.z.size == best.z.size else None
        if start is not None:
            z0, pattern = best.start_near(start)
            with enforce_limits(self.seconds_left(), None):
                best.polish(z0, pattern)
            z0 = best.z if best.is_good else z0
        methods: list[str] = []
        if not best.has_solution:
            methods = ["interior", "newton"] if z0 is None else ["newton", "interior"]
            if best.problem.n <= PIVOT_UP_TO:
                methods.insert(0, "lemke")
        proof = None
        for method in (*methods, None):
            if method is None and proof is not None:
                break
            try:
                solution = self._solve(best.problem, method, z0, best.is_finished)
            except SingularOperator:
                continue
            if self.seconds_left() == 0.0:
                break
            with enforce_limits(self.seconds_left(), None):
                if not best.is_exact:
                    best.polish(best.z, best.pattern(best.z))
            if solution.status is Status.MEMORY_LIMIT or best.is_good:
                break
            proof = proof or self._without_solution(best.problem, solution)
            if proof is not None and not proof.status.endswith("_inaccurate"):
                break
        if proof is not None and not best.is_good:
            return replace(proof, iterations=self.iterations)
        error = best.violation[0]
        status = "optimal"
        message = "solved"
        if not best.is_good:
            message = f"rows or multipliers are wrong by {error:.3g} of their terms; {solution.message}"
            status = "optimal_inaccurate" if error <= _MAX_INACCURATE_VIOLATION else "solver_error"
            if solution.status is Status.MEMORY_LIMIT or self.seconds_left() == 0.0:
                status = "user_limit"
        return Outcome(status, message, best.values(), violation=error, iterations=self.iterations, incumbent=best)

    def _solve(
        self, problem: ICP, method: str | None = None, z0: Vector | None = None, callback: Any = None, rtol: float = 0.0
    ) -> Solution:
        solution = problem.solve(
            method, z0=z0, rtol=rtol, callback=callback, time_limit=self.seconds_left(), raise_on_failure=False
        )
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        self.iterations += solution.iterations
        return solution

    def _without_solution(self, problem: ICP, solution: Solution) -> Outcome | None:
        """The outcome without a solution: proved by the last direction of the run, or by the least violation."""
        if solution.infeasible is not None and solution.infeasible.witness is not None:
            y = np.array([float(weight) for weight in solution.infeasible.witness])
        else:
            nearest, signed = least_violation(problem)
            least = self._solve(ICP(nearest.A, nearest.q, nearest.psi), rtol=1e-10).polish()
            y = np.zeros(problem.n)
            y[signed] = least.z[problem.n :]
        rows = np.arange(problem.n) >= self.program.g.size
        for direction, primal in ((np.where(rows, y, 0.0), True), (y, False)):
            if not contradicts(problem, direction):
                continue
            answer = infeasible(problem, direction)
            inaccurate = "" if answer.holds else "_inaccurate"
            reason = "up to rounding" if inaccurate else answer.reason
            if primal:
                return Outcome(f"infeasible{inaccurate}", f"a combination of the constraints says 0 < 0: {reason}")
            return self._without_multipliers(inaccurate, reason)
        return None

    def _without_multipliers(self, inaccurate: str, reason: str) -> Outcome:
        """The outcome where no multipliers exist: "unbounded" only if a feasible point is computed."""
        if not self.program.is_symmetric:
            return Outcome(f"infeasible{inaccurate}", f"no x and multipliers meet the conditions: {reason}")
        n = self.program.g.size
        nearest = replace(self.program, H=sp.eye_array(n, format="csr"), g=np.zeros(n))
        feasible = _ProgramRun(nearest, self.tolerance, self.seconds_left(), time.perf_counter()).outcome(None, None)
        self.iterations += feasible.iterations
        if feasible.status == "optimal":
            message = "there is a feasible point, and a direction along which the objective falls for ever"
            return Outcome(f"unbounded{inaccurate}", f"{message}: {reason}")
        if feasible.status.startswith("infeasible"):
            return feasible
        return Outcome("infeasible_or_unbounded", f"no multipliers exist: {reason}; no feasible point was computed")


class Incumbent:
    """The best iterate of a program: among those good up to rounding, the one with the least violation.

    Parameters
    ----------
    program, tolerance
        What is judged, and what may be wrong.
    last
        The incumbent of another program, whose matrices may be the same.
    """

    def __init__(self, program: Program, tolerance: float, last: Incumbent | None = None) -> None:
        self.size = program.g.size, program.b.size
        self.tolerance = tolerance
        self.problem: ICP = conditions_of(program, None if last is None else last.problem)
        self.judge: Judge
        if last is not None and last.problem.A is self.problem.A:
            self.judge = last.judge
        else:
            self.judge = Judge(self.problem, program.g.size)
        self.low = self.problem.psi.value(np.zeros(self.problem.n))
        upper = self.problem.upper
        self.high = np.full(self.problem.n, np.inf) if upper is None else upper.value(self.low)
        self.z = np.clip(0.0, self.low, self.high)
        self.violation = np.inf, np.inf

    @property
    def is_good(self) -> bool:
        """Whether the violation is within the tolerance, up to rounding."""
        return self.violation[0] <= self.tolerance

    @property
    def is_exact(self) -> bool:
        """Whether the same holds without regard to rounding."""
        return self.violation[1] <= self.tolerance

    @property
    def has_solution(self) -> bool:
        """Whether there certainly is one, in a bounded box or by dominant diagonals, so that no proof is needed."""
        in_box = np.isfinite(self.low).all() and np.isfinite(self.high).all()
        return bool(in_box) or self.problem.matrix.jacobi_radius < 1.0

    def is_finished(self, progress: Progress) -> bool:
        """Whether a run has come to an answer."""
        return self.improve(progress.z, self.pattern(progress.z))

    def pattern(self, z: Vector) -> Pattern:
        """The active set at `z`."""
        return Pattern.at(self.problem, z, self.problem.p(z), self.judge.unit**2)

    def improve(self, z: Vector, pattern: Pattern) -> bool:
        """Whether `z`, with its active rows on their obstacles, is strictly good, or no better than a good iterate."""
        z = np.where(pattern.active, self.low, np.clip(z, self.low, self.high))
        if pattern.above is not None:
            z = np.where(pattern.above, self.high, z)
        enough = 0.5 * self.violation[1] if self.is_good else self.tolerance
        cleaned = np.clip(self.judge.without_noise(self.problem, z), self.low, self.high)
        for one in (z,) if np.array_equal(z, cleaned) else (z, cleaned):
            violation = self.judge.violation(self.problem, one)
            if self._rank(violation) <= self._rank(self.violation):
                self.violation = violation
                self.z = one
            if self.is_exact:
                return True
        return self.violation[1] > enough > self.tolerance

    def _rank(self, violation: tuple[float, float]) -> tuple[float, float]:
        return max(violation[0], self.tolerance), violation[1]

    def start_near(self, x: Vector) -> tuple[Vector, Pattern]:
        """The iterate with `x` and multipliers 0, and the active set of the rows and bounds that are tight at `x`."""
        z = np.concatenate([x, np.zeros(self.z.size - x.size)])
        terms = abs(self.problem.A) @ np.abs(z) + np.abs(self.problem.q)
        free = np.isneginf(self.low) | (self.problem.p(z) <= _TIGHT_SLACK * terms)
        free[: x.size] = ((self.low < z) & (z < self.high))[: x.size]
        return z, Pattern(z, ~free, ~free & (z >= self.high))

    def polish(self, z: Vector, pattern: Pattern) -> None:
        """Newton steps from `z` with one active set, of the equations and a small multiple of W."""
        steps = ProximalSteps(self.problem, z)
        weights = _REGULARISATION * self.problem.matrix.proximal_weights
        with suppress(IcpError, MemoryError):
            for _ in range(_REFINEMENTS):
                refined = steps.step(z, self.problem.p(z), pattern, z, weights)
                if refined is None or not np.isfinite(refined[0]).all():
                    break
                z = refined[0]
                if self.improve(z, self.pattern(z)):
                    break

    def values(self) -> Values:
        """x and the multipliers; those of bounds are p where it presses x on them."""
        p = self.problem.p(self.z)
        n, equations = self.size
        box = np.where(room_of(self.problem, self.z, p) == 0, -p, 0.0)[:n]
        x, nu, multiplier = np.split(self.z, [n, n + equations])
        return Values(x, nu, multiplier, box)
