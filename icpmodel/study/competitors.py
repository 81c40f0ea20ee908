"""The competitors of a comparison, and a timed run of one of them."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import partial
from timeit import repeat
from typing import Any, TypeVar

import numpy as np
from scipy.sparse.linalg import eigsh

from ..algebra.relaxation import best_omega
from ..errors import IcpError, OutOfTime
from ..icp import ICP
from ..methods.aor import overrelaxed
from ..methods.contract import Method, named
from ..numerics.arrays import as_float64
from ..numerics.krylov import couplings
from ..numerics.multigrid import linear_solve
from ..numerics.rounding import UNIT_ROUNDOFF
from ..present.display import Displayable
from ..problem.matrix import MAX_DENSE_ROWS
from ..solve.goal import RTOL
from ..solvers.foreign import Claim, ForeignSolver, ask
from ..solvers.time_limited import time_limited
from .cases import Case, uncached_copy, uninterrupted

T = TypeVar("T")

#: the relative tolerance of ARPACK for the Jacobi radius
_RADIUS_TOLERANCE = 1e-4


@dataclass(frozen=True, repr=False)
class Entry(Displayable):
    """One competitor at one `tolerance` of a race.

    `seconds` are the times of the first round and of each later one that did not fail. Each includes `build` seconds to
    make the ICP or the QP, and `setup` seconds of the solver (None: not measured separately). `error` is in the race's
    measure, and `residual` is Res_D(z)/Res_D(0). A `claim` of success is `loose` if the residual exceeds ten times the
    tolerance, or is not known. A foreign solver applies the tolerance in its own measure.
    """

    name: str
    kind: str
    tolerance: float
    seconds: tuple[float, ...] = ()
    build: float = 0.0
    setup: float | None = None
    error: float | None = None
    residual: float | None = None
    claim: str = ""
    loose: bool = False

    @property
    def median(self) -> float:
        """The median of the `seconds`."""
        return float(np.median(self.seconds))

    @property
    def note(self) -> str:
        """The requested and the reached accuracy of a loose claim; empty for other claims."""
        if not self.loose:
            return ""
        ours = "no number" if self.residual is None else f"{self.residual:.1e}"
        theirs = " in its own measure" if self.kind == "peer" else ""
        return f"asked for {self.tolerance:g}{theirs}, {ours} in ours"


class Competitor(ABC):
    """A competitor in a race; its `kind` is "solve", "own" or "peer"."""

    kind: str
    name: str
    #: the number of set-ups in a run that cannot be interrupted
    setups = 0

    def why_not(self, case: Case) -> str | None:
        """Why this competitor cannot solve `case`, or None."""
        return None

    def build(self, case: Case) -> Any:
        """Make the ICP anew, and for a peer the QP from it, so that this can be timed; `run` does not use them."""
        return uncached_copy(case.problem)

    @abstractmethod
    def run(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        """Solve `case` from scratch; call it only where `why_not` is None."""

    def first_run(self, case: Case, tolerance: float, limit: float) -> str | None:
        """Run once untimed, to import and compile; return why this competitor does not take part, or None."""

        def first() -> str | None:
            if reason := self.why_not(case):
                return reason
            self.build(case)
            with suppress(IcpError, MemoryError):
                self.run(case, tolerance, limit)
            return None

        try:  # facts computed in a separate process are lost: `why_not` caches them in this one
            return within(case, self.setups, limit, first) or self.why_not(case)
        except OutOfTime:
            return f"its set-up and first run take longer than time_limit = {limit:g} s"
        except ChildProcessError as error:
            return str(error)

    def timed_run(self, case: Case, tolerance: float, limit: float) -> Claim:
        """Run with a time limit of `limit` seconds; an error becomes the words of the claim."""
        start_time = time.perf_counter()
        try:
            return within(case, self.setups, limit, lambda: self.run(case, tolerance, limit))
        except (OutOfTime, ChildProcessError) as error:
            return Claim(None, str(error), False, limit)
        except (IcpError, MemoryError) as error:
            return Claim(None, f"{type(error).__name__}: {error}", False, time.perf_counter() - start_time)


class OwnMethod(Competitor):
    """A `method` of this package, or `solve()` if it is None. With `tune`, each run calls and times tune(problem)."""

    def __init__(
        self, name: str = "solve()", method: Method | None = None, tune: Callable[[ICP], Method] | None = None
    ) -> None:
        self.name, self._method, self._tune = name, method, tune
        self.kind = "solve" if method is None else "own"

    def why_not(self, case: Case) -> str | None:
        return None if self._method is None else self._method.why_not(case.problem)

    def run(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        problem = uncached_copy(case.problem)
        start_time = time.perf_counter()
        method = self._method if self._tune is None else self._tune(problem)
        setup = None if self._tune is None else time.perf_counter() - start_time
        solution = uninterrupted(problem.solve(method, rtol=tolerance, time_limit=time_limit, raise_on_failure=False))
        seconds = time.perf_counter() - start_time
        words = solution.status.value + ("" if method is not None else f" by {solution.method.name}")
        return Claim(solution.z, words, solution.solved, seconds, setup)


class ForeignCompetitor(Competitor):
    """A foreign `solver`. Its QP is made before the clock starts; conversion to its own format counts as its time."""

    kind = "peer"
    setups = 1

    def __init__(self, solver: ForeignSolver) -> None:
        self.name, self.solver = solver.name, solver

    def why_not(self, case: Case) -> str | None:
        if case.formulation is None:
            return "psi is neither constant nor affine: no QP"
        return self.solver.why_not(case.formulation[0])

    def build(self, case: Case) -> Any:
        formulation = Case(uncached_copy(case.problem)).formulation
        return None if formulation is None else self.solver.pose(formulation[0])

    def run(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        assert case.formulation is not None
        target, unit = case.formulation
        claim = ask(self.solver, target, tolerance, time_limit)
        return claim if claim.z is None else replace(claim, z=as_float64(claim.z, "its z") * unit)


def within(case: Case, setups: int, limit: float, call: Callable[[], T]) -> T:
    """Return call(), from a separate process that is killed after `limit` seconds if the set-ups may take longer.

    Raises OutOfTime at the limit, ChildProcessError where the process died.
    """
    if not setups:
        return call()
    return next(time_limited(lambda: iter([call()]), case.problem, setups, time.perf_counter() + limit))


def linear_solve_seconds(case: Case, repeats: int, limit: float) -> float | None:
    """The median time of one solve with A by PyAMG, to ‖Ax − b‖ ≤ 1e-8‖b‖ or as rounding allows, for comparison.

    None where it fails or takes longer than `limit`.
    """
    A = case.problem.A
    b = np.ones(case.problem.n)
    with suppress(OutOfTime, ChildProcessError, MemoryError, RuntimeError, ValueError):
        x = within(case, 1, limit, partial(linear_solve, A, b))
        floor = 16 * UNIT_ROUNDOFF * np.linalg.norm(case.problem.matrix.absolute @ np.abs(x))
        if np.linalg.norm(A @ x - b) <= max(2 * RTOL * np.linalg.norm(b), floor) < np.inf:
            return float(np.median(repeat(partial(linear_solve, A, b), number=1, repeat=repeats)))
    return None


def tuned_methods() -> list[Competitor]:
    """The competitors with the relaxation parameter `tuned_omega`."""
    return [
        OwnMethod("psor, tuned", named("psor"), lambda problem: named("psor", omega=tuned_omega(problem))),
        OwnMethod("mnmaor, tuned", named("mnmaor"), lambda problem: overrelaxed(problem, tuned_omega(problem))),
    ]


def tuned_omega(problem: ICP) -> float:
    """ω = 2/(1 + √(1 − ρ²)), ρ the Jacobi radius, by ARPACK for many unknowns; 1 unless D > 0 and A couples rows."""
    S = couplings(problem.A)
    if not (np.isfinite(S.data).all() and S.data.any() and problem.matrix.has_positive_diagonal):
        return 1.0
    if problem.n <= MAX_DENSE_ROWS:
        return best_omega(float(np.linalg.eigvalsh(S.toarray())[-1]))
    start = np.ones(problem.n)
    return best_omega(float(eigsh(S, 1, which="LA", v0=start, tol=_RADIUS_TOLERANCE, return_eigenvectors=False)[0]))
