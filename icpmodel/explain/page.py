"""`problem.explain()`: what is certain before a solve, as a page that a person can read."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..methods.contract import Method, named
from ..methods.modulus import ModulusMember
from ..numerics.arrays import as_number
from ..numerics.rounding import UNIT_ROUNDOFF, at_most
from ..present.card import Sections, inner_width
from ..present.table import Table
from ..problem.data import ProblemData, as_problem
from ..solve.choice import candidates
from ..theory.answers import Answer
from ..theory.certificates.bounds import ErrorBound, error_bound, listed
from ..theory.matrices.classes import NAMES, MatrixClasses, classify
from .advice import parameters, recommendation, shown, theorems, what_to_do
from .forecasts import Forecast, forecasts_of, members, recommended, same

#: what the columns of the table mean
_THEOREMS = "theorems: 4.1 to 4.4 are the paper's, corrected; icpmodel.theory.theorems() states all of them"
_FACTOR = (
    "factor: a step leaves at most so much of the error, in a norm that goes with the method, so that a method with a "
    "smaller factor may need more steps"
)
#: why solve() may begin with another method than the one that is proved to be the best
_MEASURED = "; this goes by what was measured to be quick, not by what is proved"


@dataclass(frozen=True, eq=False)
class Explanation:
    """Everything that is certain of an ICP before it is solved; `print` shows the page.

    `classes` the `MatrixClasses` of A; `bound` the `ErrorBound` at z = 0, whose proof says whether the solution exists
    and is the only one; `forecasts` one `Forecast` per method looked at; `picked` the method that `solve()` tries first
    and `why`; `accuracy` what the numbers of steps refer to; `asked` whether one method was asked for, and `instead`
    another one that is proved where that one is not, or None.

    >>> print(ICP([[2.0]], [-2.0]).explain().recommended.method)
    MNMJ()
    """

    problem: ProblemData
    classes: MatrixClasses
    bound: ErrorBound
    forecasts: tuple[Forecast, ...]
    picked: Method | None
    why: str
    accuracy: float
    asked: bool = False
    instead: Forecast | None = None

    @property
    def recommended(self) -> Forecast | None:
        """The method that is proved to need the fewest steps, sweeps first; None where no rate is proved."""
        return recommended(self.forecasts)

    def sections(self) -> dict[str, str]:
        """The page, part by part: title → text."""
        return {
            "problem": repr(self.problem),
            "matrix A": str(self.classes),
            "map psi": self.problem.psi.describe(),
            "solution": self._solution(),
            "methods": "\n".join(self._methods()),
            "advice": "\n".join(self._advice()),
        }

    def about(self) -> dict[str, Any]:
        """The page as plain data for JSON; no arrays."""
        return {
            "problem": repr(self.problem),
            "n": self.problem.n,
            "classes": {name: _plain(getattr(self.classes, name)) for name in NAMES},
            "psi": self.problem.psi.describe(),
            "unique": self.bound.unique or None,
            "proof": self.bound.proof or None,
            "no_proof_because": self.bound.reason or None,
            "accuracy": self.accuracy,
            "methods": [
                {
                    "title": forecast.title,
                    "method": repr(forecast.method),
                    "theorems": {name: _plain(check) for name, check in forecast.checks.items()},
                    "factor": forecast.factor,
                    "steps": forecast.steps,
                }
                for forecast in self.forecasts
            ],
            "picked": None if self.picked is None else repr(self.picked),
            "advice": list(self._advice()),
        }

    def _solution(self) -> str:
        if self.bound.unique:
            return f"exists, and is the only one: {self.bound.proof}"
        return f"neither existence nor uniqueness is proved:{listed(self.bound.reason)}"

    def _methods(self) -> Iterator[str]:
        if not self.forecasts:
            yield "no member of the modulus family that was looked at can start with this A"
            return
        yield from self._table().to_text(inner_width()).splitlines()
        yield _THEOREMS
        if any(forecast.factor is not None for forecast in self.forecasts):
            yield _FACTOR
            yield f"steps: in exact arithmetic, from z = 0 until no entry of z is off by more than {self.accuracy:g}"
        if any(map(_is_isotone, self.forecasts)):
            yield (
                "(isotone): the step keeps the order, and is monotone from super- and subsolutions (theorem monotone); "
                "from every start it is proved only where a strict supersolution is known"
            )
        if self.asked:
            for forecast in self.forecasts:
                yield from (f"theorem {name:<8}  {check}" for name, check in forecast.checks.items())

    def _table(self) -> Table:
        rows = [
            (
                forecast.title,
                theorems(forecast) + (" (isotone)" if _is_isotone(forecast) else ""),
                None if forecast.factor is None else shown(forecast.factor),
                forecast.steps,
            )
            for forecast in self.forecasts
        ]
        return Table("", ("method", "proved by theorem", "factor", "steps"), tuple(rows))

    def _advice(self) -> Iterator[str]:
        best = self.recommended
        if best is not None and best.factor is not None:
            yield recommendation(best, best.factor)
            yield from parameters({forecast.title: forecast.factor for forecast in self.forecasts})
        proved = [forecast for forecast in self.forecasts if forecast.proved_by]
        if best is None and proved:
            by = proved[0].proved_by[0]
            how = "monotone, with a strict supersolution" if by == "monotone" else by
            yield f"{proved[0].title} converges from every start (theorem {how})"
        if self.asked and not proved:
            yield from self._not_covered()
        if self.picked is not None:
            alone = "left to itself, " if self.asked else ""
            measured = "" if best is None or same(best.method, self.picked) else _MEASURED
            yield f"{alone}solve() begins with {self.picked!r}: {self.why}{measured}"
        if not proved and self.instead is None:
            yield from what_to_do(self.problem, self.classes, self.picked)
        largest = self.bound.value
        if largest is not None and self.accuracy < UNIT_ROUNDOFF * largest:
            yield (
                f"the accuracy {self.accuracy:g} may be out of reach: entries of z can be as large as "
                f"{at_most(largest)}, and float64 rounds such numbers by up to {at_most(UNIT_ROUNDOFF * largest)}"
            )

    def _not_covered(self) -> Iterator[str]:
        """Where the method that was asked for is not proved: no theorem covers it, but perhaps another one."""
        for forecast in self.forecasts:
            yield f"no theorem covers {forecast.title} on this problem, which does not say that it fails"
        if self.instead is not None:
            other = self.instead
            yield f"{other.title} is proved here (theorem {theorems(other)}); without a method, explain looks at more"

    def __str__(self) -> str:
        return str(Sections(self.sections()))

    def __repr__(self) -> str:
        best = self.recommended
        return f"Explanation({self.problem!r}, unique={self.bound.unique}, recommended={best and best.title!r})"

    def _repr_html_(self) -> str:
        return Sections(self.sections()).to_html()


def explain(
    problem: ProblemData, method: str | Method | None = None, *, accuracy: float = 1e-6, **options: Any
) -> Explanation:
    """What is certain of `problem` before it is solved, and which methods are proved to solve it.

    Parameters: `method` a member of the modulus family by name (with its `options`) or as an object, to be looked at
    alone; by default MNMJ, MNMGS, MNMSOR and MNMAOR with several θ₁, θ₂ and Ω, MNMOD and MNMMOD, and the method that
    `solve()` tries first. `accuracy` > 0, in the units of z, to which the numbers of steps refer. A member with
    theta1="auto" is looked at with the numbers of `settled`, although a run of mnmaor adapts them.
    Returns an `Explanation`. Raises InputError for a method outside of the family.
    Reference: `icpmodel.theory`, which states and checks every theorem.

    >>> page = icp.explain(ICP([[2, -1], [-1, 2]], [-1, 3]))
    >>> page.bound.unique, page.recommended.factor < 0.5
    (True, True)
    """
    problem, accuracy = as_problem(problem), as_number(accuracy, "accuracy", above=0)
    if options and not isinstance(method, str):
        raise InputError(f"{next(iter(options))}: the options of a method are taken only where it is named")
    first = next(candidates(problem), None)
    if method is not None:
        wanted = _member(named(method, **options) if isinstance(method, str) else method).settled(problem)
        methods: dict[str, Method] = {repr(wanted): wanted}
    else:
        methods = members(problem)
        if first is not None and not any(same(first.method, one) for one in methods.values()):
            methods[f"{type(first.method).__name__}, first choice of solve()"] = first.method
    forecasts = tuple(forecasts_of(problem, methods, accuracy))
    instead = None
    if method is not None and not any(forecast.proved_by for forecast in forecasts):
        others = forecasts_of(problem, members(problem), accuracy)
        instead = next((forecast for forecast in others if forecast.proved_by), None)
    picked, why = (None, "") if first is None else (first.method, first.why)
    bound, asked = error_bound(problem, np.zeros(problem.n)), method is not None
    return Explanation(problem, classify(problem.A), bound, forecasts, picked, why, accuracy, asked, instead)


def _member(method: Method) -> ModulusMember:
    if isinstance(method, type):
        raise InputError(f"method is the class {method.__name__}; an object such as {method.__name__}() was expected")
    if not isinstance(method, ModulusMember):
        raise InputError(f"method is {method!r}; theory covers the members of the modulus family only")
    return method


def _is_isotone(forecast: Forecast) -> bool:
    """Whether its steps are monotone from some starts only."""
    return forecast.checks["monotone"].holds is True and not forecast.supersolution


def _plain(answer: Answer) -> dict[str, Any]:
    return {"holds": answer.holds, "reason": answer.reason, "number": answer.number}
