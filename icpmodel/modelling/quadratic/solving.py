"""Convex quadratic programs solved: which way is taken, who judges the answer, and what is proved where there is none."""

from __future__ import annotations

import time
from contextlib import nullcontext
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp

from ...errors import OutOfTime
from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.threads import one_blas_thread
from .central_path import CentralPath, Mask
from .kkt import dense_cost
from .program import Program
from .proofs import EXACTLY, NUMERICALLY, contradiction
from .reduction import Frame, ProgramLcp

#: what may be wrong in the units of the program, as a multiple of the tolerance in those of the ICP, and up to what an
#: answer is called inaccurate and not an error
_USERS, _INACCURATE = 1e2, 1e-4
#: what may be noise beside 1
_NOISE = (0.0, 1e-13)
#: steps at the most, and without less error
_STEPS, _PATIENCE = 200, 15
#: signs are corrected so often before the run begins anew
_CORRECTIONS = 5
#: units that are tried one after the other: where a bound is far away, or P is small, others than the first are better
_UNITS: tuple[dict[str, bool], ...] = (
    {},
    {"by_bounds": False},
    {"by_bounds": False, "as_linear": True},
    {"as_linear": True},
)
#: nanoseconds that it takes to tell BLAS to use one thread
_SAYING = 12_000.0
#: what counts as less
_LESS = 0.9
#: a direction is tried as a proof if what is wrong with it is so small beside what it shows, and a tenth each time
_SHOWN = 1e-2
#: the error to which signs that stand still are taken at their word
_NEAR = 1e-2


@dataclass(frozen=True, eq=False)
class ProgramOutcome:
    """`status` in CVXPY's words and `message`, what it rests on; `x`, `equality` = ν and `inequality` = λ, None where
    there is no optimum; the `objective` there; the `residual` in handy units; Newton's `steps`; which inequalities were
    `active`, for the next program like this one."""

    status: str
    message: str
    x: Vector | None = None
    equality: Vector | None = None
    inequality: Vector | None = None
    objective: float = np.nan
    residual: float = np.nan
    steps: int = 0
    seconds: float = 0.0
    active: Mask | None = None


class Judged(NamedTuple):
    """How far an answer is from optimal in the units of the program, its `residual` in those of the ICP; x, ν and λ."""

    violation: float = np.inf
    residual: float = np.inf
    values: tuple[Vector, Vector, Vector] | None = None


class Judge:
    """It keeps the `best` answer; one is good `enough` by its residual in the units of the ICP and in the program's."""

    def __init__(self, lcp: ProgramLcp, tolerance: float) -> None:
        self.lcp, self.tolerance, self.best, self.active = lcp, tolerance, Judged(), np.zeros(0, bool)

    def asked(self, y: Vector, active: Mask) -> bool:
        """Whether there is an answer that is good enough, now that y, or what is left of it without noise, is known."""
        for noise in _NOISE:
            of_y = y if noise == 0.0 else np.where(np.abs(y) <= noise, 0.0, y)
            residual = self.lcp.residual(of_y)
            if np.isfinite(residual):
                values = self.lcp.back(of_y)
                one = Judged(self.lcp.program.violation(*values), residual, values)
                if one[:2] < self.best[:2]:
                    self.best, self.active = one, active
            if self.enough:
                return True
        return False

    @property
    def enough(self) -> bool:
        return self.best.violation <= _USERS * self.tolerance and self.best.residual <= self.tolerance


def solve_program(
    program: Program,
    *,
    tolerance: float = 1e-9,
    time_limit: float = np.inf,
    frame: Frame | None = None,
    active: Mask | None = None,
) -> ProgramOutcome:
    """Solve a convex quadratic program; `frame` and `active` are those of one like it, if there was one.

    Parameters: `tolerance` of the residual of the ICP in units in which its data are about 1; `time_limit` in seconds.
    "optimal": the residual is below the tolerance; "optimal_inaccurate": below 1e-6. "infeasible" and "unbounded" are
    proved in exact arithmetic (for the latter a feasible x was found, too), with "_inaccurate" they are proved up to
    rounding. "user_limit": the time is over; "solver_error": none of these."""
    begin = time.perf_counter()
    if not np.isfinite(program.b).all() or np.isneginf(program.g).any():
        return ProgramOutcome("infeasible", "a right-hand side is infinite")
    frame = Frame(program.matrices, program.g < np.inf) if frame is None else frame
    alone = one_blas_thread() if dense_cost(frame) > _SAYING else nullcontext()
    with work.within(time_limit), alone:
        outcome = _outcome(program, frame, tolerance, active)
    return replace(outcome, seconds=time.perf_counter() - begin)


@np.errstate(all="ignore")
def _outcome(program: Program, frame: Frame, tolerance: float, active: Mask | None) -> ProgramOutcome:
    best, steps, ended, proof = Judged(), 0, "solver_error", None
    for units in _UNITS:
        lcp = ProgramLcp(program, frame, **units)
        if lcp.bounds_cross:
            return ProgramOutcome("infeasible", f"the bounds of a variable contradict each other, {EXACTLY}")
        judge = Judge(lcp, tolerance)
        try:
            path = CentralPath(lcp)
            if active is None or active.size != path.d.size or not _corrected(path, judge, active):
                proof = _followed(path, judge)
            steps += path.steps
        except OutOfTime:
            ended = "user_limit"
        best = min(best, judge.best, key=lambda one: one[:2])
        if judge.enough or proof is not None or ended == "user_limit":
            break
    if proof is not None:
        outcome = without_solution(program, *proof, tolerance, 1e-9 * work.nanoseconds_left())
        return replace(outcome, steps=steps + outcome.steps)
    if best.values is None:
        best = Judged(*best[:2], (np.zeros(program.q.size), np.zeros(program.b.size), np.zeros(program.g.size)))
    x, equality, inequality = best.values
    told = (
        f"a residual of {best.residual:.3g}, and rows or multipliers are wrong by {best.violation:.3g} of their terms"
    )
    status, message = ended, f"no answer was found: {told}"
    if judge.enough:
        status, message = "optimal", "solved"
    elif best.violation <= _INACCURATE and ended != "user_limit":
        status, message = "optimal_inaccurate", told
    value = program.objective(x)
    return ProgramOutcome(status, message, x, equality, inequality, value, best.residual, steps, active=judge.active)


def _corrected(path: CentralPath, judge: Judge, active: Mask) -> bool:
    """Whether Newton's steps from these signs, each less wrong than the one before, end at the answer."""
    zero, least = np.zeros(path.d.size), np.inf
    for _ in range(_CORRECTIONS):
        path.steps += 1
        found = path.exact(active, path.x, zero, path.nu)
        if found is None:
            return False
        wrong = path.wrong(active, *found[:2])
        if wrong <= judge.tolerance:
            return judge.asked(path.y_of(*found), active)
        if not wrong < least:
            return False
        least, active = wrong, found[1] > path.d - path.rows(found[0])
    return False


def _followed(path: CentralPath, judge: Judge) -> tuple[str, str] | None:
    """The path to its end: an answer that the judge takes, a proof that there is none, or neither."""
    if not path.begin():
        return None
    before = taken = proof = None
    least, lowest, waited, shown = np.inf, np.inf, 0, _SHOWN
    for _ in range(_STEPS):
        error, active = path.error, path.active
        still = before is None or np.array_equal(active, before)
        share = path.share
        shows = share < shown or active.size == 0
        if shows or (error < _NEAR and still and not (taken is not None and np.array_equal(active, taken))):
            taken, found = active, path.exact(active, path.x.copy(), path.multiplier, path.nu)
            close = found is not None and path.wrong(active, *found[:2]) <= judge.tolerance
            if close and judge.asked(path.y_of(*found), active):
                return None
            if found is not None and shows:
                shown = 0.1 * share
                for direction in path.rays(found, active):
                    new = contradiction(judge.lcp, direction)
                    if new is not None and new[1] != NUMERICALLY:
                        return new
                    if new is not None and proof is not None:
                        return proof
                    proof = proof or new
        before = active
        if error < judge.tolerance and judge.asked(path.y, active):
            return None
        waited = 0 if error < _LESS * least or share < _LESS * lowest else waited + 1
        least, lowest = min(error, least), min(share, lowest)
        if waited > _PATIENCE or not path.advance():
            break
    if proof is None:
        judge.asked(path.y, path.active)
    return proof


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
