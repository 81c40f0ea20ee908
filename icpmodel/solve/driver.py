"""`solve()`: check the arguments, run the methods, return the solution."""

from __future__ import annotations

import contextlib
import inspect
import logging
import math
from collections.abc import Callable, Iterator
from dataclasses import replace
from typing import Any

import numpy as np

from ..errors import InputError, MapError, NotApplicable, NotSolved, did_you_mean
from ..methods.aor import MNMGS
from ..methods.contract import Method, named
from ..numerics import work
from ..numerics.arrays import Vector, as_truth, norm
from ..numerics.rounding import CTRL_C, is_ctrl_c, public_entry
from ..problem.data import ProblemData, ProblemLike, as_problem
from ..problem.user_code import as_function
from ..theory.certificates.infeasible import infeasible_as_given
from .accuracy import solve_to_accuracy
from .goal import RTOL, Goal, Limits, check_family
from .jobs import Choice, Job, MethodSequence
from .last_resort import search
from .newton_josephy import NewtonJosephy
from .outcome import solution_of, why_none
from .progress import CallbackFailure, Progress
from .reduction import ladder_steps, presolve
from .run import Run
from .small import solve_small
from .solution import Solution, Status
from .stopping import WORTH_ANOTHER_METHOD, StopReason, fault_of_psi

_LOG = logging.getLogger("icpmodel")


@public_entry
def solve(
    problem: ProblemLike,
    method: str | Method | None = None,
    *,
    z0: Any = None,
    rtol: float | None = None,
    atol: float | None = None,
    accuracy: float | None = None,
    family: str | None = None,
    max_iter: int = 100_000,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    callback: Callable[[Progress], Any] | None = None,
    history: bool = False,
    progress: bool = False,
    raise_on_failure: bool = True,
    **options: Any,
) -> Solution:
    """Solve an ICP.

    Parameters
    ----------
    problem : ICP or object
        An ICP, or an object that holds one: a scene, a solution, an `icpmodel.Problem` written in
        CVXPY, a Pyomo model that was read.
    method : str or Method, optional
        A name with its `options`, e.g. theta1=1.2, or a `Method`. By default one is chosen by the
        rule of `select_method`. Then the obstacle is first replaced by a fixed one if every ψ_i
        depends on z_i alone and changes by less than z_i, and the problem may be reduced. A named
        method gets the problem as it is.
    z0 : array of shape (n,) or Solution, optional
        The start, by default 0; where p is nonlinear, the point nearest to 0 between fixed obstacles.
    rtol : float, optional
        Stop when Res_D(z) ≤ rtol·Res_D(0), by default 1e-8.
    atol : float, optional
        Stop when Res(z) ≤ atol, the ε of the paper, by default 0. One of the two is enough.
    accuracy : float, optional
        Instead of rtol and atol: stop when |z_i − z*_i| ≤ accuracy is proved for every entry, in
        the units of z.
    family : {None, "modulus", "paper"}
        The methods that may be chosen, as in `select_method`; only where no method is named.
    max_iter : int, default 100_000
        Limit on iterations; a sweep or a Newton step is one.
    time_limit : float, optional
        Seconds; a run may exceed them by a tenth plus 0.2 s. A step that is expected to take longer than
        the remaining time is not started. Compiling and loading in the first calls do not count.
    memory_limit : float, optional
        Bytes that the solve may allocate, by default the free memory of the machine. A method that
        needs more is replaced by another.
    callback : callable, optional
        Called with a `Progress` for each tested iterate; it stops the run by returning True.
    history : bool, default False
        Whether the residuals are kept in `Solution.history`.
    progress : bool, default False
        Whether a bar is shown, on a terminal or in a notebook. Where standard error is neither, a
        line is written after 1, 2, 4, … seconds, then one a minute.
    raise_on_failure : bool, default True
        Whether a run that fails raises NotSolved; else its best iterate is returned.
    **options
        The options of the named method.

    Returns
    -------
    Solution
        Its z is the best iterate. SOLVED means that the residual was recomputed for this very z.

    Raises
    ------
    InputError
        For arguments that make no sense.
    NotApplicable
        Where the named method, or every method, cannot take the problem (SingularOperator: its
        operator is singular), or nothing bounds the error and `accuracy` is given.
    MapError
        Where ψ or f fails at the start.
    NotSolved
        Where the run fails, reaches a limit, or is stopped by the callback or, once a method has begun, by Ctrl-C.
        The exception carries the solution.

    Notes
    -----
    Res_D(z) = ‖min(D⁻¹p, r)‖₂ with d_i = max_j |a_ij| does not depend on the units of p.
    `ICP.residual_scale` says what takes the place of Res_D(0) where 0 is a solution.

    The logger "icpmodel" of Python's `logging` reports the decisions. At INFO: which methods begin,
    why, how they end, and the answer. At DEBUG also: the estimated cost of every method that was
    considered, or why it cannot take the problem.

    Examples
    --------
    >>> solution = solve(ICP([[4, -1], [-2, 4]], [-3, -2]), "mnmsor", theta1=1.1)
    >>> solution.status, solution.z.round(6)
    (<Status.SOLVED: 'solved'>, array([1., 1.]))
    """
    check_family(family)
    if family is not None and method is not None:
        raise InputError("family restricts the choice, but a method is named: leave out one of them")
    limits = _limits(rtol, atol, accuracy, max_iter, time_limit, memory_limit)
    display = _display_options(callback, history, progress)
    as_truth(raise_on_failure, "raise_on_failure")
    problem = as_problem(problem, nonlinear=True)
    is_default_call = problem.f is method is family is z0 is None and not options
    if is_default_call and limits.is_default and not any(display.values()):
        solution = solve_small(problem, limits)
        if solution is not None:
            return _log_and_return(solution)
    start = _starting_point(problem, z0)
    with limits.enforced():
        named_method = _method_of(method, problem, options)
        by_method = method is not None
        with work.unlimited():  # the residual at the start is computed in any case
            run = _new_run(problem, start, limits, warm_start=z0 is not None, **display)

        def run_all() -> None:
            _run_all(run, named_method, family)

        error = None
        try:
            if accuracy is None:
                run_all()
            else:
                solve_to_accuracy(run, float(accuracy), run_all)
        except CallbackFailure as failure:
            error = failure.error
        if error is not None:  # with the cause that the callback gave it
            raise error
        _check_best(run, by_method)
        solution = _log_and_return(solution_of(run, limits))
    if raise_on_failure and not solution.solved:
        raise NotSolved(solution) from (run.fault if solution.status is Status.MAP_FAILED else None)
    return solution


def _check_best(run: Run, by_method: bool) -> None:
    """Raise SingularOperator if the named method met it, and NotApplicable if no method takes the problem.

    If a chosen method met a singular operator and there is no best iterate, the start becomes the best iterate.
    """
    if run.singular is not None:
        if by_method:
            raise run.singular
        if run.best is None:
            run.best = run.candidate(run.start, run.start_residual)
            run.stop_reason = StopReason(Status.STAGNATED, str(run.singular))
    if run.best is None:
        raise NotApplicable(f"no method takes this problem: {why_none(run.problem)}")


def _run_all(run: Run, method: Method | None, family: str | None) -> None:
    """Run the named method, or the chosen ones: on the presolved problem and, if they fail, on the problem as given.

    The second attempt is needed because presolving relies on the user's Lipschitz constants. If all fail and there is
    no `family`, a global search follows.
    """
    if method is not None:
        run_methods(run, run.steps(MethodSequence(method)))
        return
    if run.problem.f is not None:
        run_methods(run, run.steps(MethodSequence(NewtonJosephy(inner_family=family), why="p is nonlinear")))
        if family is None:
            search(run, run_methods)
        return
    other = presolve(run.problem)
    if other is not run.problem:
        run.presolved = other
        run_methods(run, ladder_steps(run, other, family))
        if run.infeasible is not None and run.infeasible.witness is None:  # by enumeration, for rounded data
            run.infeasible = None
            run.is_over = False
            run.stop_reason = StopReason(Status.STAGNATED, "")
        elif run.infeasible is not None:
            run.infeasible = infeasible_as_given(run.problem, run.infeasible)
            run.stop_reason = StopReason(Status.INFEASIBLE, run.infeasible.reason)
        if run.stop_reason.status not in WORTH_ANOTHER_METHOD:
            return
        run.presolved = None
    run_methods(run, ladder_steps(run, run.problem, family))
    if family is None:
        search(run, run_methods)


def _starting_point(problem: ProblemData, z0: Any) -> Vector:
    """A copy of `z0`; by default 0, and where p is nonlinear the point nearest to 0 between fixed obstacles."""
    if z0 is not None:
        return problem.vector(z0, "z0", finite=True).copy()
    start = np.zeros(problem.n)
    if problem.f is not None and problem.facts.has_fixed_obstacle:  # beyond them f may have no value
        start = np.clip(start, problem.facts.obstacle, problem.facts.upper_obstacle)
    return start


def _own_options(options: dict[str, Any]) -> str:
    """In words, the names of the options of `solve` itself, and those of them that the `options` resemble."""
    names = list(inspect.signature(solve).parameters)[2:-1]
    return f"takes {', '.join(names)}" + "".join(did_you_mean(one, names) for one in options)


def _display_options(callback: Any, history: Any, progress: Any) -> dict[str, Any]:
    if callback is not None:
        as_function(callback, "callback", "a Progress")
    as_truth(history, "history")
    as_truth(progress, "progress")
    return {"callback": callback, "history": history, "progress": progress}


def _limits(rtol: Any, atol: Any, accuracy: Any, max_iter: Any, time_limit: Any, memory_limit: Any) -> Limits:
    if accuracy is not None and (rtol is not None or atol is not None):
        raise InputError("accuracy bounds the error, rtol and atol the residual: give accuracy alone, or leave it out")
    return Limits(
        rtol=RTOL if rtol is None else rtol,
        atol=0.0 if atol is None else atol,
        max_iter=max_iter,
        time_limit=time_limit,
        accuracy=accuracy,
        memory_limit=memory_limit,
    )


def _method_of(method: str | Method | None, problem: ProblemData, options: dict[str, Any]) -> Method | None:
    """The method that the user names; None if one is to be chosen."""
    if options and not isinstance(method, str):
        expected = "an option of a method goes beside its name, or into the constructor of a Method"
        raise InputError(f"solve has no option {next(iter(options))}; it {_own_options(options)}; {expected}")
    if method is None:
        return None
    if not isinstance(method, Method):
        try:
            method = named(method, **options)
        except InputError as error:
            more = f"; solve itself {_own_options(options)}" if "has no option" in str(error) else ""
            raise InputError(f"{error}{more}") from None
    why_not = method.why_not(problem)
    if why_not is not None:
        raise NotApplicable(f"{method.name}: {why_not}")
    return method


def _new_run(problem: ProblemData, start: Vector, limits: Limits, **display: Any) -> Run:
    """Set up the run from `start`. Raises MapError if ψ has no value there."""
    start_time = work.clock()
    start_cost = work.counter()
    # with an f, Res_D(0) may exceed `residual_at_0`, which scales the tolerance
    is_at_0 = problem.f is None and not np.count_nonzero(start)
    start_residual = residual_at_0 = problem.residual_at_0() if is_at_0 else problem.residual(start)
    if not math.isfinite(start_residual) and (fault := fault_of_psi(problem, start)):
        other_causes = "" if fault.startswith("f(") else ", -inf in psi or inf in upper"
        raise MapError(f"{fault} at the start; a finite number{other_causes} was expected: give another z0")
    # after a failure the next method starts from 0, unless psi has no value there
    restart = start
    if not is_at_0:
        residual_at_0 = math.nan
        with contextlib.suppress(MapError):
            residual_at_0 = problem.residual_at_0()
        if math.isfinite(residual_at_0):
            restart = np.zeros(problem.n)
    scale = problem.residual_scale(residual_at_0)
    if residual_at_0 == 0.0 and scale and not is_at_0:  # the data at 0 may be far larger than the start
        scale = min(scale, norm(start)) or scale
    goal = Goal(float(limits.tolerance(scale)), problem, limits.atol)
    if limits.accuracy is not None:
        goal = Goal(math.inf)
    elif not scale:
        goal = replace(goal, rtol_of_z=limits.rtol, start_norm=norm(start))
    elif problem.f is not None and goal.tolerance:  # else it has underflown
        goal = replace(goal, rtol_of_z=limits.rtol)
    return Run(
        problem,
        start,
        start_residual,
        goal,
        limits=limits,
        target_reduction=_target_reduction(problem, limits),
        scale=scale,
        restart=restart,
        start_time=start_time,
        start_cost=start_cost,
        **display,
    )


def _target_reduction(problem: ProblemData, limits: Limits) -> float:
    """The residual relative to Res_D(0) for which costs are estimated."""
    if limits.accuracy is not None:
        return RTOL  # a certified error falls about as a residual does
    if not limits.atol:
        return limits.rtol
    residual_at_0 = math.nan
    with contextlib.suppress(MapError):
        residual_at_0 = problem.paper_residual(np.zeros(problem.n))
    return max(limits.rtol, limits.atol / residual_at_0 if 0.0 < residual_at_0 < math.inf else 0.0)


@np.errstate(over="ignore", invalid="ignore")
def run_methods(run: Run, steps: Iterator[None]) -> None:
    """Exhaust the `steps` of the run; once a method has begun, Ctrl-C sets `run.stop_reason` and is not raised.

    No step is made if fixed obstacles cross. If the limits allow no method, `run.best` is the start.
    """
    try:
        if run.problem.upper is not None and _end_at_crossed_obstacles(run):
            return
        for _ in steps:
            pass
    except (KeyboardInterrupt, *CTRL_C) as error:
        if not (run.tried and is_ctrl_c(error)):
            raise
        if run.best is None:
            run.best = run.candidate(run.start, run.start_residual)
        run.stop_reason = StopReason(Status.INTERRUPTED, "by Ctrl-C")
    if run.best is None and run.refusal is not None:
        if not run.tried:
            run.job = Job(Choice(MNMGS(), "the limits were reached before a method was chosen"))
        run.best = run.candidate(run.start, run.start_residual)


def _log_and_return(solution: Solution) -> Solution:
    """Log the `solution` and return it."""
    if _LOG.isEnabledFor(logging.INFO):
        values = solution.status.value, solution.method, solution.iterations, solution.seconds, solution.residual
        _LOG.info("n = %d: %s, z is from %r; %d iterations, %.3g s, residual %.3g", solution.problem.n, *values)
    return solution


def _end_at_crossed_obstacles(run: Run) -> bool:
    """If fixed obstacles cross, make a z that shows it the best iterate and return True: no solution exists."""
    with contextlib.suppress(MapError):
        row = run.problem.facts.crossed
        if row is not None:
            c = run.problem.facts.obstacle
            run.current = np.where(np.isfinite(c), c, run.start)  # z_i ≥ c_i at every solution
            run.job = Job(Choice(MNMGS(), f"no method was tried: psi_{row} and upper_{row} are fixed, and cross"))
            run.best = run.candidate(run.current, run.problem.residual(run.current))
            return True
    return False
