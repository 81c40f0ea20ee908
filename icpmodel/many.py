"""Many problems that share A: thousands of right-hand sides or obstacles, solved by compiled code where n is small."""

from __future__ import annotations

import time
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .arrays import Vector
from .driver import RTOL
from .errors import InputError, NotSolved
from .loop import Limits
from .maps import Constant
from .methods.choose import PIVOT_UP_TO
from .problem import ICP
from .solution import Status
from .threads import cores, in_parts

Matrix = NDArray[np.float64]

#: pivots that a row may take, in multiples of n + 1, before `solve` has a try at it
_PIVOTS = 50
#: so many rows are worth a thread of their own
_ROWS_A_THREAD = 200


@dataclass(frozen=True, eq=False)
class Solutions:
    """The answers of `solve_many`, one row per problem.

    `Z` shape (k, n), read-only; `statuses` k members of `Status`; `residuals` = Res(z) of the returned rows, recomputed
    from (A, q, ψ, z), and the `tolerances` they were held against, shape (k,) each; `seconds` of the whole;
    `messages` what went wrong, by row.

    >>> solve_many([[2.0]], [[-2.0], [3.0]]).Z
    array([[1.],
           [0.]])
    """

    Z: Matrix
    statuses: tuple[Status, ...]
    residuals: Vector
    tolerances: Vector
    seconds: float
    messages: dict[int, str] = field(repr=False)

    @property
    def failed(self) -> list[int]:
        """The rows whose status is not SOLVED.

        >>> solve_many([[-1.0]], [[1.0], [-1.0]], raise_on_failure=False).failed
        [1]
        """
        return sorted(self.messages)

    @property
    def message(self) -> str:
        """What went wrong, in one sentence.

        >>> solve_many([[2.0]], [[-2.0], [3.0]]).message
        'all 2 rows are solved'
        """
        if not self.messages:
            return f"all {len(self.Z)} rows are solved"
        first = self.failed[0]
        return f"{len(self.messages)} of {len(self.Z)} rows failed, first row {first}: {self.messages[first]}"

    def __repr__(self) -> str:
        return f"Solutions(k={self.Z.shape[0]}, n={self.Z.shape[1]}, {self.message}, seconds={self.seconds:.3g})"


def solve_many(
    A: Any,
    Q: Any,
    psi: Any = 0.0,
    *,
    rtol: float = RTOL,
    atol: float = 0.0,
    raise_on_failure: bool = True,
) -> Solutions:
    """Solve the k problems that share A, row i of `Q` with ψ or with row i of the obstacles, as `solve` would each.

    An LCP with n ≤ 64 is pivoted (see `Lemke`), all of them in a few compiled calls on all cores. What these leave
    open, and all other problems, `solve` gets one by one: what is known of A is kept from row to row, and the start is
    the answer of the row before.

    Parameters: `A` as for `ICP`; `Q` shape (k, n), or (n,) with k rows of obstacles; `psi` as for `ICP`, or obstacles
    of shape (k, n), −inf for none; `rtol` and `atol`: row i is solved where Res(z) ≤ max(atol, rtol·Res(0)).
    Returns `Solutions`. Raises InputError for wrong shapes, NotSolved, which carries them, where a row is not solved
    unless `raise_on_failure` is False, and what else `solve` raises.
    Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4.

    >>> solve_many([[2, -1], [-1, 2]], [[-1, 3], [3, -1], [-1, -1]]).Z
    array([[0.5, 0. ],
           [0. , 0.5],
           [1. , 1. ]])
    """
    clock = time.perf_counter()
    Limits(rtol=rtol, atol=atol, max_iter=0, time_limit=None)
    Q = _rows(Q, "Q", np.inf)
    obstacles = None
    if np.ndim(psi) == 2 and not sp.issparse(psi):
        obstacles = _rows(psi, "psi", -np.inf)
        if obstacles.shape[1] != Q.shape[1] or (len(obstacles) != len(Q) and 1 not in (len(obstacles), len(Q))):
            raise InputError(f"psi has shape {obstacles.shape}; shape {Q.shape} was expected")
    k = max(len(Q), 1 if obstacles is None else len(obstacles))
    problem = ICP(A, Q[0], psi if obstacles is None else obstacles[0])
    job = _Job(problem, np.broadcast_to(Q, (k, problem.n)), obstacles, rtol, atol)
    if problem.is_lcp and problem.n <= PIVOT_UP_TO:
        job.pivot()
    for row in np.flatnonzero(~job.solved):
        job.solve(int(row))
    solutions = job.solutions(clock)
    if raise_on_failure and solutions.messages:
        raise NotSolved(solutions)
    return solutions


def _rows(value: Any, name: str, infinite: float) -> Matrix:
    """`value` as a float64 matrix, one row per problem, checked; +inf as `infinite` stands for none."""
    try:
        array = np.array(value, dtype=np.float64)
    except (TypeError, ValueError):
        raise InputError(f"{name} cannot be read as rows of real numbers") from None
    if array.ndim not in (1, 2) or array.size == 0:
        raise InputError(f"{name} has shape {array.shape}; one row per problem was expected")
    array = np.atleast_2d(array)
    right = np.isfinite(array) | (np.isneginf(array) & (infinite < 0))
    if not right.all():
        i, j = np.argwhere(~right)[0]
        raise InputError(f"{name}[{i}, {j}] is {array[i, j]}; a finite number was expected")
    return array


class _Job:
    """The rows of one `solve_many` and what is found for them."""

    def __init__(self, problem: ICP, Q: Matrix, obstacles: Matrix | None, rtol: float, atol: float) -> None:
        self.problem, self.Q, self.obstacles, self.rtol, self.atol = problem, Q, obstacles, rtol, atol
        self.Z = np.zeros(Q.shape)
        self.residuals, self.tolerances = np.full(len(Q), np.inf), np.zeros(len(Q))
        self.solved = np.zeros(len(Q), dtype=bool)
        self.failures: dict[int, tuple[Status, str]] = {}

    def pivot(self) -> None:
        """All rows by Lemke's method; a row counts as solved where its residual says so."""
        from .kernels.judging import judge  # loads numba
        from .kernels.pivoting import many
        from .kernels.units import scale

        assert isinstance(self.problem.psi, Constant)
        Q, n, M = self.Q, self.problem.n, self.problem.dense()
        C = np.broadcast_to(self.problem.psi.c if self.obstacles is None else self.obstacles, Q.shape)
        at_0, zero = np.empty(len(Q)), np.broadcast_to(np.zeros(n), Q.shape)

        def pivot(low: int, high: int) -> None:
            q, c, z = Q[low:high], C[low:high], self.Z[low:high]
            many(*scaled, M, q, c, _PIVOTS * (n + 1), z)
            judge(M, q, c, z, self.residuals[low:high])
            judge(M, q, c, zero[low:high], at_0[low:high])

        with np.errstate(over="ignore", invalid="ignore"):
            scaled = scale(M)
            in_parts(len(Q), min(cores(), -(-len(Q) // _ROWS_A_THREAD)), pivot)
            self.tolerances = np.maximum(self.atol, self.rtol * at_0)
        self.solved = self.residuals <= self.tolerances

    def solve(self, row: int) -> None:
        """One row by `ICP.solve`, from the answer of the row before."""
        problem = self.problem.with_q(self.Q[row])
        if self.obstacles is not None:
            problem = problem.with_psi(self.obstacles[row if len(self.obstacles) > 1 else 0])
        start = self.Z[row - 1] if row and self.solved[row - 1] else None
        solution = problem.solve(z0=start, rtol=self.rtol, atol=self.atol, raise_on_failure=False)
        self.Z[row], self.residuals[row], self.tolerances[row] = solution.z, solution.residual, solution.tolerance
        self.solved[row] = solution.solved
        if not solution.solved:
            self.failures[row] = solution.status, solution.message

    def solutions(self, clock: float) -> Solutions:
        """What was found, `clock` being the time of the start."""
        self.Z.flags.writeable = False
        statuses = [Status.SOLVED] * len(self.Z)
        for row, (status, _) in self.failures.items():
            statuses[row] = status
        messages = {row: message for row, (_, message) in self.failures.items()}
        seconds = time.perf_counter() - clock
        return Solutions(self.Z, tuple(statuses), self.residuals, self.tolerances, seconds, messages)
