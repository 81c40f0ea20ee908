"""The rows of one call of `solve_many`, solved in compiled code where that applies, and else one by one."""

from __future__ import annotations

import logging
from contextlib import suppress
from functools import cached_property, partial
from typing import Any

import numpy as np

from ...algebra.affine_lcp import in_box
from ...errors import MapError, NotApplicable, OutOfTime, SingularOperator
from ...numerics import work
from ...numerics.arrays import Vector, axes
from ...numerics.rounding import is_ctrl_c
from ...problem.data import ProblemData
from ...problem.two_sided import sides_of
from ...theory.certificates.bounds import h_plus_proof
from ..driver import solve
from ..goal import Limits
from ..solution import Status
from ..solutions import BatchData, RunRecord, Solutions
from .compiled_solver import CompiledSolver
from .row_arguments import Stack, check_row_labels, common_count, list_items, list_obstacles, rows_of

_LOG = logging.getLogger("icpmodel")

#: the number of rows in a chain: each row starts from the answer of the row before, and each chain begins anew, so that
#: a share of the rows in another process has the same answers. A cold row was measured to cost .7 to 2 times as much
ROWS_PER_CHAIN = 16
#: the cost of a share of rows in compiled code, in nanoseconds: some hundred times the cost of sending it
SHARE_COST = 1e8


class Batch:
    """The rows of one `solve_many` and their results."""

    def __init__(self, A: Any, Q: Any, psi: Any, upper: Any, Z0: Any, limits: Limits) -> None:
        self.start_time = work.clock()
        self.limits = limits
        check_row_labels(A, Q=Q, psi=psi, upper=upper, Z0=Z0)
        Q = rows_of(Q, "Q", 0.0)
        matrices = list_items(A, lambda one: axes(one, "A") == 2)
        self.maps, self.obstacles = list_obstacles(psi, "psi", -np.inf)
        self.uppers, self.above = list_obstacles(upper, "upper", np.inf)
        self.starts = None if Z0 is None else rows_of(getattr(Z0, "Z", Z0), "Z0", 0.0)
        k = common_count(A=matrices, Q=Q, psi=self.maps, upper=self.uppers, Z0=self.starts)
        Q = np.broadcast_to(Q, (k, Q.shape[1]))
        first = [maps[0] if maps else one for one, maps in ((psi, self.maps), (upper, self.uppers))]
        make = partial(ProblemData, q=Q[0], psi=first[0], upper=first[1])
        all_matrices = matrices or [A]
        self.problem = make(all_matrices[0])
        # `many[k]` makes a problem later, when the arrays of the caller may have changed
        psi = self.problem.psi
        problems: Any = Stack.of(matrices, partial(make, psi=psi, upper=None)) or [
            self.problem,
            *map(make, all_matrices[1:]),
        ]
        lower = sides_of(psi)[0]
        upper = None if upper is None else self.problem.upper
        self.data = BatchData(problems, Q, (lower, self.maps), (upper, self.uppers), limits)
        # errors in any row are raised before a row is solved
        self._check(k)
        self._begin()

    def _begin(self) -> None:
        """Set empty results, with the starts as Z."""
        self.Z = np.zeros(self.data.Q.shape)
        k = len(self.Z)
        if self.starts is not None:
            self.Z[:] = self.starts
        self.residuals = np.full(k, np.inf)
        self.tolerances = np.zeros(k)
        self.solved = np.zeros(k, dtype=bool)
        self.failures: dict[int, tuple[Status, str]] = {}
        self.records: dict[int, RunRecord] = {}
        self.interrupted = False
        #: the number of rows that compiled code has solved, and the seconds that it took
        self.compiled = np.zeros(2)

    def _check(self, k: int) -> None:
        """Raise InputError where an obstacle of a row, or a start, does not fit the problem."""
        for name, rows in (("Z0", self.starts), ("psi", self.obstacles), ("upper", self.above)):
            if rows is not None:
                self.problem.vector(rows[0], name)  # has the right length
        if self.uppers is not None or (self.maps is not None and self.obstacles is None):
            for row in range(k):
                self.problem.with_sides(*self.data.sides(row))

    @cached_property
    def fits_compiled_code(self) -> bool:
        """Whether compiled code may take the rows together.

        All rows must have the same kind of ψ, and the same A or small dense ones of one size. Unless the obstacles are
        fixed or move alike, all rows need upper obstacles in the same entries of z. Compiled code takes no starts: with
        starts the solution must be unique, as is proved for fixed obstacles and a shared H₊-matrix. What holds for all
        rows holds for their shares as well.
        """
        problems = self.data.problems
        is_one = len(problems) == 1
        above = self.above
        fits = (self.maps is None or self.obstacles is not None) and (is_one or isinstance(problems, Stack))
        if self.uppers is not None and above is None:
            fits = False
        elif fits and above is not None and not in_box(self.problem.facts):
            fits = bool((np.isinf(above) == np.isinf(above[0])).all())
        if self.starts is None or not fits:
            return fits
        with suppress(OutOfTime, MemoryError):
            return is_one and self.problem.facts.has_fixed_obstacle and not isinstance(h_plus_proof(self.problem), str)
        return False

    def elapsed(self) -> float:
        """The seconds since it began."""
        return work.clock() - self.start_time

    @property
    def compiled_solver(self) -> CompiledSolver:
        """The solver of the rows in compiled code."""
        return CompiledSolver(self.data, self.obstacles, self.above)

    def row_cost(self) -> float | None:
        """The cost of a row in compiled code, in nanoseconds; None if it does not apply."""
        return self.compiled_solver.row_cost() if self.fits_compiled_code else None

    def solve_compiled(self) -> None:
        """Solve rows in compiled code, if it applies and as far as the limits allow; keep those that are `solved`."""
        row_cost = self.row_cost()
        if row_cost is None:
            return
        with (
            np.errstate(over="ignore", invalid="ignore"),
            suppress(MapError, SingularOperator, OutOfTime, MemoryError),  # the other rows are solved one by one
        ):
            for rows, (*results, good) in self.compiled_solver.pieces(row_cost):
                self.solved[rows] = good
                for stored, new in zip((self.Z, self.residuals, self.tolerances), results, strict=True):
                    stored[rows][good] = new[good]

    def solve(self, row: int) -> None:
        """Solve one row by `solve`, or record why it fails or is not begun."""
        if self.interrupted:
            self.failures[row] = Status.INTERRUPTED, "an earlier row was interrupted"
            return
        limits = self.limits
        if limits.time_limit is not None and self.elapsed() >= limits.time_limit:
            self.failures[row] = Status.TIME_LIMIT, f"time_limit = {limits.time_limit:g} s was over before its turn"
            return
        # the limits of all rows hold here as well, see `run`
        options: Any = {name: getattr(limits, name) for name in ("rtol", "atol", "time_limit", "memory_limit")}
        try:
            problem = self.data.problem(row)
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
            self.Z[row] = solution.z
            self.residuals[row] = solution.residual
            self.tolerances[row] = solution.tolerance
            self.solved[row] = solution.solved
            self.records[row] = RunRecord.of(solution)
            if not solution.solved:
                self.failures[row] = solution.status, solution.message
            self.interrupted = solution.status is Status.INTERRUPTED

    def start(self, row: int, problem: ProblemData) -> Vector | None:
        """The z0 of a row: its start if given, else the answer of the row before in its chain.

        None where 0 is a solution, the row begins a chain, or the row before is not solved.
        """
        if self.starts is not None:
            return np.asarray(self.starts[row if len(self.starts) > 1 else 0])
        with suppress(MapError):  # ψ need not have a value at 0
            if problem.residual_at_0() == 0.0:
                return None
        return self.Z[row - 1] if row % ROWS_PER_CHAIN and self.solved[row - 1] else None

    def run(self) -> None:
        """Solve all rows, at once where possible, the others one by one."""
        with self.limits.enforced(self.start_time):
            began = work.clock()
            try:
                self.solve_compiled()
            except (KeyboardInterrupt, SystemError) as error:
                if not is_ctrl_c(error):
                    raise
                self.interrupted = True
            self.compiled[:] = self.solved.sum(), work.clock() - began
            if _LOG.isEnabledFor(logging.INFO):
                values = *self.Z.shape, int(self.compiled[0]), self.compiled_solver.method
                _LOG.info("%d rows, n = %d: %d are solved at once by %r, the others one by one", *values)
            for left_open in np.flatnonzero(~self.solved):
                self.solve(int(left_open))

    def solutions(self) -> Solutions:
        """The results; Z becomes read-only."""
        self.Z.flags.writeable = False
        compiled_record = RunRecord.of_compiled(self.compiled_solver.method, int(self.compiled[0]), self.compiled[1])
        statuses = [self.failures.get(row, (Status.SOLVED,))[0] for row in range(len(self.Z))]
        messages = {row: self.failures[row][1] for row in sorted(self.failures)}
        arrays = self.Z, tuple(statuses), self.residuals, self.tolerances, self.elapsed(), messages
        return Solutions(*arrays, self.data, compiled_record, self.records)
