"""Default choices of θ₁, θ₂ and Ω: from the theory, and adapted during a run.

On rows with p < Ωr a step with X = 2(D/ω − L) and Ω = (2 − ω)D is successive overrelaxation (SOR).
Its best ω follows from the spectral radius μ of the Jacobi matrix of those rows: ω = 2/(1 + √(1 −
μ²)). Let A be consistently ordered. SOR with an ω below the best one reduces the error by λ a step,
and λ determines μ: (λ + ω − 1)² = ω²μ²λ. So a run with an observed rate needs no estimate of μ
beforehand, and an accelerated one hardly depends on ω.

References
----------
Young, Iterative Solution of Large Linear Systems (1971), chapters 6 and 7. Hageman and Young,
Applied Iterative Methods (1981), chapter 9.
"""

from __future__ import annotations

import math
from dataclasses import fields
from typing import Any

import numpy as np

from ..errors import InputError
from ..numerics.arrays import Vector, as_number, as_vector, axes
from ..numerics.factorisation import factorise
from ..problem.data import ProblemData
from .operators import AOROperator, inverse_diagonal
from .steps import MAX_IDLE_STEPS, Step

#: the value of theta1 that leaves the choice to the package
AUTO = "auto"
#: the number of steps from which a rate is estimated
STEPS_PER_RATE = 12
#: two factors agree if they differ by less than this share of the gap to 1; a new ω must close this share of that to 2
_SMALL_SHARE = 0.05
#: multiplies the ω that follows from the rate, as too large an ω costs more than too small a one
_CAUTION = 0.98
#: the least error factor that is assumed of a sweep, because of rounding and of matrices that are not normal
_MIN_ERROR_FACTOR = 1e-4
#: a spectral radius counts as at most 1 minus this
_MIN_GAP = 1e-6
#: largest ω of a run that does not adapt it
_MAX_FIXED_OMEGA = 1.4
#: below this ω there is nothing to adapt
MIN_ADAPTED_OMEGA = 1.2
#: the patience on top of `MAX_IDLE_STEPS`, as a multiple of the steps that halve the error, by the observed rate or by
#: the one for which ω is best; and the growth of the residual that reduces ω at once
_HALVINGS_OF_PATIENCE = 3.0
_MAX_GROWTH = 1e3
#: the largest number of steps to reduce the error by the factor e that is assumed without a rate. The patience is at
#: most 724 then: SOR with the best ω = 1.999 halves the error in that time, and a cycle is found before the run
#: stagnates
_MAX_HALVING_STEPS = 300.0


def is_auto(theta1: Any) -> bool:
    """Whether θ₁ is "auto"; otherwise it is checked to be a positive number. Raises InputError."""
    if isinstance(theta1, str) and theta1 == AUTO:
        return True
    try:
        as_number(theta1, "theta1", above=0)
    except InputError as error:
        raise InputError(f"{error}, or {AUTO!r}") from None
    return False


def theta1_number(theta1: Any) -> float:
    """θ₁ as a float. Raises InputError where it is "auto" or not positive."""
    if is_auto(theta1):
        raise InputError(f"theta1 is {AUTO!r}; adapt(problem) is the member with numbers, which was expected")
    return float(theta1)


def check_defaults(method: Any, *names: str) -> None:
    """Raise InputError where one of the options `names`, which θ₁ = "auto" decides, differs from its default."""
    for option in fields(method):
        value = getattr(method, option.name)
        if option.name in names and value is not option.default and (np.ndim(value) or value != option.default):
            raise InputError(f"{option.name} is given, but theta1={AUTO!r} decides {', '.join(names)} as well")


def check_diagonal(method: Any, name: str, *, positive: bool = True) -> None:
    """Check the diagonal `name` (a number or vector) of a frozen method; store it as a float or a float64 vector."""
    option = getattr(method, name)
    if isinstance(option, float) and (0.0 < option < np.inf or (not positive and -np.inf < option < np.inf)):
        return
    value = as_vector(option, None if axes(option, name) else 1, name)
    if positive and not (value > 0).all():
        raise InputError(f"{name} has the entry {value.min():g}; positive numbers were expected")
    value.flags.writeable = False
    object.__setattr__(method, name, value if np.ndim(option) else float(value[0]))


def sor_parameters(problem: ProblemData, omega: float) -> tuple[float, Vector]:
    """θ₁ = 1/(2/ω − s) and the diagonal of Ω = sD, s = 2 − ω, shape (n,): then D/θ₁ + Ω = 2D/ω.

    The small Ω keeps overrelaxed rows near the contact set from flipping sides; 0 < `omega` < 2.
    """
    share = 2.0 - omega
    return 1.0 / (2.0 / omega - share), share * problem.matrix.rows.diagonal


def best_omega(radius: float) -> float:
    """The ω of the least SOR rate, 2/(1 + √(1 − ρ²)), for the Jacobi radius ρ, which counts as at most 1 − 1e-6."""
    return 2.0 / (1.0 + math.sqrt(1.0 - min(radius, 1.0 - _MIN_GAP) ** 2))


def sor_log_reduction(omega: float, radius: float) -> float:
    """The log reduction of the error in a sweep with ω, for the Jacobi radius ρ = `radius`.

    It is −ln λ for the largest λ with (λ + ω − 1)² = ω²ρ²λ; λ = ω − 1 from the best ω on (Young 1971, chapter 6). ρ
    counts as at most 1 − 1e-6: a larger ρ says nothing, as it includes the rows that touch the obstacle.
    """
    radius = min(radius, 1.0 - _MIN_GAP)
    half = (omega * radius) ** 2 / 2.0 - (omega - 1.0)
    discriminant = half**2 - (omega - 1.0) ** 2
    rate = half + math.sqrt(discriminant) if discriminant > 0.0 and half > 0.0 else omega - 1.0
    return -math.log(max(rate, _MIN_ERROR_FACTOR))


def cautious_omega(problem: ProblemData) -> float:
    """A cautious ω for a run that does not adapt it: 2/(1 + √(1 − ρ²)), at most 1.4.

    ρ is `coupled_radius`; ω = 1 if ρ ≥ 1. On the rows that do not touch the obstacle the best ω is
    smaller than for all of A, and acceleration hardly needs more. With θ₂ = θ₁ the factor of the fastest
    errors is between √2 − 1 and 1. Beyond ω = 1.4 it outweighs the gain for the slow errors.
    """
    rho = problem.matrix.coupled_radius
    return min(best_omega(rho), _MAX_FIXED_OMEGA) if rho < 1.0 else 1.0


def scale_of(problem: ProblemData) -> float:
    """√(‖A‖_∞/‖A⁻¹1‖_∞), for an M-matrix the geometric mean of its largest and its smallest scale; one factorisation.

    It is ‖A‖_∞ where A is singular, and 1 where that is 0 or overflows.
    """
    with np.errstate(over="ignore", invalid="ignore"):
        size = float(problem.matrix.absolute.sum(axis=1).max())
        lu = factorise(problem.A)
        inverse = np.inf if lu is None else float(np.abs(lu.solve(np.ones(problem.n))).max())
        scale = math.sqrt(size) / math.sqrt(inverse) if 0 < inverse < np.inf else size
    return scale if 0 < scale < np.inf else 1.0


def jacobi_step(problem: ProblemData, phi: Any = 0.0) -> Step | None:
    """Jacobi's step with Ω = D/(1 − g_ii), which solves every row on its own where ψ is affine with g_ii < 1.

    It begins a run with theta1="auto", as a small problem may need no more.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    phi : float or array of shape (n,), default 0
        The diagonal φ.

    Returns
    -------
    Step or None
        None unless D > 0. Where ψ is not affine, or g_ii ≥ 1, Ω_ii = a_ii.
    """
    if not problem.matrix.has_positive_diagonal:
        return None
    diagonal = omega = problem.matrix.rows.diagonal
    if problem.psi.linear is not None:
        slope = problem.psi.linear[0].diagonal()
        omega = diagonal / (1.0 - np.where(slope < 1.0, slope, 0.0))
    shift = as_vector(phi, problem.n, "phi") + diagonal
    return AOROperator(inverse_diagonal(diagonal, shift), problem.A, 0.0).step(problem, omega)


class AdaptedOmega:
    """An ω adapted to the rate: raised from `value` to at most `max_value`, reduced if the residual grows or stalls.

    A reduction halves ω − 1, or sets ω = 1 where ω ≤ 1.2; ω never exceeds the new value again.
    Where ω = 1 does no better, `is_plain` holds from then on, and the run is MNMGS. MNMGS solves
    every problem with an H₊-matrix and a ψ of small slope, so hardly one of these is lost. The
    patience is several times the number of steps that should halve the error, by the observed rate
    or by the one for which ω is best.
    """

    def __init__(self, value: float, max_value: float = 2.0) -> None:
        self.value = value
        self.max_value = max_value
        self.is_plain = False
        self._last_residual = self._last_factor = math.nan
        self._steps_since_change = self._idle_steps = 0
        self._least = self._milestone = math.inf

    def update(self, residual: float) -> bool:
        """Adapt ω to the `residual` of the last iterate; return whether ω changed or the run became plain."""
        factor = residual / self._last_residual if self._last_residual > 0 else math.nan
        last_factor = self._last_factor
        self._last_factor = factor
        self._last_residual = residual
        self._least = min(self._least, residual)
        self._steps_since_change += 1
        self._idle_steps += 1
        if residual <= self._milestone / 2:
            self._milestone = residual
            self._idle_steps = 0
        if self.is_plain:
            return False
        if self._idle_steps > self._patience(factor) or not residual <= _MAX_GROWTH * self._least:
            self.is_plain = self.value == 1.0
            self.max_value = 1.0 + 0.5 * (self.value - 1.0) if self.value > MIN_ADAPTED_OMEGA else 1.0
            self._change(self.max_value)
            return True
        agree = abs(factor - last_factor) < _SMALL_SHARE * (1.0 - factor)
        if self.value < self.max_value and self._steps_since_change >= STEPS_PER_RATE and agree:
            omega = min(_CAUTION * self._best(factor), self.max_value)
            if omega > self.value + _SMALL_SHARE * (2.0 - self.value):
                self._change(omega)
                return True
        return False

    def _patience(self, factor: float) -> float:
        """The number of steps within which the residual must be halved, at the observed `factor`."""
        # where omega is best, 1 - rho is about (2 - omega)^2 / 8 for the Jacobi radius rho, and Gauss-Seidel sweeps
        # halve the error in ln(2) / (1 - rho^2)
        slow = min(4.0 / (2.0 - self.value) ** 2, _MAX_HALVING_STEPS)
        steps = math.log(2.0) * (max(slow, 1.0 / (1.0 - factor)) if factor < 1.0 else slow)
        return MAX_IDLE_STEPS + _HALVINGS_OF_PATIENCE * steps

    def _best(self, factor: float) -> float:
        """The ω of the least rate, from the `factor` observed at the present ω; 0 where it implies no ρ < 1."""
        if not 0 < factor < 1:
            return 0.0
        mu = (factor + self.value - 1.0) / (self.value * math.sqrt(factor))
        return best_omega(mu) if mu < 1 else 0.0

    def _change(self, omega: float) -> None:
        self.value = omega
        self._steps_since_change = 0
        self._idle_steps = 0
        self._last_factor = math.nan
        self._milestone = self._last_residual
