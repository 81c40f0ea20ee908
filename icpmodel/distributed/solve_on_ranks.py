"""`solve()` on ranks: the start from the coarser levels, Newton's steps, and sweeps where those fail.

The sweep, the active set, the options, the statuses and the sentences of proofs are those of one process. The loop of
`solve.run` is not used: each of its decisions would need a reduction over the ranks, and its clock and Ctrl-C are those
of one process. The levels are PETSc's, as PyAMG runs in one process only.
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
from ..numerics.arrays import as_truth
from ..numerics.rounding import SQRT_EPSILON, public_entry
from ..solve.goal import RTOL, Limits
from ..solve.progress import status_line
from ..solve.solution import Status
from .distributed_icp import DistributedICP, check_point
from .distributed_levels import DistributedLevels
from .distributed_solution import DistributedSolution
from .evaluation import Evaluation
from .newton_on_ranks import coarse_start, is_at_floor, iterates, simplify
from .ranks import anywhere, together


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
        The start, by default 0. Unless Res_D(z0) ≤ 1.5e-8·Res_D(0), the start from the coarser
        levels replaces it.
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
        Whether rank 0 shows a status line.
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
    if anywhere(problem.comm, problem.matrix.diagonal <= 0):
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
    """Yield a function that returns the status after Ctrl-C or at the time limit, else None, the same on all ranks.

    In the block Ctrl-C only sets a flag, and so does SIGTERM, which mpiexec then sends, perhaps twice. A second Ctrl-C
    has its old effect.
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
        if anywhere(comm, bool(pressed)):
            return Status.INTERRUPTED
        return Status.TIME_LIMIT if anywhere(comm, late) else None

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
        self.tolerance = 0.0
        self.levels: DistributedLevels | None = None
        self.best = Evaluation(problem, problem.vector())

    def solve_from(self, z0: Any) -> tuple[Status, str]:
        """Run from `z0`, a `Vec`, or 0 where it is None; return the status and a note on it. Collective."""
        problem = self.problem
        at_0 = self.best.residual
        first = self.best if z0 is None else Evaluation(problem, z0.copy())
        scale = at_0 if np.isfinite(at_0) else first.residual
        if not np.isfinite(scale):
            _check_maps(first, "at the start")
            raise MapError("the residual at the start is not finite")
        if not scale:  # Res(0) = 0: no start is nearer
            return Status.SOLVED, ""
        self.tolerance = target = float(self.limits.tolerance(scale))
        self.best = first
        if self._is_reached(first):
            return Status.SOLVED, ""
        if self.limits.atol:  # about the Res_D at which Res ≤ atol
            target = max(target, self.limits.atol * first.residual / first.paper_residual)
        fixed = simplify(problem)
        self.say("making the levels")
        self.levels = DistributedLevels(problem.matrix)
        if (stop := self.watch()) is not None:
            return stop, "while the levels were made"
        z = first.z
        try:
            if not first.residual <= SQRT_EPSILON * at_0:
                self.say(f"starting from {len(self.levels.levels)} levels")
                z = coarse_start(self.levels, simplify(fixed, start=True))
            return self._steps(fixed, iterates(self.levels, fixed, z, target, scale), scale)
        except MapError as error:
            return Status.MAP_FAILED, str(error)

    def _steps(self, fixed: DistributedICP, path: Iterator[Evaluation], scale: float) -> tuple[Status, str]:
        """Judge the iterates on `path`, those of the problem `fixed`; return the status and a note. Collective."""
        for self.iterations, iterate in enumerate(path):
            at = iterate if fixed is self.problem else Evaluation(self.problem, iterate.z)
            if at.residual < self.best.residual or not np.isfinite(self.best.residual):
                self.best = at
            self.say(f"iteration {self.iterations}, residual {at.residual:.2e} -> {self.tolerance:.2e}")
            if self._is_reached(at):
                self.best = at
                return Status.SOLVED, ""
            if self.iterations >= self.limits.max_iter:
                return Status.ITERATION_LIMIT, f"{self.iterations} iterations"
            if (stop := self.watch()) is not None:
                return stop, f"in iteration {self.iterations}"
            if np.isnan(at.residual):
                _check_maps(at, f"in iteration {self.iterations}")
        if is_at_floor(self.best, scale):
            noise = self.best.rounding_of_residuals[0]
            return Status.PRECISION_LIMIT, f"rounding leaves a residual of up to about {noise:.2g} at this z"
        return Status.STAGNATED, "neither Newton's steps nor sweeps reduce the residual any more"

    def _is_reached(self, at: Evaluation) -> bool:
        """Whether the residuals of `at` meet `rtol` or `atol`. Collective."""
        if at.residual <= self.tolerance or not self.limits.atol:
            return at.residual <= self.tolerance
        return at.paper_residual <= self.limits.atol

    def solution(self, status: Status, note: str) -> DistributedSolution:
        """The best iterate with its status: SOLVED becomes PRECISION_LIMIT where rounding may exceed the tolerance."""
        best = self.best
        atol = self.limits.atol
        if status is Status.SOLVED and max(self.tolerance, atol) > 0:
            error, paper_error = best.rounding_of_residuals
            is_certain = best.residual + error <= self.tolerance
            if not is_certain and not (atol and best.paper_residual + paper_error <= atol):
                status = Status.PRECISION_LIMIT
                note = f"rounding may account for {error:.3g} of it"
        message = "solved"
        if status is not Status.SOLVED:
            stop = f"Best residual {best.residual:.3g} (stop at {self.tolerance:.3g})"
            message = f"{status.value}: {note}. {stop}. Advice: {status.advice}"
        levels = self.levels
        return DistributedSolution(
            problem=self.problem,
            z=best.z,
            status=status,
            message=message,
            residual=best.residual,
            tolerance=self.tolerance,
            iterations=self.iterations,
            krylov_steps=0 if levels is None else levels.steps,
            sizes=(self.problem.n,) if levels is None else tuple(one.matrix.n for one in levels.levels),
            seconds=time.perf_counter() - self.start_time,
            levels=levels,
        )


def _check_maps(at: Evaluation, when: str) -> None:
    """Raise MapError, on all ranks, where an obstacle is NaN in a row in which z is finite. Collective."""
    problem = at.problem
    with together(problem.comm):
        for name, side in (("psi", at.r), ("upper", at.r_upper)):
            if side is not None and (is_nan := np.isnan(side) & np.isfinite(at.z.array_r)).any():
                raise MapError(f"{name} is nan in row {problem.low + int(np.argmax(is_nan))} {when}")
