"""Second opinions: foreign solvers solve the same problem from scratch, and one judge compares."""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError, Interrupted
from ..numerics.arrays import as_number
from ..numerics.rounding import sheltered
from ..problem.data import ProblemLike, as_problem
from ..solve.driver import solve
from ..solve.progress import status_line
from ..solvers.foreign import Claim, ForeignSolver, ask, chosen_solvers
from ..solvers.formulations import Target
from .judge import Checked, Row, Verdict
from .report import Report


@sheltered
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

    Parameters: `solution` a `Solution`, a vector z of shape (n,), or None, which solves first; `solvers` names (see
    `icpmodel.solvers.foreign_solvers`) or own `ForeignSolver` objects, None for all that are asked of themselves;
    `atol` how far two answers may lie apart in an entry, in the units of z, default 1e-6 max|z|; `time_limit` seconds
    for each problem that a solver is given; `progress` says on a terminal which solver is at work.
    Returns a `Report`; `report.agrees` is True only where at least one solver really agreed and none disagreed.
    Raises InputError for a z of the wrong shape, an unknown solver or a bad number, and Interrupted, which carries
    the report so far, after Ctrl-C.

    >>> report = icp.crosscheck(ICP([[2, -1], [-1, 2]], [-1, 3]), [0.5, 0.0], ["osqp", "cvxpy-clarabel"])
    >>> [row.verdict.value for row in report.rows], report.agrees
    (['agrees', 'agrees'], True)
    >>> icp.crosscheck(ICP([[2, -1], [-1, 2]], [-1, 3]), [0.5001, 0.0], ["osqp"]).rows[0].verdict
    <Verdict.DISAGREES: 'disagrees'>
    """
    problem = as_problem(problem)
    if isinstance(solution, list | tuple) and any(isinstance(one, str) for one in solution):
        raise InputError(f"solution is {list(solution)!r}; names of solvers go into solvers=")
    chosen = chosen_solvers(solvers, "crosscheck")
    if atol is not None:
        as_number(atol, "atol", least=0)
    as_number(time_limit, "time_limit", above=0)
    if solution is None:
        solution = solve(problem, raise_on_failure=False)
    # an answer may hold anything, infinities too: the judge sees what comes of them, the user need not be warned
    with np.errstate(over="ignore", invalid="ignore"):
        checked = Checked(problem, solution, atol)
        rows: list[Row] = []
        with status_line(progress) as say:
            for k, solver in enumerate(chosen):
                say(f"asking {solver.name} ({k + 1} of {len(chosen)})")
                try:
                    rows += _rows_of(solver, checked, time_limit)
                except KeyboardInterrupt:
                    rows += [Row(other.name, "", Verdict.SKIPPED, note="interrupted") for other in chosen[k:]]
                    raise Interrupted(Report.of(checked, rows, solution)) from None
        return Report.of(checked, rows, solution)


def _rows_of(solver: ForeignSolver, checked: Checked, time_limit: float) -> list[Row]:
    """One row for each target that `solver` can take; where it can take none, one for each reason."""
    reasons = [solver.why_not(target) for target in checked.targets]
    rows = [
        checked.judge(solver.name, solver.form(target), target, _claim(solver, target, time_limit))
        for target, reason in zip(checked.targets, reasons, strict=True)
        if reason is None
    ]
    nothing = ["psi(z) is not finite at the answer, so that its obstacle cannot be frozen"]
    if checked.problem.upper is not None:
        nothing = ["psi(z) and upper(z) are not finite at the answer, or cross there, so that they cannot be frozen"]
    because = (reason for reason in dict.fromkeys(reasons or nothing) if reason)
    return rows or [Row(solver.name, "", Verdict.SKIPPED, note=reason) for reason in because]


def _claim(solver: ForeignSolver, target: Target, time_limit: float) -> Claim:
    """What it claims at the first of its tight tolerances at which it claims success, else at the last one."""
    left = time_limit
    for k, tolerance in enumerate(solver.tight):
        # at least a second, so that a later attempt is not lost to a nearly spent limit
        claim = ask(solver, target, tolerance, max(left, 1.0) if k else time_limit)
        left -= claim.seconds
        if claim.solved or left <= 0:
            break
    words = f"{claim.words}, at {tolerance:g}" if k and claim.solved else claim.words
    return replace(claim, words=words, seconds=time_limit - left)
