"""`problem.explain()`: what is certain before a solve, as a page that a person can read."""

from __future__ import annotations

import math
import sys
from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from ..errors import InputError, MapError, NotApplicable, OutOfTime
from ..methods.contract import Method, named
from ..methods.modulus import ModulusMember
from ..numerics.arrays import as_number, as_truth, described
from ..numerics.rounding import public_entry
from ..numerics.threads import one_blas_thread
from ..present.card import Sections, inner_width
from ..present.display import Displayable
from ..present.table import Table
from ..problem.data import ProblemData, ProblemLike, as_problem
from ..solve.choice import select_method
from ..solve.newton_josephy import NewtonJosephy
from ..solve.outcome import why_none
from ..solve.reduction import presolve
from ..theory.answers import Allowance, Answer
from ..theory.certificates.bounds import ErrorBound, bullet_list, classes_of, error_bound
from ..theory.certificates.enumerated import Disproof, NoSolution
from ..theory.convergence.proximal_point import proximal_point
from ..theory.matrices.classes import CLASS_NAMES, MatrixClasses
from ..theory.nonuniqueness import solution_facts
from .advice import accuracy_advice, convergence_advice, first_steps, is_boxed, methods_for_f, nonlinear_advice
from .forecasts import Forecast, factor_text, forecasts_of, members

#: the work limit of a page is a number of products with A plus nanoseconds: for n = 10⁶ and n = 10⁴ that were 5 s and
#: 2 s on the machine of `work.Costs`; and the share of it for one question
MAX_PRODUCTS = 600.0
MAX_NANOSECONDS = 0.8e9
_QUESTION_SHARE = 0.2
#: for matrices with long rows the limit is this number of nanoseconds per row, for at least 10⁶ rows
_NANOSECONDS_PER_ROW = 3_000.0
_MIN_ROWS = 1e6


@dataclass(frozen=True, eq=False)
class Explanation(Displayable):
    """What is proved about an ICP before it is solved; `print` shows the page.

    Attributes
    ----------
    problem : ICP
        The problem.
    classes : MatrixClasses
        The classes of A.
    bound : ErrorBound
        The bound at z = 0, whose proof says whether the solution exists and is unique.
    forecasts : tuple of Forecast
        One for each member of the modulus family that was examined.
    first_method : Method or None
        The method that `solve()` tries first; None if there is none, or if a limit left it open.
    why : str
        Why `solve()` takes it, or why there is no `first_method`.
    accuracy : float
        The accuracy that the predicted numbers of steps reach.
    method_named : bool
        Whether the user named one method.
    alternative : Forecast or None
        Another member that is proved to converge, if the named one is not.

    Examples
    --------
    >>> print(ICP([[2.0]], [-2.0]).explain().recommended.method)
    MNMJ()
    """

    problem: ProblemData
    classes: MatrixClasses
    bound: ErrorBound
    forecasts: tuple[Forecast, ...]
    first_method: Method | None
    why: str
    accuracy: float
    method_named: bool = False
    alternative: Forecast | None = None

    @property
    def recommended(self) -> Forecast | None:
        """The forecast with the fewest steps, None if no method has a proved factor.

        Of equal ones it is a method without factorisation, then one with a smaller factor, then the first.
        """
        rated = {one: one.factor for one in self.forecasts if one.factor is not None}

        def cost(one: Forecast) -> tuple[float, bool, float]:
            steps = math.inf if one.steps is None else one.steps
            return steps, one.factorises, round(rated[one], 6)  # as many digits as the page shows

        return min(rated, key=cost, default=None)

    @cached_property
    def facts(self) -> tuple[str, ...]:
        """Proved statements about the solutions; empty if the solution is proved to be unique."""
        return () if self.bound.unique else tuple(solution_facts(self.problem, self.classes))

    @property
    def disproof(self) -> Disproof | None:
        """The sentence that there are several solutions, or none; None where that is not proved."""
        return next((one for one in self.facts if isinstance(one, Disproof)), None)

    def sections(self) -> dict[str, str]:
        """The page, part by part.

        Returns
        -------
        dict
            Title → text.
        """
        f = self.problem.f
        if self.bound.unique:
            solution = f"exists, and is the only one: {self.bound.proof}"
        elif isinstance(disproof := self.disproof, NoSolution):
            solution = disproof
        elif disproof:
            solution = "\n".join([disproof, *(one for one in self.facts if one != disproof)])
        else:
            known = "neither existence nor uniqueness is proved"
            if is_boxed(self.problem):
                given = "" if f is None else ", given that f is continuous there"
                alone = "that it is the only one is not proved"
                known = f"exists, as every row has a fixed obstacle on both sides{given}; {alone}"
            solution = "\n".join([f"{known}:{bullet_list(self.bound.reason)}", *self.facts])
        return {
            "what to do": "\n".join(self._to_do()),
            "problem": repr(self.problem),
            "matrix A": str(self.classes),
            **({} if f is None else {"nonlinear part f": f.describe()}),
            "map psi" if self.problem.upper is None else "obstacles": self.problem.psi.describe(),
            "solution": solution,
            "methods": "\n".join(self._methods()),
            "best proved": "\n".join(self._best_proved()),
        }

    def about(self) -> dict[str, Any]:
        """The page as plain data for JSON: the lines of each section, the numbers beside them, and the methods.

        Returns
        -------
        dict
            It has no arrays.
        """
        return {title.replace(" ", "_"): text.splitlines() for title, text in self.sections().items()} | {
            "n": self.problem.n,
            "classes": {name: _as_data(getattr(self.classes, name)) for name in CLASS_NAMES},
            "unique": self.bound.unique or (False if self.disproof else None),
            "accuracy": self.accuracy,
            "methods": [
                {
                    "title": forecast.title,
                    "method": repr(forecast.method),
                    "theorems": {name: _as_data(check) for name, check in forecast.checks.items()},
                    "factor": forecast.factor,
                    "steps": forecast.steps,
                }
                for forecast in self.forecasts
            ],
            "first_method": None if self.first_method is None else repr(self.first_method),
        }

    def _methods(self) -> Iterator[str]:
        if self.problem.f is not None:
            yield from methods_for_f(self.problem)
            return
        if not self.forecasts:
            yield "no member of the modulus family that was examined can start with this A"
            return
        rows = [
            (
                one.title,
                one.theorems + (" (isotone)" if one.isotone else ""),
                None if one.factor is None else factor_text(one.factor),
                one.steps,
            )
            for one in self.forecasts
        ]
        table = Table("", ("method", "proved by theorem", "factor", "steps"), tuple(rows))
        yield from table.to_text(inner_width()).splitlines()
        yield "theorems: 4.1 to 4.4 are the paper's, corrected; icpmodel.theory.theorems() states all of them"
        if any(one.factor is not None for one in self.forecasts):
            yield (
                "factor: a step multiplies the error by this at most, in a norm of the method; a method with a "
                "smaller factor may need more steps"
            )
            yield f"steps: in exact arithmetic, from z = 0 until no entry of z is off by more than {self.accuracy:g}"
        proved = any(one.proved_by for one in self.forecasts)
        if proved and not self.bound.unique and not self.problem.psi.parallel:
            yield (
                "the obstacles may cross for some z: the point that a method is proved to converge to is the solution "
                "if psi <= upper there, and else there is none"
            )
        if undecided := [one for one in self.forecasts if one.undecided]:
            reason = undecided[0].checks[undecided[0].undecided[0]].reason
            titles = "; ".join(one.title for one in undecided)
            yield f"{reason}, which explain(thorough=True) lifts: theorems on {titles}"
        if any(one.isotone for one in self.forecasts):
            yield (
                "(isotone): the step keeps the order, and is monotone from super- and subsolutions (theorem monotone); "
                "from every start it is proved only where a strict supersolution is known"
            )
        if self.method_named:
            for one in self.forecasts:
                yield from (f"theorem {name:<8}  {check}" for name, check in one.checks.items())

    def _to_do(self) -> Iterator[str]:
        disproof = self.disproof
        yield from first_steps(self.first_method, self.why, self.method_named, disproof)
        if isinstance(disproof, NoSolution):
            return
        if self.problem.f is not None:
            yield from nonlinear_advice(self.problem, self.bound.unique)
        elif self.alternative is None and not any(one.proved_by for one in self.forecasts):
            is_decided = self.bound.unique or bool(disproof)
            yield from convergence_advice(self.problem, self.classes, self.first_method, is_decided)
        yield from accuracy_advice(self.accuracy, self.bound.value)

    def _best_proved(self) -> Iterator[str]:
        if self.problem.f is not None:
            yield "NewtonJosephy converges quadratically near strongly regular solutions; elsewhere nothing is proved"
            return
        best = self.recommended
        proved = next((one for one in self.forecasts if one.proved_by), None)
        if best is not None and best.factor is not None:
            cost = "one sweep over A per step"
            if best.factorises:
                cost = "one solve with X = M1 + phi + Omega per step, factorised once"
            enough = "" if best.steps is None else f", {best.steps} steps suffice"
            yield f"{best.title}: each step leaves at most {factor_text(best.factor)} of the error{enough}; {cost}"
            if self.first_method is not None and not _same(best.method, self.first_method):
                yield "solve() chooses by expected cost, not by proved rates alone"
        elif proved is not None:
            by = proved.proved_by[0]
            how = "monotone, with a strict supersolution" if by == "monotone" else by
            yield f"{proved.title} converges from every start (theorem {how})"
        elif self.method_named:
            for one in self.forecasts:
                yield f"no theorem covers {one.title} on this problem, which does not mean that it fails"
            if self.alternative is not None:
                also = "without a method, explain examines more of them"
                yield f"{self.alternative.title} is proved here (theorem {self.alternative.theorems}); {also}"
        # printing a page computes no further facts of A
        if proved is None and self.classes.semidefinite.holds and (answer := proximal_point(self.problem)).holds:
            yield f"Proximal() is proved (theorem proximal): {answer.reason}"
        elif proved is None and self.alternative is None:
            yield "no method that was examined is proved to converge"

    def __str__(self) -> str:
        return str(Sections(self.sections()))

    def __repr__(self) -> str:
        best = self.recommended
        return f"Explanation({self.problem!r}, unique={self.bound.unique}, recommended={best and best.title!r})"

    def _repr_html_(self) -> str:
        return Sections(self.sections()).to_html()


@public_entry
def explain(
    problem: ProblemLike,
    method: str | Method | None = None,
    *,
    accuracy: float = 1e-6,
    thorough: bool = False,
    **options: Any,
) -> Explanation:
    """State what is certain of `problem` before a solve, and which methods are proved to solve it.

    Parameters
    ----------
    problem : ICP
        The problem.
    method : str or Method, optional
        The only member of the modulus family to examine. By default MNMJ, MNMGS, MNMSOR and MNMAOR
        with several θ₁, θ₂ and Ω, PSOR, MNMOD and MNMMOD, and the method that `solve()` tries
        first.
    accuracy : float, default 1e-6
        Accuracy > 0, in the units of z, that the predicted numbers of steps reach.
    thorough : bool, default False
        Whether to answer every question, however long it takes. By default a question is left open
        beyond a work limit, and the output says so.
    **options
        Options of a `method` that is given by name.

    Returns
    -------
    Explanation
        The page; `print` shows it.

    Raises
    ------
    InputError
        For a method outside of the family.
    NotApplicable
        For a method where p is nonlinear.

    Notes
    -----
    A member with theta1="auto" is examined with the fixed numbers of its `adapt`, although a run
    changes them.

    References
    ----------
    `icpmodel.theory` states and checks every theorem.

    Examples
    --------
    >>> page = icp.explain(ICP([[2, -1], [-1, 2]], [-1, 3]))
    >>> page.bound.unique, page.recommended.factor < 0.5
    (True, True)
    """
    problem = as_problem(problem, nonlinear=True)
    accuracy = as_number(accuracy, "accuracy", above=0)
    if options and not isinstance(method, str):
        raise InputError(
            f"explain has no option {next(iter(options))}; it takes method, accuracy, thorough, and the options of a "
            "method only where that is named"
        )
    product_cost = problem.matrix.product_cost
    max_cost = min(MAX_PRODUCTS * product_cost + MAX_NANOSECONDS, _NANOSECONDS_PER_ROW * max(problem.n, _MIN_ROWS))
    if as_truth(thorough, "thorough"):
        max_cost = sys.float_info.max  # a limit, because without any `error_bound` stops after a minute of work
    products = max_cost / product_cost
    with Allowance(products, product_cost).enforced(), one_blas_thread():
        limit = Allowance(_QUESTION_SHARE * products, product_cost)
        return _make_explanation(problem, method, accuracy, limit, options)


def _make_explanation(
    problem: ProblemData, method: str | Method | None, accuracy: float, limit: Allowance, options: dict[str, Any]
) -> Explanation:
    """Make the page within a `limit` for each question; the other parameters are as in `explain`."""
    method_named = method is not None
    alternative = None
    classes = classes_of(problem).decided(limit)
    first_method, why = _first_method(problem, limit)
    methods: dict[str, Method] = {}
    if method is not None:
        member = _member(problem, method, options)
        methods[repr(member)] = member
    elif problem.f is None:
        methods = members(problem)
        if first_method is not None and not any(_same(first_method, one) for one in methods.values()):
            title = f"{type(first_method).__name__}, first choice of solve()"
            adapted = first_method.adapt(problem) if isinstance(first_method, ModulusMember) else first_method
            methods = {title: adapted} | methods  # first, as the limit may not allow all forecasts
    bound = _bound_at_zero(problem, limit)
    forecasts = tuple(forecasts_of(problem, methods, accuracy, limit))
    if method_named and not any(one.proved_by for one in forecasts):
        others = forecasts_of(problem, members(problem), accuracy, limit)
        alternative = next((one for one in others if one.proved_by), None)
    return Explanation(problem, classes, bound, forecasts, first_method, why, accuracy, method_named, alternative)


def _member(problem: ProblemData, method: str | Method, options: dict[str, Any]) -> ModulusMember:
    """The member of the modulus family that the user named, adapted to `problem`."""
    if isinstance(method, type):
        raise InputError(f"method is the class {method.__name__}; an object such as {method.__name__}() was expected")
    member = named(method, **options) if isinstance(method, str) else method
    if not isinstance(member, ModulusMember):
        raise InputError(f"method is {described(member)}; theory covers the members of the modulus family only")
    if problem.f is not None:
        raise NotApplicable("the theorems on steps have affine p: name no method, or give problem.linearised(z)")
    return member.adapt(problem)


def _bound_at_zero(problem: ProblemData, limit: Allowance) -> ErrorBound:
    """The error bound at z = 0, or why there is none within `limit`."""
    try:
        with limit.enforced():
            return error_bound(problem, np.zeros(problem.n), sharp=False)
    except (OutOfTime, MemoryError) as error:
        return ErrorBound.none(limit.undecided(error))
    except MapError as error:
        return ErrorBound.none(f"{error}, at z = 0")


def _first_method(problem: ProblemData, limit: Allowance) -> tuple[Method | None, str]:
    """The method that `solve` begins with, and why; or None, and why there is none or why `limit` left it open."""
    if problem.f is not None:
        return NewtonJosephy(), "p is nonlinear"
    try:
        with limit.enforced():
            choice = select_method(presolve(problem))
    except (OutOfTime, MemoryError) as error:
        return None, f"call solve(); which method it will run first: {limit.undecided(error)}"
    if choice is None:
        return None, f"solve() has no method for this problem: {why_none(problem)}"
    return choice.method, choice.why


def _same(one: Method, other: Method) -> bool:
    """Whether both are the same method with the same options."""
    return type(one) is type(other) and all(np.array_equal(x, vars(other)[name]) for name, x in vars(one).items())


def _as_data(answer: Answer) -> dict[str, Any]:
    return {"holds": answer.holds, "reason": answer.reason, "number": answer.number}
