"""The result of a solve: `Status` says why the loop stopped, `Certificate` what is known of z."""

from __future__ import annotations

from contextlib import suppress
from dataclasses import dataclass, fields, replace
from enum import Enum
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ..algebra.equations import Pattern, solve_on
from ..errors import IcpError, InputError, MapError, OutOfTime, check_arguments
from ..methods.contract import REDUCTION, Method
from ..numerics import work
from ..numerics.arrays import ReadOnly, Vector, locked
from ..numerics.rounding import public_entry
from ..present.card import Card
from ..present.display import Plottable, counted, cut
from ..present.table import Table, Tabular
from ..problem.data import ProblemData
from ..theory.answers import Answer
from ..theory.certificates.bounds import ErrorBound, classes_of, enforce_limits, error_bound
from ..theory.certificates.certificate import NOT_COMPUTED, ActiveSet, Certificate, active_set, certify
from ..theory.certificates.contradiction import Contradiction, contradiction
from ..theory.nonuniqueness import solution_facts
from .goal import Goal
from .progress import NOTICED_SECONDS


class Status(Enum):
    """Why a run stopped. Only SOLVED is success; every other member carries advice.

    Examples
    --------
    >>> Status.CYCLED.advice
    'try another method or another start z0'
    """

    SOLVED = "solved"
    PRECISION_LIMIT = "precision limit"
    STAGNATED = "stagnated"
    CYCLED = "cycled"
    DIVERGED = "diverged"
    INFEASIBLE = "infeasible"
    ITERATION_LIMIT = "iteration limit"
    TIME_LIMIT = "time limit"
    MEMORY_LIMIT = "memory limit"
    INTERRUPTED = "interrupted"
    STOPPED = "stopped by callback"
    MAP_FAILED = "map failed"
    CROSSED = "obstacles cross"
    WORKER_LOST = "worker lost"

    @property
    def advice(self) -> str:
        """What to try next, in one sentence; empty for SOLVED.

        Examples
        --------
        >>> Status.SOLVED.advice
        ''
        """
        return self.advice_with("")

    def advice_with(self, to_try: str) -> str:
        """The `advice`, with a suggestion of the method put first.

        Parameters
        ----------
        to_try : str
            What a method suggests, see `Method.to_try`.

        Returns
        -------
        str
            The advice.

        Examples
        --------
        >>> Status.CYCLED.advice_with("a smaller omega")
        'try a smaller omega, another method or another start z0'
        """
        return _ADVICE[self.name].format(f"{to_try}, " if to_try else "")


_ADVICE = {
    "SOLVED": "",
    "PRECISION_LIMIT": "rounding forbids a smaller residual: accept this z, or scale the problem; see its error bound",
    "STAGNATED": "try {}another method or another start z0; unless certified, there may be no solution",
    "CYCLED": "try {}another method or another start z0",
    "DIVERGED": "try {}another method or another start z0; A may be far from an H+-matrix, or psi move too much: see "
    "problem.explain()",
    "INFEASIBLE": "this is proved: change A, q or psi; `solution.contradiction` may name the conditions in conflict",
    "ITERATION_LIMIT": "raise max_iter, ask for less (rtol, accuracy), or pass this solution as z0 to go on",
    "TIME_LIMIT": "raise time_limit, ask for less (rtol, accuracy), or pass this solution as z0 to go on",
    "MEMORY_LIMIT": "raise memory_limit, free memory, or name a method that needs little, such as mnmgs",
    "INTERRUPTED": "pass this solution as z0 to go on",
    "STOPPED": "the callback returned True; pass this solution as z0 to go on",
    "MAP_FAILED": "correct psi or f, or start nearer to the solution; this is the best iterate before it failed",
    "CROSSED": "change psi or upper, or start elsewhere: psi is above upper in that row at the last iterate",
    "WORKER_LOST": "solve it alone to see why, or give its worker more memory",
}

#: the least that the error bound of a printed solution may cost, in counted nanoseconds
_PRINT_COST = 2e6


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class History(ReadOnly, Plottable, Tabular):
    """The path of a run, one entry per tested iterate.

    Parameters
    ----------
    iteration : array of int
        Number of the iterate.
    residual : array
        Res_D(z).
    seconds : array
        Seconds since the start.
    method : tuple of str
        Name of the method that made the iterate.
    tolerance : float
        The residual at which the run stops.

    Examples
    --------

    >>> history = ICP([[2.0]], [-2.0]).solve("mnmgs", history=True).history
    >>> history.iteration
    array([0, 1])
    >>> history
    History(iteration=<2 values>, residual=<2 values>, seconds=<2 values>, method=('mnmgs', 'mnmgs'), tolerance=1e-08)
    """

    iteration: NDArray[np.int64]
    residual: Vector
    seconds: Vector
    method: tuple[str, ...] = ()
    tolerance: float = 0.0

    def table(self) -> Table:
        """One row per tested iterate.

        Returns
        -------
        Table
            The table.
        """
        columns = (self.iteration.tolist(), self.residual.tolist(), self.seconds.tolist(), self.method)
        return Table("", ("iteration", "Res_D(z)", "seconds", "method"), tuple(zip(*columns, strict=True)))


@dataclass(frozen=True, eq=False, repr=False)
class Solution(ReadOnly, Plottable):
    """An answer: z, why the loop stopped, and, computed on first access, what is certain of z.

    Attributes
    ----------
    problem : ICP
        The problem.
    z : array of shape (n,)
        The best iterate.
    status : Status
        Why the run stopped.
    message : str
        What went wrong, with advice.
    method, adapted_method, last_method : Method
        The method that found z. The same with its adapted parameters, such as those of
        theta1="auto". The method whose end is the `status`: the last of several that were tried.
    why : str
        Why `method` was chosen.
    residual, tolerance : float
        Res_D(z), recomputed for the returned z, and the tolerance that it is compared with.
    atol : float
        The tolerance for Res(z), the residual of the paper.
    iterations : int
        The number of iterations of all methods together.
    seconds : float
        The time of the run, set-up included.
    accuracy : float or None
        The certified error that was asked for.
    infeasible : Answer or None
        The proof with its witness where the status is INFEASIBLE.
    time_limit, memory_limit : float or None
        The limits of the run. They hold anew for the certificate, and for `polish`.
    cost : float
        The counted cost of the run in nanoseconds, see `numerics.work`; 0 where it is not known.

    Examples
    --------
    >>> solution = ICP([[2.0]], [-2.0]).solve("mnmgs")
    >>> solution.status, solution.iterations
    (<Status.SOLVED: 'solved'>, 1)
    >>> solution
    Solution(ICP(n=1, nnz=1, psi=Constant(0)), solved, MNMGS(), residual=0, iterations=1)
    """

    problem: ProblemData
    z: Vector
    status: Status
    message: str
    method: Method
    adapted_method: Method
    last_method: Method
    why: str
    residual: float
    tolerance: float
    iterations: int
    seconds: float
    atol: float = 0.0
    accuracy: float | None = None
    history_or_none: History | None = None
    infeasible: Answer | None = None
    time_limit: float | None = None
    memory_limit: float | None = None
    cost: float = 0.0

    def __post_init__(self) -> None:
        self.z.flags.writeable = False  # all else is locked already

    @property
    def solved(self) -> bool:
        """Whether the status is SOLVED: Res_D(z) ≤ `tolerance`, Res(z) ≤ `atol` or a certified error ≤ `accuracy`.

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().solved
        True
        """
        return self.status is Status.SOLVED

    def __bool__(self) -> bool:
        """Whether the status is SOLVED."""
        return self.solved

    @property
    def history(self) -> History:
        """The residuals on the way to z.

        Raises
        ------
        InputError
            Where they were not kept.
        """
        if self.history_or_none is None:
            raise InputError("history was not kept: solve(..., history=True) keeps it")
        return self.history_or_none

    @property
    def _goal(self) -> Goal:
        """The convergence test of the run, without `accuracy`."""
        return Goal(self.tolerance, self.problem, self.atol)

    @cached_property
    def p(self) -> Vector:
        """p(z), shape (n,).

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().p
        array([0.])
        """
        return locked(self.problem.p(self.z))

    @cached_property
    def r(self) -> Vector:
        """r = z − ψ(z), shape (n,).

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().r
        array([1.])
        """
        return locked(self.problem.r(self.z))

    @cached_property
    def certificate(self) -> Certificate:
        """Everything that is certain of z; may cost one linear solve, once per A and ψ, where the limits allow it.

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().certificate.unique
        True
        """
        return certify(self.problem, self.z, time_limit=self.time_limit, memory_limit=self.memory_limit)

    @cached_property
    def contradiction(self) -> Contradiction | None:
        """`icpmodel.contradiction` of the problem: conditions in conflict; None if solved or p is nonlinear.

        Examples
        --------
        >>> ICP([[0.0]], [-2.0]).solve(raise_on_failure=False).contradiction
        infeasible by 2: p[0] >= 0
        """
        return None if self.solved or self.problem.f is not None else contradiction(self.problem)

    @cached_property
    def active_set(self) -> ActiveSet:
        """Which rows are proved to touch the obstacle, and which not.

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().active_set.inactive
        array([ True])
        """
        return active_set(self.problem, self.z, self.certificate.bound)

    @public_entry
    def polish(self) -> Solution:
        """Improve the answer to rounding accuracy: one linear solve on the active set.

        Undecided rows take the side to which z is nearer. Where all rows are decided the result is z* up
        to rounding; otherwise it is judged like any other candidate.

        Returns
        -------
        Solution
            The new solution if its residual or its error bound is smaller by at least a tenth, else
            this one. It is SOLVED if it reaches the tolerance, or the accuracy, of the run. A solved
            answer is replaced by a solved one only. Where the equations cannot be solved, `why` of a
            copy of this one says so.

        Examples
        --------
        >>> rough = ICP([[2, -1], [-1, 2]], [-1, 3]).solve("mnmgs", rtol=0.1)
        >>> rough.polish().z
        array([0.5, 0. ])
        """
        problem = self.problem
        known = self.active_set
        try:
            with enforce_limits(self.time_limit, self.memory_limit):
                z = solve_on(problem.linearised(self.z), self.z, *known.completed(Pattern.at(problem, self.z)))
            residual = problem.residual(z)
            if not self.accuracy:
                residual = self._goal.judged(z, residual)
        except (IcpError, MemoryError) as error:
            return self._with(why=self._and_why(f"not polished: {error}"))
        if not (residual < REDUCTION * self.residual or self._closer(z)):
            return self
        undecided = int(known.undecided.sum())
        guessed = f", {undecided} of these rows not proved" if undecided else ""
        reason = f"polished by one linear solve on the active set{guessed}"
        better = replace(self, z=z, residual=residual, why=self._and_why(reason))
        if self.certificate.bound.reason == NOT_COMPUTED:
            better = better.without_bound()
        bound = better.error_bound if self.accuracy else None
        reached = bound is not None and bound <= self.accuracy if self.accuracy else self._goal.reached(z, residual)
        if reached:
            return better._with(status=Status.SOLVED, message="solved")
        if self.solved or self.status is Status.CROSSED:  # the status refers to this very z
            return self
        return better._with(message=f"{self.message}; polished to a residual of {residual:.3g}")

    def derivative(self) -> Any:
        """Differentiate z* by A, q and ψ at this answer.

        Returns
        -------
        Derivative
            The derivative.

        Raises
        ------
        InputError
            For a row of `solve_many`, which `icpmodel.Derivative` takes.

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().derivative().forward(dq=[1.0])
        array([-0.5])
        """
        problem: Any = self.problem
        if not hasattr(problem, "derivative"):
            raise InputError("a row of solve_many has no derivative(): icpmodel.Derivative(solution) takes the row")
        return problem.derivative(self)

    def _closer(self, z: Vector) -> bool:
        """Whether the error bound of `z` is smaller than that of this answer by at least a tenth."""
        known = self.error_bound
        if known is None:
            return False
        bound = error_bound(self.problem, z, time_limit=self.time_limit, memory_limit=self.memory_limit).value
        return bound is not None and bound < REDUCTION * known

    def _and_why(self, reason: str) -> str:
        return f"{self.why}; {reason}" if self.why else reason

    def _with(self, **changed: Any) -> Solution:
        """A copy with the `changed` fields that keeps a computed certificate."""
        copy = replace(self, **changed)
        if "certificate" in self.__dict__:
            copy.__dict__["certificate"] = self.certificate
        return copy

    def without_bound(self) -> Solution:
        """The same answer with a certificate that has no error bound, which would cost about one linear solve.

        Returns
        -------
        Solution
            A copy.

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().without_bound().certificate.bound.reason
        'it was not computed'
        """
        copy = replace(self)
        copy.__dict__["certificate"] = certify(self.problem, self.z, bound=False)
        return copy

    @property
    def error_bound(self) -> float | None:
        """max_i |z_i − z*_i| is at most this, in the units of z; None where no bound is certain.

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve().error_bound < 1e-14
        True
        """
        return self.certificate.error_bound

    def summary(self) -> Card:
        """All that is known of this answer, as names with texts; `print` shows it as a table.

        Returns
        -------
        Card
            The certificate is computed if it has not been, which may cost more than the solve did.

        Examples
        --------
        >>> ICP([[2.0]], [-2.0]).solve("mnmgs").summary()["status"]
        'solved after 1 iteration'
        """
        try:
            bound = self.certificate.bound
            rows_known = str(self.active_set)
        except MapError as error:
            bound = ErrorBound.none(str(error).replace("; ", ", "))
            rows_known = ""
        last = ""
        adapted = "" if self.adapted_method is self.method else f", in the end {self.adapted_method!r}"
        if self.last_method is not self.method:
            last = f"; the last method was {self.last_method!r}"
            adapted += ", which found this z"
        rows = {
            "problem": f"{self.problem!r}",
            "status": f"{self.status.value} after {counted(self.iterations, 'iteration')}{last}",
            "method": f"{self.method!r}{adapted}" + (f"\n{self.why}" if self.why else ""),
            "residual": f"{self.residual:.3g}" + ("" if self.accuracy else f" ({self._goal.in_words(self.z)})"),
            "error": bound.in_words(self.accuracy),
        }
        if bound.value is not None:
            rows["rows"] = rows_known
        if self.solved and not bound.unique:
            with suppress(IcpError, MemoryError), enforce_limits(self.time_limit, self.memory_limit):
                if known := list(solution_facts(self.problem, classes_of(self.problem), self.z)):
                    rows["solutions"] = "\n".join(known)
        if not self.solved:
            rows["message"] = self.message
        rows["seconds"] = f"{self.seconds:.3g}"
        return Card(rows)

    def _in_short(self) -> Card:
        """Status, error bound (or why there is none) and method; also the message, where it is not solved."""
        rows = {
            "status": f"{self.status.value}: residual {self.residual:.3g}",
            "error": self._quick_bound(),
            "method": f"{self.adapted_method!r}, {counted(self.iterations, 'iteration')}, {self.seconds:.3g} s",
        }
        if not self.accuracy:
            rows["status"] += f" ({self._goal.in_words(self.z)})"
        if not self.solved:
            rows["message"] = self.message
        return Card(rows)

    def _quick_bound(self) -> str:
        """The error bound in words, if it is known or cheap, else how to compute it. A new certificate is kept.

        It is cheap if it costs no more than the solve did, or than `NOTICED_SECONDS` and `_PRINT_COST`.
        """
        certificate = self.__dict__.get("certificate")
        if certificate is None:
            seconds = max(self.seconds, NOTICED_SECONDS)
            if self.time_limit is not None:
                seconds = min(seconds, self.time_limit)
            memory = np.inf if self.memory_limit is None else self.memory_limit
            limits = work.work_limit(seconds, memory, max(self.cost, _PRINT_COST))
            with suppress(MapError, OutOfTime, MemoryError), limits:
                certificate = certify(self.problem, self.z)
        if certificate is None:
            return "not computed, as it may cost more than the solve did: solution.error_bound computes it"
        self.__dict__["certificate"] = certificate
        return str(certificate.bound.in_words(self.accuracy))

    def about(self) -> dict[str, Any]:
        """What is known of this answer as plain data for JSON: status, method, residuals, error bound.

        Returns
        -------
        dict
            It has no arrays.

        Examples
        --------
        >>> ICP([[2.0]], [-1.0]).solve().about()["status"]
        'solved'
        """
        certificate = self.certificate
        known = self.active_set
        numbers = {field.name: getattr(certificate, field.name) for field in fields(certificate)}
        bound = numbers.pop("bound")
        entries = {
            "problem": repr(self.problem),
            "n": self.problem.n,
            "status": self.status.value,
            "message": self.message,
            "method": repr(self.method),
            "last_method": repr(self.last_method),
            "why": self.why,
            "iterations": self.iterations,
            "seconds": self.seconds,
            "tolerance": None if self.accuracy else self.tolerance,
            "atol": None if self.accuracy else self.atol,
            "accuracy": self.accuracy,
            **numbers,
            "error_bound": bound.value,
            "error_bound_euclidean": bound.euclidean,
            "error_bound_proof": bound.proof or None,
            "no_error_bound_because": bound.reason or None,
            "unique": bound.unique or None,
            "rows_active": int(known.active.sum()),
            **({} if known.above is None else {"rows_active_above": int(known.above.sum())}),
            "rows_inactive": int(known.inactive.sum()),
            "rows_undecided": int(known.undecided.sum()),
        }
        # JSON has no NaN and no infinity
        return {name: None if isinstance(x, float) and not np.isfinite(x) else x for name, x in entries.items()}

    def __repr__(self) -> str:
        text = f"{self.problem!r}, {self.status.value}, {self.method!r}"
        return f"Solution({cut(text, 400)}, residual={self.residual:.3g}, iterations={self.iterations})"

    def __str__(self) -> str:
        return str(self._in_short())

    def _repr_html_(self) -> str:
        return self._in_short().to_html()
