"""The members with M₁ = (D − θ₂L)/θ₁: one pass over A per step."""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from typing import Any, ClassVar

from ..algebra.relaxation import (
    MIN_ADAPTED_OMEGA,
    AdaptedOmega,
    cautious_omega,
    check_defaults,
    is_auto,
    sor_parameters,
    theta1_number,
)
from ..algebra.splittings import AOR, Splitting
from ..algebra.steps import StepResult, repeated_steps
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from .contract import Iterate, Method, with_options
from .modulus import FreeOmega


@with_options
class _AdaptiveRelaxation(FreeOmega):
    """Members whose θ₁ may be "auto": ω starts at `_starting_omega`, and adapts during the run."""

    theta1: Any = 1.0

    @abstractmethod
    def _starting_omega(self, problem: ProblemData) -> AdaptedOmega: ...

    @abstractmethod
    def _with_omega(self, problem: ProblemData, omega: float) -> MNMAOR | MNMSOR: ...

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        return _AdaptedPath(self, problem, z) if is_auto(self.theta1) else super().iterates(problem, z)


class _AdaptedPath(Iterator[Iterate]):
    """The iterates with theta1="auto"; `adapted_method` is the member with the numbers of the latest steps."""

    def __init__(self, member: _AdaptiveRelaxation, problem: ProblemData, z: Vector) -> None:
        self.adapted_method: Method = member
        self.member = member
        self.problem = problem
        self.z = z
        self.step: Any = member.opening(problem)
        self.omega: AdaptedOmega | None = None
        self.ahead: list[StepResult] = []
        self.residual: float | None = None

    def __next__(self) -> Iterate:
        if self.residual is not None:
            self._adapt(self.residual)
        if not self.ahead:
            self.ahead = repeated_steps(self.step, self.z)
        z = self.z
        self.z, self.residual = self.ahead.pop(0)
        return z, self.residual

    def _adapt(self, residual: float) -> None:
        """Change ω if the `residual` of the last iterate calls for it."""
        if self.omega is None:
            self.omega = self.member._starting_omega(self.problem)
        elif not self.omega.update(residual):
            return
        plain = type(self.member)(phi=self.member.phi)
        self.adapted_method = plain if self.omega.is_plain else self.member._with_omega(self.problem, self.omega.value)
        self.step = self.adapted_method.step_of(self.problem)
        self.ahead = []


@with_options
class MNMAOR(_AdaptiveRelaxation):
    """Accelerated overrelaxation: M₁ = (D − θ₂L)/θ₁.

    Parameters
    ----------
    phi, phi1, phi2 : float or array of shape (n,)
        The diagonals of φ, φ₁ and φ₂, as in `Modulus`.
    theta1 : float or "auto", default 1
        θ₁ > 0. With "auto" the run starts at ω = 1, or at a `cautious_omega` between 1 and 1.2, and
        adapts ω to the observed rate.
    theta2 : float, default 1
        θ₂.

    Notes
    -----
    With θ₁ = 1/(2/ω − s), θ₂ = 2θ₁ and Ω = sD, s = 2 − ω, the step where p < Ωr is that of SOR:
    z⁺ = z − (D/ω − L)⁻¹p. "auto" uses these. `Solution.adapted_method` has the numbers at the end of
    the run.

    References
    ----------
    Kumar, Deepmala and Das, section 3; `algebra.relaxation` for "auto".

    Examples
    --------
    >>> method = MNMAOR(theta1=1.2, theta2=1.0, phi=0.5)
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(method).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmaor"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another theta1 or theta2"
    theta2: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if is_auto(self.theta1):
            check_defaults(self, "theta2", "phi1", "phi2")
        else:
            AOR(self.theta1, self.theta2)

    def adapt(self, problem: ProblemData) -> MNMAOR:
        """This method with numbers in place of "auto": ω = `cautious_omega`, which is enough for acceleration.

        Parameters
        ----------
        problem : ProblemData
            The problem.

        Returns
        -------
        MNMAOR
            Itself where θ₁ is a number.
        """
        return self._with_omega(problem, cautious_omega(problem)) if is_auto(self.theta1) else self

    def _starting_omega(self, problem: ProblemData) -> AdaptedOmega:
        omega = cautious_omega(problem)
        return AdaptedOmega(omega, max_value=omega) if 1.0 < omega < MIN_ADAPTED_OMEGA else AdaptedOmega(1.0)

    def _with_omega(self, problem: ProblemData, omega: float) -> MNMAOR:
        return overrelaxed(problem, omega, self.phi)

    def splitting_of(self) -> Splitting:
        return AOR(theta1_number(self.theta1), self.theta2)


@with_options
class MNMSOR(_AdaptiveRelaxation):
    """Successive overrelaxation: MNMAOR with θ₂ = θ₁.

    Parameters
    ----------
    phi, phi1, phi2 : float or array of shape (n,)
        The diagonals of φ, φ₁ and φ₂, as in `Modulus`.
    theta1 : float or "auto", default 1
        θ₁ > 0. "auto" is 1/(2/ω − s) with Ω = sD and s = 2 − ω.

    Notes
    -----
    "auto" begins with the ω that is best for SOR, but at most with 1.4, as θ₂ = θ₁ allows no more. It
    reduces ω where that is too large for the run. `Solution.adapted_method` has the numbers at the end.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMSOR(theta1=1.1)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmsor"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another theta1"

    def __post_init__(self) -> None:
        super().__post_init__()
        if is_auto(self.theta1):
            check_defaults(self, "phi1", "phi2")

    def adapt(self, problem: ProblemData) -> MNMSOR:
        """This method with θ₁ = 1 and Ω = D in place of "auto": a proved choice, and the best for acceleration.

        Parameters
        ----------
        problem : ProblemData
            The problem.

        Returns
        -------
        MNMSOR
            Itself where θ₁ is a number.
        """
        return MNMSOR(phi=self.phi) if is_auto(self.theta1) else self

    def _starting_omega(self, problem: ProblemData) -> AdaptedOmega:
        omega = cautious_omega(problem)
        return AdaptedOmega(omega, max_value=omega)

    def _with_omega(self, problem: ProblemData, omega: float) -> MNMSOR:
        theta1, phi2 = sor_parameters(problem, omega)
        return MNMSOR(phi=self.phi, phi2=phi2, theta1=theta1)

    def splitting_of(self) -> Splitting:
        theta1 = theta1_number(self.theta1)
        return AOR(theta1, theta1)


@with_options
class MNMGS(FreeOmega):
    """Gauss–Seidel: MNMAOR with θ₁ = θ₂ = 1.

    Parameters
    ----------
    phi, phi1, phi2 : float or array of shape (n,)
        The diagonals of φ, φ₁ and φ₂, as in `Modulus`.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMGS()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmgs"

    def splitting_of(self) -> Splitting:
        return AOR(1.0, 1.0)


@with_options
class MNMJ(FreeOmega):
    """Jacobi: MNMAOR with θ₁ = 1, θ₂ = 0; projected Jacobi with the default Ω = D and φ = 0.

    Parameters
    ----------
    phi, phi1, phi2 : float or array of shape (n,)
        The diagonals of φ, φ₁ and φ₂, as in `Modulus`.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMJ()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmj"

    def splitting_of(self) -> Splitting:
        return AOR(1.0, 0.0)


def overrelaxed(problem: ProblemData, omega: float, phi: Any = 0.0) -> MNMAOR:
    """MNMAOR with X = 2(D/ω − L) and Ω = (2 − ω)D: on the rows where p < Ωr it is successive overrelaxation.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    omega : float
        ω in (0, 2).
    phi : float or array of shape (n,), default 0
        The diagonal of φ.

    References
    ----------
    The module `algebra.relaxation`.
    """
    theta1, phi2 = sor_parameters(problem, omega)
    return MNMAOR(phi=phi, phi2=phi2, theta1=theta1, theta2=2.0 * theta1)
