"""What is proved about the members of the modulus family on one problem, before any of them runs."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass

import numpy as np

from ..algebra.splittings import FullSplitting, UserSplitting
from ..errors import OutOfTime
from ..methods.aor import MNMAOR, MNMGS, MNMJ, MNMSOR
from ..methods.contract import Method
from ..methods.factorised import MNMMOD, MNMOD
from ..methods.modulus import ModulusMember
from ..methods.psor import PSOR
from ..numerics.rounding import rounded_up
from ..present.display import Displayable
from ..problem.data import ProblemData
from ..theory.answers import UNDECIDED, Allowance, Answer
from ..theory.certificates.bounds import supersolution_proof
from ..theory.certificates.supersolution import SupersolutionProof
from ..theory.convergence.rates import Rate, predicted_rate
from ..theory.convergence.theorems import Check, check_all
from ..theory.matrices.classes import MatrixClasses
from ..theory.matrices.comparison_matrix import FACTORISE_FIRST_UP_TO


@dataclass(frozen=True, eq=False)
class Forecast(Displayable):
    """What is proved about one method before it runs.

    Attributes
    ----------
    title : str
        The method as the page shows it, such as "MNMGS(), Omega = D".
    method : ModulusMember
        The method.
    checks : dict of str to Check
        Theorem → whether its conditions hold.
    rate : Rate, Answer or None
        The predicted rate; an `Answer` says why there is none; None if a limit left it open.
    steps : int or None
        Bound on the number of steps from z = 0 to the accuracy; None if none is known.
    supersolution : bool
        Whether a strict supersolution is known, which makes the theorem "monotone" global.

    Examples
    --------
    >>> forecast = ICP([[2.0]], [-2.0]).explain("mnmj").forecasts[0]
    >>> forecast.proved_by, forecast.factor < 1e-9, forecast.steps
    (['4.1', '4.2', '4.3', '4.4', 'sharper', 'definite'], True, 1)
    """

    title: str
    method: ModulusMember
    checks: dict[str, Check]
    rate: Rate | Answer | None
    steps: int | None
    supersolution: bool

    @property
    def factor(self) -> float | None:
        """The proved contraction factor per step; None if there is none."""
        return self.rate.factor if isinstance(self.rate, Rate) else None

    @property
    def proved_by(self) -> list[str]:
        """The theorems that prove convergence from every start."""
        proved = [name for name, check in self.checks.items() if check.holds]
        return [name for name in proved if name != "monotone" or self.supersolution]

    @property
    def isotone(self) -> bool:
        """Whether its steps are proved to be monotone, but only from super- and subsolutions."""
        return self.checks["monotone"].holds is True and not self.supersolution

    @property
    def theorems(self) -> str:
        """The theorems of `proved_by` as text; "none" or "not decided" if there are none."""
        none = "not decided" if self.undecided else "none"
        return ", ".join(self.proved_by).replace("4.1, 4.2, 4.3, 4.4", "4.1 to 4.4") or none

    @property
    def undecided(self) -> list[str]:
        """The theorems that a limit left open."""
        return [name for name, check in self.checks.items() if check.reason.startswith(UNDECIDED)]

    @property
    def factorises(self) -> bool:
        """Whether a step solves with a factorisation of X = M₁ + φ + Ω instead of sweeping over A."""
        splitting = self.method.splitting_of()
        if isinstance(splitting, UserSplitting):
            return not MatrixClasses(splitting.M1).triangular.holds
        return isinstance(splitting, FullSplitting)

    def __repr__(self) -> str:
        return f"Forecast({self.title!r}, proved_by={self.proved_by}, factor={self.factor}, steps={self.steps})"


def members(problem: ProblemData) -> dict[str, Method]:
    """Title → member: the members to examine, fewer if A is large or has huge entries."""
    diagonal = problem.A.diagonal()
    methods: dict[str, Method] = {"MNMJ(), Omega = D": MNMJ(), "MNMGS(), Omega = D": MNMGS()}
    if np.abs(problem.A.data).max() > np.finfo(np.float64).max / 4:  # M1 and Omega of the others would overflow
        return methods
    methods |= {"MNMAOR(theta2=2), Omega = D": MNMAOR(theta2=2.0), "PSOR(), newest values": PSOR()}
    if problem.n > FACTORISE_FIRST_UP_TO:  # none that factorises
        return methods
    methods |= {f"MNMSOR(theta1={theta}), Omega = D": MNMSOR(theta1=theta) for theta in (0.9, 1.1)}
    if problem.matrix.has_positive_diagonal:
        methods |= {f"MNMGS(), Omega = {share} D": MNMGS(phi2=share * diagonal) for share in (0.9, 1.5)}
    theta1 = float(np.abs(diagonal).max()) or 1.0
    methods["MNMOD(), Omega = I"] = MNMOD()
    methods[f"MNMMOD(theta1={theta1:g}), Omega = theta1 I"] = MNMMOD(theta1=theta1)
    return methods


def forecasts_of(
    problem: ProblemData, methods: dict[str, Method], accuracy: float, limit: Allowance
) -> Iterator[Forecast]:
    """Yield the forecasts of those `methods` that are members of the family and can start on `problem`."""
    supersolution = False
    with suppress(OutOfTime, MemoryError), limit.enforced():
        supersolution = isinstance(supersolution_proof(problem), SupersolutionProof)
    for title, one in methods.items():
        if isinstance(one, ModulusMember) and one.why_not(problem) is None:
            checks = check_all(problem, one, limit)
            rate = None
            steps = None
            with suppress(OutOfTime, MemoryError), limit.enforced():
                rate = predicted_rate(problem, one, checks)
                steps = rate.steps(problem, np.zeros(problem.n), accuracy) if isinstance(rate, Rate) else None
            yield Forecast(title, one, checks, rate, steps, supersolution)


def factor_text(factor: float) -> str:
    """A proved factor per step as text, rounded upwards, but below 1."""
    return rounded_up(factor, 6, below=1.0)
