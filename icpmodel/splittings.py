"""Splittings A = M₁ − N₁ and what a modulus step needs of them: the operator X⁻¹, X = M₁ + φ + Ω.

Convention: A = D − L − U with D the diagonal and **−L, −U** the strict triangles of A.
By |x − y| = x + y − 2 min(x, y) every method of the modulus family is the one step

    z⁺ = z − 2 X⁻¹ F_Ω(z),        F_Ω(z) = min(Az + q, Ω(z − ψ(z))),

so a method is nothing but a choice of X and Ω. `Operator.step` below is that line; the triangular and diagonal
operators fuse it into one compiled pass over A.
"""

from __future__ import annotations

from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from .arrays import Vector, as_csr, diagonal_positions
from .errors import InputError, SingularOperator
from .maps import Affine, Constant, Elementwise, is_compiled
from .problem import ICP, UNIT_ROUNDOFF

#: z ↦ (z⁺, Res(z) or None where it does not fall out of the step)
Step = Callable[[Vector], tuple[Vector, float | None]]


class Splitting(ABC):
    """A choice of M₁ (and so of N₁ = M₁ − A).

    >>> AOR(1.0, 1.0).matrix(sp.csr_array([[4.0, -1.0], [-2.0, 4.0]])).toarray()
    array([[ 4.,  0.],
           [-2.,  4.]])
    """

    @abstractmethod
    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        """M₁, shape (n, n), for `A` of that shape.

        >>> Whole().matrix(sp.csr_array([[4.0]])).toarray()
        array([[4.]])
        """

    @abstractmethod
    def operator(self, A: sp.csr_array, shift: Vector) -> Operator:
        """X⁻¹ for X = M₁ + diag(`shift`), `shift` = φ + Ω of shape (n,). Raises SingularOperator.

        >>> float(Whole().operator(sp.csr_array([[4.0]]), np.ones(1)).solve(np.array([10.0]))[0])
        2.0
        """


@dataclass(frozen=True)
class AOR(Splitting):
    """Accelerated overrelaxation: M₁ = (D − θ₂L)/θ₁.

    (θ, θ) is successive overrelaxation, (1, 1) Gauss–Seidel, (1, 0) Jacobi.
    Raises InputError unless θ₁ is finite and not 0 and θ₂ is finite.
    Reference: Hadjidimos, Math. Comp. 32 (1978).

    >>> AOR(2.0, 1.0).matrix(sp.csr_array([[4.0, -1.0], [-2.0, 4.0]])).toarray()
    array([[ 2.,  0.],
           [-1.,  2.]])
    """

    theta1: float
    theta2: float

    def __post_init__(self) -> None:
        for name in ("theta1", "theta2"):
            value = getattr(self, name)
            if not isinstance(value, (int, float)) or not np.isfinite(value):
                raise InputError(f"{name} is {value!r}; a finite number was expected")
        if self.theta1 == 0:
            raise InputError("theta1 is 0; M1 = (D - theta2 L)/theta1 needs another number")

    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        """See `Splitting.matrix`."""
        lower = sp.tril(A, -1, format="csr") * (self.theta2 / self.theta1)
        return sp.csr_array(sp.diags_array(A.diagonal() / self.theta1) + lower)

    def operator(self, A: sp.csr_array, shift: Vector) -> Operator:
        """See `Splitting.operator`."""
        diagonal = A.diagonal() / self.theta1
        inverse = _inverse_diagonal(diagonal, shift)
        if self.theta2 == 0:
            return DiagonalOperator(inverse)
        return AOROperator(inverse, A, self.theta2 / self.theta1)


@dataclass(frozen=True)
class Whole(Splitting):
    """M₁ = A, N₁ = 0: one factorisation of A + φ + Ω, reused in every step.

    >>> Whole().matrix(sp.csr_array([[4.0]])).toarray()
    array([[4.]])
    """

    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        """See `Splitting.matrix`."""
        return A

    def operator(self, A: sp.csr_array, shift: Vector) -> Operator:
        """See `Splitting.operator`."""
        return FactorisedOperator(A + sp.diags_array(shift))


class Given(Splitting):
    """A user's own M₁: dense or sparse, shape (n, n). Diagonal and triangular ones run in compiled sweeps.

    >>> Given([[4.0]]).matrix(sp.csr_array([[1.0]])).toarray()
    array([[4.]])
    """

    def __init__(self, M1: Any) -> None:
        self.M1 = as_csr(M1, "splitting (M1)", keep_diagonal=True)

    def matrix(self, A: sp.csr_array) -> sp.csr_array:
        """See `Splitting.matrix`."""
        if self.M1.shape != A.shape:
            raise InputError(f"splitting (M1) has shape {self.M1.shape}; shape {A.shape} was expected")
        return self.M1

    def operator(self, A: sp.csr_array, shift: Vector) -> Operator:
        """See `Splitting.operator`."""
        M1 = self.matrix(A)
        diag = diagonal_positions(M1)
        lower = bool((diag == M1.indptr[1:] - 1).all())
        upper = bool((diag == M1.indptr[:-1]).all())
        if not (lower or upper):
            return FactorisedOperator(M1 + sp.diags_array(shift))
        inverse = _inverse_diagonal(M1.data[diag], shift)
        if lower and upper:
            return DiagonalOperator(inverse)
        return TriangularOperator(inverse, M1, diag, lower)

    def __repr__(self) -> str:
        return f"Given(M1 with {self.M1.nnz} entries)"


class Operator(ABC):
    """X⁻¹ of a splitting.

    >>> DiagonalOperator(np.array([0.5])).solve(np.array([4.0]))
    array([2.])
    """

    @abstractmethod
    def solve(self, f: Vector) -> Vector:
        """X⁻¹f, shape (n,).

        >>> DiagonalOperator(np.array([0.5])).solve(np.array([4.0]))
        array([2.])
        """

    def step(self, problem: ICP, omega: Vector) -> Step:
        """The modulus step z ↦ (z − 2 X⁻¹ F_Ω(z), Res(z)) on `problem` with Ω = diag(`omega`).

        >>> step = DiagonalOperator(np.array([0.25])).step(ICP([[2.0]], [-2.0]), np.array([2.0]))
        >>> step(np.array([3.0]))
        (array([1.]), 3.0)
        """

        def step(z: Vector) -> tuple[Vector, float]:
            p, r = problem.A @ z + problem.q, z - problem.psi.value(z)
            residual = float(np.linalg.norm(np.minimum(p, r)))
            return z - 2.0 * self.solve(np.minimum(p, omega * r)), residual

        return step


@dataclass(frozen=True)
class DiagonalOperator(Operator):
    """X = diag(1/`inverse`), `inverse` of shape (n,).

    >>> DiagonalOperator(np.array([0.5])).solve(np.array([4.0]))
    array([2.])
    """

    inverse: Vector

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        return self.inverse * f

    def step(self, problem: ICP, omega: Vector) -> Step:
        """See `Operator.step`."""
        A = problem.A
        return compiled_step(problem, "diagonal", (A.indptr, A.indices, A.data, problem.q), (omega, self.inverse))


@dataclass(frozen=True)
class AOROperator(Operator):
    """X = diag(1/`inverse`) + `tau` times the strict lower triangle of `A`.

    >>> A = sp.csr_array([[4.0, -1.0], [-2.0, 4.0]])
    >>> AOR(1.0, 1.0).operator(A, np.zeros(2)).solve(np.array([4.0, 2.0]))
    array([1., 1.])
    """

    inverse: Vector
    A: sp.csr_array
    tau: float

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        from .kernels import substitute

        A, out = self.A, np.empty(f.size)
        diag = diagonal_positions(A)
        substitute(A.indptr, diag, A.indices, A.data, self.tau, self.inverse, True, f, out)
        return out

    def step(self, problem: ICP, omega: Vector) -> Step:
        """See `Operator.step`."""
        A = problem.A
        matrix = (A.indptr, A.indices, A.data, diagonal_positions(A), problem.q)
        return compiled_step(problem, "aor", matrix, (omega, self.inverse, self.tau))


@dataclass(frozen=True)
class TriangularOperator(Operator):
    """X = diag(1/`inverse`) + the strict lower (or upper) triangle of `M1`, whose diagonal stands at `diag`.

    >>> M1 = sp.csr_array([[4.0, -1.0], [0.0, 4.0]])
    >>> Given(M1).operator(M1, np.zeros(2)).solve(np.array([3.0, 4.0]))
    array([1., 1.])
    """

    inverse: Vector
    M1: sp.csr_array
    diag: Any
    lower: bool

    @property
    def _rows(self) -> tuple[Any, Any]:
        """Where each row's strictly triangular entries begin and end."""
        return (self.M1.indptr[:-1], self.diag) if self.lower else (self.diag + 1, self.M1.indptr[1:])

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        from .kernels import substitute

        out = np.empty(f.size)
        substitute(*self._rows, self.M1.indices, self.M1.data, 1.0, self.inverse, self.lower, f, out)
        return out

    def step(self, problem: ICP, omega: Vector) -> Step:
        """See `Operator.step`."""
        A, M1 = problem.A, self.M1
        X = (*self._rows, M1.indices, M1.data, self.inverse, self.lower)
        return compiled_step(problem, "triangular", (A.indptr, A.indices, A.data, problem.q), (omega, *X))


class FactorisedOperator(Operator):
    """X⁻¹ by a sparse LU factorisation of the CSR matrix `X`, made once.

    Raises SingularOperator where X is singular to working precision.

    >>> FactorisedOperator(sp.csr_array([[2.0, 1.0], [1.0, 2.0]])).solve(np.array([3.0, 3.0]))
    array([1., 1.])
    """

    def __init__(self, X: sp.csr_array) -> None:
        X = sp.csr_array(X)
        size = _row_maxima(X)
        if not size.all():
            row = int(np.argmin(size))
            raise SingularOperator(f"X = M1 + phi + Omega is singular: row {row} is zero", row)
        self._scale = 1.0 / size
        scaled = sp.csr_array(sp.diags_array(self._scale) @ X)
        self._lu = factorise(scaled)
        if self._lu is not None:
            pivots = np.abs(self._lu.U.diagonal())
            if pivots.min() > X.shape[0] * UNIT_ROUNDOFF * pivots.max():
                return
        row = _dependent_row(scaled)
        raise SingularOperator(
            f"X = M1 + phi + Omega is singular to working precision: row {row} is a linear combination of the others; "
            "change phi or phi2",
            row,
        )

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        solution: Vector = self._lu.solve(self._scale * f)
        return solution


def factorise(matrix: sp.csr_array) -> Any:
    """SuperLU of a sparse matrix (n × n), ordered for its pattern; None where a pivot is exactly zero.

    >>> factorise(sp.csr_array([[0.0]])) is None
    True
    """
    from scipy.sparse.linalg import splu

    columns = sp.csc_array(matrix)
    pattern = sp.csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)
    symmetric = (pattern != pattern.T).nnz == 0
    # threshold pivoting keeps the fill of the symmetric ordering where the diagonal is not small
    options: dict[str, Any] = (
        {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.1} if symmetric else {"permc_spec": "COLAMD"}
    )
    try:
        return splu(columns, **options)
    except RuntimeError as error:
        if "singular" not in str(error):
            raise
        return None


def compiled_step(problem: ICP, name: str, before: tuple[Any, ...], after: tuple[Any, ...]) -> Step:
    """One compiled sweep as a step: `before` and `after` are the kernel's arguments around ψ.

    ψ = constant, affine and compiled elementwise maps are evaluated inside the sweep; any other is called once for it.

    >>> problem = ICP([[2.0]], [-2.0])
    >>> matrix = (problem.A.indptr, problem.A.indices, problem.A.data, problem.q)
    >>> compiled_step(problem, "diagonal", matrix, (np.array([2.0]), np.array([0.25])))(np.array([3.0]))
    (array([1.]), 3.0)
    """
    from .kernels import SWEEPS, USER_SWEEPS

    psi = problem.psi
    inside: Any = None
    if isinstance(psi, Constant):
        inside = psi.c
    elif isinstance(psi, Affine):
        inside = (psi.c, psi.G.indptr, psi.G.indices, psi.G.data)
    elif isinstance(psi, Elementwise) and is_compiled(psi.f):
        inside = (psi.c, psi.f)
    sweep = getattr(USER_SWEEPS if isinstance(psi, Elementwise) and inside is not None else SWEEPS, name)

    def step(z: Vector) -> tuple[Vector, float]:
        out = np.empty(z.size)
        squares = sweep(*before, psi.value(z) if inside is None else inside, *after, z, out)
        return out, float(np.sqrt(squares))

    return step


def _inverse_diagonal(diagonal: Vector, shift: Vector) -> Vector:
    """1/(diagonal + shift), or SingularOperator where the sum cancels."""
    total = diagonal + shift
    bad = np.abs(total) <= 4 * UNIT_ROUNDOFF * (np.abs(diagonal) + np.abs(shift))
    if bad.any():
        row = int(np.argmax(bad))
        raise SingularOperator(
            f"X = M1 + phi + Omega is singular: its diagonal entry in row {row} is {total[row]:g} "
            f"({diagonal[row]:g} from M1, {shift[row]:g} from phi + Omega); change phi or phi2",
            row,
        )
    inverse: Vector = 1.0 / total
    return inverse


def _row_maxima(X: sp.csr_array) -> Vector:
    return np.asarray(abs(X).max(axis=1).toarray(), dtype=np.float64).reshape(-1)


def _dependent_row(X: sp.csr_array) -> int:
    """The largest entry of a left null vector of X, by two steps of inverse iteration on a slightly shifted X."""
    lu = factorise(sp.csr_array(X + 1e-10 * sp.eye_array(X.shape[0])))
    if lu is None:
        return 0
    y = lu.solve(lu.solve(np.ones(X.shape[0]), trans="T"), trans="T")
    return int(np.argmax(np.abs(y)))
