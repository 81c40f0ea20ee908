"""icpmodel as a solver of qpsolvers.

qpsolvers has no function that adds a solver, but its tables of solvers are public: the dictionary
`qpsolvers.solvers.solve_function` and the lists of names beside it.
"""

from __future__ import annotations

from typing import Any

from ...errors import InputError, NotApplicable, check_arguments
from ...present.display import counted
from .solve_qp import solve_qp

NAME = "icpmodel"


@check_arguments
def qpsolvers_solver() -> str:
    """Register icpmodel with qpsolvers: `qpsolvers.solve_qp(…, solver=icp.qpsolvers_solver())`.

    The options are `tolerance` and `time_limit`. The `extras` of the qpsolvers `Solution` hold the status, the
    message and the violation.

    Returns
    -------
    str
        The name of the solver in qpsolvers, "icpmodel".

    Raises
    ------
    NotApplicable
        Where qpsolvers is not installed.

    References
    ----------
    Caron and others, qpsolvers, https://github.com/qpsolvers/qpsolvers.

    Examples
    --------
    >>> from importlib.util import find_spec
    >>> icp.qpsolvers_solver() if find_spec("qpsolvers") else "icpmodel"
    'icpmodel'
    """
    try:
        from qpsolvers import solvers
    except ImportError as error:
        raise NotApplicable("qpsolvers is not installed: pip install qpsolvers") from error
    solvers.solve_function[NAME] = _solve_problem
    for names in (solvers.available_solvers, solvers.dense_solvers, solvers.sparse_solvers):
        if NAME not in names:
            names.append(NAME)
    return NAME


def _solve_problem(problem: Any, initvals: Any = None, verbose: bool = False, **options: Any) -> Any:
    """Solve a `problem` of qpsolvers and return its `Solution`. Raises ProblemError for wrong arguments."""
    from qpsolvers import Solution
    from qpsolvers.exceptions import ProblemError

    try:
        answer = solve_qp(*problem.unpack(), initvals=initvals, raise_on_failure=False, **options)
    except (InputError, TypeError) as error:  # TypeError: for example, an argument that is given twice
        raise ProblemError(str(error)) from error
    if verbose:
        print(f"icpmodel: {answer.status} after {counted(answer.iterations, 'step')}: {answer.message}")
    solution = Solution(problem, found=answer.solved, solve_time=answer.seconds)
    solution.extras = {"status": answer.status, "message": answer.message, "violation": answer.violation}
    if answer.solved:
        solution.x, solution.y, solution.z, solution.z_box = answer.x, answer.y, answer.z, answer.z_box
        solution.obj = answer.objective
    return solution
