"""The contract of foreign solvers, and functions to choose and run them.

To add one, define a subclass of `ForeignSolver` with a `name`. It may be in a file of this folder, in a script, or in a
module that a package announces as an entry point of the group "icpmodel". It is then found by that name everywhere.
"""

from __future__ import annotations

import contextlib
import ctypes
import importlib
import io
import logging
import os
import pkgutil
import sys
import threading
import time
from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from inspect import isabstract
from pathlib import Path
from typing import Any, ClassVar

import numpy as np

from ..errors import InputError, check_arguments, did_you_mean
from ..numerics.arrays import as_list, described
from ..numerics.plugins import load_plugins
from ..numerics.rounding import is_ctrl_c
from ..present.display import Displayable
from .formulations import QP, Target

_REGISTRY: dict[str, type[ForeignSolver]] = {}


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Claim(Displayable):
    """The answer of a foreign solver and what it claims; the claim is recorded, the answer is judged.

    Parameters
    ----------
    z : array of shape (n,) or None
        The answer, in the units of `target.problem`.
    words : str
        The status, in the solver's own words.
    solved : bool
        Whether the solver claims success.
    seconds : float
        Total time, filled in by `ask`.
    setup : float or None
        Time of the set-up, filled in by `ask`; None where that failed.
    tolerance : float or None
        The requested tolerance, in the solver's own sense; filled in by `ask`.

    Examples
    --------
    >>> icp.solvers.Claim(None, "infeasible", False).z is None
    True
    """

    z: Any
    words: str
    solved: bool
    seconds: float = 0.0
    setup: float | None = None
    tolerance: float | None = None


class ForeignSolver(Displayable, ABC):
    """Base class: one foreign solver that solves a `Target`.

    The caller sets the tolerance and the time limit. A subclass is instantiated without arguments, and
    registered by its `name`.

    Attributes
    ----------
    name : str
        The unique name that users write.
    package : str or None
        The module that it needs, which `why_not` imports to see whether it is there.
    extra : str or None
        The extra of this package that installs the module.
    forms : tuple of str
        The formulations that it takes, best first. They are "energy" and "gap" (convex QPs), "mpec"
        (as it stands) and "nlp" (p nonlinear); see `icpmodel.solvers.formulations`.
    used_by : tuple of str
        The studies that run it where no solvers are named: "crosscheck", "race".
    tight : tuple of float
        Tolerances of a cross-check, in the solver's own sense. The next one is tried where the solver
        does not claim success.
    largest : int or None
        The largest `size`, by default n, for which it is run.
    too_large : str
        What would happen beyond `largest`.

    Examples
    --------
    >>> class Guess(icp.solvers.ForeignSolver):
    ...     name, used_by = "guess", ()
    ...
    ...     def set_up(self, target, tolerance, time_limit):
    ...         return target.problem
    ...
    ...     def run(self, model):
    ...         return icp.solvers.Claim(np.zeros(model.n), "zero, what else", True)
    >>> print(ICP([[2.0]], [-1.0]).crosscheck(solvers=["guess"]).rows[0].note)
    claims 'zero, what else': asked for 1e-10 in its own measure, 1.0e+00 in ours, where 1e-07 was expected
    """

    name: ClassVar[str]
    package: ClassVar[str | None] = None
    extra: ClassVar[str | None] = None
    forms: ClassVar[tuple[str, ...]] = ("energy", "gap")
    used_by: ClassVar[tuple[str, ...]] = ("crosscheck", "race")
    tight: ClassVar[tuple[float, ...]] = (1e-10,)
    largest: ClassVar[int | None] = None
    too_large: ClassVar[str] = "it takes minutes"

    def __init_subclass__(cls, **options: Any) -> None:
        super().__init_subclass__(**options)
        if not cls.tight:
            raise InputError(f"{cls.__name__}.tight is empty; at least one tolerance was expected")
        if "name" in vars(cls):
            _REGISTRY[cls.name] = cls

    def why_not(self, target: Target) -> str | None:
        """Why this solver cannot take a problem; an overriding method calls `super()` as well.

        Parameters
        ----------
        target : Target
            The problem and its forms.

        Returns
        -------
        str or None
            One sentence, None where it can.
        """
        if self.package is not None and (reason := missing(self.package, self.extra)):
            return reason
        n = target.problem.n
        size = self.size(target)
        if self.largest is not None and size > self.largest:
            more = f", and {size - n} further unknowns count as well" if size > n else ""
            return f"{self.too_large} beyond n = {self.largest}; this n is {n}{more}"
        reasons = {form: target.why_not(form) for form in self.forms}
        # of the two QPs the gap has the weaker conditions, so its reason is the more informative one
        return None if None in reasons.values() else reasons.get("gap", reasons[self.forms[-1]])

    def size(self, target: Target) -> int:
        """The size of the problem that is compared with `largest`; by default n.

        Parameters
        ----------
        target : Target
            The problem and its forms.

        Returns
        -------
        int
            The size.
        """
        return target.problem.n

    def form(self, target: Target) -> str:
        """The first of `forms` that applies; call it only where `why_not` is None.

        Parameters
        ----------
        target : Target
            The problem and its forms.

        Returns
        -------
        str
            "energy", "gap", "mpec" or "nlp".
        """
        return next(form for form in self.forms if target.why_not(form) is None)

    def pose(self, target: Target) -> Any:
        """Make the formulation that `set_up` translates; this is not timed.

        Parameters
        ----------
        target : Target
            The problem and its forms.

        Returns
        -------
        QP or Target
            The `QP` of its form; `target` itself for "mpec" and "nlp".
        """
        form = self.form(target)
        return target if form in ("mpec", "nlp") else target.qp(form)

    @abstractmethod
    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        """Make the solver's own model.

        Called only where `why_not` is None. It may raise whatever the foreign package raises.

        Parameters
        ----------
        target : Target
            The problem and its forms.
        tolerance : float
            The tolerance, positive.
        time_limit : float
            The seconds that a run may take, roughly.

        Returns
        -------
        object
            The model.
        """

    @abstractmethod
    def run(self, model: Any) -> Claim:
        """Solve a model from scratch. It may raise whatever the foreign package raises.

        Parameters
        ----------
        model : object
            What `set_up` returned.

        Returns
        -------
        Claim
            The answer and the solver's status.
        """


#: one thread at a time redirects the streams of the process
_STREAMS = threading.Lock()


def _renew_lock() -> None:
    """Replace the lock after a fork: no thread of the new process would release the old one."""
    global _STREAMS
    _STREAMS = threading.Lock()


if hasattr(os, "register_at_fork"):
    os.register_at_fork(after_in_child=_renew_lock)


@contextlib.contextmanager
def _silence() -> Iterator[None]:
    """Suppress all output and logging in a block, also of compiled code: PIQP, for one, prints warnings.

    Python's own standard error stays open, for the status line. Only one thread at a time can be in such a block.
    """
    with (
        _STREAMS,
        contextlib.redirect_stdout(io.StringIO()),
        contextlib.ExitStack() as cleanup,
        open(os.devnull, "wb") as devnull,
    ):
        cleanup.callback(logging.disable, logging.root.manager.disable)
        # OSQP always prints about polishing, Pyomo logs failures
        logging.disable(logging.CRITICAL)
        stderr_number = None
        with contextlib.suppress(OSError, AttributeError, ValueError):  # sys.stderr may be no file, or None
            stderr_number = sys.stderr.fileno()
        if sys.stderr is None:  # Pyomo flushes it
            cleanup.enter_context(contextlib.redirect_stderr(io.StringIO()))
        for stream in (1, 2):
            with contextlib.suppress(OSError, AttributeError):  # there may be no such stream
                saved = os.dup(stream)
                cleanup.callback(os.close, saved)
                cleanup.callback(os.dup2, saved, stream)
                if stream == stderr_number:
                    terminal = cleanup.enter_context(open(saved, "w", buffering=1, closefd=False))
                    cleanup.enter_context(contextlib.redirect_stderr(terminal))
                cleanup.callback(ctypes.CDLL(None).fflush, None)
                os.dup2(devnull.fileno(), stream)
        yield


def missing(module: str, extra: str | None = None) -> str | None:
    """Import `module`; return why that fails and how to install it (the extra `extra` does), None if it works."""
    try:
        importlib.import_module(module)
    except Exception as error:  # not ImportError alone: under `python -OO` some miss their docstrings
        if isinstance(error, ModuleNotFoundError) and error.name == module:
            requirement = module if extra is None else f'"icpmodel[{extra}]"'
            return f"{module} is not installed: pip install {requirement}"
        return f"{module} cannot be imported: {error}"
    return None


@check_arguments
def foreign_solvers() -> dict[str, ForeignSolver]:
    """Every foreign solver by name: those of this package, of plug-ins, and all others defined so far.

    Returns
    -------
    dict
        Name → solver, sorted. No foreign package is imported. Classes with abstract methods are left out.

    Examples
    --------
    >>> icp.solvers.foreign_solvers()["osqp"].forms
    ('energy', 'gap')
    """
    for info in pkgutil.iter_modules([str(Path(__file__).parent)]):
        importlib.import_module(f"{__package__}.{info.name}")
    load_plugins()
    return {name: _REGISTRY[name]() for name in sorted(_REGISTRY) if not isabstract(_REGISTRY[name])}


@check_arguments
def chosen_solvers(solvers: Iterable[str | ForeignSolver] | None, used_by: str | None = None) -> list[ForeignSolver]:
    """The named solvers, each once.

    Parameters
    ----------
    solvers : iterable of str or ForeignSolver, optional
        Names or objects; by default all that `used_by` runs.
    used_by : {"crosscheck", "race"}, optional
        The study that runs them.

    Returns
    -------
    list of ForeignSolver
        The solvers.

    Raises
    ------
    InputError
        For an unknown name; the message lists the known ones.

    Examples
    --------
    >>> [solver.name for solver in icp.solvers.chosen_solvers(["osqp", "osqp"])]
    ['osqp']
    """
    known = foreign_solvers()
    if solvers is None:
        return [solver for solver in known.values() if used_by is None or used_by in solver.used_by]
    requested = [solvers] if isinstance(solvers, str | ForeignSolver) else as_list(solvers, "solvers")
    for solver in requested:
        if isinstance(solver, str) and solver not in known:
            hint = did_you_mean(solver, known)
            raise InputError(f"solvers has {solver!r}; one of {', '.join(map(repr, known))} was expected{hint}")
        if not isinstance(solver, str | ForeignSolver):
            raise InputError(f"solvers has {described(solver)}; names or ForeignSolver objects were expected")
    chosen = [known[solver] if isinstance(solver, str) else solver for solver in requested]
    return list({solver.name: solver for solver in chosen}.values())


@check_arguments
def ask(solver: ForeignSolver, target: Target, tolerance: float, time_limit: float) -> Claim:
    """Run `solver` on `target` silently; an exception other than Ctrl-C becomes the words of its claim.

    While it runs in this process, what other threads print or log is lost.

    Parameters
    ----------
    solver : ForeignSolver
        A solver whose `why_not(target)` is None.
    target : Target
        The problem.
    tolerance : float
        Tolerance > 0, in the solver's own sense.
    time_limit : float
        Seconds.

    Returns
    -------
    Claim
        The claim, with the seconds that `set_up` and `run` took.

    Examples
    --------
    >>> solver = icp.solvers.foreign_solvers()["osqp"]
    >>> target = icp.solvers.Target(ICP([[2.0]], [-1.0]))
    >>> icp.solvers.ask(solver, target, 1e-9, 10.0).z.round(6)
    array([0.5])
    """
    start_time = time.perf_counter()
    setup = None
    try:
        with _silence(), np.errstate(all="ignore"):
            form = solver.pose(target)
            start_time = time.perf_counter()
            model = solver.set_up(target, tolerance, time_limit)
            setup = time.perf_counter() - start_time
            claim = solver.run(model)
            if isinstance(form, QP) and np.shape(claim.z) == form.q.shape:
                claim = replace(claim, z=claim.z[: target.problem.n])
    except Exception as error:  # whatever a foreign package may raise; KeyboardInterrupt is none of these
        if is_ctrl_c(error):
            raise KeyboardInterrupt from error
        claim = Claim(None, f"{type(error).__name__}: {error}", False)
    return replace(claim, seconds=time.perf_counter() - start_time, setup=setup, tolerance=tolerance)
