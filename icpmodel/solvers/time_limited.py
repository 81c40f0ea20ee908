"""Foreign work that nothing can stop, within a limit of time."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from ..algebra.factor_costs import factor_costs
from ..errors import OutOfTime
from ..numerics.processes import CAN_FORK, in_a_process
from ..problem.data import ProblemData

_T = TypeVar("_T")

#: ten times what a solver was measured to set up in one piece, in factorisations by BLAS, and in nanoseconds for each
#: entry of A beside them: OSQP and CVXPY at n = 1000, dense, and for the membrane with n = 40 000
_SETUP_FACTORISATIONS = 250.0
_SETUP_COST_PER_ENTRY = 30_000.0


def time_limited(items: Callable[[], Iterator[_T]], problem: ProblemData, setups: int, end: float) -> Iterator[_T]:
    """Yield the `items`, from a separate process if a single step may exceed the time limit.

    Parameters
    ----------
    items : callable
        Makes the iterator; what it yields is pickled.
    problem : ProblemData
        What is solved.
    setups : int
        How many solvers are set up.
    end : float
        When the time is over, as `time.perf_counter` says it.

    Raises
    ------
    OutOfTime
        At the `end`, or at once where there are no processes.
    ChildProcessError
        Where the process died.
    """
    piece = _SETUP_FACTORISATIONS * factor_costs(problem.matrix).first + _SETUP_COST_PER_ENTRY * problem.matrix.nnz
    if setups * piece <= 1e9 * (end - time.perf_counter()):
        return items()
    if not CAN_FORK:
        raise OutOfTime("the solvers may take longer, and cannot be interrupted on this system")
    return in_a_process(items, end)
