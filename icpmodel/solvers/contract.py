"""Foreign solvers: the contract."""

from __future__ import annotations

import importlib
import pkgutil
from abc import ABC, abstractmethod
from collections.abc import Iterable
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

from ..errors import InputError
from ..numerics.arrays import as_list
from .formulations import Target


@dataclass(frozen=True, eq=False)
class Answer:
    """What an independent solver returns: its `z`, shape (n,) in the units of `target.problem`, or None; the `claim`,
    its status in its own words; and whether that claims success. The claim is recorded and never believed.

    >>> Answer(None, "infeasible", False).z is None
    True
    """

    z: Any
    claim: str
    claims_solved: bool


class IndependentSolver(ABC):
    """The contract. A subclass in a file of this folder that defines `name` is found by itself.

    `name` is unique and what users write; `forms` are the formulations it can take, best first, of "energy", "gap"
    (convex QPs, see `formulations.py`) and "mpec"; `largest` the n beyond which it is not asked, or None, and
    `too_large` what happens there. Importing the file must not import the foreign package.

    >>> independent_solvers()["osqp"].forms
    ('energy', 'gap')
    """

    name: ClassVar[str]
    forms: ClassVar[tuple[str, ...]]
    largest: ClassVar[int | None] = None
    too_large: ClassVar[str] = "it takes minutes"

    def why_not(self, target: Target) -> str | None:
        """Why this solver cannot take `target`, in one sentence, or None where it can.

        Override it to add reasons (not installed), and end with `super().why_not(target)`, which says why
        none of `forms` applies.

        >>> independent_solvers()["osqp"].why_not(Target(ICP([[-1.0]], [1.0])))
        "A + A' is not positive semidefinite: its diagonal entry -2 in row 0 is negative"
        """
        if self.largest is not None and target.problem.n > self.largest:
            return f"{self.too_large} beyond n = {self.largest}; this n is {target.problem.n}"
        reasons = {form: target.why_not(form) for form in self.forms}
        # the gap asks least of a problem, so that its reason says most
        return None if None in reasons.values() else reasons.get("gap", reasons[self.forms[-1]])

    def form(self, target: Target) -> str:
        """The first of `forms` that applies to `target`; call it only where `why_not` is None.

        >>> independent_solvers()["osqp"].form(Target(ICP([[1.0]], [1.0])))
        'energy'
        """
        return next(form for form in self.forms if target.why_not(form) is None)

    @abstractmethod
    def solve(self, target: Target, *, time_limit: float) -> Answer:
        """Solve `target` from scratch, in the form `self.form(target)`, in at most about `time_limit` seconds.

        Called only where `why_not` is None. May raise whatever the foreign package raises.

        >>> independent_solvers()["osqp"].solve(Target(ICP([[2.0]], [-1.0], psi=1)), time_limit=10).claims_solved
        True
        """


def missing(module: str) -> str | None:
    """Why `module` cannot be imported, with the command that mends it, or None where it can."""
    try:
        importlib.import_module(module)
    except ModuleNotFoundError as error:
        if error.name == module:
            return f"{module} is not installed: pip install {module}"
        return f"{module} cannot be imported: {error}"
    except ImportError as error:
        return f"{module} cannot be imported: {error}"
    return None


def independent_solvers() -> dict[str, IndependentSolver]:
    """Every independent solver of this folder by name, in the order of the files; foreign packages stay unloaded.

    >>> independent_solvers()["osqp"].name
    'osqp'
    """
    found: dict[str, IndependentSolver] = {}
    for info in sorted(pkgutil.iter_modules([str(Path(__file__).parent)]), key=lambda info: info.name):
        module = importlib.import_module(f"{__package__}.{info.name}")
        for value in vars(module).values():
            if isinstance(value, type) and issubclass(value, IndependentSolver) and "name" in vars(value):
                found[value.name] = value()
    return found


def chosen_solvers(solvers: Iterable[str | IndependentSolver] | None) -> list[IndependentSolver]:
    """The solvers that names or own objects stand for, None for all; each once.

    Raises InputError for an unknown name.

    >>> [solver.name for solver in chosen_solvers(["osqp", "osqp"])]
    ['osqp']
    """
    known = independent_solvers()
    if solvers is None:
        return list(known.values())
    chosen: dict[str, IndependentSolver] = {}
    for solver in [solvers] if isinstance(solvers, str | IndependentSolver) else as_list(solvers, "solvers"):
        if isinstance(solver, str):
            if solver not in known:
                raise InputError(f"solvers has {solver!r}; one of {', '.join(known)} was expected")
            solver = known[solver]
        elif not isinstance(solver, IndependentSolver):
            raise InputError(f"solvers has a {type(solver).__name__}; names or IndependentSolver objects were expected")
        chosen[solver.name] = solver  # named twice, asked once
    return list(chosen.values())
