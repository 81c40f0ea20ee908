"""Who takes part in a comparison, and one run of one of them, on the clock."""

from __future__ import annotations

import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import replace
from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import best_omega
from ..errors import IcpError
from ..icp import ICP
from ..methods.aor import overrelaxed
from ..methods.contract import Method, named
from ..methods.contract import names as method_names
from ..numerics.arrays import Vector
from ..numerics.factorisation import factorise
from ..numerics.lanczos import jacobi_radius
from ..numerics.multigrid import linear_solve
from ..numerics.rounding import UNIT_ROUNDOFF
from ..solve.driver import RTOL
from ..solvers.contract import Claim, ForeignSolver, ask, chosen_solvers
from .cases import Case, fresh, unbroken


class Competitor(ABC):
    """One that takes part: `name`; `kind` "solve", "own", "peer" or "limit"; `ladder`, tolerances to try in turn."""

    kind: ClassVar[str]
    #: what it may raise, which is then what it says
    raises: ClassVar[tuple[type[Exception], ...]] = (IcpError, MemoryError)
    name: str
    ladder: tuple[float, ...] = (RTOL,)

    def why_not(self, case: Case) -> str | None:
        """Why it cannot take `case`, or None."""
        return None

    def build(self, case: Case) -> float:
        """Seconds to make what it is given, outside of the time of `run`: the ICP, and for a peer the QP from it."""
        begin = time.perf_counter()
        fresh(case.problem)
        return time.perf_counter() - begin

    def run(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        """Solve `case` from scratch; call it only where `why_not` is None."""
        begin = time.perf_counter()
        try:
            return self.attempt(case, tolerance, time_limit)
        except self.raises as error:
            return Claim(None, f"{type(error).__name__}: {error}", False, time.perf_counter() - begin)

    @abstractmethod
    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        """The same; what it raises becomes the claim."""


class Own(Competitor):
    """A method of this package. Parameters: `name`, and the `method`."""

    kind: ClassVar[str] = "own"

    def __init__(self, name: str, method: Method | None) -> None:
        self.name, self._method = name, method

    def method(self, problem: ICP) -> Method | None:
        """The method for `problem`."""
        return self._method

    def why_not(self, case: Case) -> str | None:
        method = self.method(fresh(case.problem))
        return None if method is None else method.why_not(case.problem)

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        problem = fresh(case.problem)
        begin = time.perf_counter()
        method = self.method(problem)
        between = time.perf_counter()
        solution = unbroken(problem.solve(method, rtol=tolerance, time_limit=time_limit, raise_on_failure=False))
        seconds = time.perf_counter() - begin
        words = solution.status.value + ("" if method is not None else f" by {solution.method.name}")
        setup = between - begin if isinstance(self, Tuned) else None
        return Claim(solution.z, words, solution.solved, seconds, setup)


class Solve(Own):
    """`solve()` without a method."""

    kind: ClassVar[str] = "solve"

    def __init__(self) -> None:
        super().__init__("solve()", None)


class Tuned(Own):
    """A method `make`(problem, ω) with the ω of the estimated Jacobi radius, which is part of its time."""

    def __init__(self, name: str, make: Callable[[ICP, float], Method]) -> None:
        super().__init__(name, None)
        self.make = make

    def method(self, problem: ICP) -> Method:
        return self.make(problem, best_omega(jacobi_radius(problem.A)))

    def why_not(self, case: Case) -> str | None:
        if not case.problem.matrix.has_positive_diagonal:
            return "A has no positive diagonal"
        return super().why_not(case)


class Foreign(Competitor):
    """A foreign `solver`. Its QP is made before the clock starts, turning that into its own format is its own time."""

    kind: ClassVar[str] = "peer"
    raises: ClassVar[tuple[type[Exception], ...]] = (TypeError, ValueError)  # what it calls a vector may be none

    def __init__(self, solver: ForeignSolver) -> None:
        self.name, self.solver, self.ladder = solver.name, solver, solver.ladder

    def why_not(self, case: Case) -> str | None:
        if case.posed is None:
            return "psi is neither constant nor affine: no QP"
        return self.solver.why_not(case.posed[0])

    def build(self, case: Case) -> float:
        begin = time.perf_counter()
        posed = Case(case.scene, fresh(case.problem)).posed
        if posed is not None:
            self.solver.pose(posed[0])
        return time.perf_counter() - begin

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        assert case.posed is not None
        target, unit = case.posed
        claim = ask(self.solver, target, tolerance, time_limit)
        return claim if claim.z is None else replace(claim, z=np.asarray(claim.z, dtype=np.float64) * unit)


class Limit(Competitor):
    """One linear solve with A, which is what no method of Newton's kind can be quicker than by much.

    Parameters: `name`; `solve` the function (A, b) ↦ x, to be solved to ‖Ax − b‖ ≤ 1e-8‖b‖ or as rounding allows.
    """

    kind: ClassVar[str] = "limit"
    raises: ClassVar[tuple[type[Exception], ...]] = (MemoryError, ValueError, RuntimeError, AttributeError)

    def __init__(self, name: str, solve: Callable[[Any, Vector], Vector]) -> None:
        self.name, self.solve = name, solve

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Claim:
        A, b = case.problem.A, np.ones(case.problem.n)
        begin = time.perf_counter()
        x = self.solve(A, b)
        seconds = time.perf_counter() - begin
        floor = 16 * UNIT_ROUNDOFF * np.linalg.norm(case.problem.matrix.absolute @ np.abs(x))
        solved = bool(np.linalg.norm(A @ x - b) <= max(2 * tolerance * np.linalg.norm(b), floor) < np.inf)
        return Claim(None, "solved" if solved else "does not converge", solved, seconds)


def own_methods() -> list[Competitor]:
    """Every method by its name at its default options, and those that gain by relaxation with the ω of the estimated
    Jacobi radius ρ, ω = 2/(1 + √(1 − ρ²)), the estimate being part of their time.
    """
    return [
        *(Own(name, named(name)) for name in method_names()),
        Tuned("psor, tuned", lambda problem, omega: named("psor", omega=omega)),
        Tuned("mnmaor, tuned", overrelaxed),
    ]


def limits() -> list[Competitor]:
    """The linear solves with A that bound what can be reached."""
    return [Limit("SuperLU, one solve", _superlu), Limit("PyAMG, one solve", linear_solve)]


def competitors() -> list[Competitor]:
    """`solve()`, all peers, all own methods and the limits, in the order of a table."""
    return [Solve(), *map(Foreign, chosen_solvers(None, "benchmark")), *own_methods(), *limits()]


def _superlu(A: Any, b: Vector) -> Vector:
    lu = factorise(A)
    if lu is None:
        raise RuntimeError("A is singular")
    return np.asarray(lu.solve(b))
