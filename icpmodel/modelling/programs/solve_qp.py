"""`solve_qp` and `solve_avi`: quadratic programs and affine variational inequalities from their arrays."""

from __future__ import annotations

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any

import numpy as np

from ...crosscheck import crosscheck
from ...crosscheck.report import Report
from ...errors import Interrupted, NotSolved, OutOfTime
from ...icp import ICP
from ...numerics import work
from ...numerics.arrays import Vector, as_truth, as_vector
from ...numerics.rounding import public_entry
from ...present.display import Displayable
from ...theory.certificates.bounds import ErrorBound, limited_bound
from .distance import distance
from .program import Presolve, Program, conditions_of
from .program_arguments import check_convex, check_order, program_limits, read
from .program_run import ProgramRun

#: the message after Ctrl-C
INTERRUPTED = "interrupted by Ctrl-C"


@dataclass(frozen=True, eq=False, repr=False)
class ProgramSolution(Displayable):
    """The result of `solve_qp`, where H is P and g is q, and of `solve_avi`.

    Attributes
    ----------
    x : ndarray, shape (n,)
        The best iterate; NaN if it is proved, exactly or up to rounding, that there is no solution.
    y, z, z_box : ndarray
        The multipliers of Ax = b (of any sign), of Gx ≤ h (≥ 0), and of the bounds: Hx + g + Gᵀz + Aᵀy + z_box = 0.
        z_box_i ≥ 0 where x_i = ub_i, ≤ 0 where x_i = lb_i.
    objective : float
        ½xᵀHx + gᵀx; NaN where H is not symmetric.
    status : str
        "optimal"; "optimal_inaccurate"; "infeasible" or "unbounded", which are proved; the same with "_inaccurate",
        which are proved up to rounding; "infeasible_or_unbounded"; "user_limit"; "solver_error".
    message : str
        The reason for the status.
    violation : float
        The largest violation of a condition of optimality, relative to the sum of its |terms|. The conditions are the
        rows of Ax = b, Gx ≤ h, the bounds, stationarity, complementarity, and the duality gap.
    iterations : int
        Steps of all methods.
    seconds : float

    Examples
    --------
    >>> icp.solve_qp([[2.0]], [-2.0])
    ProgramSolution(optimal: x = [1.], objective = -1)
    """

    x: Vector
    y: Vector
    z: Vector
    z_box: Vector
    objective: float
    status: str
    message: str
    violation: float
    iterations: int
    seconds: float
    _program: Program = field(repr=False)

    @property
    def solved(self) -> bool:
        """Whether x is optimal.

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).solved
        True
        """
        return self.status == "optimal"

    @property
    def conditions(self) -> ICP:
        """The conditions of optimality as an ICP, in the unknowns (x, y, z). Raises InputError where lb > ub.

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).conditions
        ICP(n=1, nnz=1, psi=Constant(-inf), upper=Constant(0.5))
        """
        check_order(self._program.low, self._program.high)
        return conditions_of(self._program)

    @cached_property
    def error_bound(self) -> ErrorBound:
        """Bound on the distance from x to the solution, if H is strongly monotone, and whether there is only one.

        It is computed within a minute of counted work, as in `icpmodel.error_bound`.

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).error_bound.value < 1e-14
        True
        """
        return limited_bound(lambda: distance(self._program, self.x, np.concatenate([self.y, self.z])))

    def crosscheck(
        self, solvers: Any = None, *, atol: float | None = None, time_limit: float = 60.0, progress: bool = False
    ) -> Report:
        """Have independent solvers check the same conditions, as `icpmodel.crosscheck`; the error bound is that of x.

        If x is NaN, `solve` gives the answer to be checked.

        Parameters
        ----------
        solvers : iterable of str or ForeignSolver, optional
            The solvers; by default every one that is run unless named otherwise.
        atol : float, optional
            Largest difference of two answers in an entry, in the units of z.
        time_limit : float, default 60
            Seconds in all, without those of the error bound.
        progress : bool, default False
            Whether to show which solver is running.

        Returns
        -------
        Report
            The verdicts.

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).crosscheck(["osqp"]).agrees
        True
        """
        z = np.concatenate([self.x, self.y, self.z]) if np.isfinite(self.x).all() else None
        report = crosscheck(self.conditions, z, solvers, atol=atol, time_limit=time_limit, progress=progress)
        return replace(report, error_bound=self.error_bound.value, reason=self.error_bound.reason, bounded="x")

    def __repr__(self) -> str:
        if not self.solved:
            return f"ProgramSolution({self.status}: {self.message})"
        value = "" if np.isnan(self.objective) else f", objective = {self.objective:.6g}"
        with np.printoptions(threshold=8, precision=6):
            return f"ProgramSolution({self.status}: x = {self.x}{value})"


@public_entry
def solve_qp(
    P: Any,
    q: Any,
    G: Any = None,
    h: Any = None,
    A: Any = None,
    b: Any = None,
    lb: Any = None,
    ub: Any = None,
    *,
    initvals: Any = None,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    raise_on_failure: bool = True,
) -> ProgramSolution:
    """Minimise ½xᵀPx + qᵀx subject to Gx ≤ h, Ax = b and lb ≤ x ≤ ub.

    The arguments are those of qpsolvers. The conditions of optimality are an ICP with a positive semidefinite matrix,
    which `solve` solves. If there is no solution, `solve_qp` tries to prove it.

    Parameters
    ----------
    P : array or sparse matrix of shape (n, n)
        Symmetric and positive semidefinite.
    q : array of shape (n,)
        The linear term.
    G : array or sparse matrix of shape (m, n), optional
        The rows of the inequalities.
    h : array of shape (m,), optional
        Their right-hand sides; +inf for a row without one.
    A : array or sparse matrix of shape (k, n), optional
        The rows of the equations.
    b : array of shape (k,), optional
        Their right-hand sides.
    lb, ub : float or array of shape (n,), optional
        −inf and +inf where there is no bound. A large number, such as ±1e20, is a bound, unlike in other solvers.
    initvals : array of shape (n,), optional
        An x near the solution.
    tolerance : float, default 1e-9
        The largest violation of any condition, relative to its terms; see `ProgramSolution.violation`.
    time_limit : float, optional
        Seconds; a run may exceed them by a tenth plus 0.2 s. The first calls also compile or load loops, which is not
        counted.
    raise_on_failure : bool, default True
        Whether a run that fails raises NotSolved.

    Returns
    -------
    ProgramSolution
        x, the multipliers, the status and its reason.

    Raises
    ------
    InputError
        Where an argument is wrong, or P is not symmetric or is proved not to be semidefinite.
    NotSolved
        Where no optimum is found, with the `solution`, unless `raise_on_failure` is False.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (2009), section 1.2.

    Examples
    --------
    >>> solution = icp.solve_qp([[2, 0], [0, 2]], [-2, -6], G=[[1, 1]], h=[2], lb=0)
    >>> solution.x, solution.z, round(solution.objective, 9)
    (array([0., 2.]), array([2.]), -8.0)
    >>> icp.solve_qp([[1.0]], [0.0], lb=1, ub=0, raise_on_failure=False).status
    'infeasible'
    """
    return _solve((P, q, G, h, A, b, lb, ub), "Pq", initvals, tolerance, time_limit, raise_on_failure)


@public_entry
def solve_avi(
    H: Any,
    g: Any,
    G: Any = None,
    h: Any = None,
    A: Any = None,
    b: Any = None,
    lb: Any = None,
    ub: Any = None,
    *,
    initvals: Any = None,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    raise_on_failure: bool = True,
) -> ProgramSolution:
    """Find x in C = {Gx ≤ h, Ax = b, lb ≤ x ≤ ub} with (Hx + g)ᵀ(y − x) ≥ 0 for all y in C.

    If H is symmetric, this affine variational inequality states the optimality conditions of a quadratic program,
    otherwise those of a game or an equilibrium. An x with the status "optimal" solves it, whatever H is. If H is
    monotone (xᵀHx ≥ 0) and there is a solution, one is found; for other H the methods may fail.

    Parameters
    ----------
    H : array or sparse matrix of shape (n, n)
        It need not be symmetric.
    g : array of shape (n,)
        The constant term.
    G, h, A, b, lb, ub : array, optional
        C, as in `solve_qp`.
    initvals : array of shape (n,), optional
        An x near the solution.
    tolerance : float, default 1e-9
        The largest violation of any condition.
    time_limit : float, optional
        Seconds, as in `solve_qp`.
    raise_on_failure : bool, default True
        Whether a run that fails raises NotSolved.

    Returns
    -------
    ProgramSolution
        x, the multipliers and the status. It is "infeasible" if C is proved to be empty or to contain no solution; for
        a symmetric H the latter is "unbounded".

    Raises
    ------
    InputError
        Where an argument is wrong.
    NotSolved
        Where no solution is found, with the `solution`, unless `raise_on_failure` is False.

    References
    ----------
    Facchinei and Pang, Finite-Dimensional Variational Inequalities and Complementarity Problems (2003), section 1.2.

    Examples
    --------
    >>> solution = icp.solve_avi([[2, 1], [-1, 2]], [-3, -3], G=[[1, 1]], h=[1], lb=0)
    >>> solution.x.round(9), solution.z.round(9), solution.error_bound.unique
    (array([0.25, 0.75]), array([1.75]), True)
    """
    return _solve((H, g, G, h, A, b, lb, ub), "Hg", initvals, tolerance, time_limit, raise_on_failure)


@np.errstate(all="ignore")  # units may leave the range of floats
def solve_program(
    program: Program,
    *,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    before: ProgramRun | None = None,
    start: Vector | None = None,
    start_time: float | None = None,
    convex: bool = True,
) -> tuple[ProgramSolution, ProgramRun | None]:
    """Solve an affine variational inequality.

    Parameters
    ----------
    program
        The variational inequality; if H is not positive semidefinite, the methods may fail.
    tolerance
        The largest violation of a condition as a share of its terms, up to rounding.
    time_limit
        In seconds from `start_time`.
    before
        The run on a program of the same size, whose best iterate is the start.
    start
        An x near the solution.
    start_time
        Time of `work.clock()` at which the limit starts; now by default.
    convex
        Whether to skip the check of H, which raises InputError if H is not symmetric or proved not semidefinite.

    Returns
    -------
    solution : ProgramSolution
        Its status is "optimal" if the violation is within the tolerance, "optimal_inaccurate" if it is within 1e-4.
        "infeasible" and "unbounded" are proved; for the latter a feasible x was computed. With "_inaccurate" they are
        proved up to rounding. The others are "infeasible_or_unbounded", "user_limit" and "solver_error".
    run : ProgramRun or None
        The value of `before` for the next program; the `before` of this one if the time limit precluded a run.

    Raises
    ------
    InputError
        Where a limit is wrong; unless `convex`, where H is not symmetric, or proved not to be semidefinite.
    Interrupted
        After Ctrl-C, with the solution so far.
    """
    start_time = work.clock() if start_time is None else start_time
    with program_limits(tolerance, time_limit, start_time):
        try:
            if not convex:
                check_convex(program)
            presolve = Presolve(program)
            run = ProgramRun(presolve.program, tolerance, before)
        except OutOfTime as error:  # return the x within the bounds that is nearest to 0
            z = np.concatenate([np.clip(0.0, program.low, program.high), np.zeros(program.d.size)])
            message = f"before the first iterate: {error}"
            values = (z, np.zeros(program.g.size), "user_limit", message, np.inf, 0)
            return _solution(program, start_time, *values), before
        if not presolve.contradiction:  # bounds that cross only by rounding errors are set to the same value
            program = replace(program, low=np.minimum(program.low, program.high))
        try:
            status, message = ("infeasible", presolve.contradiction) if presolve.contradiction else run.verdict(start)
        except (KeyboardInterrupt, OutOfTime) as error:
            status = "user_limit"
            message = str(error) if isinstance(error, OutOfTime) else INTERRUPTED
    z, box = presolve.postsolve(*run.values())
    violation = run.violation.rounded
    if status.startswith(("infeasible", "unbounded")):  # proved: there is no solution
        z[:] = np.nan
        box[:] = np.nan
        violation = np.nan
    answer = _solution(program, start_time, z, box, status, message, violation, run.iterations)
    if message == INTERRUPTED:
        raise Interrupted(answer)
    return answer, run


def _solution(
    program: Program, start_time: float, z: Vector, box: Vector, status: str, message: str, violation: float, steps: int
) -> ProgramSolution:
    """The solution with x and the multipliers of rows in `z`, and those of bounds in `box`."""
    x, y, multiplier = np.split(z, [box.size, box.size + program.equations])
    value = program.objective(x)
    seconds = work.clock() - start_time
    return ProgramSolution(x, y, multiplier, box, value, status, message, violation, steps, seconds, program)


def _solve(
    data: tuple[Any, ...], names: str, initvals: Any, tolerance: Any, time_limit: Any, raise_on_failure: Any
) -> ProgramSolution:
    start_time = work.clock()
    as_truth(raise_on_failure, "raise_on_failure")
    program = read(data, names, initvals)
    start = None if initvals is None else as_vector(initvals, program.g.size, "initvals")
    try:
        solution, _ = solve_program(
            program,
            tolerance=tolerance,
            time_limit=time_limit,
            start=start,
            start_time=start_time,
            convex=names != "Pq",
        )
    except Interrupted as error:
        solution = error.report
    if raise_on_failure and not solution.solved:
        raise NotSolved(solution)
    return solution
