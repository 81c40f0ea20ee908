"""θ₁, θ₂ and Ω where they are left to the package: from the theory, and adapted while a run goes on.

On rows with p < Ωr a step with X = 2(D/ω − L) and Ω = (2 − ω)D is successive overrelaxation (SOR), whose best ω follows
from the spectral radius μ of the Jacobi matrix of those rows: ω = 2/(1 + √(1 − μ²)). Where A is consistently ordered,
SOR with an ω below the best one shrinks the error by λ a step, and λ tells μ: (λ + ω − 1)² = ω²μ²λ.
Reference: Young, Iterative Solution of Large Linear Systems (1971), chapters 6 and 7; Hageman and Young, Applied
Iterative Methods (1981), chapter 9.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np

from ..arrays import Vector, as_number
from ..errors import InputError
from ..operators import factorise
from ..problem import ICP
from ..theory.spectral import jacobi_radius

#: what theta1 may be instead of a number
AUTO = "auto"
#: an ω between two looks at the rate stays this many steps, until two factors agree to so much of their gap to 1
_SETTLE, _AGREE = 12, 0.05
#: from the rate follows an ω that is multiplied by this, as too large a one costs more than too small a one …
_CAUTION = 0.98
#: … and it is taken where it comes nearer to 2 by this share
_WORTH = 0.05
#: below this ω there is nothing to adapt
_RELAXED = 1.2
#: the least patience in steps, and the growth that is a reason to step back at once
_PATIENCE, _GROWN = 100, 1e3


def is_auto(theta1: Any) -> bool:
    """Whether θ₁ is "auto"; otherwise it is checked to be a positive number. Raises InputError.

    >>> is_auto("auto"), is_auto(1.2)
    (True, False)
    """
    if isinstance(theta1, str) and theta1 == AUTO:
        return True
    try:
        as_number(theta1, "theta1", above=0)
    except InputError as error:
        raise InputError(f"{error}, or {AUTO!r}") from None
    return False


def a_number(theta1: Any) -> float:
    """θ₁ where only a number will do. Raises InputError.

    >>> a_number("auto")
    Traceback (most recent call last):
    icpmodel.errors.InputError: theta1 is 'auto'; settled(problem) is the member with numbers, which was expected
    """
    if is_auto(theta1):
        raise InputError(f"theta1 is {AUTO!r}; settled(problem) is the member with numbers, which was expected")
    return float(theta1)


def leave_out(method: Any, *names: str) -> None:
    """Raise InputError where one of the options `names`, which θ₁ = "auto" decides, differs from its default.

    >>> from icpmodel import MNMAOR
    >>> MNMAOR(theta1="auto", theta2=1.5)
    Traceback (most recent call last):
    icpmodel.errors.InputError: theta2 is given, but theta1='auto' decides theta2, phi1, phi2 as well
    """
    for option in fields(method):
        value = getattr(method, option.name)
        if option.name in names and value is not option.default and (np.ndim(value) or value != option.default):
            raise InputError(f"{option.name} is given, but theta1={AUTO!r} decides {', '.join(names)} as well")


def sor(problem: ICP, omega: float) -> tuple[float, Vector]:
    """θ₁ = 1/(2/ω − s) and the diagonal of Ω = sD, s = 2 − ω, shape (n,): then D/θ₁ + Ω = 2D/ω.

    The small Ω keeps overrelaxed rows near the contact set from flipping sides. Parameters: `omega` in (0, 2).

    >>> sor(ICP([[2.0]], [-1.0]), 1.0)
    (1.0, array([2.]))
    """
    share = 2.0 - omega
    return 1.0 / (2.0 / omega - share), share * problem.A.diagonal()


def best_omega(radius: float) -> float:
    """The ω of the least SOR rate, 2/(1 + √(1 − ρ²)), for the Jacobi radius ρ, which counts as at most 1 − 1e-6.

    >>> best_omega(0.6) == 2 / (1 + 0.8)
    True
    """
    return 2.0 / (1.0 + math.sqrt(1.0 - min(radius, 1.0 - 1e-6) ** 2))


def relaxation(problem: ICP) -> float:
    """The ω of the least SOR rate for the whole of A: 2/(1 + √(1 − ρ²)), ρ the estimated Jacobi radius; 1 where ρ ≥ 1.

    On the rows that do not touch the obstacle the radius is smaller, so that this ω is rather too large.

    >>> relaxation(ICP([[2.0, -1.2], [-1.2, 2.0]], [-1.0, 1.0])) == 2 / (1 + 0.8)
    True
    """
    with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
        radius: float = problem.remembered("jacobi radius", lambda: jacobi_radius(problem.A))
    return best_omega(radius) if radius < 1.0 else 1.0


def scale_of(problem: ICP) -> float:
    """√(‖A‖_∞/‖A⁻¹1‖_∞), for an M-matrix the geometric mean of its largest and its smallest scale; one factorisation.

    It is ‖A‖_∞ where A is singular, and 1 where that is no positive number either.

    >>> scale_of(ICP([[4.0, 0.0], [0.0, 1.0]], [0.0, 0.0]))
    2.0
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(problem.absolute_A().sum(axis=1).max())
        lu = factorise(problem.A)
        inverse = np.inf if lu is None else float(np.abs(lu.solve(np.ones(problem.n))).max())
        scale = math.sqrt(size) / math.sqrt(inverse) if 0 < inverse < np.inf else size
    return scale if 0 < scale < np.inf else 1.0


class AdaptedOmega:
    """An ω that follows the observed rate: from 1 up to `best`, and back where the residual grows or hardly falls.

    Every step back halves ω − 1, takes all of it where ω ≤ 1.2, and is final. Where ω = 1 does no better, the run is
    `plain` from then on, with MNMGS; so hardly a problem is lost that MNMGS solves, and that is every one with an
    H₊-matrix and a ψ of small slope. The patience is somewhat more than Gauss–Seidel sweeps need to halve an error.
    Parameters: `best`, the ω that is best for all of A, from which the run starts where it is below 1.2; `fixed`, an
    ω from which the run starts and which it does not exceed.

    >>> omega = AdaptedOmega(1.9)
    >>> any([omega.changes(0.81**k) for k in range(13)]), round(omega.value, 3)
    (True, 1.365)
    """

    def __init__(self, best: float, fixed: float | None = None) -> None:
        self.most, self.plain = fixed or best, False
        self.value = fixed or (best if best < _RELAXED else 1.0)
        # 1 - rho is about (2 - omega)^2 / 8, and ln(2) / (1 - rho^2) Gauss-Seidel sweeps halve the error; a fixed omega
        # is hardly faster than they are, and from it there are fewer steps back to wait for
        self._patience = _PATIENCE + (2.0 if fixed is None else 6.0) / (2.0 - best) ** 2
        self._last = self._factor = math.nan
        self._steps = self._since = 0
        self._least = self._mark = math.inf

    def changes(self, residual: float | None) -> bool:
        """Whether the `residual` of the next iterate is a reason to change ω, or to be `plain` from now on.

        >>> AdaptedOmega(1.9).changes(1.0)
        False
        """
        assert residual is not None
        factor = residual / self._last if self._last > 0 else math.nan
        before, self._factor, self._last = self._factor, factor, residual
        self._least = min(self._least, residual)
        self._steps += 1
        self._since += 1
        if residual <= self._mark / 2:
            self._mark, self._since = residual, 0
        if self.plain:
            return False
        stuck = self._since > self._patience
        if stuck or not residual <= _GROWN * self._least:
            self.plain = self.value == 1.0
            self.most = 1.0 + 0.5 * (self.value - 1.0) if self.value > 1.2 else 1.0
            self._change(self.most)
            return True
        if self.value < self.most and self._steps >= _SETTLE and abs(factor - before) < _AGREE * (1.0 - factor):
            omega = min(_CAUTION * self._best(factor), self.most)
            if omega > self.value + _WORTH * (2.0 - self.value):
                self._change(omega)
                return True
        return False

    def _best(self, factor: float) -> float:
        """The ω for which this factor, seen at the present ω, gives the least rate; 0 where it tells nothing."""
        if not 0 < factor < 1:
            return 0.0
        mu = (factor + self.value - 1.0) / (self.value * math.sqrt(factor))
        return 2.0 / (1.0 + math.sqrt(1.0 - mu**2)) if mu < 1 else 0.0

    def _change(self, omega: float) -> None:
        self.value, self._steps, self._since = omega, 0, 0
        self._factor = math.nan
        self._mark = self._last
