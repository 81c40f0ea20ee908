"""Reduction before a run: rows that need no iteration leave, and independent parts are solved one by one.

1. Obstacles that move with their own unknown alone are fixed, and redundant rows leave: `presolve`.
2. If few rows have an obstacle, the rows without any are eliminated, see `algebra.schur`. This is done before the first
   iterate if the last problem with this A took a quarter as much, otherwise before rung 4 of `select_method`.
3. The strong components of A and ψ are solved in their order: a single row by a maximum, a small block by pivots. The
   other rows fall into parts that do not interact.

Each part goes up a ladder of its own. The joined answer is judged as an answer of the whole problem; if it fails, the
run of the whole problem continues from the best iterate. A part without a solution proves in two cases that the whole
has none: its proof, with 0 in all other rows, is a proof for the whole; or the unknowns of earlier blocks have only one
solution, which an error bound encloses.

References: Tarjan, SIAM J. Comput. 1 (1972), for the components; Cottle, Pang and Stone, The Linear Complementarity
Problem (1992), section 4.4, for blocks.
"""

from __future__ import annotations

import logging
from collections.abc import Callable, Generator, Iterator
from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..algebra.schur import SchurComplement, record_run
from ..algebra.subproblems import Blocks, Rows, blocks, restricted, with_fixed_obstacle, without_redundant_rows
from ..errors import MapError, OutOfTime
from ..methods.contract import Infeasible, Method
from ..methods.psor import PSOR
from ..methods.shortcuts import Lemke
from ..numerics import work
from ..numerics.arrays import Vector, norm
from ..problem.data import ProblemData
from ..theory.certificates.bounds import error_bound
from ..theory.certificates.combination_rows import ProvedBounds
from ..theory.certificates.infeasible import infeasible
from .choice import Ladder
from .goal import Goal
from .jobs import Choice, Job
from .run import Run
from .solution import Status
from .stopping import WORTH_ANOTHER_METHOD, StopReason

_LOG = logging.getLogger("icpmodel")
#: the largest share of the rows that a part may have to count as a smaller problem
_MAX_PART = 0.6
#: the share of the tolerance of the whole for all parts together, and the share of it for parts on which others depend
_TOLERANCE_SHARE = 0.5
_EARLIER_SHARE = 1e-3
#: statuses of a part that end the run of the whole
_FINAL_STATUSES = (Status.ITERATION_LIMIT, Status.TIME_LIMIT, Status.STOPPED)

#: a generator of steps that returns the blocks still to be solved, or None
PartSteps = Generator[None, None, Blocks | None]


def presolve(problem: ProblemData) -> ProblemData:
    """Return an equivalent problem that is easier for the methods: fixed obstacles, no redundant rows.

    The obstacles can be fixed where every ψ_i depends on z_i alone, with a Lipschitz constant below 1. Sweeps and
    Newton steps then need not evaluate ψ. If ψ fails here, the problem itself is returned, since ψ may have values
    at the iterates.
    """
    with suppress(MapError), np.errstate(over="ignore", invalid="ignore"):
        return without_redundant_rows(with_fixed_obstacle(problem))
    return problem


def ladder_steps(run: Run, problem: ProblemData, family: str | None, first: Method | None = None) -> Iterator[None]:
    """The steps of `run` up its ladder, with the reductions of `problem` in between; `first` as in `Ladder`."""
    reduces = family != "paper"
    ladder = Ladder(problem, run.target_reduction, family, first, run.warm_start, reduces)
    complement = ladder.complement()
    before = work.counter()
    try:
        if complement is not None:
            yield from _Parts(run, problem, family).steps(complement)
        if not run.is_over:
            yield from run.steps(ladder)
        if not ladder.is_paused or run.is_over:
            return
        if complement is None and (complement := ladder.complement()) is not None:
            yield from _Parts(run, problem, family).steps(complement)
        if not run.is_over:
            yield from solve_parts(run, problem, family)
        if not run.is_over:
            yield from run.steps(ladder)
    finally:
        if complement is None:
            record_run(problem, work.counter() - before)


def solve_parts(run: Run, problem: ProblemData, family: str | None = None, share: float = _MAX_PART) -> Iterator[None]:
    """Solve the parts of `problem` and join their answers in `run`; do nothing if a part is too large.

    A part may have at most this `share` of the rows. With a `family` nothing is done if a block would be pivoted.
    """
    max_rows = share * problem.n
    partition = structure(problem, max_rows)
    if partition is not None and not (family is not None and partition.is_pivoted):
        yield from _Parts(run, problem, family).steps(partition, max_rows)


class _Parts:
    """The parts of a reduced problem, and their joined answer z.

    Parameters
    ----------
    run : Run
        The run of the whole problem.
    problem : ProblemData
        The problem that is reduced.
    family : str or None
        As in `select_method`.
    """

    def __init__(self, run: Run, problem: ProblemData, family: str | None) -> None:
        self.run = run
        self.problem = problem
        self.family = family
        self.z = (run.start if run.best is None else run.best.z).copy()
        tolerance = run.goal.tolerance_at(self.z)
        largest = max(1.0 / float(problem.matrix.row_weights.min()), 1.0)
        self.tolerance = _TOLERANCE_SHARE * max(tolerance, run.goal.atol / largest)
        #: completes z, of which a part has been changed, to an iterate of the whole problem
        self.extend: Callable[[Vector], Vector] = np.copy
        #: the job of the largest part that was solved, and its number of rows
        self.job = Job(Choice(PSOR()))
        self.size = 0

    def steps(self, partition: Blocks | SchurComplement, max_rows: float = np.inf) -> Iterator[None]:
        """Solve the parts of `partition`, of at most `max_rows` each, and join their answers."""
        run = self.run
        if run.best is None:
            run.job = self.job
            run.best = run.candidate(run.start, run.start_residual)
        try:
            rest: Blocks | None = None
            if isinstance(partition, SchurComplement):
                yield from self._solve_complement(partition)
            else:
                rest = partition
            while rest is not None and rest.largest <= max_rows and not run.is_over:
                partition = rest
                rest = yield from self._in_blocks(partition)
            if isinstance(partition, Blocks) and partition.is_pivoted and not self.size:
                self.job = Job(Choice(Lemke()))
        except Infeasible as proof:
            run.infeasible = proof.answer
            run.stop_reason = StopReason(Status.INFEASIBLE, proof.answer.reason)
            run.is_over = True
        finally:
            self.job.choice = replace(self.job.choice, why=f"{partition!r}; {self.job.choice.why}".removesuffix("; "))
            with suppress(MapError):
                self._join()

    def _join(self) -> None:
        """Judge z as an answer of the whole problem, and record it and its job in the run."""
        run = self.run
        if (end := self.job.stop_reason) and end.status not in WORTH_ANOTHER_METHOD:
            self.job.stop_reason = None  # a solved or infeasible part does not end the whole
        run.job = self.job
        run.path = iter(())
        run.tried.append(self.job)
        self.job.is_fresh = False  # it began with another problem
        self.z = self.extend(self.z)
        if not np.isfinite(self.z).all():  # a block has overflowed
            self.z = run.start
        run.current = self.z
        residual = run.goal.judged(self.z, run.problem.residual(self.z))
        reached = not run.is_over and run.goal.reached(self.z, residual)
        if reached or run.best is None or residual <= run.best.residual:
            run.best = run.candidate(self.z, residual)
        if reached:
            run.stop_reason = StopReason(Status.SOLVED, "")
            run.is_over = True
        _LOG.info("n = %d: %s: residual %.3g", run.problem.n, self.job.choice.why, residual)

    def _in_blocks(self, partition: Blocks) -> PartSteps:
        """Solve the small blocks before the core, its parts, and the small blocks after it."""
        self.z, solved = partition.substitute(self.z, partition.before_core)
        if (unsolved := partition.before_core & ~solved).any():
            return partition.with_core(unsolved)
        share = _EARLIER_SHARE if partition.after_core.any() else 1.0
        for rows in partition.parts:
            problem = restricted(partition.problem, rows, self.z)
            if not np.isfinite(problem.q).all():  # an earlier block has overflowed
                return None
            part = self._part(problem, rows, share * self.tolerance / len(partition.parts) ** 0.5)
            yield from self._solve(part, rows)
            if self.run.is_over:
                return None
        self.z, solved = partition.substitute(self.z, partition.after_core)
        unsolved = partition.after_core & ~solved
        return partition.with_core(unsolved) if unsolved.any() else None

    def _solve_complement(self, complement: SchurComplement) -> Iterator[None]:
        """Solve the rows with an obstacle, then the equations; do nothing if the factors of A_FF are inaccurate."""
        problem = self.problem
        equations = problem.matrix.row_weights.copy()
        equations[complement.rows] = 0.0
        z = complement.extended(problem, self.z)
        if norm(equations * problem.p(z)) <= self.tolerance:
            self.z = z
            self.extend = lambda z: complement.extended(problem, z)
            part = self._part(complement.reduced(problem), complement.rows, self.tolerance)
            yield from self._solve(part, complement.rows)

    def _part(self, part: ProblemData, rows: Rows, tolerance: float) -> Run:
        """A run of `part`, whose unknowns are the `rows` of the whole; it reports its iterates to the whole run."""
        start = self.z[rows]
        known = [start_residual := part.residual(start)]
        with suppress(MapError):
            known.append(part.residual_at_0())
        scale = max((x for x in known if x < np.inf), default=0.0)
        limits = replace(self.run.limits, max_iter=max(self.run.limits.max_iter - max(self.run.iteration, 0), 0))
        before = max(self.run.iteration, 0)

        def watch(z: Vector, residual: float) -> StopReason | None:
            self.run.iteration = before + max(run_of_part.iteration, 0)
            if not self.run.is_watched:
                return None
            self.run.job = run_of_part.job
            self.run.path = run_of_part.path
            whole = self.z.copy()
            whole[rows] = z
            return self.run.report_whole(self.extend(whole))

        run_of_part = Run(
            part,
            start,
            start_residual,
            Goal(tolerance),
            limits=limits,
            target_reduction=tolerance / scale if scale else 0.0,
            scale=scale,
            watch=watch,
            start_time=self.run.start_time,
        )
        return run_of_part

    def _solve(self, part: Run, rows: Rows) -> Iterator[None]:
        """Yield the steps of a `part`, copying its best iterate to z after each.

        Ends the whole run if the part has reached a limit. Raises Infeasible if a proof holds for the whole.
        """
        try:
            for _ in part.steps(Ladder(part.problem, part.target_reduction, self.family)):
                if part.best is not None:
                    self.z[rows] = part.best.z
                yield
        finally:
            if part.best is not None:
                self.z[rows] = part.best.z
                if rows.size > self.size:
                    self.size = rows.size
                    self.job = part.best.job
        if part.infeasible is not None:
            self._raise_infeasible(part, rows)
        if part.stop_reason.status in _FINAL_STATUSES:
            self.run.stop_reason = part.stop_reason
            self.run.is_over = True

    def _raise_infeasible(self, part: Run, rows: Rows) -> None:
        """Raise Infeasible if the proof that a `part` has no solution is a proof for the whole problem."""
        assert part.infeasible is not None
        problem = self.problem
        answer = part.infeasible
        if answer.witness is None:  # no choice of active rows in this part has a solution
            if problem.psi.is_constant and np.isin(problem.A[rows].indices, rows).all():
                raise Infeasible(replace(answer, reason=f"of rows {', '.join(map(str, rows))} alone: {answer.reason}"))
            return
        witness = np.array([float(x) for x in answer.witness]).reshape(-1, rows.size)
        y = np.zeros((len(witness), problem.n))
        y[:, rows] = witness
        answer = infeasible(problem, y.ravel())
        with suppress(OutOfTime):
            if answer.holds is None and (known := proved_of_earlier(problem, rows, self.z)):
                answer = infeasible(problem, y.ravel(), known)
        if answer.holds:
            raise Infeasible(answer)


def proved_of_earlier(problem: ProblemData, rows: Rows, z: Vector) -> ProvedBounds | None:
    """Proved bounds of the unknowns that the `rows` depend on; None unless these form an LCP with a certified z."""
    A = problem.A
    visited = np.zeros(problem.n, dtype=bool)
    visited[rows] = True
    new = rows
    while new.size:
        reached = np.unique(A[new].indices)
        new = reached[~visited[reached]]
        visited[new] = True
    visited[rows] = False
    earlier = np.flatnonzero(visited)
    if not earlier.size or not problem.is_lcp or not visited[A[earlier].indices].all():
        return None
    bound = error_bound(restricted(problem, earlier, z), z[earlier])
    if bound.componentwise is None:
        return None
    low = np.full(problem.n, -np.inf)
    high = np.full(problem.n, np.inf)
    low[earlier] = np.nextafter(z[earlier] - bound.componentwise, -np.inf)
    high[earlier] = np.nextafter(z[earlier] + bound.componentwise, np.inf)
    return ProvedBounds(low, high, bound.proof)


def structure(problem: ProblemData, max_rows: float) -> Blocks | None:
    """The blocks of `problem`; None if there are none, a part has more than `max_rows` rows, or ψ fails."""
    with suppress(MapError), np.errstate(over="ignore", invalid="ignore"):
        partition = blocks(problem)
        if partition is not None and partition.largest <= max_rows:
            return partition
    return None
