"""icpmodel as a solver of CVXPY: convex quadratic programs as ICPs, with proofs where there is no solution."""

from __future__ import annotations

from functools import cache
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy import settings as s
from cvxpy.reductions.solution import Solution as CvxpySolution
from cvxpy.reductions.solution import failure_solution
from cvxpy.reductions.solvers import utilities
from cvxpy.reductions.solvers.qp_solvers.qp_solver import QpSolver

from ...errors import InputError, check_arguments
from ...present.display import counted
from ..programs.program import Program
from ..programs.solve_qp import ProgramSolution, solve_program

_OPTIONS = ("tolerance", "time_limit")


class IcpSolver(QpSolver):
    """CVXPY's interface to `solve_program`; `cvxpy_solver` makes one."""

    #: bounds are passed as rows: CVXPY 1.9.3 computes wrong bounds for some expressions, as NaN (0 · ∞) counts as one
    BOUNDED_VARIABLES = False

    def name(self) -> str:
        return "ICPMODEL"

    def import_solver(self) -> None:
        """Import nothing: icpmodel is loaded."""

    def cite(self, data: Any) -> str:
        return ""

    def solve_via_data(
        self, data: Any, warm_start: bool, verbose: bool, solver_opts: Any, solver_cache: Any = None
    ) -> ProgramSolution:
        """Solve the compiled data; store the run in `solver_cache`. Raises InputError (wrong option), SolverError."""
        for option in solver_opts:
            if option not in _OPTIONS:
                raise InputError(f"the solver ICPMODEL has no option {option}; it takes {', '.join(_OPTIONS)}")
        before = solver_cache.get(self.name()) if warm_start and solver_cache is not None else None
        solution, run = solve_program(program_of(data), before=before, **solver_opts)
        if solver_cache is not None:
            solver_cache[self.name()] = run
        if verbose:
            print(f"icpmodel: {solution.status} after {counted(solution.iterations, 'step')}: {solution.message}")
        if solution.status == s.SOLVER_ERROR:
            raise cp.SolverError(f"icpmodel: {solution.message}")
        return solution

    def invert(self, solution: ProgramSolution, inverse_data: Any) -> CvxpySolution:
        attributes = {s.SOLVE_TIME: solution.seconds, s.NUM_ITERS: solution.iterations, s.EXTRA_STATS: solution}
        if solution.status not in s.SOLUTION_PRESENT:
            return failure_solution(solution.status, attributes)
        duals: dict[Any, Any] = {}
        for values, key in ((solution.y, self.EQ_CONSTR), (solution.z, self.NEQ_CONSTR)):
            duals |= utilities.get_dual_values(values, utilities.extract_dual_value, inverse_data[key])
        value = solution.objective + inverse_data[s.OFFSET]
        return CvxpySolution(solution.status, value, {self.VAR_ID: solution.x}, duals, attributes)


@cache
@check_arguments
def cvxpy_solver() -> IcpSolver:
    """icpmodel as a solver for CVXPY's `Problem.solve(solver=…)`: convex quadratic and linear programs.

    The conditions of optimality are an ICP, which `icpmodel.solve` solves. CVXPY has checked that P is semidefinite.
    Duals are returned. "infeasible" and "unbounded" are proved, "infeasible_inaccurate" and "unbounded_inaccurate" up
    to rounding. `Problem.solve` takes the options `tolerance` and `time_limit`. With the default tolerance, 1e-9, no
    condition is violated by more than 1e-9 of its terms, up to rounding. After `time_limit` seconds the status is
    "user_limit", and the variables have the values of the best iterate. With `warm_start`, the default, a further solve
    starts from the last solution and reuses the facts about the matrices. The function always returns the same object,
    by which CVXPY recognises that a problem with parameters is already compiled.

    Examples
    --------
    >>> import cvxpy as cp
    >>> x = cp.Variable(2)
    >>> problem = cp.Problem(
    ...     cp.Minimize(cp.sum_squares(x - [3, 0])), [cp.sum(x) == 1, x >= 0]
    ... )
    >>> round(problem.solve(solver=icp.cvxpy_solver()), 6), x.value.round(6) + 0.0
    (4.0, array([1., 0.]))
    """
    return IcpSolver()


def program_of(data: Any) -> Program:
    """The program of CVXPY's compiled data."""
    P, A, F = (sp.csr_array(data[key], dtype=np.float64) for key in (s.P, s.A, s.F))
    for M in (P, A, F):
        M.sum_duplicates()
        M.eliminate_zeros()
    q, b, g = (np.asarray(data[key], dtype=np.float64) for key in (s.Q, s.B, s.G))
    none = np.full(q.size, np.inf)
    return Program.of_rows(P, q, (A, b), (F, g), -none, none)
