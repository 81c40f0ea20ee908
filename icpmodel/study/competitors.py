"""The competitors of a comparison, and a timed run of one of them."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.sparse.linalg import eigsh

from ..algebra.relaxation import best_omega
from ..errors import IcpError
from ..icp import ICP
from ..methods.aor import overrelaxed
from ..methods.contract import Method, named
from ..numerics.arrays import as_float64
from ..numerics.krylov import couplings
from ..numerics.multigrid import linear_solve
from ..numerics.rounding import UNIT_ROUNDOFF
from ..present.display import Displayable
from ..problem.matrix import MAX_DENSE_ROWS
from ..solvers.foreign import Claim, ForeignSolver, ask
from .cases import Case, uncached_copy, uninterrupted

#: the residual of the eigenvector of the Jacobi radius
_RADIUS_TOLERANCE = 1e-4


@dataclass(frozen=True, repr=False)
class Entry(Displayable):
    """One competitor at one `tolerance` of a race.

    `seconds` are those of each round that did not fail. Among them are `build` seconds to make the ICP or the QP, and
    `setup` seconds of the solver (None: not measured separately). `error` is in the race's measure, and `residual` is
    Res_D(z)/Res_D(0). A `claim` of success is `loose` if the residual exceeds ten times the tolerance. A foreign solver
    understands the tolerance in a measure of its own.
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
        """The note on a loose claim."""
        if not self.loose:
            return ""
        ours = "no number" if self.residual is None else f"{self.residual:.1e}"
        theirs = " in its own measure" if self.kind == "peer" else ""
        return f"asked for {self.tolerance:g}{theirs}, {ours} in ours"


class Competitor(ABC):
    """A competitor in a race; its `kind` is "solve", "own", "peer" or "limit"."""

    kind: str
    name: str
    #: exceptions that count as its claim; any other is an error of this package
    raises: tuple[type[Exception], ...] = (IcpError, MemoryError)
    #: whether it keeps to the time limit by itself
    keeps_time_limit = False

    def why_not(self, case: Case) -> str | None:
        """Why it cannot take `case`, or None."""
        return None

    def build(self, case: Case) -> Any:
        """Build the input of `run`, outside of its time: the ICP, and for a peer the QP from it."""
        return uncached_copy(case.problem)

    def run(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        """Solve `case` from scratch; call it only where `why_not` is None."""
        start_time = time.perf_counter()
        try:
            return self.attempt(case, tolerance, time_limit)
        except self.raises as error:
            return Claim(None, f"{type(error).__name__}: {error}", False, time.perf_counter() - start_time)

    @abstractmethod
    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        """`run`, where an exception becomes the claim."""


class OwnMethod(Competitor):
    """A `method` of this package, or `solve()` without one; with `tune` it is tune(problem), part of its time."""

    keeps_time_limit = True

    def __init__(
        self, name: str = "solve()", method: Method | None = None, tune: Callable[[ICP], Method] | None = None
    ) -> None:
        self.name, self._method, self._tune = name, method, tune
        self.kind = "solve" if method is None else "own"

    def why_not(self, case: Case) -> str | None:
        return None if self._method is None else self._method.why_not(case.problem)

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        problem = uncached_copy(case.problem)
        start_time = time.perf_counter()
        method = self._method if self._tune is None else self._tune(problem)
        setup = None if self._tune is None else time.perf_counter() - start_time
        solution = uninterrupted(problem.solve(method, rtol=tolerance, time_limit=time_limit, raise_on_failure=False))
        seconds = time.perf_counter() - start_time
        words = solution.status.value + ("" if method is not None else f" by {solution.method.name}")
        return Claim(solution.z, words, solution.solved, seconds, setup)


class ForeignCompetitor(Competitor):
    """A foreign `solver`. Its QP is made before the clock starts, turning that into its own format is its own time."""

    kind = "peer"
    raises = (IcpError, MemoryError, TypeError, ValueError)

    def __init__(self, solver: ForeignSolver) -> None:
        self.name, self.solver = solver.name, solver

    def why_not(self, case: Case) -> str | None:
        if case.formulation is None:
            return "psi is neither constant nor affine: no QP"
        return self.solver.why_not(case.formulation[0])

    def build(self, case: Case) -> Any:
        formulation = Case(uncached_copy(case.problem)).formulation
        return None if formulation is None else self.solver.pose(formulation[0])

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        assert case.formulation is not None
        target, unit = case.formulation
        claim = ask(self.solver, target, tolerance, time_limit)
        return claim if claim.z is None else replace(claim, z=as_float64(claim.z, "its z") * unit)


class LinearSolve(Competitor):
    """One linear solve with A by PyAMG, to ‖Ax − b‖ ≤ 1e-8‖b‖ or as rounding allows: what bounds every method."""

    name = "PyAMG, one solve"
    kind = "limit"
    raises = (MemoryError, RuntimeError, ValueError)

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        A = case.problem.A
        b = np.ones(case.problem.n)
        start_time = time.perf_counter()
        x = linear_solve(A, b)
        seconds = time.perf_counter() - start_time
        floor = 16 * UNIT_ROUNDOFF * np.linalg.norm(case.problem.matrix.absolute @ np.abs(x))
        solved = bool(np.linalg.norm(A @ x - b) <= max(2 * tolerance * np.linalg.norm(b), floor) < np.inf)
        return Claim(None, "solved" if solved else "does not converge", solved, seconds)


def tuned_methods() -> list[Competitor]:
    """Methods that gain by relaxation with the `tuned_omega`."""
    return [
        OwnMethod("psor, tuned", named("psor"), lambda problem: named("psor", omega=tuned_omega(problem))),
        OwnMethod("mnmaor, tuned", named("mnmaor"), lambda problem: overrelaxed(problem, tuned_omega(problem))),
    ]


def tuned_omega(problem: ICP) -> float:
    """ω = 2/(1 + √(1 − ρ²)) of the Jacobi radius ρ, by ARPACK for many unknowns; 1 unless D > 0 and A couples rows."""
    S = couplings(problem.A)
    if not (np.isfinite(S.data).all() and S.data.any() and problem.matrix.has_positive_diagonal):
        return 1.0
    if problem.n <= MAX_DENSE_ROWS:
        return best_omega(float(np.linalg.eigvalsh(S.toarray())[-1]))
    start = np.ones(problem.n)
    return best_omega(float(eigsh(S, 1, which="LA", v0=start, tol=_RADIUS_TOLERANCE, return_eigenvectors=False)[0]))
