"""`solve()`: from what the user asks for to the loop that does it."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from copy import copy
from typing import Any

import numpy as np

from ..errors import InputError, NotApplicable, NotSolved
from ..methods.contract import Method, named
from ..numerics.arrays import as_truth
from ..problem.data import ProblemData, as_problem
from .choice import Choice
from .reduced import choices
from .run import Job, Limits, Progress
from .solution import Solution, Status

#: the default relative tolerance
RTOL = 1e-8
_OPTIONS = (
    "z0",
    "rtol",
    "atol",
    "accuracy",
    "max_iter",
    "time_limit",
    "callback",
    "history",
    "progress",
    "raise_on_failure",
)


def solve(
    problem: ProblemData,
    method: str | Method | None = None,
    *,
    z0: Any = None,
    rtol: float | None = None,
    atol: float | None = None,
    accuracy: float | None = None,
    max_iter: int = 100_000,
    time_limit: float | None = None,
    callback: Callable[[Progress], Any] | None = None,
    history: bool = False,
    progress: bool = False,
    raise_on_failure: bool = True,
    **options: Any,
) -> Solution:
    """Solve an ICP: stop at Res(z) = ‖min(r, p)‖₂ ≤ max(atol, rtol·Res(0)), Res(0) being that of the vector 0
    (of z0 where ψ has no value at 0, or 0 is a solution), or, with `accuracy`, where it is proved that
    |z_i − z*_i| ≤ accuracy in every entry.

    Parameters:
    `problem`; `method` a name (with its `options`, e.g. theta1=1.2), a `Method`, or None to have one picked, and the
    problem reduced before where that pays (see `icpmodel.solve.reduced`), while a named one gets the whole problem;
    `z0` the start, shape (n,), or an earlier `Solution` (default 0); `rtol`, `atol` (the paper's ε is atol),
    by default 1e-8 and 0; `accuracy` > 0 in the units of z, instead of the two;
    `max_iter` iterations in all, a sweep or a Newton step each (small problems are solved by all sweeps or pivots in
    one); `time_limit` in seconds, looked at between iterations, set-up included, and at the first call of a process
    half a second for loading compiled code, or some seconds for compiling it;
    `callback` gets a `Progress` per tested iterate and stops the run by returning True;
    `history` keeps the residuals in `Solution.history`; `progress` shows a bar where standard error is a terminal;
    `raise_on_failure`.
    Returns a `Solution`; its z is the best iterate, and SOLVED means that the residual of this very z was recomputed.
    Raises InputError, NotApplicable (SingularOperator, or nothing bounds the error and `accuracy` is wanted), MapError
    where ψ fails at the start, and NotSolved, which carries the best iterate, where the run fails, runs out of time or
    is interrupted, unless `raise_on_failure` is False: then that solution is returned.

    >>> solution = solve(ICP([[4, -1], [-2, 4]], [-3, -2]), "mnmsor", theta1=1.1)
    >>> solution.status, solution.z.round(6)
    (<Status.SOLVED: 'solved'>, array([1., 1.]))
    """
    if accuracy is not None and (rtol is not None or atol is not None):
        raise InputError("accuracy bounds the error, rtol and atol the residual: give accuracy alone, or leave it out")
    limits = Limits(
        rtol=RTOL if rtol is None else rtol,
        atol=0.0 if atol is None else atol,
        max_iter=max_iter,
        time_limit=time_limit,
        accuracy=accuracy,
    )
    if callback is not None and not callable(callback):
        raise InputError(f"callback is a {type(callback).__name__}; a function was expected")
    for name, flag in (("history", history), ("progress", progress), ("raise_on_failure", raise_on_failure)):
        as_truth(flag, name)
    n = as_problem(problem).n
    start = np.zeros(n) if z0 is None else problem.vector(z0, "z0", finite=True).copy()
    job = Job(problem, start, limits, callback, history, progress)
    solution = job.first_success(_choices(problem, method, options), tolerate_singular=method is None)
    if raise_on_failure and not solution.solved:
        raise NotSolved(solution) from (job.fault if solution.status is Status.MAP_FAILED else None)
    return solution


def _choices(problem: ProblemData, method: str | Method | None, options: dict[str, Any]) -> Iterator[Choice]:
    if method is None:
        if options:
            raise InputError(
                f"solve has no option {next(iter(options))}; it takes {', '.join(_OPTIONS)}, "
                "and the options of a method only where one is named"
            )
        yield from choices(problem)
        return
    if isinstance(method, Method):
        if options:
            raise InputError(f"{next(iter(options))}: the options of a Method object go into its constructor")
        method = copy(method)  # what a run notes on its method (`MNMAOR.used`) stays with this run's solution
    else:
        try:
            method = named(method, **options)
        except InputError as error:
            more = f"; solve itself takes {', '.join(_OPTIONS)}" if "has no option" in str(error) else ""
            raise InputError(f"{error}{more}") from None
    why_not = method.why_not(problem)
    if why_not is not None:
        raise NotApplicable(f"{method.name}: {why_not}")
    yield Choice(method, "")
