"""Second opinions: foreign solvers solve the same problem from scratch, and one judge compares."""

from __future__ import annotations

import time
from collections.abc import Iterable, Iterator
from dataclasses import replace
from functools import partial
from itertools import chain
from typing import Any

import numpy as np

from ..errors import InputError, Interrupted, OutOfTime
from ..numerics.arrays import as_number
from ..numerics.rounding import public_entry
from ..problem.data import ProblemLike, as_problem
from ..solve.driver import solve
from ..solve.progress import status_line
from ..solve.solution import Solution, certify
from ..solvers.foreign import Claim, ForeignSolver, ask, chosen_solvers
from ..solvers.formulations import Target
from ..solvers.time_limited import time_limited
from .judge import AnswerUnderTest, Row, Verdict, finite
from .report import Report

#: facts of the answer (Res_D(z), its error bound or None, why there is none), the name of the next solver, or a row
_Item = tuple[float, float | None, str] | str | Row


@public_entry
def crosscheck(
    problem: ProblemLike,
    solution: Any = None,
    solvers: Iterable[str | ForeignSolver] | None = None,
    *,
    atol: float | None = None,
    time_limit: float = 60.0,
    progress: bool = False,
) -> Report:
    """Have independent solvers solve `problem`, and compare each with the answer under test.

    Parameters
    ----------
    problem : ICP
        The problem.
    solution : Solution or array_like of shape (n,), optional
        The answer under test; by default `problem` is solved first.
    solvers : iterable of str or ForeignSolver, optional
        Names (see `icpmodel.solvers.foreign_solvers`) or objects; by default all but those that run
        only when they are named.
    atol : float, optional
        Largest difference of two answers in an entry, in the units of z; by default 1e-6 max|z|.
    time_limit : float, default 60
        Seconds in all, including the statement of the problems and the verdicts. Every solver gets an
        equal share of the remaining time.
    progress : bool, default False
        Whether to show on a terminal, and now and then in a log, which solver is at work.

    Returns
    -------
    Report
        `report.agrees` is True only where at least one solver agreed and none disagreed.

    Raises
    ------
    InputError
        For a z of the wrong shape, an unknown solver or a bad number.
    Interrupted
        After Ctrl-C; it carries the report so far.

    Notes
    -----
    If p is nonlinear, the solvers get its tangent at the answer under test. This answer solves the
    problem with the tangent if and only if it solves the original one. IPOPT gets the nonlinear p as well.

    While a foreign solver runs in this process, what other threads print or log is lost.

    Examples
    --------
    >>> report = icp.crosscheck(
    ...     ICP([[2, -1], [-1, 2]], [-1, 3]), [0.5, 0.0], ["osqp", "cvxpy-clarabel"]
    ... )
    >>> [row.verdict.value for row in report.rows], report.agrees
    (['agrees', 'agrees'], True)
    >>> report = icp.crosscheck(ICP([[2, -1], [-1, 2]], [-1, 3]), [0.5001, 0.0], ["osqp"])
    >>> report.rows[0].verdict
    <Verdict.DISAGREES: 'disagrees'>
    """
    problem = as_problem(problem, nonlinear=True)
    if isinstance(solution, list | tuple) and any(isinstance(one, str) for one in solution):
        raise InputError(f"solution is {list(solution)!r}; names of solvers go into solvers=")
    chosen = chosen_solvers(solvers, "crosscheck")
    if atol is not None:
        as_number(atol, "atol", minimum=0)
    end = time.perf_counter() + as_number(time_limit, "time_limit", above=0)
    if solution is None:
        solution = solve(problem, raise_on_failure=False, time_limit=time_limit)
    # products with a large answer may overflow: the verdicts allow for that, and a warning would tell nothing
    with np.errstate(over="ignore", invalid="ignore"):
        checked = AnswerUnderTest(problem, solution, atol)
        rows: dict[str, list[Row]] = {solver.name: [] for solver in chosen}
        certain: tuple[float, float | None, str]
        certain = (checked.problem.residual(checked.z), None, f"time_limit = {time_limit:g} s was over")
        at_work = ""
        note = f"time_limit = {time_limit:g} s was over"
        interrupted = False
        items = partial(_items, checked, chosen, solution, end)
        try:
            with status_line(progress, f"{len(chosen)} solvers, {time_limit:g} s at most") as say:
                for item in time_limited(items, checked.problem, 1 + len(chosen), end):
                    if isinstance(item, str):
                        at_work = item
                        say(f"asking {at_work}")
                    elif isinstance(item, Row):
                        rows[item.solver].append(item)
                    else:
                        certain = item
        except OutOfTime:
            pass
        except ChildProcessError as error:
            note = str(error)
        except KeyboardInterrupt:
            interrupted = True
            at_work = ""
            note = "interrupted"
        report = _report(checked, solution, certain, _all_rows(rows, at_work, note))
        if interrupted:
            raise Interrupted(report) from None
        return report


def _all_rows(rows: dict[str, list[Row]], at_work: str, note: str) -> tuple[Row, ...]:
    """All rows, with one added to `rows` for each solver without any: FAILED if it was `at_work`, else SKIPPED."""
    for name, own in rows.items():
        if own:
            continue
        if name == at_work:
            rows[name] = [Row(name, "", Verdict.FAILED, note=f"{note} before it answered")]
        else:
            rows[name] = [Row(name, "", Verdict.SKIPPED, note=f"not asked: {note}" if at_work else note)]
    return tuple(chain(*rows.values()))


def _report(
    checked: AnswerUnderTest, solution: Any, certain: tuple[float, float | None, str], rows: tuple[Row, ...]
) -> Report:
    is_vector = not isinstance(solution, Solution)
    return Report(
        rows=rows,
        problem=repr(checked.problem),
        n=checked.problem.n,
        answer="given as a vector" if is_vector else f"{solution.status.value}, {solution.method!r}",
        status="" if is_vector else solution.status.value,
        residual=finite(certain[0]),
        holds=checked.holds,
        error_bound=certain[1],
        reason=certain[2],
        tolerance=finite(checked.tolerance),
    )


def _items(checked: AnswerUnderTest, chosen: list[ForeignSolver], solution: Any, end: float) -> Iterator[_Item]:
    """Yield the certified facts of the answer to the original problem, then the name and the rows of each solver."""
    known = isinstance(solution, Solution) and solution.problem is checked.original
    certificate = solution.certificate if known else certify(checked.original, checked.z)
    yield certificate.residual, certificate.error_bound, certificate.bound.reason
    reasons = {solver.name: _why_not(solver, checked) for solver in chosen}
    for name, why in reasons.items():
        yield from (Row(name, "", Verdict.SKIPPED, note=reason) for reason in why)
    applicable = [solver for solver in chosen if not reasons[solver.name]]
    for k, solver in enumerate(applicable):
        if time.perf_counter() >= end:
            return
        yield solver.name
        targets = [target for target in checked.targets if solver.why_not(target) is None]
        for i, target in enumerate(targets):
            share = (end - time.perf_counter()) / ((len(applicable) - k) * len(targets) - i)
            yield checked.judge(solver.name, solver.form(target), target, _claim(solver, target, share))


def _why_not(solver: ForeignSolver, checked: AnswerUnderTest) -> list[str]:
    """Why `solver` can take none of the targets; empty if it can take one."""
    possible = [target for target in checked.targets if target.problem.f is None or "nlp" in solver.forms]
    reasons = [solver.why_not(target) for target in possible]
    nothing = "the obstacles are not finite at the answer, or cross there, so that they cannot be frozen"
    return [] if None in reasons else [reason for reason in dict.fromkeys(reasons or [nothing]) if reason]


def _claim(solver: ForeignSolver, target: Target, time_limit: float) -> Claim:
    """Run `solver` at its tight tolerances in turn, until it claims success or time is over; return its last claim."""
    start_time = time.perf_counter()
    claim = ask(solver, target, solver.tight[0], time_limit)
    seconds = claim.seconds
    for tolerance in solver.tight[1:]:
        seconds_left = time_limit - (time.perf_counter() - start_time)
        if claim.solved or seconds_left <= 0.0:
            break
        claim = ask(solver, target, tolerance, seconds_left)
        seconds += claim.seconds
    loosened = claim.solved and claim.tolerance is not None and claim.tolerance != solver.tight[0]
    words = f"{claim.words}, at {claim.tolerance:g}" if loosened else claim.words
    return replace(claim, words=words, seconds=seconds)
