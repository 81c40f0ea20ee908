"""`solve()` on ranks: the start from the coarser levels, Newton's steps, sweeps where those fail, and honest ends."""

from __future__ import annotations

import signal
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError, MapError, NotApplicable, NotSolved
from ..numerics.arrays import as_truth
from ..numerics.rounding import sheltered
from ..present.card import Card
from ..present.shown import Shown
from ..solve.goal import RTOL, Limits
from ..solve.progress import status_line
from ..solve.solution import Status
from .distributed_bound import DistributedCertificate, certify, rounding
from .distributed_icp import DistributedICP
from .distributed_levels import DistributedLevels
from .newton_on_ranks import LookOnRanks, looks, simplified, start
from .ranks import largest, norm, release, together, totals

#: a start with this share of Res_D(0) is kept
_NEAR = 1e-7
#: what counts as reduced, and how many Newton steps may fail to
_REDUCED, _PATIENCE = 0.9, 5
#: rounding explains nothing where it leaves more than this share of the first residual, as in `solve.run`
_LOW = 0.1
#: where they do, so many rounds of sweeps must, and that may happen so often
_ROUNDS, _SWEEPS, _RESCUES = 100, 8, 10


@dataclass(frozen=True, eq=False, repr=False)
class DistributedSolution(Shown):
    """An answer on ranks: the returned z, the reason why the run stopped and, on request, what is certain of z.

    Attributes
    ----------
    problem : DistributedICP
        The problem.
    z : Vec
        The best iterate.
    status : Status
        Why the run stopped.
    message : str
        The same in words, with advice.
    residual : float
        Res_D(z).
    tolerance : float
        The tolerance for the residual.
    iterations : int
        Newton steps and rounds of sweeps on the finest level.
    krylov_steps : int
        Krylov steps on all levels.
    sizes : tuple of int
        The number of unknowns of each level.
    seconds : float
        Time, set-up included.

    Examples
    --------
    >>> solution = icp.distributed.solve(icp.distributed.distribute(icp.scenes.membrane(n=100).problem))
    >>> solution.status, solution.solved
    (<Status.SOLVED: 'solved'>, True)
    """

    problem: DistributedICP
    z: Any
    status: Status
    message: str
    residual: float
    tolerance: float
    iterations: int
    krylov_steps: int
    sizes: tuple[int, ...]
    seconds: float
    levels: DistributedLevels | None = field(repr=False)

    @property
    def solved(self) -> bool:
        """Whether the status is SOLVED."""
        return self.status is Status.SOLVED

    def __bool__(self) -> bool:
        return self.solved

    @sheltered
    def certify(self) -> DistributedCertificate:
        """State what is certain of z: the error bound, uniqueness, and which rows are decided.

        Collective: all ranks must call it. It costs about one linear solve, once.
        """
        return self._certificate

    @cached_property
    def _certificate(self) -> DistributedCertificate:
        return certify(self.problem, self.z, self.levels)

    def summary(self) -> dict[str, str]:
        """What `print` shows, as names and texts. The bound is in it once all ranks have called `certify`."""
        many = "s" if self.problem.comm.size > 1 else ""
        steps = f"{self.iterations} iteration{'' if self.iterations == 1 else 's'}"
        rows = {
            "problem": f"{self.problem.n} unknowns on {self.problem.comm.size} rank{many}",
            "status": f"{self.status.value} after {steps} and {self.krylov_steps} Krylov steps",
            "method": f"multilevel modulus Newton on {len(self.sizes)} levels",
            "residual": f"{self.residual:.3g} (stop at {self.tolerance:.3g})",
        }
        known = vars(self).get("_certificate")
        if known is not None:
            rows |= {"error": known.bound.in_words(), "rows": known.rows}
        if not self.solved:
            rows["message"] = self.message
        return rows | {"seconds": f"{self.seconds:.3g}"}

    def about(self) -> dict[str, Any]:
        """The same as plain data for JSON."""
        known = vars(self).get("_certificate")
        told = {
            "n": self.problem.n,
            "ranks": self.problem.comm.size,
            "status": self.status.value,
            "message": self.message,
            "residual": self.residual,
            "tolerance": self.tolerance,
            "iterations": self.iterations,
            "krylov_steps": self.krylov_steps,
            "levels": list(self.sizes),
            "seconds": self.seconds,
        }
        if known is not None:
            bound = known.bound
            told |= {"error_bound": bound.value, "unique": bound.unique or None, "proof": bound.proof or None}
            told |= {"no_error_bound_because": bound.reason or None}
            told |= {f"rows_{name}": getattr(known, name) for name in ("active", "inactive", "above", "undecided")}
        return {name: None if isinstance(x, float) and not np.isfinite(x) else x for name, x in told.items()}

    def __repr__(self) -> str:
        return f"DistributedSolution({self.problem!r}, {self.status.value}, residual={self.residual:.3g})"

    def __str__(self) -> str:
        return str(Card(self.summary()))


@sheltered
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
    border of the active set. Conjugate gradients, or GMRES where A is not symmetric, solve for the
    free rows. Where Newton's steps do not reduce the residual, sweeps take over for a while.

    Ctrl-C ends the run after the current iteration. PETSc's options that begin with `-icpmodel_`
    reach its multigrid.

    Examples
    --------
    >>> problem = icp.distributed.distribute(icp.scenes.membrane(n=100).problem)
    >>> bool(abs(icp.distributed.solve(problem).z.array - icp.scenes.membrane(n=100).problem.solve().z).max() < 1e-6)
    True
    """
    problem = A if isinstance(A, DistributedICP) else DistributedICP(A, q, psi, upper)
    if isinstance(A, DistributedICP) and q is not None:
        raise InputError("A is a DistributedICP, which has its q; leave out q, psi and upper")
    limits = Limits(rtol=rtol, atol=atol, max_iter=max_iter, time_limit=time_limit)
    as_truth(progress, "progress"), as_truth(raise_on_failure, "raise_on_failure")
    if largest(problem.comm, float((problem.matrix.diagonal <= 0).any()))[0]:
        raise NotApplicable("the diagonal of A has an entry that is not positive, which sweeps and multigrid divide by")
    with _watch(problem.comm, limits) as watch, status_line(progress and problem.comm.rank == 0) as say:
        run = _Run(problem, limits, watch, say)
        status, note = run.carried_out(z0)
    solution = run.solution(status, note)
    if raise_on_failure and not solution.solved:
        raise NotSolved(solution)
    return solution


@contextmanager
def _watch(comm: Any, limits: Limits) -> Iterator[Callable[[], Status | None]]:
    """What tells, on all ranks the same, whether Ctrl-C was pressed or the time is over. Ctrl-C, and what mpiexec sends
    then, perhaps twice, is a flag as long as the block lasts; a second Ctrl-C is what it was before."""
    begin, pressed = time.perf_counter(), list[int]()
    old: dict[int, Any] = {}

    def note(signum: int, frame: Any) -> None:
        pressed.append(signum)
        if signum == signal.SIGINT:
            signal.signal(signum, old[signum])

    if threading.current_thread() is threading.main_thread():
        old = {number: signal.signal(number, note) for number in (signal.SIGINT, signal.SIGTERM)}

    def ended() -> Status | None:
        late = comm.rank == 0 and limits.time_limit is not None and time.perf_counter() - begin > limits.time_limit
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
        self.problem, self.limits, self.watch, self.say = problem, limits, watch, say
        self.begin, self.iterations, self.scale, self.tolerance, self.wanted = time.perf_counter(), 0, np.inf, 0.0, 0.0
        self.levels: DistributedLevels | None = None
        self.best, self.least, self.size = problem.vector(), np.inf, np.inf

    def carried_out(self, z0: Any) -> tuple[Status, str]:
        """(the status, what is to be said of it)."""
        problem = self.problem
        at_0 = problem.residual(problem.vector())
        z, first = (problem.vector(), at_0) if z0 is None else (z0.copy(), problem.residual(z0))
        scale = at_0 if np.isfinite(at_0) else first
        if not np.isfinite(scale):
            _check_maps(problem, z, "at the start")
            raise MapError("the residual at the start is not finite")
        self.scale = scale or _least_term(problem)
        self.tolerance = self.wanted = float(self.limits.tolerance(self.scale))
        if self.limits.atol and (paper := problem.paper_residual(z)) > 0:
            self.wanted = max(self.wanted, self.limits.atol * first / paper)  # about what Res ≤ atol takes
        self._seen(z, first)
        if self._reached(z, first):
            return Status.SOLVED, ""
        simple = simplified(problem) if problem.calls_users else problem
        self.say("making the levels")
        self.levels = DistributedLevels(problem.matrix)
        if (stop := self.watch()) is not None:
            return stop, "while the levels were made"
        try:
            if not first <= _NEAR * at_0:
                self.say(f"starting from {len(self.levels.levels)} levels")
                z = start(self.levels, simplified(simple, start=True) if simple.calls_users else simple)
            return self._steps(simple, z)
        except MapError as error:
            return Status.MAP_FAILED, str(error)

    def _steps(self, simple: DistributedICP, z: Any) -> tuple[Status, str]:
        assert self.levels is not None
        mark, since, rescues = np.inf, 0, 0
        path = looks(self.levels, simple, z, 0, self.wanted)
        look = next(path)
        while True:
            residual = look.residual if simple is self.problem else self.problem.residual(look.z)
            self._seen(look.z, residual)
            self.say(f"iteration {self.iterations}, residual {residual:.2e} -> {self.tolerance:.2e}")
            if self._reached(look.z, residual):
                return Status.SOLVED, ""
            if self.iterations >= self.limits.max_iter:
                return Status.ITERATION_LIMIT, f"{self.iterations} iterations"
            if (stop := self.watch()) is not None:
                return stop, f"in iteration {self.iterations}"
            if np.isnan(residual):
                _check_maps(self.problem, look.z, f"in iteration {self.iterations}")
            since += 1
            if residual <= _REDUCED * mark:
                mark, since = residual, 0
            if since > _PATIENCE or not np.isfinite(residual):
                if self.least <= 2.0 * (noise := self._noise()) < _LOW * self.scale:
                    return Status.PRECISION_LIMIT, f"rounding leaves a residual of up to about {noise:.2g} at this z"
                rescues += 1
                rescued = self._swept(simple) if rescues <= _RESCUES else None
                if rescued is None:
                    return Status.STAGNATED, "neither Newton's steps nor sweeps reduce the residual any more"
                path = looks(self.levels, simple, rescued, 0, self.wanted)
                look, since = next(path), 0
            else:
                look = path.send(self.wanted)
            self.iterations += 1

    def _reached(self, z: Any, residual: float) -> bool:
        """Whether `z`, with Res_D(z) = `residual`, is what was asked for. Collective."""
        if not self.scale:  # as in `solve.goal`
            size = norm(self.problem.comm, z.array_r)
            self.size = min(self.size, size)
            self.tolerance = float(self.limits.tolerance(self.size))
        if residual <= self.tolerance or not self.limits.atol:
            return residual <= self.tolerance
        return self.problem.paper_residual(z) <= self.limits.atol

    def _swept(self, simple: DistributedICP) -> Any:
        """z from the best iterate by sweeps, with a residual that counts as reduced, or None."""
        z = self.best
        for _ in range(_ROUNDS):
            look = LookOnRanks(simple, z, None)
            if look.residual <= _REDUCED * self.least:
                return look.z
            if self.iterations >= self.limits.max_iter or not np.isfinite(look.residual):
                return None
            z = look.swept(_SWEEPS)
            release(self.problem.comm)
            self.iterations += 1
        return None

    def _noise(self) -> float:
        """What rounding may make of the residual of the best iterate."""
        return self._noises()[0]

    def _noises(self) -> tuple[float, float]:
        """What rounding may make of Res_D and of Res there. Collective."""
        (for_p, for_r), comm = rounding(self.problem, self.best), self.problem.comm
        weighted = np.maximum(self.problem.matrix.row_weights * for_p, for_r)
        return norm(comm, weighted), norm(comm, np.maximum(for_p, for_r))

    def _seen(self, z: Any, residual: float) -> None:
        if residual < self.least or not np.isfinite(self.least):
            self.best, self.least = z.copy(), residual

    def solution(self, status: Status, note: str) -> DistributedSolution:
        """The best iterate, judged once more, rounding included."""
        problem, residual = self.problem, self.least
        if status is Status.SOLVED:
            luck, of_paper = self._noises()
            atol = self.limits.atol
            sure = residual + luck <= self.tolerance or (atol and problem.paper_residual(self.best) + of_paper <= atol)
            if not sure and max(self.tolerance, atol) > 0:
                status, note = Status.PRECISION_LIMIT, f"rounding may be worth {luck:.3g} of it"
        message = "solved"
        if status is not Status.SOLVED:
            message = (
                f"{status.value}: {note}; best residual {residual:.3g} (stop at {self.tolerance:.3g}). "
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
            seconds=time.perf_counter() - self.begin,
            levels=levels,
        )


def _least_term(problem: DistributedICP) -> float:
    """The smallest of |q_i|/d_i, |ψ_i(0)| and |ψ̄_i(0)| that is not 0, 0 where there is none: see
    `ProblemData.residual_scale`. Collective."""
    _, below, above = problem.sides(problem.vector())
    sizes = np.abs(np.concatenate([problem.matrix.row_weights * problem.q, below, *([] if above is None else [above])]))
    inverse = 1.0 / sizes[(sizes > 0.0) & (sizes < np.inf)]
    most = largest(problem.comm, float(inverse.max(initial=0.0)))[0]
    return 1.0 / most if most > 0.0 else 0.0


def _check_maps(problem: DistributedICP, z: Any, when: str) -> None:
    """Raise MapError, on all ranks, where an obstacle has no value at a `z` that has one. Collective."""
    _, below, above = problem.sides(z)
    with together(problem.comm):
        for name, side in (("psi", below), ("upper", above)):
            if side is not None and (wrong := np.isnan(side) & np.isfinite(z.array_r)).any():
                raise MapError(f"{name} is nan in row {problem.low + int(np.argmax(wrong))} {when}")
