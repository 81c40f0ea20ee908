"""What theory says of the members of the modulus family on one problem, before any of them runs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from ..algebra.splittings import Given, Whole
from ..methods.aor import MNMAOR, MNMGS, MNMJ, MNMSOR
from ..methods.contract import Method
from ..methods.factorised import MNMMOD, MNMOD
from ..methods.modulus import ModulusMember
from ..problem.data import ProblemData
from ..theory.answers import Answer
from ..theory.certificates.supersolution import SupersolutionProof
from ..theory.certificates.supersolution import prove as supersolution_proof
from ..theory.convergence.rates import Rate, predicted_rate
from ..theory.convergence.theorems import Check, check_all
from ..theory.matrices.classes import MatrixClasses

#: beyond this size only the members that need no factorisation are looked at
_FACTORISE_UP_TO = 20_000
#: factors that differ by less, or are all rounding, are the same
_TIE, _NOTHING = 1e-6, 1e-12


@dataclass(frozen=True, eq=False)
class Forecast:
    """What theory says of one method before it runs.

    `title` says how it was made; `method`; `checks` theorem → `Check`; `rate` the predicted `Rate`, or the `Answer`
    that says why there is none; `steps` a bound on the number of steps from 0 to the wanted accuracy, or None;
    `supersolution` whether a strict one is known, which makes the theorem "monotone" global.

    >>> forecast = ICP([[2.0]], [-2.0]).explain("mnmj").forecasts[0]
    >>> forecast.proved_by, forecast.factor < 1e-9, forecast.steps
    (['4.1', '4.2', '4.3', '4.4', 'sharper', 'definite'], True, 1)
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


def members(problem: ProblemData) -> dict[str, Method]:
    """Title → the members to look at; few where A is large."""
    diagonal = problem.A.diagonal()
    found: dict[str, Method] = {"MNMJ(), Omega = D": MNMJ(), "MNMGS(), Omega = D": MNMGS()}
    if np.abs(problem.A.data).max() > np.finfo(np.float64).max / 4:  # M1 and Omega of the others would overflow
        return found
    found["MNMAOR(theta2=2), Omega = D"] = MNMAOR(theta2=2.0)
    if problem.n > _FACTORISE_UP_TO:
        return found
    found |= {f"MNMSOR(theta1={theta}), Omega = D": MNMSOR(theta1=theta) for theta in (0.9, 1.1)}
    if problem.matrix.has_positive_diagonal:
        found |= {f"MNMGS(), Omega = {share} D": MNMGS(phi2=share * diagonal) for share in (0.9, 1.5)}
    theta1 = float(np.abs(diagonal).max()) or 1.0
    found["MNMOD(), Omega = I"] = MNMOD()
    found[f"MNMMOD(theta1={theta1:g}), Omega = theta1 I"] = MNMMOD(theta1=theta1)
    return found


def forecasts_of(problem: ProblemData, methods: dict[str, Method], accuracy: float) -> Iterator[Forecast]:
    """A forecast of each of the `methods` that is a member of the family and can start, made when it is asked for."""
    supersolution = isinstance(supersolution_proof(problem), SupersolutionProof)
    for title, one in methods.items():
        if isinstance(one, ModulusMember) and one.why_not(problem) is None:
            checks = check_all(problem, one)
            rate = predicted_rate(problem, one, checks)
            steps = rate.steps(problem, np.zeros(problem.n), accuracy) if isinstance(rate, Rate) else None
            yield Forecast(title, one, checks, rate, steps, supersolution)


def recommended(among: Sequence[Forecast]) -> Forecast | None:
    """The one that is proved to need the fewest steps, sweeps first; of equal factors the first, None without any."""
    rated = [(forecast, forecast.factor) for forecast in among if forecast.factor is not None]
    if not rated:
        return None

    def dear(forecast: Forecast) -> tuple[float, bool]:
        return np.inf if forecast.steps is None else forecast.steps, factorises(forecast.method)

    cheapest = min(dear(forecast) for forecast, _ in rated)
    best = [(forecast, factor) for forecast, factor in rated if dear(forecast) == cheapest]
    least = min(factor for _, factor in best)
    return next(forecast for forecast, factor in best if tie(factor, least))


def factorises(method: Method) -> bool:
    """Whether a step of `method` solves with a factorisation of X = M₁ + φ + Ω instead of sweeping over A."""
    splitting = method.splitting_of() if isinstance(method, ModulusMember) else None
    if isinstance(splitting, Given):
        return not MatrixClasses(splitting.M1).triangular.holds
    return isinstance(splitting, Whole)


def tie(one: float, other: float) -> bool:
    """Whether two factors per step differ by rounding only."""
    return abs(one - other) <= _TIE * max(one, other) or max(one, other) < _NOTHING


def same(one: Method, other: Method) -> bool:
    """Whether both are the same method with the same options."""
    return type(one) is type(other) and all(np.array_equal(x, vars(other)[name]) for name, x in vars(one).items())
