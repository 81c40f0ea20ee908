"""Who takes part in a comparison, and one run of one of them; the one judge of all is the residual of the problem."""

from __future__ import annotations

import json
import time
from abc import ABC, abstractmethod
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import best_omega
from ..errors import IcpError, InputError
from ..icp import ICP
from ..methods.aor import overrelaxed
from ..methods.contract import Method, named
from ..methods.contract import names as method_names
from ..numerics.arrays import Vector, as_list, as_number
from ..numerics.factorisation import factorise
from ..numerics.lanczos import jacobi_radius
from ..numerics.multigrid import linear_solve
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.affine import Affine, Constant
from ..scenes import Scene, names, parameters, scene
from ..solve.driver import RTOL
from ..solvers.contract import ForeignSolver, ask, chosen_solvers
from ..solvers.formulations import Target, in_handy_units

#: scenes with other parameters, which make them harder or of another kind
VARIANTS = (
    "membrane,mu=4",
    "membrane,skew=0.5",
    "bai-symmetric,mu=0",
    "bai-nonsymmetric,mu=0",
    "manufactured-affine,mu=0",
    "manufactured-elementwise,mu=0",
)


def gallery() -> tuple[str, ...]:
    """Every scene, and `VARIANTS`."""
    return tuple(sorted([*names(), *VARIANTS]))


def built(text: str, n: int | None) -> Scene:
    """The scene that `text`, NAME or NAME,PARAMETER=NUMBER,…, stands for, with about `n` unknowns if it has a choice.

    Raises InputError.
    """
    name, *pairs = text.split(",")
    given: dict[str, Any] = {}
    for pair in pairs:
        key, _, value = pair.partition("=")
        try:
            given[key] = json.loads(value)
        except ValueError:
            raise InputError(f"{text!r} is not of the form NAME,PARAMETER=NUMBER") from None
    return scene(name, n if "n" in parameters(name) else None, **given)


def as_scenes(texts: Any) -> tuple[str, ...]:
    """The `texts` that `built` understands, found out before anything is measured. Raises InputError."""
    listed = tuple(as_list(texts, "scenes"))
    for text in listed:
        built(text, None)
    return listed


def as_sizes(sizes: Any) -> tuple[int, ...]:
    """Wanted numbers of unknowns. Raises InputError."""
    return tuple(int(as_number(n, "sizes", least=1, whole=True)) for n in as_list(sizes, "sizes"))


@dataclass(frozen=True, eq=False)
class Timed:
    """What a run found: `z` or None, the `claim` and whether it is one of success; `seconds` in all, and of `setup`."""

    z: Any
    claim: str
    claims_solved: bool
    seconds: float
    setup: float | None


#: a competitor that is so many times as slow as the best single method makes solve() look bad
WORST = 1.5


@dataclass(frozen=True, eq=False)
class Case:
    """One problem of a comparison: its `scene`'s text, and the `problem`."""

    scene: str
    problem: ICP

    @cached_property
    def scale(self) -> float:
        """Res(0), by which residuals are divided. Raises InputError where z = 0 is a solution."""
        scale = self.problem.residual_at_0()
        if not 0 < scale < np.inf:
            raise InputError(f"{self.scene}: Res(0) = {scale:g}, there is nothing to measure")
        return scale

    @cached_property
    def posed(self) -> tuple[Target, float] | None:
        """The problem as peers get it, and the unit of its z; None where ψ is not constant or affine."""
        if not isinstance(self.problem.psi, Constant | Affine):
            return None
        problem, unit = in_handy_units(self.problem)
        return Target(problem), unit

    def fresh(self) -> ICP:
        """The problem, nothing of which is remembered."""
        return ICP(self.problem.A, self.problem.q, self.problem.psi)

    def judged(self, z: Any) -> float | None:
        """Res(z)/Res(0), None where z is no finite vector of shape (n,)."""
        try:
            ratio = self.problem.residual(np.asarray(z, dtype=np.float64)) / self.scale
        except (IcpError, TypeError, ValueError):
            return None
        return ratio if np.isfinite(ratio) else None


class Competitor(ABC):
    """One that takes part: `name`; `kind` "solve", "own", "peer" or "limit"; `ladder`, the tolerances to try in turn."""

    kind: ClassVar[str]
    name: str
    ladder: tuple[float, ...]

    def why_not(self, case: Case) -> str | None:
        """Why it cannot take `case`, or None."""
        return None

    def build(self, case: Case) -> float:
        """Seconds to make what it is given, outside of the time of `run`: the ICP, and for a peer the QP from it."""
        begin = time.perf_counter()
        case.fresh()
        return time.perf_counter() - begin

    @abstractmethod
    def run(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        """Solve `case` from scratch; call it only where `why_not` is None. What goes wrong becomes the claim."""


class Own(Competitor):
    """A method of this package, or `solve` itself. Parameters: `name`; `make` gives the method for a problem."""

    kind: ClassVar[str] = "own"
    ladder = (RTOL,)

    def __init__(self, name: str, make: Callable[[ICP], Method | None]) -> None:
        self.name, self.make = name, make

    def why_not(self, case: Case) -> str | None:
        if not (case.problem.A.diagonal() > 0).all() and "tuned" in self.name:
            return "A has no positive diagonal"
        method = self.make(case.fresh())
        return None if method is None else method.why_not(case.problem)

    def run(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        problem = case.fresh()
        begin = time.perf_counter()
        method = self.make(problem)
        between = time.perf_counter()
        try:
            solution = problem.solve(method, rtol=tolerance, time_limit=time_limit, raise_on_failure=False)
        except (IcpError, MemoryError) as error:
            return Timed(None, f"{type(error).__name__}: {error}", False, time.perf_counter() - begin, None)
        seconds = time.perf_counter() - begin
        claim = solution.status.value if method is not None else f"{solution.status.value} by {solution.method.name}"
        return Timed(solution.z, claim, solution.solved, seconds, between - begin if "tuned" in self.name else None)


class Solve(Own):
    """`solve()` without a method."""

    kind: ClassVar[str] = "solve"

    def __init__(self) -> None:
        super().__init__("solve()", lambda problem: None)


class Foreign(Competitor):
    """A foreign solver. Parameters: `solver`."""

    kind: ClassVar[str] = "peer"

    def __init__(self, solver: ForeignSolver) -> None:
        self.name, self.solver, self.ladder = solver.name, solver, solver.ladder

    def why_not(self, case: Case) -> str | None:
        if case.posed is None:
            return "psi is neither constant nor affine: no QP"
        return self.solver.why_not(case.posed[0])

    def build(self, case: Case) -> float:
        begin = time.perf_counter()
        posed = Case(case.scene, case.fresh()).posed
        if posed is not None:
            self.solver.pose(posed[0])
        return time.perf_counter() - begin

    def run(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        assert case.posed is not None
        target, unit = case.posed
        found = ask(self.solver, target, tolerance, time_limit)
        try:
            z = None if found.z is None else np.asarray(found.z, dtype=np.float64) * unit
        except (TypeError, ValueError) as error:
            return Timed(None, f"{type(error).__name__}: {error}", False, found.seconds, found.setup)
        return Timed(z, found.words, found.solved, found.seconds, found.setup)


class Limit(Competitor):
    """One linear solve with A, which is what no method of Newton's kind can be quicker than by much.

    Parameters: `name`; `solve` the function (A, b) ↦ x, to be solved to ‖Ax − b‖ ≤ 1e-8‖b‖ or as rounding allows.
    """

    kind: ClassVar[str] = "limit"
    ladder = (RTOL,)

    def __init__(self, name: str, solve: Callable[[Any, Vector], Vector]) -> None:
        self.name, self.solve = name, solve

    def run(self, case: Case, tolerance: float, time_limit: float) -> Timed:
        """See `Competitor.run`; there is no z."""
        A, b = case.problem.A, np.ones(case.problem.n)
        begin = time.perf_counter()
        try:
            x = self.solve(A, b)
        except (MemoryError, ValueError, RuntimeError, AttributeError, np.linalg.LinAlgError) as error:
            return Timed(None, f"{type(error).__name__}: {error}", False, time.perf_counter() - begin, None)
        seconds = time.perf_counter() - begin
        floor = 16 * UNIT_ROUNDOFF * np.linalg.norm(case.problem.matrix.absolute @ np.abs(x))
        solved = bool(np.linalg.norm(A @ x - b) <= max(2 * tolerance * np.linalg.norm(b), floor) < np.inf)
        return Timed(None, "solved" if solved else "does not converge", solved, seconds, None)


def own_methods() -> list[Competitor]:
    """Every method by its name at its default options, and those that gain by relaxation with the ω of the estimated
    Jacobi radius ρ, ω = 2/(1 + √(1 − ρ²)), the estimate being part of their time.
    """

    def default(name: str) -> Competitor:
        return Own(name, lambda problem: named(name))

    tuned: list[Competitor] = [
        Own("psor, tuned", lambda problem: named("psor", omega=_omega(problem))),
        Own("mnmaor, tuned", lambda problem: overrelaxed(problem, _omega(problem))),
    ]
    return [default(name) for name in method_names()] + tuned


def limits() -> list[Competitor]:
    """The linear solves with A that bound what can be reached."""
    return [Limit("SuperLU, one solve", _superlu), Limit("PyAMG, one solve", linear_solve)]


def competitors() -> list[Competitor]:
    """`solve()`, all peers, all own methods and the limits, in the order of a table."""
    return [Solve(), *(Foreign(one) for one in chosen_solvers(None, "benchmark")), *own_methods(), *limits()]


def _omega(problem: ICP) -> float:
    return best_omega(jacobi_radius(problem.A))


def _superlu(A: Any, b: Vector) -> Vector:
    lu = factorise(A)
    if lu is None:
        raise RuntimeError("A is singular")
    return np.asarray(lu.solve(b))


def cases(texts: tuple[str, ...], sizes: tuple[int, ...]) -> Iterator[tuple[str, int, Case | str]]:
    """(text, n, the case or why there is none) for every scene and every size that it can have, each size once."""
    for text in texts:
        seen: set[int] = set()
        for wanted in sizes:
            try:
                problem = built(text, wanted).problem
                case: Case | str = Case(text, problem)
                n = problem.n
                assert isinstance(case, Case)
                _ = case.scale
            except (IcpError, MemoryError) as error:
                case, n = str(error) or "not enough memory", wanted
            if n not in seen:
                seen.add(n)
                yield text, n, case
