"""The members with M₁ = A: one factorisation of A + φ + Ω, reused in every step."""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import check_diagonal, is_auto, scale_of, theta1_number
from ..algebra.splittings import FullSplitting, Splitting
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from .contract import with_options
from .modulus import ModulusMember


@with_options
class MNMOD(ModulusMember):
    """Modified new modulus method: M₁ = A, Ω = I.

    Parameters
    ----------
    phi : float or array of shape (n,), default 0
        The diagonal of φ.

    Notes
    -----
    It converges for every positive definite A with ψ = 0 and φ = 0. In rows off the obstacle a step
    multiplies the error in an eigenvector with eigenvalue λ of A by (φ + 1 − λ)/(φ + 1 + λ). That is
    0 for λ = φ + 1, and has absolute value 1 for imaginary λ, whatever φ.

    References
    ----------
    Kumar, Deepmala and Das, section 3.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(MNMOD()).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "mnmod"
    family: ClassVar[str] = "paper"
    to_try: ClassVar[str] = "another phi (phi + 1 between A's extreme eigenvalues; none helps if some are imaginary)"
    phi: Any = 0.0

    def __post_init__(self) -> None:
        check_diagonal(self, "phi", positive=False)

    def splitting_of(self) -> Splitting:
        return FullSplitting()

    def omega_of(self, problem: ProblemData) -> Vector:
        return np.ones(problem.n)


@with_options
class MNMMOD(MNMOD):
    """Modified new modified modulus method: M₁ = A, Ω = θ₁I.

    Parameters
    ----------
    phi : float or array of shape (n,), default 0
        The diagonal of φ.
    theta1 : float or "auto", default 1
        θ₁ > 0. √(λ_min λ_max) is good for symmetric A. "auto" is √(‖A‖_∞/‖A⁻¹1‖_∞), which is near
        to it for an M-matrix.

    Notes
    -----
    The display in the paper lacks a "+" and the factor θ₁ before ψ. The scheme is
    (A + φ + θ₁I)z⁺ = φz + |(A − θ₁I)z + q + θ₁ψ(z)| − q + θ₁ψ(z).

    Examples
    --------
    >>> ICP([[1.0]], [1.0], psi=1.0).solve(MNMMOD(theta1=2.0)).z.round(6)
    array([1.])
    """

    name: ClassVar[str] = "mnmmod"
    to_try: ClassVar[str] = (
        "another theta1 (between A's extreme eigenvalues; none helps if some are imaginary), another phi"
    )
    theta1: Any = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        is_auto(self.theta1)

    def adapt(self, problem: ProblemData) -> MNMMOD:
        return MNMMOD(phi=self.phi, theta1=scale_of(problem)) if is_auto(self.theta1) else self

    def omega_of(self, problem: ProblemData) -> Vector:
        return np.full(problem.n, theta1_number(self.theta1))
