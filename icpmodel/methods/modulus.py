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
"""

from __future__ import annotations

from abc import abstractmethod
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..arrays import Vector, as_number, as_vector
from ..errors import InputError
from ..operators import rows_of
from ..problem import ICP
from ..splittings import AOR, Splitting, Whole, as_splitting
from . import Method, positive_diagonal


class ModulusMember(Method):
    """A member of the modulus family: a choice of M₁, φ and Ω, and nothing else.

    >>> MNMGS().splitting_of()
    AOR(theta1=1.0, theta2=1.0)
    """

    #: members without the option have φ = 0
    phi: Any = 0.0

    @abstractmethod
    def splitting_of(self) -> Splitting:
        """The choice of M₁.

        >>> MNMOD().splitting_of()
        Whole()
        """

    @abstractmethod
    def omega_of(self, problem: ICP) -> Vector:
        """The diagonal of Ω = φ₁⁻¹φ₂, shape (n,).

        >>> MNMMOD(theta1=3.0).omega_of(ICP([[2.0]], [1.0]))
        array([3.])
        """

    def iterates(self, problem: ICP, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`."""
        omega = self.omega_of(problem)
        shift = as_vector(self.phi, problem.n, "phi") + omega
        step = self.splitting_of().operator(problem.A, shift).step(problem, omega)
        while True:
            following, residual = step(z)
            yield z, residual
            z = following


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

    def omega_of(self, problem: ICP) -> Vector:
        """φ₂/φ₁, or D where φ₂ is not given: see `ModulusMember.omega_of`."""
        if self.phi2 is None:
            return rows_of(problem).diagonal
        return as_vector(self.phi2, problem.n, "phi2") / as_vector(self.phi1, problem.n, "phi1")

    def why_not(self, problem: ICP) -> str | None:
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
        """See `ModulusMember.splitting_of`."""
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
        """See `ModulusMember.splitting_of`."""
        return Whole()

    def omega_of(self, problem: ICP) -> Vector:
        """Ω = I: see `ModulusMember.omega_of`."""
        return np.ones(problem.n)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMMOD(MNMOD):
    """Modified new modified modulus method: M₁ = A, Ω = θ₁I, θ₁ > 0.

    The display in the paper lacks a "+" and the factor θ₁ before ψ; the scheme is
    (A + φ + θ₁I)z⁺ = φz + |(A − θ₁I)z + q + θ₁ψ(z)| − q + θ₁ψ(z). √(λ_min λ_max) is a good θ₁ for symmetric A.

    >>> ICP([[1.0]], [1.0], psi=1.0).solve(MNMMOD(theta1=2.0)).z.round(6)
    array([1.])
    """

    name: ClassVar[str] = "mnmmod"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another theta1"
    theta1: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        as_number(self.theta1, "theta1", above=0)

    def omega_of(self, problem: ICP) -> Vector:
        """Ω = θ₁I: see `ModulusMember.omega_of`."""
        return np.full(problem.n, float(self.theta1))


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMAOR(_FreeOmega):
    """Accelerated overrelaxation: M₁ = (D − θ₂L)/θ₁; `phi`, `phi1`, `phi2` as in `Modulus`.

    (θ₁, θ₂) = (ω, 2ω) with Ω = D/ω has the reach of projected SOR: then z⁺ = z − (D/ω − L)⁻¹ min(p, (D/ω) r).
    Reference: Kumar, Deepmala and Das, section 3.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMAOR(theta1=1.2, theta2=1.0, phi=0.5)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmaor"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another theta1 or theta2"
    theta1: float = 1.0
    theta2: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        AOR(self.theta1, self.theta2)

    def splitting_of(self) -> Splitting:
        """See `ModulusMember.splitting_of`."""
        return AOR(self.theta1, self.theta2)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMSOR(_FreeOmega):
    """Successive overrelaxation: MNMAOR with θ₂ = θ₁; `phi`, `phi1`, `phi2` as in `Modulus`.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMSOR(theta1=1.1)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmsor"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another theta1"
    theta1: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        AOR(self.theta1, self.theta1)

    def splitting_of(self) -> Splitting:
        """See `ModulusMember.splitting_of`."""
        return AOR(self.theta1, self.theta1)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMGS(_FreeOmega):
    """Gauss–Seidel: MNMAOR with θ₁ = θ₂ = 1; `phi`, `phi1`, `phi2` as in `Modulus`.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMGS()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmgs"

    def splitting_of(self) -> Splitting:
        """See `ModulusMember.splitting_of`."""
        return AOR(1.0, 1.0)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMJ(_FreeOmega):
    """Jacobi: MNMAOR with θ₁ = 1, θ₂ = 0. With the default Ω = D and φ = 0 it is projected Jacobi.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMJ()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmj"

    def splitting_of(self) -> Splitting:
        """See `ModulusMember.splitting_of`."""
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
        """See `ModulusMember.splitting_of`."""
        splitting: Splitting = self.splitting
        return splitting

    def omega_of(self, problem: ICP) -> Vector:
        """See `ModulusMember.omega_of`."""
        return problem.A.diagonal() if self.omega is None else as_vector(self.omega, problem.n, "omega")

    def why_not(self, problem: ICP) -> str | None:
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
        """See `ModulusMember.splitting_of`."""
        return AOR(self.omega, 0.0)

    def omega_of(self, problem: ICP) -> Vector:
        """Ω = D/ω: see `ModulusMember.omega_of`."""
        diagonal: Vector = problem.A.diagonal() / self.omega
        return diagonal

    def why_not(self, problem: ICP) -> str | None:
        """See `Method.why_not`."""
        return positive_diagonal(problem, "the fixed point divides by the diagonal of A")


def check_diagonal(method: Method, name: str, *, positive: bool = True) -> None:
    """Check one diagonal (a number or vector) of a frozen method and keep it as a float or a float64 vector.

    >>> MNMGS(phi2=-1.0)
    Traceback (most recent call last):
    icpmodel.errors.InputError: phi2 has the entry -1; positive numbers were expected
    """
    given = getattr(method, name)
    value = as_vector(given, None if np.ndim(given) else 1, name)
    if positive and not (value > 0).all():
        raise InputError(f"{name} has the entry {value.min():g}; positive numbers were expected")
    object.__setattr__(method, name, value if np.ndim(given) else float(value[0]))
