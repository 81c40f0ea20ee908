"""Predicted rates: bounds on the number of steps of a method of the modulus family, before it is run."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Any, ClassVar

import numpy as np

from ...algebra.splittings import Member
from ...errors import InputError, check_arguments
from ...numerics.arrays import Vector, as_number, as_vector, axes, described
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF, product_upper_bound, rounded_up
from ...present.display import Displayable
from ...problem.data import ProblemData, as_problem
from ..answers import Answer
from ..certificates.bounds import error_bound
from ..certificates.proof import norm_up
from .conditions import StepMatrices, sharper
from .contraction import HomogeneousMap, rounding_bound
from .rowwise import SweepMap
from .theorems import Check, check_all


@dataclass(frozen=True, eq=False)
class Rate(Displayable, ABC):
    """A proved rate: every step, in exact arithmetic, multiplies a norm of z − z* by at most `factor`.

    Attributes
    ----------
    factor : float
        The factor, proved to be below 1, whatever q is.
    v : array of shape (n,)
        The weights v > 0 of the norm.
    sentence : str
        The theorem that proves it.
    norm : str
        The norm in words.

    Notes
    -----
    Entry by entry |zᵏ − z*| ≤ factorᵏ·‖z⁰ − z*‖·v. With an upper obstacle z* stands for the limit
    of the method, which is the solution if ψ ≤ ψ̄ there.

    Examples
    --------
    >>> from icpmodel import MNMJ
    >>> problem = ICP([[2, -1], [-1, 2]], [-2, -2])
    >>> rate = predicted_rate(problem, MNMJ())
    >>> round(rate.factor, 6), rate.v, rate.steps(problem, [0.0, 0.0], 1e-3)
    (0.5, array([1., 1.]), 11)
    """

    factor: float
    v: Vector
    sentence: str
    _step: StepMatrices = field(repr=False)
    norm: ClassVar[str]

    def __str__(self) -> str:
        return f"each step leaves at most {rounded_up(self.factor, 6, below=1.0)} of {self.norm}\n{self.sentence}"

    def __repr__(self) -> str:
        return f"{type(self).__name__}(factor={self.factor:.6g}, n={self.v.size})"

    def distance(self, problem: ProblemData, z0: Any) -> float:
        """A bound on the norm of z⁰ − z*, rounding included, infinite where none is known.

        Parameters
        ----------
        problem : ICP
            A problem with the A and ψ of the rate.
        z0 : array_like of shape (n,)
            The start, finite.

        Returns
        -------
        float
            The bound ‖z¹ − z⁰‖/(1 − factor), from one step of the method.

        Raises
        ------
        InputError
            For a problem with another A or ψ, or a z0 of another shape or not finite.
        """
        problem = as_problem(problem)
        step = self._step
        z0 = problem.vector(z0, "z0", finite=True)
        if problem.A is not step.A or problem.psi is not step.problem.psi:
            raise InputError("problem has another A or psi than the rate; make the rate of this problem")
        with np.errstate(all="ignore"):
            r = problem.r(z0)
            omega = step.omega
            r_upper = problem.r_upper(z0)
            F = np.minimum(problem.p(z0), omega * r)
            if r_upper is not None:  # as in the step of the method, also where the obstacles cross
                F = np.maximum(F, omega * r_upper)
            rounding_p, rounding_r = problem.rounding(z0)
            # within its error, either argument may be the smaller one
            rounding_F = np.maximum(rounding_p, omega * rounding_r) + 4 * UNIT_ROUNDOFF * np.abs(F)
            return float(np.nan_to_num(self._distance(problem, z0, F, rounding_F), nan=math.inf, posinf=math.inf))

    @abstractmethod
    def _distance(self, problem: ProblemData, z0: Vector, F: Vector, rounding_F: Vector) -> float:
        """See `distance`. F at z⁰, min(p, Ωr) or the median, is known to `rounding_F`. NaN if no bound is known."""

    def error_after(self, k: int, distance: float) -> Vector:
        """A bound on |zᵏ − z*| entry by entry: factorᵏ·distance·v.

        Parameters
        ----------
        k : int
            The number of steps.
        distance : float
            The result of `distance` for z⁰: 0 or more, or infinite.

        Returns
        -------
        array of shape (n,)
            The bound.

        Raises
        ------
        InputError
            If k is no whole number ≥ 0, or the distance no number ≥ 0.
        """
        k = int(as_number(k, "k", minimum=0, whole=True))
        if not (isinstance(distance, float | np.floating) and distance == math.inf):
            distance = as_number(distance, "distance", minimum=0)
        with np.errstate(over="ignore"):
            size = max(self.factor**k, SMALLEST) * distance * (1 + 16 * UNIT_ROUNDOFF)
            return np.nextafter(size * self.v, np.inf)

    def steps(self, problem: ProblemData, z0: Any, accuracy: Any) -> int | None:
        """Number of steps after which |zᵏ − z*| ≤ `accuracy` in every entry, whatever z* is.

        Parameters
        ----------
        problem : ProblemData
            The problem, as for `distance`.
        z0 : array of shape (n,)
            The start, as for `distance`.
        accuracy : float or array_like of shape (n,)
            The positive accuracy, in the units of z.

        Returns
        -------
        int or None
            The number; None if none is known.

        Raises
        ------
        InputError
            Where `accuracy` is not positive.

        Notes
        -----
        Rounding in the run itself limits the accuracy that can be reached.
        """
        if axes(accuracy, "accuracy") == 0:
            accuracy = as_number(accuracy, "accuracy", above=0)
        accuracy = as_vector(accuracy, self.v.size, "accuracy")
        if not (accuracy > 0).all():
            raise InputError(f"accuracy has the entry {accuracy.min():g}; positive numbers were expected")
        distance = self.distance(problem, z0)
        with np.errstate(over="ignore"):
            target = float((accuracy / self.v).min())
        if not math.isfinite(distance) or target == 0.0:
            return None
        if distance <= target:
            return 0
        far = math.log(distance)
        near = math.log(target)
        fall = far - near + 8 * UNIT_ROUNDOFF * (1 + abs(far) + abs(near))
        return math.ceil(fall / -math.log(self.factor) * (1 + 64 * UNIT_ROUNDOFF))


class Contraction(Rate):
    """The norm is max_i |z_i − z*_i|/v_i: theorem "sharper"."""

    norm = "max_i |z_i - z*_i|/v_i"

    def _map(self) -> HomogeneousMap:
        """The map T with T(v) ≤ factor·v."""
        return sharper(self._step)

    def steps(self, problem: ProblemData, z0: Any, accuracy: Any) -> int | None:
        """The smaller of the numbers by two norms: that of v and, if it has a factor below 1, the maximum norm.

        The factor in the maximum norm may be larger, but this norm is itself the bound on the entries of z.
        """
        numbers = [Rate.steps(self, problem, z0, accuracy)]
        ones = np.ones(self.v.size)
        with np.errstate(all="ignore"):
            factor = float(self._map().upper(ones).max())
        if factor < 1:
            in_maximum_norm = type(self)(factor, ones, self.sentence, self._step)
            numbers.append(Rate.steps(in_maximum_norm, problem, z0, accuracy))
        return min((number for number in numbers if number is not None), default=None)

    def _distance(self, problem: ProblemData, z0: Vector, F: Vector, rounding_F: Vector) -> float:
        moved = self._first_step(F, rounding_F)
        return float((moved / self.v).max()) / (1.0 - self.factor) * (1 + 16 * UNIT_ROUNDOFF)

    def _first_step(self, F: Vector, rounding_F: Vector) -> Vector:
        """The bound |z⁰ − z¹| ≤ |d| + |X⁻¹||Xd − 2F| with a computed d ≈ z⁰ − z¹ = 2X⁻¹F."""
        step = self._step
        d = step.splitting.operator(step.A, step.phi + step.omega).solve(2.0 * F)
        defect = np.abs(step.X @ d - 2.0 * F) + 2.0 * rounding_F + rounding_bound(step.size, d)
        defect = defect * (1 + 8 * UNIT_ROUNDOFF) + np.finfo(np.float64).tiny
        return np.abs(d) + sharper(step).inverse.upper(defect)


class RowwiseContraction(Contraction):
    """The same norm, where the modulus uses the newest values: theorem "rowwise"."""

    def _map(self) -> SweepMap:
        return SweepMap(self._step)

    def _first_step(self, F: Vector, rounding_F: Vector) -> Vector:
        """The bound |z⁰ − z¹| ≤ d, d_i = |F_i|/Ω_i + (ω/a_ii)Σ_{j<i} |a_ij|d_j, Ω = D/ω up to rounding."""
        own = (np.abs(F) + rounding_F) / self._step.omega * (1 + 16 * UNIT_ROUNDOFF) + SMALLEST
        return self._map().solve_lower(own)


class PeacemanRachford(Rate):
    """The norm is ‖Ω^(−½)(A + Ω)(z − z*)‖₂: theorem "definite", where v = Ω^(−½)."""

    norm = "|Omega^(-1/2)(A + Omega)(z - z*)|_2"

    def _distance(self, problem: ProblemData, z0: Vector, F: Vector, rounding_F: Vector) -> float:
        """The smaller of two bounds: from (A + Ω)(z⁰ − z¹) = 2F, and |A + Ω| times an error bound of z⁰."""
        by_step = norm_up(2 * (np.abs(F) + rounding_F) * self.v) / (1 - self.factor)
        delta = error_bound(problem, z0, sharp=True).componentwise
        by_bound = math.inf if delta is None else norm_up(product_upper_bound(abs(self._step.X), delta) * self.v)
        return min(by_step, by_bound) * (1 + 16 * UNIT_ROUNDOFF)


@check_arguments
def predicted_rate(problem: ProblemData, member: Member, checks: dict[str, Check] | None = None) -> Rate | Answer:
    """The contraction factor of `member` on `problem`, or an `Answer` that says why there is none.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    member : Member
        A method of the modulus family.
    checks : dict of str to Check, optional
        `check_all(problem, member)`, if it is known already.

    Returns
    -------
    Rate or Answer
        The rate; an `Answer` is unknown or no.

    Raises
    ------
    InputError
        For a method outside of the family, or other `checks`.

    Notes
    -----
    The factor is that of theorem "sharper", which holds with the same v wherever 4.1 to 4.4 do. Its
    best factor is no larger than theirs; v is optimised to about a hundredth. If "sharper" does not
    hold, the factor is that of "definite"; if the modulus uses the newest values, that of "rowwise".

    References
    ----------
    `icpmodel.theory.convergence.conditions`, `.rowwise` and `.structural`; Banach's fixed point
    theorem.

    Examples
    --------
    >>> from icpmodel import MNMGS, Affine
    >>> print(predicted_rate(ICP([[1.0]], [0.0], Affine([[2.0]])), MNMGS()))
    no: the contraction factor is at least 1, and at most 2.00001
    """
    checks = check_all(problem, member) if checks is None else checks
    known = isinstance(checks, dict) and set(_RATE_CLASSES) <= checks.keys()
    if not (known and all(isinstance(check, Check) for check in checks.values())):
        raise InputError(f"checks is {described(checks)}; what check_all(problem, member) returns was expected")
    for name, kind in _RATE_CLASSES.items():
        check = checks[name]
        if check.holds and check.number is not None and check.vector is not None:
            return kind(check.number, check.vector, f"theorem {name}: {check.sentence}", StepMatrices(problem, member))
    return checks["rowwise" if getattr(member, "sees_newest", False) else "sharper"]


#: the theorems that give a factor, and the rate in the norm of each
_RATE_CLASSES: dict[str, type[Rate]] = {
    "sharper": Contraction,
    "rowwise": RowwiseContraction,
    "definite": PeacemanRachford,
}
