"""Method 3.1 of the paper and its members: z⁺ = z − 2 X⁻¹ F_Ω(z), X = M₁ + φ + Ω, Ω = φ₁⁻¹φ₂.

Written out with the modulus this is equation (5) of the paper. φ₁ only rescales it, so Ω stands for both:

    (M₁ + φ + Ω) z⁺ = (N₁ + φ) z + |(A − Ω)z + q + Ωψ(z)| − q + Ωψ(z),        N₁ = M₁ − A.

|x − y| = x + y − 2 min(x, y) turns that into the formula above. `algebra.operators.Operator.step` computes it.

The members differ in M₁, Ω, φ, and in the values inside the modulus. The paper uses those of the previous iterate. With
the newest values, row by row, M₁ = D/ω − L gives projected SOR (see `methods.psor`).

- MNMOD: M₁ = A, Ω = I. One factorisation, reused.
- MNMMOD: M₁ = A, Ω = θ₁I. One factorisation, reused.
- MNMAOR: M₁ = (D − θ₂L)/θ₁. Forward substitution in one pass, as for the next two.
- MNMSOR: θ₂ = θ₁, M₁ = D/θ₁ − L. With the newest values it is PSOR(omega=θ₁).
- MNMGS: θ₁ = θ₂ = 1, M₁ = D − L. With the newest values it is PSOR.
- MNMJ: θ₁ = 1, θ₂ = 0, M₁ = D. With Ω = D the newest values give the same method.
- projection-fixed-point: M₁ = Ω = D/ω, z⁺ = max(ψ(z), z − ωD⁻¹(Az + q)).
- Modulus: any M₁ and Ω. NMMS (2022) has φ = 0 and φ₁ = I.

theta1="auto" leaves θ₁ and Ω to `algebra.relaxation`.
"""

from __future__ import annotations

from abc import abstractmethod
from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import AUTO, check_diagonal, is_auto, jacobi_step
from ..algebra.secants import secant_step, why_not_rows, with_slopes
from ..algebra.splittings import AOR, FullSplitting, Splitting, as_splitting
from ..algebra.steps import Step
from ..numerics.arrays import Vector, as_number, as_vector
from ..problem.data import ProblemData
from .contract import FixedPoint, why_not_diagonal, with_options


class ModulusMember(FixedPoint):
    """A member of the modulus family: a choice of M₁, φ and Ω, and of the values inside the modulus."""

    #: whether the modulus contains the newest values, row by row, instead of the previous iterate
    sees_newest: ClassVar[bool] = False
    #: the values for members without these options
    phi: Any = 0.0
    theta1: Any = 1.0
    splitting: Splitting

    def splitting_of(self) -> Splitting:
        """The choice of M₁: the option `splitting`, where there is one."""
        return self.splitting

    @abstractmethod
    def omega_of(self, problem: ProblemData) -> Vector:
        """The diagonal of Ω = φ₁⁻¹φ₂, shape (n,)."""

    def adapt(self, problem: ProblemData) -> ModulusMember:
        """This member with numbers in place of theta1="auto", as acceleration needs them; else itself."""
        return self

    @property
    def memoryless(self) -> bool:  # type: ignore[override]
        """Whether all steps are alike, which they are not with theta1="auto": see `Method.memoryless`."""
        return not is_auto(self.theta1)

    def why_not_f(self, problem: ProblemData) -> str | None:
        f = problem.f
        if f is None:
            return None
        if reason := why_not_rows(problem):
            return reason
        if is_auto(self.theta1):
            return f"theta1={AUTO!r} follows from A alone, and p is nonlinear: give a number"
        if not isinstance(self.splitting_of(), AOR | FullSplitting):
            return "M1 is given for A alone, and p is nonlinear"
        assert f.slope_range is not None
        if isinstance(self.splitting_of(), FullSplitting) and not np.isfinite(f.slope_range[1]).all():
            return "A + diag(M) is factorised, M the largest slopes of f: give a finite M in slope_range=(m, M)"
        return None

    def opening(self, problem: ProblemData) -> Step | None:
        return jacobi_step(problem, self.phi) if is_auto(self.theta1) else None

    def step_of(self, problem: ProblemData) -> Step:
        if is_auto(self.theta1):
            return self.adapt(problem).step_of(problem)
        A = problem.A
        if problem.f is not None:
            if isinstance(self.splitting_of(), AOR):
                return secant_step(problem, self.step_of)
            assert problem.f.slope_range is not None
            A = with_slopes(problem, problem.f.slope_range[1], problem.q).A
        omega = self.omega_of(problem)
        shift = as_vector(self.phi, problem.n, "phi") + omega
        return self.splitting_of().operator(A, shift).step(problem, omega)


@with_options
class FreeOmega(ModulusMember):
    """Members whose Ω is free: φ₁ and φ₂ as numbers or vectors, by default φ₁ = I and φ₂ = φ₁D, that is Ω = D."""

    family: ClassVar[str] = "paper"
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
        """φ₂/φ₁, or D where φ₂ is not given."""
        if self.phi2 is None:
            return problem.matrix.rows.diagonal
        return as_vector(self.phi2, problem.n, "phi2") / as_vector(self.phi1, problem.n, "phi1")

    def why_not(self, problem: ProblemData) -> str | None:
        return why_not_diagonal(problem, "Omega = D must be positive") if self.phi2 is None else None


@with_options
class Modulus(FreeOmega):
    """Method 3.1 in general: any M₁, φ, φ₁, φ₂.

    Parameters
    ----------
    phi : float or array of shape (n,), default 0
        The diagonal of φ, of any sign.
    phi1 : float or array of shape (n,), default 1
        The diagonal of φ₁, positive.
    phi2 : float or array of shape (n,), optional
        The diagonal of φ₂, positive; φ₁D by default, so that Ω = φ₁⁻¹φ₂ = D.
    splitting : str, AOR or matrix of shape (n, n), default "gauss-seidel"
        M₁: "jacobi", "gauss-seidel", "whole" (M₁ = A), an `AOR`, or a dense or sparse matrix.

    Raises
    ------
    InputError
        For a wrong option.

    References
    ----------
    Kumar, Deepmala and Das, Method 3.1.

    Examples
    --------
    >>> method = Modulus(splitting="whole", phi2=2.0)
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(method).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "modulus"
    to_try: ClassVar[str] = "a larger phi (it damps the step), another phi2, another splitting"
    splitting: Any = "gauss-seidel"

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "splitting", as_splitting(self.splitting))


@with_options
class NMMS(ModulusMember):
    """New modulus-based matrix splitting (2022): the member φ = 0, φ₁ = I, Ω = φ₂.

    Parameters
    ----------
    splitting : str, AOR or matrix of shape (n, n), default "gauss-seidel"
        M₁, as in `Modulus`.
    omega : float or array of shape (n,), optional
        The diagonal of Ω, positive; D by default.

    References
    ----------
    The paper's [30].

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(NMMS(omega=4.0)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "nmms"
    family: ClassVar[str] = "paper"
    to_try: ClassVar[str] = "another omega, another splitting"
    splitting: Any = "gauss-seidel"
    omega: Any = None

    def __post_init__(self) -> None:
        object.__setattr__(self, "splitting", as_splitting(self.splitting))
        if self.omega is not None:
            check_diagonal(self, "omega")

    def omega_of(self, problem: ProblemData) -> Vector:
        return problem.matrix.rows.diagonal if self.omega is None else as_vector(self.omega, problem.n, "omega")

    def why_not(self, problem: ProblemData) -> str | None:
        return why_not_diagonal(problem, "Omega = D must be positive") if self.omega is None else None


@with_options
class ProjectionFixedPoint(ModulusMember):
    """Projection fixed point: z⁺ = max(ψ(z), z − ωD⁻¹(Az + q)).

    Parameters
    ----------
    omega : float, default 1
        ω > 0.

    Notes
    -----
    It is the modulus step with M₁ = Ω = D/ω: X = 2Ω and z⁺ = z − Ω⁻¹F_Ω(z).

    References
    ----------
    A baseline of Hong and Li (2016), the paper's [29].

    Examples
    --------
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
        return problem.matrix.rows.diagonal / self.omega

    def why_not(self, problem: ProblemData) -> str | None:
        return why_not_diagonal(problem, "the fixed point divides by the diagonal of A")
