"""`problem.explain()`: what is certain before a solve, as a page that a person can read."""

from __future__ import annotations

import html
import textwrap
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from ..errors import InputError
from ..methods.contract import Method, named
from ..methods.modulus import ModulusMember
from ..numerics.arrays import as_number
from ..numerics.rounding import UNIT_ROUNDOFF, at_most
from ..problem.data import ProblemData, as_problem
from ..solve.choice import candidates
from ..theory.answers import Answer
from ..theory.certificates.bounds import ErrorBound, error_bound, listed
from ..theory.certificates.supersolution import SupersolutionProof
from ..theory.certificates.supersolution import prove as supersolution_proof
from ..theory.convergence.rates import Rate, predicted_rate
from ..theory.convergence.theorems import Check, check_all
from ..theory.matrices.classes import NAMES, MatrixClasses, classify
from .advice import about_psi, factorises, members, parameters, recommendation, shown, tie, what_to_do

#: columns of the page
_WIDTH = 116
#: what the columns of the table mean
_THEOREMS = "theorems: 4.1 to 4.4 are the paper's, corrected; icpmodel.theory.theorems() states all of them"
_FACTOR = (
    "factor: a step leaves at most so much of the error, in a norm that goes with the method, so that a method with a "
    "smaller factor may need more steps"
)
#: why solve() may begin with another method than the one that is proved to be the best
_MEASURED = "; this goes by what was measured to be quick, not by what is proved"


@dataclass(frozen=True, eq=False)
class Forecast:
    """What theory says of one method before it runs.

    `title` says how it was made; `method`; `checks` theorem → `Check`; `rate` the predicted `Rate`, or the `Answer`
    that says why there is none; `steps` a bound on the number of steps from 0 to the wanted accuracy, or None;
    `supersolution` whether a strict one is known, which makes the theorem "monotone" global.
    """

    title: str
    method: Method
    checks: dict[str, Check]
    rate: Rate | Answer
    steps: int | None
    supersolution: bool

    @property
    def factor(self) -> float | None:
        """The proved contraction factor per step, None where there is none."""
        return self.rate.factor if isinstance(self.rate, Rate) else None

    @property
    def proved_by(self) -> list[str]:
        """The theorems that prove convergence from every start."""
        return [
            name for name, check in self.checks.items() if check.holds and (name != "monotone" or self.supersolution)
        ]

    def __repr__(self) -> str:
        return f"Forecast({self.title!r}, proved_by={self.proved_by}, factor={self.factor}, steps={self.steps})"


@dataclass(frozen=True, eq=False)
class Explanation:
    """Everything that is certain of an ICP before it is solved; `print` shows the page.

    `classes` the `MatrixClasses` of A; `bound` the `ErrorBound` at z = 0, whose proof says whether the solution exists
    and is the only one; `forecasts` one `Forecast` per method looked at; `picked` the method that `solve()` tries first
    and `why`; `accuracy` what the numbers of steps refer to; `asked` whether one method was asked for, and `instead`
    another one that is proved where that one is not, or None.

    >>> print(explain(ICP([[2.0]], [-2.0])).recommended.method)
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
        """The method that is proved to need the fewest steps, sweeps first; None where no rate is proved.

        Of methods that are equal but for rounding it is the first.

        >>> explain(ICP([[0.0]], [1.0])).recommended is None
        True
        """
        rated = [(forecast, forecast.factor) for forecast in self.forecasts if forecast.factor is not None]
        if not rated:
            return None

        def dear(forecast: Forecast) -> tuple[float, bool]:
            return np.inf if forecast.steps is None else forecast.steps, factorises(forecast.method)

        cheapest = min(dear(forecast) for forecast, _ in rated)
        best = [(forecast, factor) for forecast, factor in rated if dear(forecast) == cheapest]
        least = min(factor for _, factor in best)
        return next(forecast for forecast, factor in best if tie(factor, least))

    def sections(self) -> dict[str, str]:
        """The page, part by part: title → text.

        >>> list(explain(ICP([[2.0]], [-2.0])).sections())
        ['problem', 'matrix A', 'map psi', 'solution', 'methods', 'advice']
        """
        return {
            "problem": repr(self.problem),
            "matrix A": str(self.classes),
            "map psi": about_psi(self.problem),
            "solution": self._solution(),
            "methods": "\n".join(self._methods()),
            "advice": "\n".join(self._advice()),
        }

    def about(self) -> dict[str, Any]:
        """The page as plain data for JSON; no arrays.

        >>> explain(ICP([[2.0]], [-2.0])).about()["classes"]["h_plus"]["holds"]
        True
        """
        return {
            "problem": repr(self.problem),
            "n": self.problem.n,
            "classes": {name: _plain(getattr(self.classes, name)) for name in NAMES},
            "psi": about_psi(self.problem),
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
        rows = [("method", "proved by theorem", "factor", "steps")]
        for forecast in self.forecasts:
            proved = _listed(forecast)
            if forecast.checks["monotone"].holds and not forecast.supersolution:
                proved += " (isotone)"
            factor = "-" if forecast.factor is None else shown(forecast.factor)
            rows.append((forecast.title, proved, factor, "-" if forecast.steps is None else f"{forecast.steps}"))
        yield from _table(rows)
        yield _THEOREMS
        if any(row[2] != "-" for row in rows[1:]):
            yield _FACTOR
            yield f"steps: in exact arithmetic, from z = 0 until no entry of z is off by more than {self.accuracy:g}"
        if any("(isotone)" in row[1] for row in rows):
            yield (
                "(isotone): the step keeps the order, and is monotone from super- and subsolutions (theorem monotone); "
                "from every start it is proved only where a strict supersolution is known"
            )
        if self.asked:
            for forecast in self.forecasts:
                yield from (f"theorem {name:<8}  {check}" for name, check in forecast.checks.items())

    def _advice(self) -> Iterator[str]:
        best = self.recommended
        if best is not None and best.factor is not None:
            yield from recommendation(best.title, best.method, best.factor, best.steps)
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
            measured = "" if best is None or _same(best.method, self.picked) else _MEASURED
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
            yield f"{other.title} is proved here (theorem {_listed(other)}); without a method, explain looks at more"

    def __str__(self) -> str:
        lines = []
        for title, text in self.sections().items():
            lines += ["", title]
            for line in text.splitlines():
                if len(line) + 2 > _WIDTH:  # a sentence: tables are narrower, and keep their columns
                    lines += textwrap.wrap(line, _WIDTH, initial_indent="  ", subsequent_indent="    ")
                else:
                    lines.append(f"  {line}")
        return "\n".join(lines[1:])

    def __repr__(self) -> str:
        best = self.recommended
        return f"Explanation({self.problem!r}, unique={self.bound.unique}, recommended={best and best.title!r})"

    def _repr_html_(self) -> str:
        escaped = {title: html.escape(text) for title, text in self.sections().items()}
        return "".join(f"<h4>{title}</h4><pre>{text}</pre>" for title, text in escaped.items())


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

    >>> page = explain(ICP([[2, -1], [-1, 2]], [-1, 3]))
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
        if first is not None and not any(_same(first.method, one) for one in methods.values()):
            methods[f"{type(first.method).__name__}, first choice of solve()"] = first.method
    bound, forecasts = error_bound(problem, np.zeros(problem.n)), list(_forecasts(problem, methods, accuracy))
    instead = None
    if method is not None and not any(forecast.proved_by for forecast in forecasts):
        others = _forecasts(problem, members(problem), accuracy)
        instead = next((forecast for forecast in others if forecast.proved_by), None)
    picked, why = (None, "") if first is None else (first.method, first.why)
    classes, asked = classify(problem.A), method is not None
    return Explanation(problem, classes, bound, tuple(forecasts), picked, why, accuracy, asked, instead)


def _forecasts(problem: ProblemData, methods: dict[str, Method], accuracy: float) -> Iterator[Forecast]:
    """A forecast of each of the `methods` that is a member of the family and can start, made when it is asked for."""
    supersolution = isinstance(supersolution_proof(problem), SupersolutionProof)
    for title, one in methods.items():
        if isinstance(one, ModulusMember) and one.why_not(problem) is None:
            checks = check_all(problem, one)
            rate = predicted_rate(problem, one, checks)
            steps = rate.steps(problem, np.zeros(problem.n), accuracy) if isinstance(rate, Rate) else None
            yield Forecast(title, one, checks, rate, steps, supersolution)


def _table(rows: list[tuple[str, str, str, str]]) -> Iterator[str]:
    """The rows in columns as wide as the page; a title that is too long for that stands on a line of its own."""
    widths = [max(len(row[k]) for row in rows) for k in range(4)]
    room = _WIDTH - 2 - sum(widths[1:]) - 6
    widths[0] = max((len(row[0]) for row in rows if len(row[0]) <= room), default=0)
    for title, *cells in rows:
        if len(title) > room:
            yield title
            title = ""
        yield "  ".join(cell.ljust(width) for cell, width in zip((title, *cells), widths, strict=True)).rstrip()


def _listed(forecast: Forecast) -> str:
    """The theorems that prove it, in short."""
    return ", ".join(forecast.proved_by).replace("4.1, 4.2, 4.3, 4.4", "4.1 to 4.4") or "none"


def _member(method: Method) -> ModulusMember:
    if isinstance(method, type):
        raise InputError(f"method is the class {method.__name__}; an object such as {method.__name__}() was expected")
    if not isinstance(method, ModulusMember):
        raise InputError(f"method is {method!r}; theory covers the members of the modulus family only")
    return method


def _same(one: Method, other: Method) -> bool:
    return type(one) is type(other) and all(np.array_equal(x, vars(other)[name]) for name, x in vars(one).items())


def _plain(answer: Answer) -> dict[str, Any]:
    return {"holds": answer.holds, "reason": answer.reason, "number": answer.number}
