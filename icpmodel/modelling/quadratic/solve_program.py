"""Convex quadratic programs solved: which way is taken, who judges the answer, what is proved where there is none."""

from __future__ import annotations

import time
from collections.abc import Iterable
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...errors import OutOfTime, SingularOperator
from ...methods.contract import Method
from ...methods.shortcuts import Lemke
from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.threads import one_blas_thread
from ...solve.solution import Solution, Status
from .central_path import CentralPath, Mask
from .kkt import dense_cost, is_dense
from .program import Program
from .proofs import EXACTLY, NUMERICALLY, contradiction
from .rational_pivots import exact_outcome
from .reduction import Frame, ProgramLcp

#: what may be wrong in the units of the program, as a multiple of the tolerance in those of the ICP: 1e-8 by default,
#: as for an ICP; and up to what an answer is called inaccurate and not an error
_USERS, _INACCURATE = 10.0, 1e-4
#: what may be noise beside 1
_NOISE = (0.0, 1e-13)
#: steps at the most, and without less error
_STEPS, _PATIENCE = 200, 15
#: signs are corrected so often before the run begins anew
_CORRECTIONS = 5
#: units that are tried one after the other: where a bound is far away, or P is small, others than the first are better
_UNITS: tuple[dict[str, bool], ...] = ({}, {"by_bounds": False, "as_linear": True}, {"as_linear": True})
#: steps of a path, and calls of NumPy in each of them: 6 – 12 and 30, dense programs with 5 – 200 unknowns
_PATH, _CALLS = 9, 30
#: what counts as less, and as much less
_LESS, _FALLEN = 0.9, 0.5
#: a direction is tried as a proof if what is wrong with it is so small beside what it shows, and a tenth each time
_SHOWN = 1e-3
#: the error to which signs that stand still are taken at their word
_NEAR = 1e-2


@dataclass(frozen=True, eq=False)
class ProgramOutcome:
    """`status` in CVXPY's words and `message`, what it rests on; `values` x, ν and λ, None where there is no optimum;
    the `objective` there; the `residual` in handy units; Newton's `steps`; which inequalities were
    `active`, for the next program like this one."""

    status: str
    message: str
    values: tuple[Vector, Vector, Vector] | None = None
    objective: float = np.nan
    residual: float = np.nan
    steps: int = 0
    seconds: float = 0.0
    active: Mask | None = None


class Judged(NamedTuple):
    """How far an answer is from optimal in the units of the program, its `residual` in those of the ICP; x, ν and λ;
    which inequalities are `active`."""

    violation: float = np.inf
    residual: float = np.inf
    values: tuple[Vector, Vector, Vector] | None = None
    active: Mask = np.zeros(0, bool)

    @property
    def wrong(self) -> float:
        """The worse of both, beside the tolerance."""
        return max(self.violation / _USERS, self.residual)


class Judge:
    """It keeps the `best` answer; one is good `enough` by its residual in the units of the ICP and in the program's."""

    def __init__(self, lcp: ProgramLcp, tolerance: float) -> None:
        self.lcp, self.tolerance, self.best = lcp, tolerance, Judged()

    def asked(self, y: Vector, active: Mask) -> bool:
        """Whether there is an answer that is good enough, now that y, or what is left of it without noise, is known."""
        for noise in _NOISE:
            of_y = y if noise == 0.0 else np.where(np.abs(y) <= noise, 0.0, y)
            residual = self.lcp.residual(of_y)
            if np.isfinite(residual):
                values = self.lcp.back(of_y)
                one = Judged(self.lcp.program.violation(*values), residual, values, active)
                self.best = min(self.best, one, key=lambda of: of.wrong)
            if self.enough:
                return True
        return False

    @property
    def enough(self) -> bool:
        return self.best.wrong <= self.tolerance


def solve_program(
    program: Program,
    *,
    tolerance: float = 1e-9,
    time_limit: float = np.inf,
    frame: Frame | None = None,
    active: Mask | None = None,
    start: Vector | None = None,
) -> ProgramOutcome:
    """Solve a convex quadratic program; `frame` and `active` are those of one like it, if there was one,
    `start` an x near the solution.

    Parameters: `tolerance` of the residual of the ICP in units in which its data are about 1; `time_limit` in seconds.
    "optimal": the residual is below the tolerance, and nothing is wrong by more than ten times the tolerance in
    the units of the program; "optimal_inaccurate": the same with 1e-4 for the tolerance. "infeasible" and "unbounded"
    are proved (for the latter a feasible x was found, too), with "_inaccurate" they are proved up to rounding.
    "user_limit": the time is over; "solver_error": none of these, which small programs do not end with, as they are
    solved in rational arithmetic then. Raises OutOfMemory before the work begins."""
    begin = time.perf_counter()
    if not np.isfinite(program.b).all() or np.isneginf(program.g).any():
        return ProgramOutcome("infeasible", "a right-hand side is infinite")
    frame = Frame(program.matrices, program.g < np.inf) if frame is None else frame
    with work.within(time_limit), one_blas_thread():
        outcome = _outcome(program, frame, tolerance, active, start)
    return replace(outcome, seconds=time.perf_counter() - begin)


@np.errstate(all="ignore")
def _outcome(
    program: Program, frame: Frame, tolerance: float, active: Mask | None, start: Vector | None
) -> ProgramOutcome:
    best, steps, ended, judge = Judged(), 0, None, Judge(ProgramLcp(program, frame), tolerance)
    if judge.lcp.bounds_cross:
        return ProgramOutcome("infeasible", f"the bounds of a variable contradict each other, {EXACTLY}")
    tried: list[ProgramLcp] = []
    for units in _UNITS:
        judge = Judge(ProgramLcp(program, frame, **units), tolerance) if units else judge
        if any(map(judge.lcp.is_as, tried)):
            continue
        tried.append(judge.lcp)
        ended, made = _sought(judge, active, start)
        steps += made
        best = min(best, judge.best, key=lambda of: of.wrong)
        if judge.enough or ended is not None:
            break
    if not judge.enough and ended is None:
        found = exact_outcome(program)
        if isinstance(found, str):
            ended = found, EXACTLY
        elif found is not None:
            judge.best = best = Judged(program.violation(*found), 0.0, found)
    if isinstance(ended, tuple):
        outcome = without_solution(program, *ended, tolerance, 1e-9 * work.nanoseconds_left())
        return replace(outcome, steps=steps + outcome.steps)
    values = best.values or (np.zeros(program.q.size), np.zeros(program.b.size), np.zeros(program.g.size))
    told = f"residual {best.residual:.3g}, and rows or multipliers are wrong by {best.violation:.3g} of their terms"
    over = "the time limit was over; raise time_limit, or ask for less (tolerance)" if ended else "no answer was found"
    status, message = ended or "solver_error", f"{over}: {told}"
    if judge.enough:
        status, message = "optimal", "solved"
    elif ended is None and best.wrong <= _INACCURATE:
        status, message = "optimal_inaccurate", told
    value = program.objective(values[0])
    return ProgramOutcome(status, message, values, value, best.residual, steps, active=best.active)


def _sought(judge: Judge, active: Mask | None, start: Vector | None) -> tuple[str | tuple[str, str] | None, int]:
    """What ended the search in these units but an answer, a proof or "user_limit", and the steps."""
    lcp, path = judge.lcp, None
    try:
        if lcp.only_bounds and not is_dense(lcp.frame.blocks):
            found = _by_icp(judge)
            if found.status is Status.INFEASIBLE:
                return ("dual", EXACTLY), found.iterations
            if judge.asked(found.z, np.zeros(0, bool)):
                return None, found.iterations
        path = CentralPath(lcp)
        active = active if start is None else path.tight(start)
        if active is not None and active.size == path.d.size:
            again = start is None  # after a program that these signs are from
            if _corrected(path, judge, active) or (again and _pivoted(path, judge)):
                return None, path.steps
        return _followed(path, judge), path.steps
    except OutOfTime:
        if path is not None:
            judge.asked(*path.best)
        return "user_limit", 0 if path is None else path.steps


def _by_icp(judge: Judge, method: Method | None = None) -> Solution:
    """What `icpmodel.solve` finds in the time that is left. Raises KeyboardInterrupt after Ctrl-C."""
    left = 1e-9 * work.nanoseconds_left()
    limit = left if left < np.inf else None
    found = judge.lcp.problem.solve(method, rtol=0.0, atol=judge.tolerance, time_limit=limit, raise_on_failure=False)
    if found.status is Status.INTERRUPTED:
        raise KeyboardInterrupt
    return found


def _corrected(path: CentralPath, judge: Judge, active: Mask) -> bool:
    """Whether Newton's steps from these signs, each less wrong than the one before, end at the answer."""
    zero, least = np.zeros(path.d.size), np.inf
    for _ in range(_CORRECTIONS):
        path.steps += 1
        found = path.exact(active, path.x, zero, path.nu)
        if found is None:
            return False
        wrong = path.wrong(active, found[0], found[1])
        if wrong <= judge.tolerance:
            return judge.asked(path.y_of(*found), active)
        if not wrong < _FALLEN * least:
            return False
        least, active = wrong, found[1] > path.d - path.rows(found[0])
    return False


def _pivoted(path: CentralPath, judge: Judge) -> bool:
    """Whether Lemke's pivots, where they are expected to cost less than the path, end at the answer. What they need to
    know of the matrix is known where a program like this one was solved before."""
    problem, pivots, blocks = judge.lcp.problem, Lemke(), judge.lcp.frame.blocks
    if not is_dense(blocks) or pivots.why_not(problem) is not None:
        return False
    foreseen = pivots.estimate(problem.facts, judge.tolerance)
    cost = (foreseen.setup + foreseen.steps * foreseen.step) * problem.matrix.unit
    if cost > _PATH * (dense_cost(blocks) + _CALLS * work.COSTS.call):
        return False
    path.steps += 1
    try:
        found = _by_icp(judge, pivots)
    except SingularOperator:
        return False
    return found.solved and judge.asked(found.z, path.tight(judge.lcp.back(found.z)[0]))


def _followed(path: CentralPath, judge: Judge) -> tuple[str, str] | None:
    """The path to its end: an answer that the judge takes, a proof that there is none, or neither."""
    if not path.begin():
        return None
    before = taken = proof = None
    least, lowest, waited, shown = np.inf, np.inf, 0, _SHOWN
    for _ in range(_STEPS):
        error, active = path.error, path.active
        still = before is None or np.array_equal(active, before)
        share = path.share if error > _FALLEN * least else np.inf
        shows = share < shown or active.size == 0
        if shows or (error < _NEAR and still and not (taken is not None and np.array_equal(active, taken))):
            taken, found = active, path.exact(active, path.x, path.multiplier, path.nu, shows)
            close = found is not None and path.wrong(active, found[0], found[1]) <= judge.tolerance
            if found is not None and close and judge.asked(path.y_of(*found), active):
                return None
            if found is not None and shows:
                shown, new = 0.1 * share, _proof(judge.lcp, path.rays(found, active))
                if new is not None and (new[1] != NUMERICALLY or proof is not None):
                    return new
                proof = proof or new
        before = active
        if error < judge.tolerance and judge.asked(path.y, active):
            return None
        waited = 0 if error < _LESS * least or share < _LESS * lowest else waited + 1
        least, lowest = min(error, least), min(share, lowest)
        if waited > _PATIENCE or not path.advance():
            break
    if proof is None:
        judge.asked(*path.best)
    return proof


def _proof(lcp: ProgramLcp, directions: Iterable[Vector]) -> tuple[str, str] | None:
    """The best of what these directions prove."""
    best = None
    for direction in directions:
        found = contradiction(lcp, direction)
        if found is not None and found[1] != NUMERICALLY:
            return found
        best = best or found
    return best


def without_solution(
    program: Program, kind: str, how: str, tolerance: float = 1e-9, time_limit: float = np.inf
) -> ProgramOutcome:
    """What follows from a proof, see `contradiction`; a falling objective needs a feasible point as well."""
    inaccurate = "_inaccurate" if how == NUMERICALLY else ""
    if kind == "primal":
        return ProgramOutcome(f"infeasible{inaccurate}", f"a combination of the constraints says 0 < 0, {how}")
    n, given = program.q.size, program.matrices
    nearest = Program.of(sp.eye_array(n, format="csr"), np.zeros(n), given.A, program.b, given.F, program.g)
    feasible = solve_program(nearest, tolerance=tolerance, time_limit=time_limit)
    if feasible.status == "optimal":
        message = f"there is a feasible point, and a direction along which the objective falls for ever, {how}"
        return ProgramOutcome(f"unbounded{inaccurate}", message, steps=feasible.steps)
    if feasible.status.startswith("infeasible"):
        return feasible
    return ProgramOutcome("infeasible_or_unbounded", f"no multipliers exist, {how}; no feasible point was found")
