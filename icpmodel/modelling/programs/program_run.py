"""Scaled conditions → ICP → `solve()` → judge; if that fails, a proof that there is no solution is tried."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...algebra.affine_lcp import PIVOT_UP_TO
from ...algebra.equations import Pattern
from ...algebra.proximal_steps import ProximalSteps
from ...errors import IcpError, NotApplicable, OutOfTime
from ...icp import ICP
from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.rounding import UNIT_ROUNDOFF
from ...problem.data import ProblemData
from ...solve.estimates import pivots_cost_less
from ...solve.solution import Solution, Status
from ...theory.certificates.bounds import enforce_limits
from ...theory.certificates.combination_rows import ZERO
from ...theory.certificates.infeasible import combination_text, infeasible
from ...theory.certificates.recession import Recession, least_violation
from .program import Program, conditions_of
from .program_judge import Judge, Violation
from .scaled_conditions import ScaledConditions

#: the largest violation of an answer that is called inaccurate rather than an error
_MAX_INACCURATE_VIOLATION = 1e-4
#: the relative tolerance of the least violation: its multipliers must tell a contradiction from rounding errors
_VIOLATION_RTOL = 1e-13
#: the largest number of refinement steps, and the multiple of W that is added to A in them
_REFINEMENTS = 3
_REGULARISATION = 1e-9
#: a row or bound is tight at a start if its slack is at most this share of max(|terms|, 1)
_TIGHT_SLACK = 1e-6


class ProgramRun:
    """A run on a program, with its best iterate: of those that are good up to rounding, the least strict violation.

    Parameters
    ----------
    program, tolerance
        The program, and the largest violation of a good iterate.
    last
        The run on another program: if of equal size, its best iterate is the start; facts of equal matrices are reused.
    is_bounded
        Whether the objective is known to be bounded below, so that multipliers exist if a feasible point does.
    """

    def __init__(
        self, program: Program, tolerance: float, last: ProgramRun | None = None, *, is_bounded: bool = False
    ) -> None:
        self.program = program
        self.is_bounded = is_bounded
        self.tolerance = tolerance
        self.conditions: ScaledConditions = ScaledConditions(program, None if last is None else last.conditions)
        self.problem = self.conditions.problem
        if last is not None and last.problem.matrix is self.problem.matrix:
            self.judge: Judge = last.judge
        else:
            self.judge = Judge(self.problem, self.conditions.is_x)
        self.low = self.conditions.low
        self.high = self.conditions.high
        self.z = np.clip(0.0, self.low, self.high)
        self.start = None
        if last is not None and last.z.size == self.z.size:
            self.start = np.nan_to_num(np.ldexp(last.z, last.conditions.columns - self.conditions.columns))
        self.violation = Violation()
        self.iterations = 0

    def verdict(self, start: Vector | None) -> tuple[str, str]:
        """Run the methods and return the status and the message. `start` is an x near the solution, if one is known."""
        z0, pattern = (self.start, None) if start is None else self.start_near(start)
        if z0 is not None:
            self.polish(z0, pattern)
        proof = None
        for method in [] if self.is_good else self._methods():
            if method is None and proof is not None:
                break
            limit = {"max_iter": self.iterations} if method is None and self.iterations else {}
            options = {"z0": z0, "callback": lambda now: self.judge.is_due() and self.improve(now.z), "rtol": 0.0}
            try:
                solution = self._solve(self.problem, method, **options, **limit)
            except NotApplicable:
                if method is None:
                    raise
                continue
            z0 = solution.z
            self.improve(z0)
            is_late = work.seconds_left() == 0.0 or solution.status in (Status.TIME_LIMIT, Status.MEMORY_LIMIT)
            if self.violation.strict and not is_late:  # also if it is good already
                self.polish(self.z)
            if is_late or self.is_good:
                break
            if method in ("interior", None) or solution.status is Status.INFEASIBLE:
                with suppress(OutOfTime):
                    proof = proof or self._prove_no_solution(solution)
            if proof is not None and not proof[0].endswith("_inaccurate"):
                return proof
        if self.is_good:
            return self._optimal()
        if proof is not None and not is_late:
            return proof
        error = self.violation.rounded
        message = f"rows or multipliers are wrong by {error:.3g} of their terms; {solution.message}"
        if is_late:
            return "user_limit", message
        return "optimal_inaccurate" if error <= _MAX_INACCURATE_VIOLATION else "solver_error", message

    def _optimal(self) -> tuple[str, str]:
        """Status and message of a good iterate: "optimal", unless the rows are proved to contradict each other.

        The rounding errors of the largest unknowns may hide such a contradiction.
        """
        if self.violation.significant > self.tolerance:
            terms, largest_terms = self.judge.terms(self.problem.q, self.z)
            rows, units = self.conditions.rows_alone(np.where(terms > UNIT_ROUNDOFF * largest_terms, terms, 0.0))
            with suppress(OutOfTime):
                y = self._least_violation(rows, max_iter=self.iterations + PIVOT_UP_TO)
                proof = self._proof(np.ldexp(y, units)) if np.abs(y).max() > self.tolerance else None
                if proof is not None and proof[0] == "infeasible":
                    return proof
        return "optimal", "solved"

    def _methods(self) -> list[str | None]:
        """The methods in the order of trial; None is the choice of `solve()`, which takes longer if there are rows."""
        if self.judge.is_x.all() or self.problem.matrix.has_negative_diagonal:
            return [None]
        # Newton's method fails often, but the interior method sometimes fails, too
        return ["lemke", "interior", "newton", None] if pivots_cost_less(self.problem.facts) else ["interior", None]

    def _solve(self, problem: ICP, method: str | None, **options: Any) -> Solution:
        solution = problem.solve(method, time_limit=work.inner_time_limit(), raise_on_failure=False, **options)
        if solution.status is Status.INTERRUPTED:
            raise KeyboardInterrupt
        self.iterations += solution.iterations
        return solution

    def _prove_no_solution(self, solution: Solution) -> tuple[str, str] | None:
        """Status and message of a proof by the witness of `solution`, else by the least violation; None without one."""
        known = solution.infeasible
        if known is not None and known.witness is not None:
            return self._proof(np.array([float(weight) for weight in known.witness]))
        if known is not None and known.holds:  # every choice of active rows was excluded
            return self._infeasible_or_unbounded("", "proved")
        return self._proof(self._least_violation(self.problem))

    def _least_violation(self, problem: ProblemData, **limit: int) -> Vector:
        """The multipliers of the least violation of p ≥ 0 and r ≥ 0: a contradiction if nonzero; 0 if not found."""
        nearest, signed = least_violation(problem)
        least = self._solve(ICP(nearest.A, nearest.q, nearest.psi), None, rtol=_VIOLATION_RTOL, **limit)
        y = np.zeros(problem.n)
        if least.solved:
            y[signed] = least.z[problem.n :]
        return y

    def _proof(self, y: Vector) -> tuple[str, str] | None:
        """Status and message of what the weights `y` of rows of the scaled conditions prove; None if they do not."""
        original = conditions_of(self.program)
        for direction, primal in ((np.where(self.judge.is_x, 0.0, y), True), (y, False)):
            if self.is_bounded and not primal:
                continue
            weights = np.ldexp(direction, self.conditions.rows)
            answer = infeasible(original, weights)
            weights = answer.witness if answer.holds else weights / np.abs(weights).max()
            # a nearby combination may have simple weights in the scaled units
            holds = answer.holds or infeasible(self.problem, direction).holds
            if not (holds or Recession(self.problem).misfit(direction) < ZERO):
                continue
            inaccurate = "" if holds else "_inaccurate"
            precision = "proved" if holds else "up to rounding"
            if primal:
                used = combination_text(weights, self.program.row_name)
                message = f"the sum of {used} exceeds its right-hand side wherever {self.program.bounds}: {precision}"
                return f"infeasible{inaccurate}", message
            return self._infeasible_or_unbounded(inaccurate, precision)
        return None

    def _infeasible_or_unbounded(self, inaccurate: str, precision: str) -> tuple[str, str]:
        """Status and message if no multipliers exist: "unbounded" only if a feasible point is computed."""
        program = self.program
        if not program.is_symmetric:
            return f"infeasible{inaccurate}", f"no x and multipliers meet the conditions: {precision}"
        n = program.g.size
        nearest = replace(program, H=sp.eye_array(n, format="csr"), g=np.zeros(n))
        feasible = ProgramRun(nearest, 0.0, is_bounded=True)
        status, message = feasible.verdict(None)
        self.iterations += feasible.iterations
        if status.startswith("infeasible"):
            return status, message
        if feasible.violation.rounded > self.tolerance:
            return "infeasible_or_unbounded", f"no multipliers exist ({precision}), and no feasible point was computed"
        if not feasible.is_exact:
            inaccurate = "_inaccurate"
            precision = "up to rounding"
        message = f"there is a feasible point, and a direction along which the objective falls for ever: {precision}"
        return f"unbounded{inaccurate}", message

    @property
    def is_good(self) -> bool:
        """Whether the violation is within the tolerance, up to rounding."""
        return self.violation.rounded <= self.tolerance

    @property
    def is_exact(self) -> bool:
        """Whether the strict violation is within the tolerance."""
        return self.violation.strict <= self.tolerance

    def improve(self, z: Vector) -> bool:
        """Keep `z`, after moving its active rows onto their obstacles, if it is the best iterate so far.

        `z` is also tried with 0 in place of possible rounding errors. Returns whether the run can stop: the best
        iterate is strictly good, or `z` has not halved the strict violation of a good one.
        """
        step = z - self.problem.p(z)
        z = np.where((self.low <= step) & (step <= self.high), z, step)
        z = self.conditions.as_returned(np.clip(z, self.low, self.high))
        enough = 0.5 * self.violation.strict if self.is_good else self.tolerance
        cleaned = np.clip(self.judge.without_noise(self.problem.q, z), self.low, self.high)
        for one in (z,) if np.array_equal(z, cleaned) else (z, cleaned):
            p = self.problem.p(one)
            violation = self.judge.violation(self.problem.q, one, p, self.room(one, p))
            if self._rank(violation) <= self._rank(self.violation):
                self.violation = violation
                self.z = one
        return self.is_exact or self.violation.strict > enough > self.tolerance

    def room(self, z: Vector, p: Vector) -> Vector:
        """The distance of z to the obstacle onto which p presses it."""
        return np.where(p > 0, z - self.low, self.high - z)

    def _rank(self, violation: Violation) -> tuple[float, float]:
        return max(violation.rounded, self.tolerance), violation.strict

    def start_near(self, x: Vector) -> tuple[Vector, Pattern]:
        """The iterate with `x`, on tight bounds, and multipliers 0; and the active set of tight rows and bounds."""
        z = np.concatenate([x, np.zeros(self.z.size - x.size)])
        z = np.nan_to_num(np.ldexp(z, -self.conditions.columns))
        near = _TIGHT_SLACK * np.maximum(np.abs(z), 1.0)
        z = np.where(z - self.low <= near, self.low, np.where(self.high - z <= near, self.high, z))
        near = _TIGHT_SLACK * np.maximum(self.judge.terms(self.problem.q, z)[0], 1.0)
        is_tight = ~self.judge.is_x & (self.problem.p(z) <= near)
        free = is_tight | ((self.low < z) & (z < self.high))
        return z, Pattern(z, ~free, ~free & (z >= self.high))

    def polish(self, z: Vector, pattern: Pattern | None = None) -> None:
        """Improve the best iterate by Newton steps from `z` with a fixed active set, by default that of `z`.

        A small multiple of W is added to A.
        """
        pattern = pattern or Pattern.at(self.problem, z, omega=np.ones(z.size))
        steps = ProximalSteps(self.problem, z, reorders=not self.is_good)
        with suppress(IcpError, MemoryError), enforce_limits(None, None):
            weights = _REGULARISATION * self.problem.matrix.proximal_weights
            for _ in range(_REFINEMENTS):
                refined = steps.step(z, self.problem.p(z), pattern, z, weights)
                if refined is None or not np.isfinite(refined[0]).all():
                    break
                z = refined[0]
                if self.improve(z):
                    break

    def values(self) -> tuple[Vector, Vector]:
        """x with the multipliers of rows, and the multipliers of bounds: −p where p presses x onto one, else 0."""
        p = self.problem.p(self.z)
        is_x = self.judge.is_x
        box = np.where(self.room(self.z, p) > 0, 0.0, -p)[is_x]
        z = np.ldexp(self.z, self.conditions.columns)
        return z, np.ldexp(box, -self.conditions.rows[is_x])
