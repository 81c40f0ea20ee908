"""Make the `Solution` of a run: the exact residual, the status and the message."""

from __future__ import annotations

import contextlib
from dataclasses import replace

import numpy as np

from ..errors import MapError, OutOfTime
from ..numerics import work
from ..numerics.arrays import Vector
from ..numerics.rounding import public_entry
from ..problem.data import ProblemData
from ..problem.differences import misfit_of_derivative
from ..problem.elementwise import Elementwise
from ..problem.function import Function
from ..problem.two_sided import sides_of
from ..theory.certificates.combination_rows import ZERO, CombinationRows
from ..theory.certificates.contradiction import contradiction, multipliers
from ..theory.certificates.infeasible import combination_text
from ..theory.certificates.recession import Recession
from .goal import Limits
from .run import BestIterate, Run
from .solution import History, Solution, Status

#: the statuses that become PRECISION_LIMIT where rounding explains them
_STALLED = (Status.STAGNATED, Status.CYCLED, Status.DIVERGED)


@public_entry
def _residual(run: Run, z: Vector) -> float:
    return run.goal.judged(z, run.problem.residual(z))


@public_entry
def _passes_by_rounding(run: Run, z: Vector) -> bool:
    """Whether the residual of `z`, which failed the exact test, passes as rounded in float64."""
    with contextlib.suppress(MapError, OutOfTime):
        goal = run.goal
        problem = run.problem
        if goal.problem is not None:
            return problem.residual(z) <= goal.tolerance_at(z) or problem.paper_residual(z) <= goal.atol
    return False


def best_by_exact_residual(run: Run) -> BestIterate:
    """The better one of the best and the last iterate, by exact residuals; the run compared estimates."""
    problem = run.problem
    best = run.best
    assert best is not None
    # the residual of a z that solved is exact already
    judged = [] if run.stop_reason.status is Status.SOLVED and not problem.psi.calls_user_code else [best]
    if run.current is not best.z:
        judged.append(run.candidate(run.current, np.inf))
    for one in judged:
        # a ψ that failed may fail again, or take long
        with contextlib.suppress(MapError, KeyboardInterrupt, OutOfTime):
            one.residual = _residual(run, one.z)
        if one.residual < best.residual:
            best = one
    return best


def solution_of(run: Run, limits: Limits) -> Solution:
    """The solution of a run."""
    best = best_by_exact_residual(run)
    status, note = _status_and_note(run, best, limits)
    last = best.job if status is Status.SOLVED else run.job
    why = [best.job.choice.why] if best.job.choice.why else []
    if len(run.tried) > 1:
        why.append("in turn: " + ", then ".join(str(job) for job in run.tried))
    return Solution(
        problem=run.problem,
        z=best.z.copy(),
        status=status,
        message="solved" if status is Status.SOLVED else _message(run, best, status, note),
        method=best.job.method,
        adapted_method=best.adapted_method,
        last_method=last.method,
        why="; ".join([*why, *run.search_notes]),
        residual=best.residual,
        tolerance=run.goal.tolerance_at(best.z),
        atol=limits.atol,
        accuracy=limits.accuracy,
        iterations=max(run.iteration, 0),
        seconds=work.clock() - run.start_time,
        history_or_none=None if run.records is None else _history(run.records, run.goal.tolerance),
        infeasible=run.infeasible if status is Status.INFEASIBLE else None,
        time_limit=limits.time_limit,
        memory_limit=limits.memory_limit,
        cost=work.counter() - run.start_cost,
    )


def _status_and_note(run: Run, best: BestIterate, limits: Limits) -> tuple[Status, str]:
    """The status and its note; if a contradiction is found, it is stored as `run.infeasible`."""
    status = run.stop_reason.status
    note = run.stop_reason.note
    if limits.accuracy is None and run.goal.reached(best.z, best.residual):
        status = Status.SOLVED
    elif status is Status.SOLVED and limits.accuracy is None:
        status = Status.MAP_FAILED
        note = "psi or f gives different values at the same z"
    elif status in _STALLED and _passes_by_rounding(run, best.z):
        status = Status.PRECISION_LIMIT
        note = "the residual of this z is small enough only as rounded in float64"
    if status not in (Status.SOLVED, Status.INTERRUPTED, Status.STOPPED) and (gap := _crossing(run, best.z)):
        if status in (Status.ITERATION_LIMIT, Status.TIME_LIMIT, Status.MEMORY_LIMIT):
            note = f"{note}; {gap}"
        else:
            status = Status.CROSSED
            note = gap
    may_contradict = run.problem.f is None and status in (*_STALLED, Status.INFEASIBLE)
    try:
        conflict = contradiction(run.problem) if may_contradict else None
        if conflict is None and status in _STALLED:
            note += _derivative_note(run.problem, best.z)
            note += _rounded_contradiction(run.problem) if may_contradict else ""
    except KeyboardInterrupt:
        return Status.INTERRUPTED, "by Ctrl-C"
    if conflict is None:
        return status, note
    proof = run.infeasible if status is Status.INFEASIBLE and run.infeasible is not None else conflict.proof
    run.infeasible = replace(proof, reason=f"{proof.reason}; {conflict}")
    return Status.INFEASIBLE, run.infeasible.reason


def _derivative_note(problem: ProblemData, z: Vector) -> str:
    """A note on which of ψ, ψ̄ and f does not change at `z` as the user's derivative says; empty if all do."""
    maps = list(zip(("psi", "upper"), sides_of(problem.psi), strict=False))
    maps += [] if problem.f is None else [("f", problem.f.map)]
    for name, one in maps:
        if not isinstance(one, Elementwise | Function) or one.derivative is None:
            continue  # the derivative is the package's own
        with contextlib.suppress(MapError):
            J = one.jacobian(z)
            if J is not None and (row := misfit_of_derivative(one.value, J, z)) is not None:
                return f"; at this z {name}[{row}] does not change as its derivative says: check the derivative"
    return ""


def _rounded_contradiction(problem: ProblemData) -> str:
    """A note on rows that contradict each other up to rounding, where obstacles are fixed; empty if none do."""
    with contextlib.suppress(OutOfTime):
        y = multipliers(problem) if problem.psi.is_constant else None
        if y is not None and Recession(problem).misfit(y) < ZERO:
            rows = CombinationRows.of(problem)
            assert rows is not None
            negative = combination_text(y, rows.name)
            return f"; up to rounding there is no solution, as {negative} is negative between the obstacles"
    return ""


def _message(run: Run, best: BestIterate, status: Status, note: str) -> str:
    """The message: what went wrong, and what may help."""
    last = run.job
    by = "" if last is best.job else f" by {best.job.method!r}"
    advice = status.advice_with(last.method.to_try if len(run.tried) < 2 else "")
    residual = f"Best residual {best.residual:.3g}{by} ({run.goal.in_words(best.z)})"
    return f"{last.method!r} {status.value}: {note}. {residual}. Advice: {advice}"


def _crossing(run: Run, z: Vector) -> str:
    """A note on a row with ψ > ψ̄ at `z`, beyond rounding and the tolerance; empty if there is none."""
    problem = run.problem
    with contextlib.suppress(MapError), np.errstate(over="ignore"):
        r = problem.r(z)
        r_upper = problem.r_upper(z)
        if r_upper is not None:
            gap = r_upper - r - 2.0 * problem.rounding(z)[1]
            if (gap > run.goal.tolerance_at(z)).any():
                i = int(np.argmax(gap))
                return f"psi_{i} = {z[i] - r[i]:.6g} is above upper_{i} = {z[i] - r_upper[i]:.6g} at this z"
    return ""


def _history(records: list[tuple[int, float, float, str]], tolerance: float) -> History:
    iteration, residual, seconds, method = zip(*records, strict=True) if records else ((), (), (), ())
    return History(np.array(iteration, dtype=np.int64), np.array(residual), np.array(seconds), method, tolerance)


def why_none(problem: ProblemData) -> str:
    """Why no method can start."""
    diagonal = problem.A.diagonal()
    i = int(np.argmin(diagonal))
    if diagonal[i] > 0.0:
        return "no suitable method fits into the memory that is left (memory_limit)"
    others = problem.psi.no_derivative() or "factors do not fit into the memory that is left: raise memory_limit"
    return f"A[{i}, {i}] = {diagonal[i]:g} is not positive, which sweeps need, and {others}"
