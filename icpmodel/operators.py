"""The operators X⁻¹, X = M₁ + φ + Ω, and the step of the modulus family that each makes possible.

By |x − y| = x + y − 2 min(x, y) every method of the family is the one step

    z⁺ = z − 2 X⁻¹ F_Ω(z),        F_Ω(z) = min(Az + q, Ω(z − ψ(z))),

so a method is nothing but a choice of X and Ω. `Operator.step` is that line; the triangular and diagonal operators fuse
it into one compiled pass over A.
"""

from __future__ import annotations

import warnings
from abc import ABC, abstractmethod
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from .arrays import Vector, diagonal_positions, norm
from .errors import SingularOperator
from .problem import ICP, UNIT_ROUNDOFF
from .steps import Step, compiled_step, rows_of

#: coarsening has stalled where so many rows are left
_STALLED = 500


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
            residual = norm(np.minimum(p, r))
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
    >>> AOROperator(np.array([0.25, 0.25]), A, 1.0).solve(np.array([4.0, 2.0]))
    array([1., 1.])
    """

    inverse: Vector
    A: sp.csr_array
    tau: float

    @cached_property
    def diag(self) -> Any:
        """Where in `A.data` each row's diagonal entry stands, shape (n,).

        >>> AOROperator(np.ones(1), sp.csr_array([[4.0]]), 1.0).diag.tolist()
        [0]
        """
        return diagonal_positions(self.A)

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        from .kernels.sweeps import substitute

        A, out = self.A, np.empty(f.size)
        substitute(A.indptr, self.diag, A.indices, A.data, self.tau, self.inverse, True, f, out)
        return out

    def step(self, problem: ICP, omega: Vector) -> Step:
        """See `Operator.step`."""
        A, rows = problem.A, rows_of(problem)
        matrix = (A.indptr, A.indices, A.data, rows.diag if self.A is A else self.diag, problem.q)
        parameters = (omega, self.inverse, self.tau)
        return compiled_step(problem, "in_order", matrix, (parameters, True), reach=rows.above)


@dataclass(frozen=True)
class TriangularOperator(Operator):
    """X = diag(1/`inverse`) + the strict lower (or upper) triangle of `M1`, whose diagonal stands at `diag`.

    >>> M1 = sp.csr_array([[4.0, -1.0], [0.0, 4.0]])
    >>> TriangularOperator(np.array([0.25, 0.25]), M1, np.array([0, 2]), lower=False).solve(np.array([3.0, 4.0]))
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
        from .kernels.sweeps import substitute

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
        # rows and columns are brought to the size 1, so that units do not look like singularity
        self._row_scale = 1.0 / np.maximum(size, np.finfo(np.float64).tiny)
        scaled = sp.csr_array(sp.diags_array(self._row_scale) @ X)
        size = _row_maxima(sp.csr_array(scaled.T))
        self._column_scale = 1.0 / np.where(size > np.finfo(np.float64).tiny, size, 1.0)
        scaled = sp.csr_array(scaled @ sp.diags_array(self._column_scale))
        self._lu = factorise(scaled)
        if self._lu is not None:
            pivots = np.abs(self._lu.U.diagonal())
            if pivots.min() > 16 * UNIT_ROUNDOFF * pivots.max():
                return
        row = _dependent_row(scaled)
        raise SingularOperator(
            f"X = M1 + phi + Omega is singular to working precision: row {row} is a linear combination of the others; "
            "change phi or phi2",
            row,
        )

    def solve(self, f: Vector) -> Vector:
        """See `Operator.solve`."""
        solution: Vector = self._column_scale * self._lu.solve(self._row_scale * f)
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


def ruge_stuben(A: sp.csr_array, **options: Any) -> Any:
    """PyAMG's algebraic multigrid hierarchy of `A` (CSR, shape (n, n)), with the `options` of its Ruge–Stüben solver.

    A coarsest level that is still large, as coarsening stalled, is left to SuperLU, which raises RuntimeError in the
    first cycle where it is singular: PyAMG's default, a dense pseudoinverse, would take all memory.
    Reference: Ruge and Stüben, Algebraic multigrid (1987).

    >>> len(ruge_stuben(sp.csr_array([[2.0]])).levels)
    1
    """
    import pyamg

    with quiet():
        made = pyamg.ruge_stuben_solver(sp.csr_matrix(A), **options)  # PyAMG takes the older class only
        if made.levels[-1].A.shape[0] > _STALLED:
            made.coarse_solver = pyamg.coarse_grid_solver("splu")
        return made


@contextmanager
def quiet() -> Iterator[None]:
    """What PyAMG warns of, matrices that are nothing for it above all, its callers see by the result.

    >>> with quiet():
    ...     np.ones(1) / np.zeros(1)
    array([inf])
    """
    # recorded, and dropped: PyAMG switches some of its warnings on again while it runs
    with np.errstate(all="ignore"), warnings.catch_warnings(record=True):
        warnings.simplefilter("ignore")
        yield


def inverse_diagonal(diagonal: Vector, shift: Vector) -> Vector:
    """1/(`diagonal` + `shift`), both of shape (n,). Raises SingularOperator where the sum cancels.

    >>> inverse_diagonal(np.array([1.0]), np.array([1.0]))
    array([0.5])
    """
    total = diagonal + shift
    if diagonal.min() > 0.0 and shift.min() >= 0.0:  # nothing cancels
        return np.divide(1.0, total, out=total)
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
    # a start without symmetries, which could be orthogonal to the null vector
    y = lu.solve(lu.solve(np.random.default_rng(0).random(X.shape[0]), trans="T"), trans="T")
    return int(np.argmax(np.abs(y)))
