"""The rows of one `solve_many`, in compiled code where it can be, and else one by one."""

from __future__ import annotations

import logging
from collections.abc import Callable
from contextlib import suppress
from functools import partial
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.affine_lcp import PIVOT_UP_TO, PIVOTS, AffineLcp
from ...errors import InputError, MapError, NotApplicable, OutOfTime, SingularOperator
from ...methods.contract import Method
from ...methods.shortcuts import Lemke, Tridiagonal
from ...numerics import work
from ...numerics.arrays import Vector, as_float64, axes, read_only, row_norms, smallest_size
from ...numerics.rounding import is_ctrl_c
from ...numerics.threads import cores, in_parts
from ...problem.between import as_map, mid
from ...problem.data import ProblemData
from ...problem.map import Map
from ...problem.verdict import certain_rows
from ..driver import solve
from ..goal import Limits
from ..solution import Status
from ..solutions import Found, Solutions, Stated

_LOG = logging.getLogger("icpmodel")

Matrix = NDArray[np.float64]

#: Newton's steps that a row may take where A is tridiagonal, before `solve` has a try at it
_STEPS = 50
#: arrays of the size of Q that the rows at once take
_COPIES = 6
#: so many rows, or unknowns where A is tridiagonal, are worth a thread of their own
ROWS_A_THREAD = 200
UNKNOWNS_A_THREAD = 20_000
#: so many rows that are solved one by one start each from the answer of the one before; the next one begins anew, so
#: that a share of the rows in another process has the same answers: measured, a cold row costs .7 to 2 times as much
CHAIN = 16
#: a share of rows in compiled code is worth so many nanoseconds, some hundred times what it takes to send it
SHARE = 1e8


def _rows(value: Any, name: str, infinite: float) -> Matrix:
    """`value` as a float64 matrix, one row per problem, checked; `infinite` is allowed, 0 for neither infinity."""
    array = as_float64(value, name)
    if array.ndim not in (1, 2) or array.size == 0:
        raise InputError(f"{name} has shape {array.shape}; one row per problem was expected")
    array = np.atleast_2d(array)
    right = np.isfinite(array) | ((array == infinite) & (infinite != 0.0))
    if not right.all():
        i, j = np.argwhere(~right)[0]
        wanted = f"a finite number or {infinite}" if infinite else "a finite number"
        raise InputError(f"{name}[{i}, {j}] is {array[i, j]}; {wanted} was expected")
    return array


def _listed(value: Any, name: str, none: float) -> tuple[list[Any] | None, Matrix | None]:
    """The obstacles of `value`, one for each problem, or None; and these as a matrix where they are rows of numbers."""
    maps = _each(value, lambda one: isinstance(one, Map) or callable(one))
    if maps is None and isinstance(value, list | tuple | np.ndarray) and axes(value, name) == 2:
        rows = _rows(value, name, none)
        return list(rows), rows
    return maps, None


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

    def __init__(self, A: Any, Q: Any, psi: Any, upper: Any, Z0: Any, limits: Limits) -> None:
        self.clock, self.limits, Q = work.clock(), limits, _rows(Q, "Q", 0.0)
        matrices = _each(A, lambda one: axes(one, "A") == 2)
        self.maps, self.obstacles = _listed(psi, "psi", -np.inf)
        self.uppers, self.above = _listed(upper, "upper", np.inf)
        self.starts = None if Z0 is None else _rows(getattr(Z0, "Z", Z0), "Z0", 0.0)
        k = _common(A=matrices, Q=Q, psi=self.maps, upper=self.uppers, Z0=self.starts)
        # what is wrong in a row is said before another one is solved
        below = (psi, self.maps)
        above = (upper, self.uppers)
        of_all = limits.atol, limits.time_limit, limits.memory_limit
        self.stated = Stated([], np.broadcast_to(Q, (k, Q.shape[1])), below, above, *of_all)
        first = self.stated.sides(0)
        self.stated.problems.extend(ProblemData(one, Q[0], *first) for one in (matrices or [A]))
        self.problem = self.stated.problems[0]
        n = self.problem.n
        self.small = self.problem.n <= PIVOT_UP_TO
        self.affine = self.problem.psi.linear is not None and not self.problem.psi.is_constant
        self.compiler: Method = Lemke() if self.small else Tridiagonal()
        for name, rows in (("Z0", self.starts), ("psi", self.obstacles), ("upper", self.above)):
            if rows is not None:
                self.problem.vector(rows[0], name)  # has the right length
        if self.uppers is None and self.obstacles is None and self.maps is not None:
            self.maps[:] = [as_map(one, n) for one in self.maps]
        elif self.uppers is not None:
            for row in range(k):
                self.problem.with_sides(*self.stated.sides(row))
        #: whether compiled code may take the rows together: A, and which rows have an obstacle above, are the same
        self.together = len(self.stated.problems) == 1 and (self.maps is None or self.obstacles is not None)
        if self.uppers is not None:
            self.together &= self.above is not None and bool((np.isinf(self.above) == np.isinf(self.above[0])).all())
        self.Q, self.Z = self.stated.Q, np.zeros((k, n))
        if self.starts is not None:
            self.Z[:] = self.starts
        self.residuals, self.tolerances = np.full(k, np.inf), np.zeros(k)
        self.solved = np.zeros(k, dtype=bool)
        self.failures: dict[int, tuple[Status, str]] = {}
        self.alone: dict[int, Found] = {}
        #: the rows that compiled code has solved, and the seconds that it took
        self.interrupted, self.compiled = False, np.zeros(2)

    def elapsed(self) -> float:
        """The seconds since it began."""
        return work.clock() - self.clock

    def price(self) -> float | None:
        """What compiled code takes for a row, in nanoseconds; None where it takes none of these problems."""
        problem = self.problem
        if not self.together or not (self.affine or problem.facts.has_fixed_obstacle):
            return None
        if self.small:
            return work.COSTS.pivot_entry * problem.n**3 / 3.0
        return None if self.affine or self.compiler.why_not(problem) else work.COSTS.band_entry * 3.0 * problem.n

    def at_once(self) -> None:
        """The rows in compiled code, where there is some for them, while the limits allow it; a row is solved where its
        residual says so."""
        problem = self.problem
        psi = self.problem.psi
        small = self.small
        price = self.price()
        if price is None:
            return
        with (
            np.errstate(over="ignore", invalid="ignore"),
            suppress(MapError, SingularOperator, OutOfTime, MemoryError),  # then it is seen row by row what remains
        ):
            work.afford(memory=_COPIES * 8.0 * self.Q.size)
            C, G = self._affine(psi, self.obstacles)
            D, H = (None, None) if psi.upper is None else self._affine(psi.upper, self.above)
            above = None if D is None else (D[0], H)
            lcp = AffineLcp(problem.dense(), self.Q[0], C[0], G, above) if small else None
            piece = work.pieces(price)
            for low in range(0, len(C), piece):
                rows = slice(low, low + piece)
                work.afford(price)
                work.add(price * len(C[rows]))
                of_rows = self.Q[rows], C[rows], None if D is None else D[rows]
                Z = self.by_thomas(*of_rows) if lcp is None else lcp.back(self.pivoted(lcp, *of_rows))
                residuals, tolerances, good = self._judged(Z, *of_rows)
                self.solved[rows] = good
                for kept, found in ((self.Z, Z), (self.residuals, residuals), (self.tolerances, tolerances)):
                    kept[rows][good] = found[good]

    def _affine(self, psi: Map, rows: Matrix | None) -> tuple[Matrix, Any]:
        """c and G of one obstacle Gz + c, c row by row, be it fixed: then G is None."""
        facts = self.problem.facts
        G = None
        c = rows
        if self.affine and psi.linear is not None:
            G = psi.linear[0].toarray()
            c = psi.linear[1] if rows is None else rows
        elif rows is None:
            c = facts.obstacle if psi is self.problem.psi else facts.upper_obstacle
        return np.broadcast_to(np.asarray(c), self.Q.shape), G

    def _threads(self, Q: Matrix) -> int:
        """How many threads the rows of `Q` are worth."""
        return min(cores(), len(Q), -(-len(Q) // ROWS_A_THREAD) if self.small else -(-Q.size // UNKNOWNS_A_THREAD))

    def _values(self, psi: Map, Z: Matrix, C: Matrix) -> Matrix:
        """ψ(z), row by row."""
        if psi.is_constant:
            return C
        return (psi.linear[0] @ Z.T).T + psi.linear[1] if psi.linear else np.array([psi.value(z) for z in Z])

    def _judged(self, Z: Matrix, Q: Matrix, C: Matrix, D: Matrix | None) -> tuple[Vector, Vector, Any]:
        """The residuals of the rows `Z`, which have the obstacles `C` and `D`, what they are held against, and which
        rows are solved."""
        problem = self.problem
        psi = self.problem.psi
        upper = self.problem.upper
        zero = np.zeros((1, self.problem.n))
        here = self._values(psi, Z, C)
        p = (problem.A @ Z.T).T + Q
        above = None
        above_0 = None
        if upper is not None and D is not None:
            above = self._values(upper, Z, D)
            above_0 = -self._values(upper, zero, D)
        weights = problem.matrix.row_weights
        below = Z - here
        top = None if above is None else Z - above
        residuals = row_norms(mid(weights * p, below, top))
        below_0 = -self._values(psi, zero, C)
        at_0 = row_norms(mid(weights * Q, below_0, above_0))
        at_0[~np.isfinite(at_0)] = 0.0
        for row in np.flatnonzero(at_0 == 0.0):  # as `residual_scale` has it
            at_0[row] = smallest_size(weights * Q[row], *(X[row % len(X)] for X in (below_0, above_0) if X is not None))
        tolerances = self.limits.tolerance(at_0)
        data = [Q, C if psi.linear is not None else here, Z]
        beyond = [] if above is None or upper is None or D is None else [D if upper.linear is not None else above]

        def raised(residuals: Vector, tolerances: Vector, weights: Vector) -> Any:
            """Which rows are within their tolerances, by bounds of the exact residuals."""
            of_rows = [*data, residuals, tolerances, *beyond]
            look = partial(certain_rows, problem.matrix, psi, weights=weights)
            in_parts(len(Q), self._threads(Q), lambda low, high: look(*(X[low:high] for X in of_rows)))
            return residuals <= tolerances

        solved = raised(residuals, tolerances, weights)
        if self.limits.atol:
            paper = row_norms(mid(p, below, top))
            solved |= raised(paper, np.full(len(Q), self.limits.atol), np.ones(problem.n))
        return residuals, tolerances, solved

    def pivoted(self, lcp: AffineLcp, Q: Matrix, C: Matrix, D: Matrix | None) -> Matrix:
        """What the pivots make of the rows, each an LCP of its own."""
        from ...algebra.kernels.balancing import scale
        from ...algebra.kernels.pivoting import many  # loads numba

        if D is not None:
            Q = lcp.extended(Q, D)
            C = np.concatenate([C, np.zeros((len(C), len(lcp.q) - lcp.n))], axis=1)
        M, Q, C = read_only((lcp.M, Q, C))
        X = np.empty(Q.shape)
        scaled = scale(M)
        limit = PIVOTS * (M.shape[0] + 1)
        rows = lambda low, high: many(*scaled, M, Q[low:high], C[low:high], limit, X[low:high])  # noqa: E731
        in_parts(len(Q), self._threads(Q), rows)
        return X

    def by_thomas(self, Q: Matrix, C: Matrix, D: Matrix | None) -> Matrix:
        """What the direct method for tridiagonal A makes of the rows."""
        from ...algebra.kernels.tridiagonal import bands, many  # loads numba

        A = self.problem.A
        Z = np.zeros(Q.shape)
        Q, C, D = read_only((Q, C, D))
        matrix = bands(A.indptr, A.indices, A.data)
        parts = lambda low, high: (Q[low:high], C[low:high], None if D is None else D[low:high], _STEPS, Z[low:high])  # noqa: E731
        in_parts(len(Q), self._threads(Q), lambda *part: many(*matrix, *parts(*part)))
        return Z

    def solve(self, row: int) -> None:
        """One row by `ICP.solve`; none where an earlier one was interrupted."""
        if self.interrupted:
            self.failures[row] = Status.INTERRUPTED, "an earlier row was interrupted"
            return
        limits = self.limits
        left = None
        if limits.time_limit is not None:
            left = limits.time_limit - self.elapsed()
            if left <= 0.0:
                self.failures[row] = Status.TIME_LIMIT, f"time_limit = {limits.time_limit:g} s was over before its turn"
                return
        free = None if limits.memory_limit is None else work.free_memory()
        options: Any = {"rtol": limits.rtol, "atol": limits.atol, "time_limit": left, "memory_limit": free}
        try:
            problem = self.stated.problem(row)
            start = self.start(row, problem)
            try:
                solution = solve(problem, z0=start, raise_on_failure=False, **options)
            except MapError:
                if start is None or self.starts is not None:
                    raise
                # psi of this row has no value at the answer of the one before
                solution = solve(problem, raise_on_failure=False, **options)
        except MapError as error:
            self.failures[row] = Status.MAP_FAILED, str(error)
        except NotApplicable as error:
            status = Status.STAGNATED if limits.memory_limit is None else Status.MEMORY_LIMIT
            self.failures[row] = status, str(error)
        except MemoryError as error:
            self.failures[row] = Status.MEMORY_LIMIT, str(error)
        except KeyboardInterrupt:  # before there was an iterate
            self.failures[row] = Status.INTERRUPTED, "interrupted by Ctrl-C before its first iterate"
            self.interrupted = True
        else:
            self.Z[row], self.residuals[row], self.tolerances[row] = solution.z, solution.residual, solution.tolerance
            self.solved[row], self.alone[row] = solution.solved, Found.of(solution)
            if not solution.solved:
                self.failures[row] = solution.status, solution.message
            self.interrupted = solution.status is Status.INTERRUPTED

    def start(self, row: int, problem: ProblemData) -> Vector | None:
        """Where `solve` begins: at 0 where that is a solution, else at the answer of the row before."""
        if self.starts is not None:
            return np.asarray(self.starts[row if len(self.starts) > 1 else 0])
        with suppress(MapError):  # ψ need not have a value at 0
            if problem.residual_at_0() == 0.0:
                return None
        return self.Z[row - 1] if row % CHAIN and self.solved[row - 1] else None

    def run(self) -> None:
        """All rows, at once where that can be, the others one by one."""
        with self.limits.kept(self.clock):
            began = work.clock()
            try:
                self.at_once()
            except (KeyboardInterrupt, SystemError) as error:
                if not is_ctrl_c(error):
                    raise
                self.interrupted = True
            self.compiled[:] = self.solved.sum(), work.clock() - began
            if _LOG.isEnabledFor(logging.INFO):
                told = *self.Z.shape, int(self.compiled[0]), self.compiler
                _LOG.info("%d rows, n = %d: %d are solved at once by %r, the others one by one", *told)
            for left_open in np.flatnonzero(~self.solved):
                self.solve(int(left_open))

    def solutions(self) -> Solutions:
        """What was found."""
        self.Z.flags.writeable = False
        at_once = Found.at_once(self.compiler, int(self.compiled[0]), self.compiled[1])
        statuses = [self.failures.get(row, (Status.SOLVED,))[0] for row in range(len(self.Z))]
        messages = {row: self.failures[row][1] for row in sorted(self.failures)}
        found = self.Z, tuple(statuses), self.residuals, self.tolerances, self.elapsed(), messages
        return Solutions(*found, self.stated, at_once, self.alone)
