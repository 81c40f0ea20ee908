"""Method 3.1 of the paper and its members: z⁺ = z − 2 X⁻¹ F_Ω(z), X = M₁ + φ + Ω, Ω = φ₁⁻¹φ₂.

Written out with the modulus (equation (5) of the paper; φ₁ only rescales, so that Ω is all it leaves):

    (M₁ + φ + Ω) z⁺ = (N₁ + φ) z + |(A − Ω)z + q + Ωψ(z)| − q + Ωψ(z),        N₁ = M₁ − A.

|x − y| = x + y − 2 min(x, y) turns that into the line above; `operators.Operator.step` is that line.

| method  | M₁             | Ω    |                                                    |
|---------|----------------|------|----------------------------------------------------|
| MNMOD   | A              | I    | one factorisation, reused                          |
| MNMMOD  | A              | θ₁I  | one factorisation, reused                          |
| MNMAOR  | (D − θ₂L)/θ₁   | any  | forward substitution in one pass over A            |
| MNMSOR  | (D − θ₁L)/θ₁   | any  | θ₂ = θ₁                                            |
| MNMGS   | D − L          | any  | θ₁ = θ₂ = 1                                        |
| MNMJ    | D              | any  | θ₁ = 1, θ₂ = 0                                     |
| NMMS    | any            | any  | φ = 0, φ₁ = I (the method of 2022)                 |
| projection-fixed-point | D/ω | D/ω | z⁺ = max(ψ(z), z − ωD⁻¹(Az + q))               |

theta1="auto" leaves θ₁, and what goes with it, to `methods.parameters`.
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import (
    RELAXED,
    AdaptedOmega,
    a_number,
    after_jacobi,
    as_diagonal,
    is_auto,
    jacobi_step,
    leave_out,
    relaxation,
    scale_of,
    sor,
)
from ..algebra.splittings import AOR, Splitting, Whole, as_splitting
from ..algebra.sweeps import Step
from ..errors import InputError
from ..numerics.arrays import Vector, as_number, as_vector
from ..problem.data import ProblemData
from .contract import FixedPoint, Method, positive_diagonal


class ModulusMember(FixedPoint):
    """A member of the modulus family: a choice of M₁, φ and Ω, and nothing else."""

    #: members without these options have φ = 0 and numbers for all else
    phi: Any = 0.0
    theta1: Any = 1.0

    @abstractmethod
    def splitting_of(self) -> Splitting:
        """The choice of M₁."""

    @abstractmethod
    def omega_of(self, problem: ProblemData) -> Vector:
        """The diagonal of Ω = φ₁⁻¹φ₂, shape (n,)."""

    def settled(self, problem: ProblemData) -> ModulusMember:
        """This member with fixed numbers in place of theta1="auto", as acceleration needs them; itself if it has some."""
        return self

    @property
    def memoryless(self) -> bool:  # type: ignore[override]
        """Whether all steps are alike, which they are not with theta1="auto": see `Method.memoryless`."""
        return not is_auto(self.theta1)

    def step_of(self, problem: ProblemData) -> Step:
        """See `FixedPoint.step_of`; with theta1="auto" the first step is `parameters.jacobi_step`."""
        if is_auto(self.theta1):
            return after_jacobi(problem, self.phi, lambda: self.settled(problem).step_of(problem))
        omega = self.omega_of(problem)
        shift = as_diagonal(self.phi, problem.n, "phi") + omega
        return self.splitting_of().operator(problem.A, shift).step(problem, omega)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class _FreeOmega(ModulusMember):
    """Members whose Ω is free: φ₁ and φ₂ as numbers or vectors, by default φ₁ = I and φ₂ = φ₁D, that is Ω = D."""

    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2"
    phi: Any = 0.0
    phi1: Any = 1.0
    phi2: Any = None

    def __post_init__(self) -> None:
        check_diagonal(self, "phi", positive=False)
        check_diagonal(self, "phi1")
        if self.phi2 is not None:
            check_diagonal(self, "phi2")

    def omega_of(self, problem: ProblemData) -> Vector:
        """φ₂/φ₁, or D where φ₂ is not given: see `ModulusMember.omega_of`."""
        if self.phi2 is None:
            return problem.matrix.rows.diagonal
        return as_diagonal(self.phi2, problem.n, "phi2") / as_diagonal(self.phi1, problem.n, "phi1")

    def why_not(self, problem: ProblemData) -> str | None:
        """See `Method.why_not`: the default Ω = D must be positive."""
        return positive_diagonal(problem, "Omega = D must be positive") if self.phi2 is None else None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Modulus(_FreeOmega):
    """Method 3.1 in general: any M₁, φ, φ₁, φ₂.

    Parameters: `splitting` is M₁: "jacobi", "gauss-seidel", "whole" (M₁ = A), an `AOR`, or a dense or sparse matrix of
    shape (n, n); `phi` (any sign), `phi1`, `phi2` (positive) the diagonals, numbers or vectors of shape (n,).
    Raises InputError for a wrong option. Reference: Kumar, Deepmala and Das, Method 3.1.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Modulus(splitting="whole", phi2=2.0)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "modulus"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another splitting"
    splitting: Any = "gauss-seidel"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "splitting", as_splitting(self.splitting))

    def splitting_of(self) -> Splitting:
        splitting: Splitting = self.splitting
        return splitting


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMOD(ModulusMember):
    """Modified new modulus method: M₁ = A, Ω = I. `phi` is a number or a vector of shape (n,).

    Converges for every positive definite A with ψ = 0 and φ = 0. Reference: Kumar, Deepmala and Das, section 3.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMOD()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmod"
    to_try: ClassVar[str] = "a larger phi (it damps the step)"
    phi: Any = 0.0

    def __post_init__(self) -> None:
        check_diagonal(self, "phi", positive=False)

    def splitting_of(self) -> Splitting:
        return Whole()

    def omega_of(self, problem: ProblemData) -> Vector:
        """Ω = I: see `ModulusMember.omega_of`."""
        return np.ones(problem.n)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMMOD(MNMOD):
    """Modified new modified modulus method: M₁ = A, Ω = θ₁I, θ₁ > 0.

    The display in the paper lacks a "+" and the factor θ₁ before ψ; the scheme is
    (A + φ + θ₁I)z⁺ = φz + |(A − θ₁I)z + q + θ₁ψ(z)| − q + θ₁ψ(z). √(λ_min λ_max) is a good θ₁ for symmetric A;
    theta1="auto" is √(‖A‖_∞/‖A⁻¹1‖_∞), which comes near to it for an M-matrix.

    >>> ICP([[1.0]], [1.0], psi=1.0).solve(MNMMOD(theta1=2.0)).z.round(6)
    array([1.])
    """

    name: ClassVar[str] = "mnmmod"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another theta1"
    theta1: Any = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        is_auto(self.theta1)

    def settled(self, problem: ProblemData) -> MNMMOD:
        return MNMMOD(phi=self.phi, theta1=scale_of(problem)) if is_auto(self.theta1) else self

    def omega_of(self, problem: ProblemData) -> Vector:
        """Ω = θ₁I: see `ModulusMember.omega_of`."""
        return np.full(problem.n, a_number(self.theta1))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class _Relaxing(_FreeOmega):
    """Members whose θ₁ may be "auto": then ω goes from what `_adapted` begins with to what the run makes of it."""

    theta1: Any = 1.0

    @abstractmethod
    def _adapted(self, problem: ProblemData) -> AdaptedOmega: ...

    @abstractmethod
    def _relaxed(self, problem: ProblemData, omega: float) -> MNMAOR | MNMSOR: ...

    @property
    def used(self) -> MNMAOR | MNMSOR | None:
        """With theta1="auto", the numbers that the latest run of this object came to; None before there is one."""
        return self.__dict__.get("_used")

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        if not is_auto(self.theta1):
            yield from super().iterates(problem, z)
            return
        omega, step = None, jacobi_step(problem, self.phi)
        while True:
            following, residual = step(z)
            yield z, residual
            z = following
            if omega is None or omega.changes(residual):
                omega = omega or self._adapted(problem)
                member = type(self)(phi=self.phi) if omega.plain else self._relaxed(problem, omega.value)
                object.__setattr__(self, "_used", member)
                step = member.step_of(problem)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMAOR(_Relaxing):
    """Accelerated overrelaxation: M₁ = (D − θ₂L)/θ₁; `phi`, `phi1`, `phi2` as in `Modulus`.

    θ₁ = 1/(2/ω − s), θ₂ = 2θ₁ and Ω = sD with s = 2 − ω have the reach of projected SOR: where p < Ωr,
    z⁺ = z − (D/ω − L)⁻¹p. theta1="auto" takes these; the run starts at ω = 1 and adapts ω to the rate that it
    sees, and `used` tells where it ended.
    Reference: Kumar, Deepmala and Das, section 3; `methods.parameters` for "auto".

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMAOR(theta1=1.2, theta2=1.0, phi=0.5)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmaor"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another theta1 or theta2"
    theta2: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        if is_auto(self.theta1):
            leave_out(self, "theta2", "phi1", "phi2")
        else:
            AOR(self.theta1, self.theta2)

    def settled(self, problem: ProblemData) -> MNMAOR:
        """See `ModulusMember.settled`; ω is `parameters.relaxation`: acceleration needs no more."""
        return self._relaxed(problem, relaxation(problem)) if is_auto(self.theta1) else self

    def _adapted(self, problem: ProblemData) -> AdaptedOmega:
        omega = relaxation(problem)
        return AdaptedOmega(omega, most=omega) if 1.0 < omega < RELAXED else AdaptedOmega(1.0)

    def _relaxed(self, problem: ProblemData, omega: float) -> MNMAOR:
        theta1, phi2 = sor(problem, omega)
        return MNMAOR(phi=self.phi, phi2=phi2, theta1=theta1, theta2=2.0 * theta1)

    def splitting_of(self) -> Splitting:
        return AOR(a_number(self.theta1), self.theta2)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMSOR(_Relaxing):
    """Successive overrelaxation: MNMAOR with θ₂ = θ₁; `phi`, `phi1`, `phi2` as in `Modulus`.

    theta1="auto" is 1/(2/ω − s) with Ω = sD, s = 2 − ω: of the ω that is best for SOR as much as θ₂ = θ₁ bears, and
    less where the run shows that it is too much; `used` tells where it ended.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMSOR(theta1=1.1)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmsor"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another theta1"

    def __post_init__(self) -> None:
        super().__post_init__()
        if is_auto(self.theta1):
            leave_out(self, "phi1", "phi2")

    def settled(self, problem: ProblemData) -> MNMSOR:
        """See `ModulusMember.settled`; θ₁ = 1 and Ω = D, which is proved, and the best start for acceleration."""
        return MNMSOR(phi=self.phi) if is_auto(self.theta1) else self

    def _adapted(self, problem: ProblemData) -> AdaptedOmega:
        omega = relaxation(problem)
        return AdaptedOmega(omega, most=omega)

    def _relaxed(self, problem: ProblemData, omega: float) -> MNMSOR:
        theta1, phi2 = sor(problem, omega)
        return MNMSOR(phi=self.phi, phi2=phi2, theta1=theta1)

    def splitting_of(self) -> Splitting:
        theta1 = a_number(self.theta1)
        return AOR(theta1, theta1)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMGS(_FreeOmega):
    """Gauss–Seidel: MNMAOR with θ₁ = θ₂ = 1; `phi`, `phi1`, `phi2` as in `Modulus`.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMGS()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmgs"

    def splitting_of(self) -> Splitting:
        return AOR(1.0, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMJ(_FreeOmega):
    """Jacobi: MNMAOR with θ₁ = 1, θ₂ = 0. With the default Ω = D and φ = 0 it is projected Jacobi.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMJ()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmj"

    def splitting_of(self) -> Splitting:
        return AOR(1.0, 0.0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class NMMS(ModulusMember):
    """New modulus-based matrix splitting (2022): the member φ = 0, φ₁ = I, Ω = φ₂.

    Parameters: `splitting` as in `Modulus`; `omega` the diagonal of Ω, a positive number or vector of shape (n,), or
    None for D. Reference: the paper's [30].

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(NMMS(omega=4.0)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "nmms"
    to_try: ClassVar[str] = "another omega, another splitting"
    splitting: Any = "gauss-seidel"
    omega: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "splitting", as_splitting(self.splitting))
        if self.omega is not None:
            check_diagonal(self, "omega")

    def splitting_of(self) -> Splitting:
        splitting: Splitting = self.splitting
        return splitting

    def omega_of(self, problem: ProblemData) -> Vector:
        return problem.matrix.rows.diagonal if self.omega is None else as_diagonal(self.omega, problem.n, "omega")

    def why_not(self, problem: ProblemData) -> str | None:
        """See `Method.why_not`: the default Ω = D must be positive."""
        return positive_diagonal(problem, "Omega = D must be positive") if self.omega is None else None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ProjectionFixedPoint(ModulusMember):
    """Projection fixed point: z⁺ = max(ψ(z), z − ωD⁻¹(Az + q)), `omega` > 0.

    It is the modulus step with M₁ = Ω = D/ω: X = 2Ω and z⁺ = z − Ω⁻¹F_Ω(z).
    Reference: a baseline of Hong and Li (2016), the paper's [29].

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(ProjectionFixedPoint()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "projection-fixed-point"
    to_try: ClassVar[str] = "a smaller omega"
    omega: float = 1.0

    def __post_init__(self) -> None:
        as_number(self.omega, "omega", above=0)

    def splitting_of(self) -> Splitting:
        return AOR(self.omega, 0.0)

    def omega_of(self, problem: ProblemData) -> Vector:
        """Ω = D/ω: see `ModulusMember.omega_of`."""
        return problem.matrix.rows.diagonal / self.omega

    def why_not(self, problem: ProblemData) -> str | None:
        return positive_diagonal(problem, "the fixed point divides by the diagonal of A")


def check_diagonal(method: Method, name: str, *, positive: bool = True) -> None:
    """Check one diagonal (a number or vector) of a frozen method and keep it as a float or a float64 vector."""
    given = getattr(method, name)
    if isinstance(given, float) and (0.0 < given < np.inf or (not positive and -np.inf < given < np.inf)):
        return
    value = as_vector(given, None if np.ndim(given) else 1, name)
    if positive and not (value > 0).all():
        raise InputError(f"{name} has the entry {value.min():g}; positive numbers were expected")
    value.flags.writeable = False
    object.__setattr__(method, name, value if np.ndim(given) else float(value[0]))
