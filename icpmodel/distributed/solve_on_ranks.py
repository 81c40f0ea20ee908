"""`solve()` on ranks: the start from the coarser levels, Newton's steps, and sweeps where those fail.

Shared with one process are the sweep, the active set, the options, the statuses and the sentences of proofs. The loop
of `solve.run` is not: each of its decisions would need a reduction over the ranks. Its clock and Ctrl-C are those of
one process. The levels are PETSc's, as a hierarchy of PyAMG is that of one process.
"""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from ..errors import InputError, MapError, NotApplicable, NotSolved
from ..methods.contract import PATIENCE, REDUCTION
from ..methods.multilevel import GOOD_START
from ..numerics.arrays import as_truth
from ..numerics.rounding import public_entry
from ..solve.goal import RTOL, Limits
from ..solve.progress import status_line
from ..solve.run import MAX_ROUNDING
from ..solve.solution import Status
from .distributed_bound import rounding
from .distributed_icp import DistributedICP, check_point
from .distributed_levels import DistributedLevels
from .distributed_solution import DistributedSolution
from .newton_on_ranks import Evaluation, coarse_start, newton_steps, simplify
from .ranks import largest, norm, release, together, totals

#: rounds of sweeps that may take over, and how many sweeps a round has
_MAX_ROUNDS = 100
_SWEEPS_PER_ROUND = 8
#: the largest number of times that sweeps take over
_MAX_EXTRA_SWEEPS = 10


@public_entry
def solve(
    A: Any,
    q: Any = None,
    psi: Any = 0.0,
    upper: Any = None,
    *,
    z0: Any = None,
    rtol: float = RTOL,
    atol: float = 0.0,
    max_iter: int = 200,
    time_limit: float | None = None,
    progress: bool = False,
    raise_on_failure: bool = True,
) -> DistributedSolution:
    """Solve an ICP on the ranks of A: stop at Res_D(z) ≤ rtol·Res_D(0), or Res(z) ≤ atol, as `icpmodel.solve`.

    Every rank calls it at the same time with the same options.

    Parameters
    ----------
    A : DistributedICP or Mat
        The problem, or its matrix.
    q, psi, upper : optional
        With a `Mat`, the other arguments of `DistributedICP`.
    z0 : Vec, optional
        The start, by default 0. It is kept where Res_D(z0) ≤ 1e-7·Res_D(0).
    rtol : float, default 1e-8
        Relative tolerance.
    atol : float, default 0
        Absolute tolerance.
    max_iter : int, default 200
        Largest number of iterations on the finest level.
    time_limit : float, optional
        Seconds of rank 0, checked between two iterations. A step that PETSc has begun is not cut
        short.
    progress : bool, default False
        Whether rank 0 shows a line.
    raise_on_failure : bool, default True
        Whether a failure raises NotSolved.

    Returns
    -------
    DistributedSolution
        On every rank; its z is the best iterate.

    Raises
    ------
    InputError
        On all ranks, for wrong arguments.
    MapError
        Where ψ fails at the start.
    NotApplicable
        Where the diagonal of A is not positive.
    NotSolved
        With the best iterate, unless `raise_on_failure` is False.

    Notes
    -----
    It is the multilevel modulus Newton method of `icpmodel.Multilevel`. PETSc's algebraic multigrid
    makes the levels once: hypre's BoomerAMG where it is built in, else GAMG. Each level starts from
    the answer of the next coarser one. Projected Gauss–Seidel in the rows of each rank moves the
    boundary of the active set. Conjugate gradients, or GMRES where A is not symmetric, solve for the
    free rows. Where Newton's steps do not reduce the residual, sweeps take over for a while.

    Ctrl-C ends the run after the current iteration. PETSc's options that begin with `-icpmodel_`
    reach its multigrid.

    Examples
    --------
    >>> problem = icp.distributed.distribute(icp.scenes.membrane(n=100).problem)
    >>> serial = icp.scenes.membrane(n=100).problem.solve()
    >>> bool(abs(icp.distributed.solve(problem).z.array - serial.z).max() < 1e-6)
    True
    """
    problem = A if isinstance(A, DistributedICP) else DistributedICP(A, q, psi, upper)
    no_psi = isinstance(psi, float | int) and psi == 0
    if isinstance(A, DistributedICP) and not (q is None and no_psi and upper is None):
        raise InputError("A is a DistributedICP, which has its q; leave out q, psi and upper")
    limits = Limits(rtol=rtol, atol=atol, max_iter=max_iter, time_limit=time_limit)
    if z0 is not None:
        z0 = check_point(problem, z0, "z0", finite=True)
    as_truth(progress, "progress"), as_truth(raise_on_failure, "raise_on_failure")
    if largest(problem.comm, float((problem.matrix.diagonal <= 0).any()))[0]:
        raise NotApplicable("the diagonal of A has an entry that is not positive, which sweeps and multigrid divide by")
    with _watch(problem.comm, limits) as watch, status_line(progress and problem.comm.rank == 0) as say:
        run = _Run(problem, limits, watch, say)
        status, note = run.solve_from(z0)
    solution = run.solution(status, note)
    if raise_on_failure and not solution.solved:
        raise NotSolved(solution)
    return solution


@contextmanager
def _watch(comm: Any, limits: Limits) -> Iterator[Callable[[], Status | None]]:
    """A function that returns, the same on all ranks, the status after Ctrl-C or at the time limit, else None.

    In the block Ctrl-C, and the signal that mpiexec then sends, perhaps twice, only sets a flag. A second Ctrl-C has
    its old effect.
    """
    start_time = time.perf_counter()
    pressed = list[int]()
    old: dict[int, Any] = {}

    def note(signum: int, frame: Any) -> None:
        pressed.append(signum)
        if signum == signal.SIGINT:
            signal.signal(signum, old[signum])

    if threading.current_thread() is threading.main_thread():
        old = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}

    def ended() -> Status | None:
        late = comm.rank == 0 and limits.time_limit is not None and time.perf_counter() - start_time > limits.time_limit
        stop, over = totals(comm, float(bool(pressed)), float(late))
        return Status.INTERRUPTED if stop else Status.TIME_LIMIT if over else None

    try:
        yield ended
    finally:
        for number, handler in old.items():
            signal.signal(number, handler)


class _Run:
    """One run: the best iterate so far, and the loop."""

    def __init__(
        self, problem: DistributedICP, limits: Limits, watch: Callable[[], Status | None], say: Callable[[str], None]
    ) -> None:
        self.problem = problem
        self.limits = limits
        self.watch = watch
        self.say = say
        self.start_time = time.perf_counter()
        self.iterations = 0
        self.scale = np.inf
        self.tolerance = self.target = 0.0
        self.levels: DistributedLevels | None = None
        self.best = problem.vector()
        self.least = np.inf

    def solve_from(self, z0: Any) -> tuple[Status, str]:
        """Run from `z0`, a `Vec`, or 0 where it is None; return the status and a note on it. Collective."""
        problem = self.problem
        at_0 = problem.residual(problem.vector())
        z, first = (problem.vector(), at_0) if z0 is None else (z0.copy(), problem.residual(z0))
        scale = at_0 if np.isfinite(at_0) else first
        if not np.isfinite(scale):
            _check_maps(problem, z, "at the start")
            raise MapError("the residual at the start is not finite")
        if not scale:  # Res(0) = 0: no start is nearer
            self._keep_best(problem.vector(), 0.0)
            return Status.SOLVED, ""
        self.scale = scale
        self.tolerance = self.target = float(self.limits.tolerance(self.scale))
        if self.limits.atol and (paper := problem.paper_residual(z)) > 0:
            self.target = max(self.target, self.limits.atol * first / paper)  # about what Res ≤ atol takes
        self._keep_best(z, first)
        if self._reached(z, first):
            return Status.SOLVED, ""
        fixed = simplify(problem) if problem.calls_user_code else problem
        self.say("making the levels")
        self.levels = DistributedLevels(problem.matrix)
        if (stop := self.watch()) is not None:
            return stop, "while the levels were made"
        try:
            if not first <= GOOD_START * at_0:
                self.say(f"starting from {len(self.levels.levels)} levels")
                z = coarse_start(self.levels, simplify(fixed, start=True) if fixed.calls_user_code else fixed)
            return self._steps(fixed, z)
        except MapError as error:
            return Status.MAP_FAILED, str(error)

    def _steps(self, fixed: DistributedICP, z: Any) -> tuple[Status, str]:
        """Newton's steps from `z`, and sweeps where they fail; the status and a note on it. Collective."""
        assert self.levels is not None
        milestone = np.inf
        idle = 0
        extra_sweeps = 0
        path = newton_steps(self.levels, fixed, z, 0, self.target)
        at = next(path)
        while True:
            residual = at.residual if fixed is self.problem else self.problem.residual(at.z)
            self._keep_best(at.z, residual)
            self.say(f"iteration {self.iterations}, residual {residual:.2e} -> {self.tolerance:.2e}")
            if self._reached(at.z, residual):
                return Status.SOLVED, ""
            if self.iterations >= self.limits.max_iter:
                return Status.ITERATION_LIMIT, f"{self.iterations} iterations"
            if (stop := self.watch()) is not None:
                return stop, f"in iteration {self.iterations}"
            if np.isnan(residual):
                _check_maps(self.problem, at.z, f"in iteration {self.iterations}")
            idle += 1
            if residual <= REDUCTION * milestone:
                milestone = residual
                idle = 0
            if idle > PATIENCE or not np.isfinite(residual):
                if self.least <= 2.0 * (noise := self._rounding()[0]) < MAX_ROUNDING * self.scale:
                    return Status.PRECISION_LIMIT, f"rounding leaves a residual of up to about {noise:.2g} at this z"
                extra_sweeps += 1
                swept = self._after_sweeps(fixed) if extra_sweeps <= _MAX_EXTRA_SWEEPS else None
                if swept is None:
                    return Status.STAGNATED, "neither Newton's steps nor sweeps reduce the residual any more"
                path = newton_steps(self.levels, fixed, swept, 0, self.target)
                at = next(path)
                idle = 0
            else:
                at = path.send(self.target)
            self.iterations += 1

    def _reached(self, z: Any, residual: float) -> bool:
        """Whether `z`, with Res_D(z) = `residual`, is what was asked for. Collective."""
        if residual <= self.tolerance or not self.limits.atol:
            return residual <= self.tolerance
        return self.problem.paper_residual(z) <= self.limits.atol

    def _after_sweeps(self, fixed: DistributedICP) -> Any:
        """z from the best iterate by sweeps, with a residual that counts as reduced, or None."""
        z = self.best
        for _ in range(_MAX_ROUNDS):
            at = Evaluation(fixed, z, None)
            if at.residual <= REDUCTION * self.least:
                return at.z
            if self.iterations >= self.limits.max_iter or not np.isfinite(at.residual):
                return None
            z = at.after_sweeps(_SWEEPS_PER_ROUND)
            release(self.problem.comm)
            self.iterations += 1
        return None

    def _rounding(self) -> tuple[float, float]:
        """Bounds on the rounding errors of Res_D and Res at the best iterate. Collective."""
        rounding_p, rounding_r = rounding(self.problem, self.best)
        comm = self.problem.comm
        weighted = np.maximum(self.problem.matrix.row_weights * rounding_p, rounding_r)
        return norm(comm, weighted), norm(comm, np.maximum(rounding_p, rounding_r))

    def _keep_best(self, z: Any, residual: float) -> None:
        if residual < self.least or not np.isfinite(self.least):
            self.best = z.copy()
            self.least = residual

    def solution(self, status: Status, note: str) -> DistributedSolution:
        """The best iterate, judged once more, rounding included."""
        problem = self.problem
        residual = self.least
        if status is Status.SOLVED:
            error, paper_error = self._rounding()
            atol = self.limits.atol
            is_certain = residual + error <= self.tolerance
            if atol and not is_certain:
                is_certain = problem.paper_residual(self.best) + paper_error <= atol
            if not is_certain and max(self.tolerance, atol) > 0:
                status = Status.PRECISION_LIMIT
                note = f"rounding may account for {error:.3g} of it"
        message = "solved"
        if status is not Status.SOLVED:
            message = (
                f"{status.value}: {note}. Best residual {residual:.3g} (stop at {self.tolerance:.3g}). "
                f"Advice: {status.advice}"
            )
        levels = self.levels
        return DistributedSolution(
            problem=problem,
            z=self.best,
            status=status,
            message=message,
            residual=residual,
            tolerance=self.tolerance,
            iterations=self.iterations,
            krylov_steps=0 if levels is None else levels.steps,
            sizes=(problem.n,) if levels is None else tuple(one.matrix.n for one in levels.levels),
            seconds=time.perf_counter() - self.start_time,
            levels=levels,
        )


def _check_maps(problem: DistributedICP, z: Any, when: str) -> None:
    """Raise MapError, on all ranks, where an obstacle has no value at a `z` that has one. Collective."""
    _, r, r_upper = problem.sides(z)
    with together(problem.comm):
        for name, side in (("psi", r), ("upper", r_upper)):
            if side is not None and (is_nan := np.isnan(side) & np.isfinite(z.array_r)).any():
                raise MapError(f"{name} is nan in row {problem.low + int(np.argmax(is_nan))} {when}")
