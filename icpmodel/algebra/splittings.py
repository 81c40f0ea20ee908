"""Splittings A = M₁ − N₁: the choices of M₁, and the operator X⁻¹ = (M₁ + φ + Ω)⁻¹ of each.

Convention: A = D − L − U with D the diagonal and **−L, −U** the strict triangles of A.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any, Protocol

import scipy.sparse as sp

from ..errors import InputError, check_arguments
from ..numerics.arrays import Vector, as_csr, as_number
from ..numerics.sparse_structure import is_diagonal
from ..present.display import Displayable
from ..problem.data import ProblemData
from .operators import AOROperator, FactorisedOperator, Operator, inverse_diagonal


class Splitting(Displayable, ABC):
    """A choice of M₁ (and so of N₁ = M₁ − A)."""

    @abstractmethod
    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        """M₁, shape (n, n), for `A` of that shape."""

    def operator(self, A: sp.csr_array, shift: Vector) -> Operator:
        """X⁻¹ for X = M₁ + diag(`shift`), by default by an LU factorisation.

        Parameters
        ----------
        A : CSR array of shape (n, n)
            The matrix.
        shift : array of shape (n,)
            φ + Ω.

        Returns
        -------
        Operator
            X⁻¹.

        Raises
        ------
        SingularOperator
            Where X is singular.
        """
        return FactorisedOperator(self.matrix(A) + sp.diags_array(shift))


class Member(Protocol):
    """What theory needs of a method of the modulus family: M₁, φ, Ω, θ₁ if any, and where the modulus is evaluated."""

    @property
    def phi(self) -> Any:
        """The diagonal φ: a number or a vector of shape (n,)."""

    @property
    def theta1(self) -> Any:
        """θ₁, a number or "auto"."""

    @property
    def sees_newest(self) -> bool:
        """Whether the modulus is evaluated at the newest values, row by row, instead of at the last iterate."""

    def splitting_of(self) -> Splitting:
        """The choice of M₁."""

    def omega_of(self, problem: ProblemData) -> Vector:
        """The diagonal of Ω, shape (n,)."""


@check_arguments
@dataclass(frozen=True)
class AOR(Splitting):
    """Accelerated overrelaxation: M₁ = (D − θ₂L)/θ₁.

    (θ, θ) is successive overrelaxation, (1, 1) Gauss–Seidel, (1, 0) Jacobi.

    Parameters
    ----------
    theta1 : float
        θ₁ > 0.
    theta2 : float
        θ₂.

    Raises
    ------
    InputError
        Unless θ₁ is finite and positive and θ₂ is finite.

    References
    ----------
    Hadjidimos, Math. Comp. 32 (1978).

    Examples
    --------
    >>> AOR(2.0, 1.0).matrix(sp.csr_array([[4.0, -1.0], [-2.0, 4.0]])).toarray()
    array([[ 2.,  0.],
           [-1.,  2.]])
    """

    theta1: float
    theta2: float

    def __post_init__(self) -> None:
        as_number(self.theta1, "theta1", above=0)
        as_number(self.theta2, "theta2")

    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        diagonal = sp.csr_array(sp.diags_array(A.diagonal() / self.theta1))
        if self.theta2 == 0:
            return diagonal
        return sp.csr_array(diagonal + sp.tril(A, -1, format="csr") * (self.theta2 / self.theta1))

    def operator(self, A: sp.csr_array, shift: Vector) -> Operator:
        diagonal = A.diagonal() / self.theta1
        return AOROperator(inverse_diagonal(diagonal, shift), A, self.theta2 / self.theta1)


@dataclass(frozen=True)
class FullSplitting(Splitting):
    """M₁ = A, N₁ = 0: one factorisation of A + φ + Ω, reused in every step."""

    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        return A


class UserSplitting(Splitting):
    """A user's own M₁: dense or sparse, shape (n, n). It is factorised unless it is diagonal."""

    def __init__(self, M1: Any) -> None:
        self.M1 = as_csr(M1, "splitting (M1)", keep_diagonal=True)

    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        if self.M1.shape != A.shape:
            raise InputError(f"splitting (M1) has shape {self.M1.shape}; shape {A.shape} was expected")
        return self.M1

    def operator(self, A: sp.csr_array, shift: Vector) -> Operator:
        M1 = self.matrix(A)
        if is_diagonal(M1):
            return AOROperator(inverse_diagonal(M1.diagonal(), shift), A, 0.0)
        return super().operator(A, shift)

    def __repr__(self) -> str:
        return f"UserSplitting(M1 with {self.M1.nnz} entries)"


_NAMED = {"jacobi": AOR(1.0, 0.0), "gauss-seidel": AOR(1.0, 1.0), "whole": FullSplitting()}


def as_splitting(value: Any) -> Splitting:
    """M₁ from the user's argument: a name, a `Splitting`, or a matrix. Raises InputError."""
    if isinstance(value, Splitting):
        return value
    if isinstance(value, str):
        if value not in _NAMED:
            raise InputError(f"splitting is {value!r}; one of {', '.join(_NAMED)}, an AOR or a matrix was expected")
        return _NAMED[value]
    return UserSplitting(value)
