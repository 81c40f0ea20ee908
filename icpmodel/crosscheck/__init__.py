"""Second opinions: independent solvers solve the same problem from scratch, and one judge compares.

The contract of an independent solver is `IndependentSolver`. To add one, add one file to this folder with a class that
has a `name`; nothing else is edited. `crosscheck` asks them and returns a `Report`.
"""

from __future__ import annotations

import contextlib
import importlib
import io
import logging
import pkgutil
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..arrays import as_list, as_number
from ..errors import InputError, Interrupted
from ..problem import ICP, as_icp
from ..progress import status_line
from ..solution import Solution
from .formulations import QP, Target
from .judge import Checked, Row, Verdict
from .report import Report

__all__ = [
    "QP",
    "Answer",
    "IndependentSolver",
    "Report",
    "Row",
    "Target",
    "Verdict",
    "chosen_solvers",
    "crosscheck",
    "independent_solvers",
    "missing",
]


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
    """Why `module` cannot be imported, with the command that mends it, or None where it can.

    >>> missing("no_such_module")
    'no_such_module is not installed: pip install no_such_module'
    """
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
    for info in sorted(pkgutil.iter_modules(__path__), key=lambda info: info.name):
        module = importlib.import_module(f"{__name__}.{info.name}")
        for value in vars(module).values():
            if isinstance(value, type) and issubclass(value, IndependentSolver) and "name" in vars(value):
                found[value.name] = value()
    return found


def crosscheck(
    problem: ICP,
    solution: Any = None,
    solvers: Iterable[str | IndependentSolver] | None = None,
    *,
    atol: float | None = None,
    time_limit: float = 60.0,
    progress: bool = False,
) -> Report:
    """Have independent solvers solve `problem`, and compare each with the answer under test.

    Parameters: `solution` a `Solution`, a vector z of shape (n,), or None, which solves first; `solvers` names (see
    `independent_solvers`) or own `IndependentSolver` objects, None for all; `atol` how far two answers may lie apart in
    an entry, in the units of z, default 1e-6 max|z|; `time_limit` seconds for each problem that a
    solver is given; `progress` says on a
    terminal which solver is at work.
    Returns a `Report`; `report.agrees` is True only where at least one solver really agreed and none disagreed.
    Raises InputError for a z of the wrong shape, an unknown solver or a bad number, and Interrupted, which carries
    the report so far, after Ctrl-C.

    >>> report = crosscheck(ICP([[2, -1], [-1, 2]], [-1, 3]), [0.5, 0.0], ["osqp", "cvxpy-clarabel"])
    >>> [row.verdict.value for row in report.rows], report.agrees
    (['agrees', 'agrees'], True)
    >>> crosscheck(ICP([[2, -1], [-1, 2]], [-1, 3]), [0.5001, 0.0], ["osqp"]).rows[0].verdict
    <Verdict.DISAGREES: 'disagrees'>
    """
    as_icp(problem)
    chosen = chosen_solvers(solvers)
    if atol is not None:
        as_number(atol, "atol", least=0)
    as_number(time_limit, "time_limit", above=0)
    if solution is None:
        solution = problem.solve(raise_on_failure=False)
    # an answer may hold anything, infinities too: the judge sees what comes of them, the user need not be warned
    with np.errstate(over="ignore", invalid="ignore"):
        checked = Checked.of(problem, solution, atol)
        rows: list[Row] = []
        known = solution if isinstance(solution, Solution) else None
        with status_line(progress) as say:
            for k, solver in enumerate(chosen):
                say(f"asking {solver.name} ({k + 1} of {len(chosen)})")
                try:
                    rows += _ask(solver, checked, time_limit)
                except KeyboardInterrupt:
                    rows += [Row.skipped(other.name, "interrupted") for other in chosen[k:]]
                    raise Interrupted(Report.of(checked, rows, known)) from None
        return Report.of(checked, rows, known)


def _ask(solver: IndependentSolver, checked: Checked, time_limit: float) -> list[Row]:
    """One row for each target that `solver` can take; where it can take none, one for each reason."""
    reasons = [solver.why_not(target) for target in checked.targets]
    rows = []
    for target, reason in zip(checked.targets, reasons, strict=True):
        if reason is None:
            form = solver.form(target)
            start = time.perf_counter()
            try:
                # foreign chatter (OSQP prints about polishing whatever one asks) must not reach the user's output
                with contextlib.redirect_stdout(io.StringIO()), _quiet_logs():
                    answer = solver.solve(target, time_limit=time_limit)
            except Exception as error:  # whatever a foreign package may raise; KeyboardInterrupt is none of these
                answer = Answer(None, f"{type(error).__name__}: {error}", False)
            rows.append(checked.judge(solver.name, form, target, answer, time.perf_counter() - start))
    if not rows:
        nothing = ["psi(z) is not finite at the answer, so that its obstacle cannot be frozen"]
        rows = [Row.skipped(solver.name, reason) for reason in dict.fromkeys(reasons or nothing) if reason]
    return rows


@contextlib.contextmanager
def _quiet_logs() -> Iterator[None]:
    """Pyomo logs what goes wrong in a solver; the report says it."""
    before = logging.root.manager.disable
    logging.disable(logging.CRITICAL)
    try:
        yield
    finally:
        logging.disable(before)


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
