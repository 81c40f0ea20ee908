"""Thousands of problems at once: right-hand sides, obstacles or parameter values, in compiled code where it can be."""

from __future__ import annotations

from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.affine_lcp import PIVOT_UP_TO, PIVOTS, AffineLcp
from ..errors import InputError, MapError, NotApplicable, NotSolved
from ..methods.tridiagonal import Tridiagonal
from ..numerics import work
from ..numerics.arrays import ReadOnly, Vector, as_array, as_real, axes, norm
from ..numerics.rounding import sheltered
from ..numerics.threads import cores, in_parts
from ..problem.data import ProblemData
from ..problem.map import Map
from .driver import solve
from .goal import RTOL, Limits
from .solution import Status

Matrix = NDArray[np.float64]

#: Newton's steps that a row may take where A is tridiagonal, before `solve` has a try at it
_STEPS = 50
#: so many rows, or unknowns where A is tridiagonal, are worth a thread of their own
ROWS_A_THREAD, UNKNOWNS_A_THREAD = 200, 20_000


@dataclass(frozen=True, eq=False)
class Solutions(ReadOnly):
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


@sheltered
def solve_many(
    A: Any,
    Q: Any,
    psi: Any = 0.0,
    *,
    Z0: Any = None,
    rtol: float = RTOL,
    atol: float = 0.0,
    time_limit: float | None = None,
    raise_on_failure: bool = True,
) -> Solutions:
    """Solve k problems, row i of `Q` with A and ψ, or with the i-th of those that are lists, as `solve` would each.

    Where they share A, and ψ is affine or amounts to fixed obstacles, problems with n ≤ 64 are pivoted (see `Lemke`),
    and those with a tridiagonal A go the way of `Tridiagonal`: all of them in a few compiled calls on all cores. What
    these leave open, and all other problems, `solve` gets one by one: what is known of a shared A is kept from row to
    row, and the start is the row of `Z0`, or the answer of the row before. Ctrl-C leaves the rows that are solved.

    Parameters: `A` as for `ICP`, or a list of k of them; `Q` shape (k, n), or (n,) where A or psi are k; `psi` as for
    `ICP`, or obstacles of shape (k, n), −inf for none, or a list of k maps; `Z0` starts of shape (k, n) or (n,), or
    earlier `Solutions`; `rtol` and `atol`: row i is solved where Res(z) ≤ max(atol, rtol·Res(0)); `time_limit` in
    seconds, after which no row is begun that is not solved at once.
    Returns `Solutions`. Raises InputError for wrong shapes, NotSolved, which carries them, where a row is not solved
    unless `raise_on_failure` is False, and what else `solve` raises.
    Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4.

    >>> solve_many([[2, -1], [-1, 2]], [[-1, 3], [3, -1], [-1, -1]]).Z
    array([[0.5, 0. ],
           [0. , 0.5],
           [1. , 1. ]])
    >>> solve_many([[[2.0]], [[4.0]]], [-2.0]).Z.ravel()
    array([1. , 0.5])
    """
    Limits(rtol=rtol, atol=atol, max_iter=0, time_limit=time_limit)
    solutions = Batch(A, Q, psi, Z0, rtol, atol, np.inf if time_limit is None else time_limit).solutions()
    if raise_on_failure and solutions.messages:
        raise NotSolved(solutions)
    return solutions


def _rows(value: Any, name: str, infinite: float) -> Matrix:
    """`value` as a float64 matrix, one row per problem, checked; +inf as `infinite` stands for none."""
    array = np.array(as_real(as_array(value, name), name), dtype=np.float64)
    if array.ndim not in (1, 2) or array.size == 0:
        raise InputError(f"{name} has shape {array.shape}; one row per problem was expected")
    array = np.atleast_2d(array)
    right = np.isfinite(array) | (np.isneginf(array) & (infinite < 0))
    if not right.all():
        i, j = np.argwhere(~right)[0]
        raise InputError(f"{name}[{i}, {j}] is {array[i, j]}; a finite number was expected")
    return array


def _each(value: Any, is_one: Callable[[Any], bool]) -> list[Any] | None:
    """The items of a list of which each is a value of its own; None for a single value."""
    listed = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)
    return list(value) if listed and len(value) and is_one(value[0]) else None


def _common(**several: Any) -> int:
    """How many problems there are, by the lists that are not None. Raises InputError where they differ."""
    counts = {name: len(values) for name, values in several.items() if values is not None}
    k = max(counts.values())
    if not set(counts.values()) <= {1, k}:
        found = ", ".join(f"{count} of {name}" for name, count in counts.items())
        raise InputError(f"there are {found}; as many of each were expected, or one for all")
    return k


class Batch:
    """The rows of one `solve_many` and what is found for them."""

    def __init__(self, A: Any, Q: Any, psi: Any, Z0: Any, rtol: float, atol: float, time_limit: float = np.inf) -> None:
        self.clock, Q = work.clock(), _rows(Q, "Q", np.inf)
        self.psi, self.rtol, self.atol, self.time_limit = psi, rtol, atol, time_limit
        self.matrices = _each(A, lambda one: axes(one, "A") == 2)
        self.maps = _each(psi, lambda one: isinstance(one, Map) or callable(one))
        self.obstacles: Matrix | None = None
        if self.maps is None and isinstance(psi, list | tuple | np.ndarray) and axes(psi, "psi") == 2:
            self.obstacles = _rows(psi, "psi", -np.inf)
            self.maps = list(self.obstacles)
        self.starts = None if Z0 is None else _rows(getattr(Z0, "Z", Z0), "Z0", np.inf)
        k = _common(A=self.matrices, Q=Q, psi=self.maps, Z0=self.starts)
        self.problem = ProblemData(A if self.matrices is None else self.matrices[0], Q[0], self._psi(0))
        if self.starts is not None:
            self.problem.vector(self.starts[0], "Z0")  # has the right length
        shape = k, self.problem.n
        self.Q, self.Z = np.broadcast_to(Q, shape), np.zeros(shape)
        self.residuals, self.tolerances = np.full(k, np.inf), np.zeros(k)
        self.solved = np.zeros(k, dtype=bool)
        self.failures: dict[int, tuple[Status, str]] = {}

    def _psi(self, row: int) -> Any:
        """ψ of one row."""
        return self.psi if self.maps is None else self.maps[row if len(self.maps) > 1 else 0]

    def at_once(self) -> None:
        """All rows in compiled code, where there is some for them; a row is solved where its residual says so."""
        problem = self.problem
        affine = problem.psi.linear is not None and not problem.psi.is_constant
        shared = self.matrices is None and (self.maps is None or self.obstacles is not None)
        if not shared or not (affine or problem.facts.has_fixed_obstacle):
            return
        small = problem.n <= PIVOT_UP_TO
        if not small and (affine or Tridiagonal().why_not(problem) is not None):
            return
        with np.errstate(over="ignore", invalid="ignore"), suppress(MapError):
            c: Any = self.obstacles
            if affine and problem.psi.linear is not None:
                c = problem.psi.linear[1]
            elif c is None:
                c = problem.facts.obstacle
            C = np.broadcast_to(c, self.Q.shape)
            if small:
                self._pivot(C)
            else:
                self._solve_tridiagonal(C)
        self.solved = self.residuals <= self.tolerances

    def _values(self, Z: Matrix, C: Matrix) -> Matrix:
        """ψ(z), row by row."""
        psi = self.problem.psi
        if psi.is_constant:
            return C
        return (psi.linear[0] @ Z.T).T + psi.linear[1] if psi.linear else np.array([psi.value(z) for z in Z])

    def _pivot(self, C: Matrix) -> None:
        """The rows by Lemke's method."""
        from ..numerics.kernels.products import judge  # loads numba

        problem, Q, A = self.problem, self.Q, self.problem.dense()
        moves = problem.psi.linear is not None and not problem.psi.is_constant
        G = problem.psi.linear[0].toarray() if moves and problem.psi.linear else None
        lcp = AffineLcp(A, Q[0], C[0], G)
        at_0, zero, parts = np.empty(len(Q)), np.broadcast_to(0.0, Q.shape), min(cores(), -(-len(Q) // ROWS_A_THREAD))
        self.Z = np.ascontiguousarray(lcp.back(self.pivoted(lcp, C, parts)))
        there, here = (np.broadcast_to(self._values(Z, C), Q.shape) for Z in (zero[:1], self.Z))

        def look(low: int, high: int) -> None:
            judge(A, Q[low:high], here[low:high], self.Z[low:high], self.residuals[low:high])
            judge(A, Q[low:high], there[low:high], zero[low:high], at_0[low:high])

        in_parts(len(Q), parts, look)
        self.tolerances = np.maximum(self.atol, self.rtol * at_0)

    def pivoted(self, lcp: AffineLcp, C: Matrix, parts: int) -> Matrix:
        """What the pivots make of the rows, each an LCP of its own."""
        from ..numerics.kernels.balancing import scale
        from ..numerics.kernels.pivoting import many  # loads numba

        Q, X, scaled, limit = self.Q, np.empty(self.Q.shape), scale(lcp.M), PIVOTS * (self.problem.n + 1)
        in_parts(len(Q), parts, lambda low, high: many(*scaled, lcp.M, Q[low:high], C[low:high], limit, X[low:high]))
        return X

    def _solve_tridiagonal(self, C: Matrix) -> None:
        """The rows by the direct method for tridiagonal A."""
        from ..numerics.kernels.thomas import bands, many  # loads numba

        A, Q, Z, k = self.problem.A, self.Q, self.Z, len(C)
        matrix = bands(A.indptr, A.indices, A.data)
        in_parts(
            k,
            min(cores(), k, -(-Z.size // UNKNOWNS_A_THREAD)),
            lambda low, high: many(*matrix, Q[low:high], C[low:high], _STEPS, Z[low:high]),
        )
        here, there = self._values(Z, C), np.broadcast_to(self._values(np.zeros((1, self.problem.n)), C), C.shape)
        for row, (z, q) in enumerate(zip(Z, Q, strict=True)):
            self.residuals[row] = norm(np.minimum(self.problem.product(z) + q, z - here[row]))
            self.tolerances[row] = max(self.atol, self.rtol * norm(np.minimum(q, -there[row])))

    def solve(self, row: int) -> None:
        """One row by `ICP.solve`; none where an earlier one was interrupted."""
        if any(status is Status.INTERRUPTED for status, _ in self.failures.values()):
            self.failures[row] = Status.INTERRUPTED, "an earlier row was interrupted"
            return
        left = self.time_limit - (work.clock() - self.clock)
        if left <= 0.0:
            self.failures[row] = Status.TIME_LIMIT, f"time_limit = {self.time_limit:g} s was over before its turn"
            return
        problem, start = self._problem(row), self.start(row)
        limit = left if left < np.inf else None
        options: Any = {"rtol": self.rtol, "atol": self.atol, "time_limit": limit, "raise_on_failure": False}
        try:
            try:
                solution = solve(problem, z0=start, **options)
            except MapError:
                if start is None or self.starts is not None:
                    raise
                solution = solve(problem, **options)  # psi of this row has no value at the answer of the one before
        except MapError as error:
            self.failures[row] = Status.MAP_FAILED, str(error)
            return
        except NotApplicable as error:
            self.failures[row] = Status.STAGNATED, str(error)
            return
        except KeyboardInterrupt:  # before there was an iterate
            self.failures[row] = Status.INTERRUPTED, "interrupted by Ctrl-C before its first iterate"
            return
        self.Z[row], self.residuals[row], self.tolerances[row] = solution.z, solution.residual, solution.tolerance
        self.solved[row] = solution.solved
        if not solution.solved:
            self.failures[row] = solution.status, solution.message

    def start(self, row: int) -> Vector | None:
        """Where `solve` begins."""
        if self.starts is not None:
            return np.asarray(self.starts[row if len(self.starts) > 1 else 0])
        return self.Z[row - 1] if row and self.solved[row - 1] else None

    def _problem(self, row: int) -> ProblemData:
        """The problem of one row, which shares with the others what they have in common."""
        if self.matrices is not None and len(self.matrices) > 1:
            return ProblemData(self.matrices[row], self.Q[row], self._psi(row))
        problem = self.problem.with_q(self.Q[row])
        return problem if self.maps is None else problem.with_psi(self._psi(row))

    def solutions(self) -> Solutions:
        """All rows, at once where that can be, the others one by one."""
        self.at_once()
        for left_open in np.flatnonzero(~self.solved):
            self.solve(int(left_open))
        self.Z.flags.writeable = False
        statuses = [Status.SOLVED] * len(self.Z)
        for row, (status, _) in self.failures.items():
            statuses[row] = status
        messages = {row: message for row, (_, message) in self.failures.items()}
        seconds = work.clock() - self.clock
        return Solutions(self.Z, tuple(statuses), self.residuals, self.tolerances, seconds, messages)
