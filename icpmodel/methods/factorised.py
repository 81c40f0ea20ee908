"""The members with M₁ = A: one factorisation of A + φ + Ω, reused in every step."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import a_number, check_diagonal, is_auto, scale_of
from ..algebra.splittings import Splitting, Whole
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from .modulus import ModulusMember


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMOD(ModulusMember):
    """Modified new modulus method: M₁ = A, Ω = I. `phi` is a number or a vector of shape (n,).

    Converges for every positive definite A with ψ = 0 and φ = 0. In rows that leave the obstacle a step multiplies what
    an eigenvalue λ of A leaves by (φ + 1 − λ)/(φ + 1 + λ): by nothing for λ = φ + 1, by 1 in absolute value for an
    imaginary λ, whatever φ. Reference: Kumar, Deepmala and Das, section 3.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMOD()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmod"
    family: ClassVar[str] = "paper"
    to_try: ClassVar[str] = "another phi (phi + 1 amid A's eigenvalues; none helps where A only rotates)"
    phi: Any = 0.0

    def __post_init__(self) -> None:
        check_diagonal(self, "phi", positive=False)

    def splitting_of(self) -> Splitting:
        return Whole()

    def omega_of(self, problem: ProblemData) -> Vector:
        return np.ones(problem.n)


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MNMMOD(MNMOD):
    """Modified new modified modulus method: M₁ = A, Ω = θ₁I, θ₁ > 0.

    The display in the paper lacks a "+" and the factor θ₁ before ψ; the scheme is
    (A + φ + θ₁I)z⁺ = φz + |(A − θ₁I)z + q + θ₁ψ(z)| − q + θ₁ψ(z). √(λ_min λ_max) is a good θ₁ for symmetric A;
    theta1="auto" is √(‖A‖_∞/‖A⁻¹1‖_∞), which comes near to it for an M-matrix.

    Examples
    --------
    >>> ICP([[1.0]], [1.0], psi=1.0).solve(MNMMOD(theta1=2.0)).z.round(6)
    array([1.])
    """

    name: ClassVar[str] = "mnmmod"
    family: ClassVar[str] = "paper"
    to_try: ClassVar[str] = "another theta1 (amid A's eigenvalues; none helps where A only rotates), another phi"
    theta1: Any = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        is_auto(self.theta1)

    def settled(self, problem: ProblemData) -> MNMMOD:
        return MNMMOD(phi=self.phi, theta1=scale_of(problem)) if is_auto(self.theta1) else self

    def omega_of(self, problem: ProblemData) -> Vector:
        return np.full(problem.n, a_number(self.theta1))
