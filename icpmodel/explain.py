"""`problem.explain()`: what is certain before a solve, as a page that a person can read."""

from __future__ import annotations

import html
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np

from .arrays import Vector, as_number
from .errors import InputError
from .intervention import Intervention
from .maps import Constant
from .methods import Method, named
from .methods.choose import choose
from .methods.modulus import MNMAOR, MNMGS, MNMJ, MNMMOD, MNMOD, MNMSOR, ModulusMember
from .problem import ICP
from .theory.answers import Answer
from .theory.certificates.bounds import ErrorBound, error_bound
from .theory.certificates.supersolution import SupersolutionProof
from .theory.certificates.supersolution import prove as supersolution_proof
from .theory.convergence.rates import Rate, predicted_rate
from .theory.convergence.theorems import Check, check_all
from .theory.matrices.classes import MatrixClasses, classify

#: the matrix classes in the order of the page, with their names
_CLASSES = {
    "symmetric": "symmetric",
    "triangular": "triangular",
    "banded": "banded",
    "reducible": "reducible",
    "dominant": "strictly diagonally dominant",
    "z": "Z-matrix",
    "m": "M-matrix",
    "h_plus": "H+-matrix",
    "definite": "positive definite",
    "semidefinite": "positive semidefinite",
    "p": "P-matrix",
}
#: beyond this size only the members that need no factorisation are looked at
_FACTORISE_UP_TO = 20_000


@dataclass(frozen=True, eq=False)
class Forecast:
    """What theory says of one method before it runs.

    `title` says how it was made; `method`; `checks` theorem → `Check`; `rate` the predicted `Rate`, or the `Answer`
    that says why there is none; `steps` a bound on the number of steps from 0 to the wanted accuracy, or None;
    `supersolution` whether a strict one is known, which makes the theorem "monotone" global.

    >>> explain(ICP([[2, -1], [-1, 2]], [-1, 3])).forecasts[0].steps
    20
    """

    title: str
    method: Method
    checks: dict[str, Check]
    rate: Rate | Answer
    steps: int | None
    supersolution: bool

    @property
    def factor(self) -> float | None:
        """The proved contraction factor per step, None where there is none.

        >>> round(explain(ICP([[2, -1], [-1, 2]], [-1, 3])).forecasts[0].factor, 6)
        0.5
        """
        return self.rate.factor if isinstance(self.rate, Rate) else None

    @property
    def proved_by(self) -> list[str]:
        """The theorems that prove convergence from every start.

        >>> explain(ICP([[2, -1], [-1, 2]], [-1, 3])).forecasts[0].proved_by
        ['4.3', '4.4', '4.2', '4.1', 'sharper']
        """
        return [
            name for name, check in self.checks.items() if check.holds and (name != "monotone" or self.supersolution)
        ]


@dataclass(frozen=True, eq=False)
class Explanation:
    """Everything that is certain of an ICP before it is solved; `print` shows the page.

    `classes` the `MatrixClasses` of A; `bound` the `ErrorBound` at z = 0, whose proof says whether the solution exists
    and is the only one; `forecasts` one `Forecast` per method looked at; `picked` the method that `solve()` tries first
    and `why`; `accuracy` what the numbers of steps refer to.

    >>> print(explain(ICP([[2.0]], [-2.0])).recommended.method)
    MNMJ()
    """

    problem: ICP
    classes: MatrixClasses
    bound: ErrorBound
    forecasts: tuple[Forecast, ...]
    picked: Method | None
    why: str
    accuracy: float

    @property
    def recommended(self) -> Forecast | None:
        """The method with the smallest proved contraction factor, None where nothing is proved.

        >>> explain(ICP([[0.0]], [1.0])).recommended is None
        True
        """
        proved = [forecast for forecast in self.forecasts if forecast.factor is not None]
        return min(proved, key=lambda forecast: forecast.factor or 0.0, default=None)

    def sections(self) -> dict[str, str]:
        """The page, part by part: title → text.

        >>> list(explain(ICP([[2.0]], [-2.0])).sections())
        ['problem', 'matrix A', 'map psi', 'solution', 'methods', 'advice']
        """
        return {
            "problem": repr(self.problem),
            "matrix A": "\n".join(self._classes()),
            "map psi": _about_psi(self.problem),
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
            "classes": {name: _plain(getattr(self.classes, name)) for name in _CLASSES},
            "psi": _about_psi(self.problem),
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

    def _classes(self) -> Iterator[str]:
        for name, title in _CLASSES.items():
            yield f"{title:<29} {getattr(self.classes, name)}"

    def _solution(self) -> str:
        if self.bound.unique:
            return f"exists, and is the only one: {self.bound.proof}"
        return f"neither existence nor uniqueness is proved: {self.bound.reason}"

    def _methods(self) -> Iterator[str]:
        if not self.forecasts:
            yield "no member of the modulus family that was looked at can start with this A"
            return
        rows = [("method", "proved by theorem", "factor per step", f"steps to {self.accuracy:g}")]
        for forecast in self.forecasts:
            proved = ", ".join(forecast.proved_by) or "none"
            if forecast.checks["monotone"].holds and not forecast.supersolution:
                proved += " (isotone)"
            factor = "-" if forecast.factor is None else f"{forecast.factor:.6g}"
            rows.append((forecast.title, proved, factor, "-" if forecast.steps is None else f"{forecast.steps}"))
        widths = [max(len(row[k]) for row in rows) for k in range(4)]
        for row in rows:
            yield "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
        if any("(isotone)" in row[1] for row in rows):
            yield "(isotone): the step keeps the order, and is monotone from super- and subsolutions (theorem monotone)"

    def _advice(self) -> Iterator[str]:
        best = self.recommended
        if best is not None:
            yield f"{best.title} has the smallest proved factor, {best.factor:.6g}, of the methods above: " + (
                "it converges from every start, and no step does worse"
            )
        proved = [forecast for forecast in self.forecasts if forecast.proved_by]
        if best is None and proved:
            yield f"{proved[0].title} converges from every start (theorem {proved[0].proved_by[0]})"
        if self.picked is not None:
            yield f"solve() begins with {self.picked!r}: {self.why}"
        if not proved:
            yield from _what_to_do(self.problem, self.classes)

    def __str__(self) -> str:
        indented = {title: text.replace("\n", "\n  ") for title, text in self.sections().items()}
        return "\n\n".join(f"{title}\n  {text}" for title, text in indented.items())

    def _repr_html_(self) -> str:
        escaped = {title: html.escape(text) for title, text in self.sections().items()}
        return "".join(f"<h4>{title}</h4><pre>{text}</pre>" for title, text in escaped.items())


def explain(problem: ICP, method: str | Method | None = None, *, accuracy: float = 1e-6, **options: Any) -> Explanation:
    """What is certain of `problem` before it is solved, and which methods are proved to solve it.

    Parameters: `method` a member of the modulus family by name (with its `options`) or as an object, to be looked at
    alone; by default MNMJ, MNMGS, MNMSOR and MNMAOR with several θ₁, θ₂ and Ω, MNMOD and MNMMOD, and the method that
    `solve()` tries first. `accuracy` > 0, in the units of z, to which the numbers of steps refer.
    Returns an `Explanation`. Raises InputError for a method outside of the family.
    Reference: `icpmodel.theory`, which states and checks every theorem.

    >>> page = explain(ICP([[2, -1], [-1, 2]], [-1, 3]))
    >>> page.bound.unique, page.recommended.factor < 0.5
    (True, True)
    """
    accuracy = as_number(accuracy, "accuracy", above=0)
    if options and not isinstance(method, str):
        raise InputError(f"{next(iter(options))}: the options of a method are taken only where it is named")
    first = next(choose(problem), None)
    if method is not None:
        wanted = _member(named(method, **options) if isinstance(method, str) else method)
        methods: dict[str, Method] = {repr(wanted): wanted}
    else:
        methods = _members(problem)
        if first is not None and not any(_same(first.method, one) for one in methods.values()):
            methods["the first choice of solve()"] = first.method
    bound, start = error_bound(problem, np.zeros(problem.n)), np.zeros(problem.n)
    supersolution = isinstance(supersolution_proof(problem), SupersolutionProof)
    forecasts = []
    for title, one in methods.items():
        if isinstance(one, ModulusMember) and one.why_not(problem) is None:
            checks = check_all(problem, one)
            rate = predicted_rate(problem, one, checks)
            steps = rate.steps(problem, start, accuracy) if isinstance(rate, Rate) else None
            forecasts.append(Forecast(title, one, checks, rate, steps, supersolution))
    picked, why = (None, "") if first is None else (first.method, first.why)
    return Explanation(problem, classify(problem.A), bound, tuple(forecasts), picked, why, accuracy)


def _member(method: Method) -> ModulusMember:
    if not isinstance(method, ModulusMember):
        raise InputError(f"method is {method!r}; theory covers the members of the modulus family only")
    return method


def _same(one: Method, other: Method) -> bool:
    return type(one) is type(other) and all(np.array_equal(x, vars(other)[name]) for name, x in vars(one).items())


def _members(problem: ICP) -> dict[str, Method]:
    """Title → the members to look at; few where A is large."""
    diagonal: Vector = problem.A.diagonal()
    members: dict[str, Method] = {
        "MNMJ(), Omega = D": MNMJ(),
        "MNMGS(), Omega = D": MNMGS(),
    }
    if np.abs(problem.A.data).max() > np.finfo(np.float64).max / 4:  # M1 and Omega of the others would overflow
        return members
    members["MNMAOR(theta2=2), Omega = D"] = MNMAOR(theta2=2.0)
    if problem.n > _FACTORISE_UP_TO:
        return members
    members["MNMSOR(theta1=0.9), Omega = D"] = MNMSOR(theta1=0.9)
    members["MNMSOR(theta1=1.1), Omega = D"] = MNMSOR(theta1=1.1)
    if (diagonal > 0).all():
        members["MNMGS(), Omega = 0.9 D"] = MNMGS(phi2=0.9 * diagonal)
        members["MNMGS(), Omega = 1.5 D"] = MNMGS(phi2=1.5 * diagonal)
    members["MNMOD(), Omega = I"] = MNMOD()
    theta1 = float(np.abs(diagonal).max()) or 1.0
    members[f"MNMMOD(theta1={theta1:g}), Omega = theta1 I"] = MNMMOD(theta1=theta1)
    return members


def _plain(answer: Answer) -> dict[str, Any]:
    return {"holds": answer.holds, "reason": answer.reason, "number": answer.number}


def _about_psi(problem: ICP) -> str:
    psi, G = problem.psi, problem.psi.lipschitz
    if isinstance(psi, Constant):
        free = int(np.isneginf(psi.c).sum())
        rows = "row" if free == 1 else "rows"
        return "constant: G = 0, a linear complementarity problem" + (
            f"; {free} {rows} without obstacle" if free else ""
        )
    if isinstance(psi, Intervention):
        return f"{psi!r}: isotone; where jumps form a cycle rho(G) >= 1, and no proof by contraction can exist"
    if G is None:
        return f"{psi!r}: no Lipschitz matrix is known"
    slope = float((G @ np.ones(problem.n)).max())
    own = "; each row depends on its own unknown only" if G.nnz == np.count_nonzero(G.diagonal()) else ""
    word = " (at the user's word)" if psi.at_users_word else ""
    return f"{psi!r}: Lipschitz matrix G with {G.nnz} entries, largest row sum {slope:.6g}{word}{own}"


def _what_to_do(problem: ICP, classes: MatrixClasses) -> Iterator[str]:
    """What helps where nothing is proved."""
    yield "nothing above proves that a method converges; solve() tries several and calls nothing solved that is not"
    if problem.psi.lipschitz is None and not isinstance(problem.psi, Intervention):
        yield "give psi's Lipschitz matrix (lipschitz=...): without it no theorem can be applied"
    elif classes.h_plus.holds and not isinstance(problem.psi, Intervention):
        yield "A is an H+-matrix, but psi moves too much for it: a smaller G, or a larger diagonal of A, is needed"
    if isinstance(problem.psi, Intervention):
        if classes.z.holds:
            yield "for an intervention: mnmj (phi >= |D - Omega|) converges monotonically from super- and subsolutions"
        else:
            yield "A is no Z-matrix, which the theorem on interventions needs; check the signs of its discretisation"
    elif classes.definite.holds and not problem.is_lcp:
        yield "A is positive definite: with the obstacle frozen at an iterate, mnmod and mnmmod are proved"
    elif classes.p.holds:
        yield "A is a P-matrix, so with constant psi the solution is unique, but sweeps may cycle: try mnmmod"
    elif classes.semidefinite.holds and problem.is_lcp:
        yield "A is positive semidefinite: where p >= 0, r >= 0 can be met there is a solution, perhaps one of many"
    elif classes.p.holds is False:
        yield "A is no P-matrix: there may be no solution, or many; check signs and units of the model"
