"""The matrices of the step of a modulus method, from which every theorem about its convergence is made."""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...algebra.splittings import Member
from ...errors import InputError
from ...numerics.arrays import Vector, as_csr, as_vector, described, diagonal_positions
from ...problem.data import ProblemData, as_problem


class StepMatrices:
    """M₁, M̂ = M₁ + φ, N̂ = M̂ − A, X = M̂ + Ω as CSR and D, φ, φ₁, Ω as vectors, of `member` on `problem`.

    What a theorem makes of them is at most twice `size` entry by entry, and so are the rounding errors of making it.
    Raises InputError where `problem` is no ICP, or `member` has no M₁ or Ω (a name, a class, Newton).
    """

    def __init__(self, problem: ProblemData, member: Member) -> None:
        as_problem(problem)
        if isinstance(member, str | type):
            raise InputError(f"member is {described(member)}; a Method object was expected, such as MNMGS()")
        if not (hasattr(member, "splitting_of") and hasattr(member, "omega_of")):
            raise InputError(
                f"member is {member!r}; a method of the modulus family, such as icpmodel.MNMGS(), was expected"
            )
        self.problem, self.member = problem, member
        self.A, self.n = problem.A, problem.n
        self.D = problem.A.diagonal()
        self.splitting = member.splitting_of()
        self.omega = member.omega_of(problem)
        self.phi = as_vector(member.phi, self.n, "phi")
        self.phi1 = as_vector(getattr(member, "phi1", 1.0), self.n, "phi1")
        #: vectors v > 0 that served one theorem and may serve the next
        self.vectors: list[Vector] = []

    @property
    def G(self) -> sp.csr_array:
        """The Lipschitz matrix of ψ, which must be known."""
        G = self.problem.psi.lipschitz
        assert G is not None
        return G

    @cached_property
    def M1(self) -> sp.csr_array:
        """M₁, every diagonal entry stored."""
        return as_csr(self.splitting.matrix(self.A), "M1", keep_diagonal=True)

    @cached_property
    def M(self) -> sp.csr_array:
        """M̂ = M₁ + φ."""
        return _shifted(self.M1, self.phi)

    @cached_property
    def N(self) -> sp.csr_array:
        """N̂ = M̂ − A."""
        return sp.csr_array(self.M - self.A)

    @cached_property
    def X(self) -> sp.csr_array:
        """X = M̂ + Ω, every diagonal entry stored."""
        return _shifted(self.M, self.omega)

    @cached_property
    def size(self) -> sp.csr_array:
        """|M₁| + |φ| + Ω + |A| + ΩG."""
        return sp.csr_array(
            abs(self.M1) + abs(self.A) + self.omega_G + sp.diags_array(np.abs(self.phi) + self.omega + np.abs(self.D))
        )

    @cached_property
    def omega_G(self) -> sp.csr_array:
        """ΩG."""
        return sp.csr_array(sp.diags_array(self.omega) @ self.G)

    @cached_property
    def short(self) -> Any:
        """diag (D − Ω)⁺, the zero matrix where Ω ≥ D."""
        return sp.diags_array(np.maximum(self.D - self.omega, 0.0))

    @property
    def reads_psi(self) -> bool:
        """Whether a Lipschitz matrix of ψ is known."""
        return self.problem.psi.lipschitz is not None


def off_diagonal(matrix: sp.csr_array) -> sp.csr_array:
    """|`matrix`| with a zero diagonal."""
    result = sp.csr_array(abs(matrix))
    return sp.csr_array(result - sp.diags_array(result.diagonal()))


def _shifted(matrix: sp.csr_array, diagonal: Vector) -> sp.csr_array:
    data = matrix.data.copy()
    data[diagonal_positions(matrix)] += diagonal
    return sp.csr_array((data, matrix.indices, matrix.indptr), shape=matrix.shape)
