"""A time limit for foreign code that cannot be interrupted."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator
from typing import TypeVar

from ..algebra.factor_costs import factor_costs
from ..errors import OutOfTime
from ..numerics.processes import CAN_FORK, in_a_process
from ..problem.data import ProblemData

_T = TypeVar("_T")

#: ten times the measured cost of a solver's set-up, which cannot be interrupted, in factorisations by BLAS, and beside
#: them in nanoseconds for each entry of A: OSQP and CVXPY at n = 1000, dense, and for the membrane with n = 40 000
_SETUP_FACTORISATIONS = 250.0
_SETUP_COST_PER_ENTRY = 30_000.0


def time_limited(items: Callable[[], Iterator[_T]], problem: ProblemData, setups: int, end: float) -> Iterator[_T]:
    """Iterate over the `items`, in a separate process if the set-ups may exceed the time limit.

    In this process, the iteration does not stop at the `end` by itself.

    Parameters
    ----------
    items : callable
        Makes the iterator; what it yields is pickled.
    problem : ProblemData
        The problem to solve.
    setups : int
        The number of set-ups of solvers.
    end : float
        The end of the time limit, on the clock `time.perf_counter`.

    Raises
    ------
    OutOfTime
        At the `end`, or at once where a process cannot be forked.
    ChildProcessError
        Where the process died.
    """
    piece = _SETUP_FACTORISATIONS * factor_costs(problem.matrix).first + _SETUP_COST_PER_ENTRY * problem.matrix.nnz
    if setups * piece <= 1e9 * (end - time.perf_counter()):
        return items()
    if not CAN_FORK:
        raise OutOfTime("the solvers may take longer, and cannot be interrupted on this system")
    return in_a_process(items, end)
