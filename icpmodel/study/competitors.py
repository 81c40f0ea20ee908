"""Who takes part in a comparison, and one run of one of them, on the clock."""

from __future__ import annotations

import contextlib
import io
import time
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from functools import lru_cache
from typing import Any, ClassVar, Protocol, runtime_checkable

import numpy as np

from ..algebra.relaxation import best_omega
from ..errors import IcpError, InputError
from ..icp import ICP
from ..methods.contract import Method, named
from ..methods.contract import names as method_names
from ..numerics.arrays import Vector, as_list, described
from ..numerics.factorisation import factorise
from ..numerics.lanczos import jacobi_radius
from ..numerics.multigrid import linear_solve
from ..numerics.rounding import UNIT_ROUNDOFF
from ..solve.choice import overrelaxed
from ..solve.driver import RTOL
from ..solvers.contract import IndependentSolver, independent_solvers
from ..solvers.formulations import Target
from ..solvers.peers import PEERS, RACERS, Peer
from .cases import Case, fresh, unbroken
from .timing import Timed

# -- the contract of foreign solvers, until it is that of the room solvers ------------------------------------------


@dataclass(frozen=True, eq=False)
class Claim:
    """What a solver says: its `z` or None, its status in its own `words`, and whether that means `solved`."""

    z: Any
    words: str
    solved: bool


@runtime_checkable
class ForeignSolver(Protocol):
    """A solver that is set up and run apart, so that both can be timed."""

    name: str
    ladder: tuple[float, ...]

    def why_not(self, target: Target) -> str | None:
        """Why it cannot take `target`, or None."""

    def form(self, target: Target) -> str:
        """The form that it takes `target` in."""

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        """Its model of `target`."""

    def run(self, model: Any) -> Claim:
        """Solve the model."""


class _Wired:
    """One of today's independent solvers in that contract; without a ladder it has a tolerance of its own."""

    def __init__(self, kind: type[IndependentSolver]) -> None:
        self.name, self.kind, self.ladder = kind.name, kind, getattr(kind, "ladder", (RTOL,))

    def why_not(self, target: Target) -> str | None:
        return self.kind().why_not(target)

    def form(self, target: Target) -> str:
        return self.kind().form(target)

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        solver: Any = self.kind(tolerance) if hasattr(self.kind, "ladder") else self.kind()  # type: ignore[call-arg]
        if isinstance(solver, Peer):
            model = solver.set_up(_qp(target, self.form(target)), time_limit)
            return lambda: solver.run(model)
        return lambda: solver.solve(target, time_limit=time_limit)

    def run(self, model: Any) -> Claim:
        answer = model()
        return Claim(answer.z, answer.claim, answer.claims_solved)


@lru_cache(maxsize=1)
def _qp(target: Target, form: str) -> Any:
    return target.qp(form)


def foreign_solvers() -> dict[str, ForeignSolver]:
    """Every foreign solver by name, those first that a race asks by default."""
    kinds: dict[str, Any] = {kind.name: kind for kind in RACERS}
    for name, one in independent_solvers().items():
        kinds.setdefault(name, type(one))
    return {name: _Wired(kind) for name, kind in kinds.items()}


def _asked_by_default(of_race: bool) -> list[str]:
    return [kind.name for kind in (RACERS if of_race else PEERS)]


# -- end of what the merge replaces: _qp becomes the target's, the rest solvers.contract ----------------------------


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

    def run(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        """Solve `case` from scratch; call it only where `why_not` is None. The value is a `Claim`."""
        begin = time.perf_counter()
        try:
            return self.attempt(case, tolerance, time_limit)
        except self.raises as error:
            words = f"{type(error).__name__}: {error}"
            return Timed(time.perf_counter() - begin, value=Claim(None, words, False))

    @abstractmethod
    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Timed:
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

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        problem = fresh(case.problem)
        begin = time.perf_counter()
        method = self.method(problem)
        between = time.perf_counter()
        solution = unbroken(problem.solve(method, rtol=tolerance, time_limit=time_limit, raise_on_failure=False))
        seconds = time.perf_counter() - begin
        words = solution.status.value + ("" if method is not None else f" by {solution.method.name}")
        setup = between - begin if isinstance(self, Tuned) else None
        return Timed(seconds, setup, Claim(solution.z, words, solution.solved))


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
    raises: ClassVar[tuple[type[Exception], ...]] = (Exception,)  # whatever its package raises, or calls a vector

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
            self._pose(posed[0])
        return time.perf_counter() - begin

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        assert case.posed is not None
        target, unit = case.posed
        self._pose(target)
        # OSQP prints about polishing whatever one asks
        with contextlib.redirect_stdout(io.StringIO()), np.errstate(all="ignore"):
            begin = time.perf_counter()
            model = self.solver.set_up(target, tolerance, time_limit)
            between = time.perf_counter()
            claim = self.solver.run(model)
            end = time.perf_counter()
            z = None if claim.z is None else np.asarray(claim.z, dtype=np.float64) * unit
        return Timed(end - begin, between - begin, Claim(z, claim.words, claim.solved))

    def _pose(self, target: Target) -> None:
        if (form := self.solver.form(target)) != "mpec":
            _qp(target, form)


class Limit(Competitor):
    """One linear solve with A, which is what no method of Newton's kind can be quicker than by much.

    Parameters: `name`; `solve` the function (A, b) ↦ x, to be solved to ‖Ax − b‖ ≤ 1e-8‖b‖ or as rounding allows.
    """

    kind: ClassVar[str] = "limit"
    raises: ClassVar[tuple[type[Exception], ...]] = (MemoryError, ValueError, RuntimeError, AttributeError)

    def __init__(self, name: str, solve: Callable[[Any, Vector], Vector]) -> None:
        self.name, self.solve = name, solve

    def attempt(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        A, b = case.problem.A, np.ones(case.problem.n)
        begin = time.perf_counter()
        x = self.solve(A, b)
        seconds = time.perf_counter() - begin
        floor = 16 * UNIT_ROUNDOFF * np.linalg.norm(case.problem.matrix.absolute @ np.abs(x))
        solved = bool(np.linalg.norm(A @ x - b) <= max(2 * tolerance * np.linalg.norm(b), floor) < np.inf)
        return Timed(seconds, value=Claim(None, "solved" if solved else "does not converge", solved))


def own_methods() -> list[Competitor]:
    """Every method by its name at its default options, and those that gain by relaxation with the ω of the estimated
    Jacobi radius ρ, ω = 2/(1 + √(1 − ρ²)), the estimate being part of their time.
    """
    return [
        *(Own(name, named(name)) for name in method_names()),
        Tuned("psor, tuned", lambda problem, omega: named("psor", omega=omega)),
        Tuned("mnmaor, tuned", overrelaxed),
    ]


def foreign(solvers: Any = None, *, of_race: bool = False) -> list[Competitor]:
    """The foreign solvers by name or as objects; None for those that a race or a benchmark asks. Raises InputError."""
    known = foreign_solvers()
    found: list[Competitor] = []
    for one in _asked_by_default(of_race) if solvers is None else as_list(solvers, "solvers"):
        if isinstance(one, str) and one in known:
            found.append(Foreign(known[one]))
        elif not isinstance(one, str) and isinstance(one, ForeignSolver):
            found.append(Foreign(one))
        else:
            raise InputError(f"solvers has {described(one)}; one of {', '.join(map(repr, known))} was expected")
    return found


def limits() -> list[Competitor]:
    """The linear solves with A that bound what can be reached."""
    return [Limit("SuperLU, one solve", _superlu), Limit("PyAMG, one solve", linear_solve)]


def competitors() -> list[Competitor]:
    """`solve()`, all peers, all own methods and the limits, in the order of a table."""
    return [Solve(), *foreign(), *own_methods(), *limits()]


def _superlu(A: Any, b: Vector) -> Vector:
    lu = factorise(A)
    if lu is None:
        raise RuntimeError("A is singular")
    return np.asarray(lu.solve(b))
