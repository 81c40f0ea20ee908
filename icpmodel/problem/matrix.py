"""The matrix A of a problem, and the facts about A alone, each computed once."""

from __future__ import annotations

import math
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..numerics import work
from ..numerics.arrays import ReadOnly, Vector, as_csr, as_square, freeze, locked, with_entries
from ..numerics.equilibration import balanced, in_units, row_exponents
from ..numerics.krylov import couplings
from ..numerics.sparse_input import checked_sparse
from ..numerics.sparse_structure import ROUNDING_RTOL, absolute, is_symmetric
from ..numerics.threads import THREADS_FROM, run_in_threads, threads_for

#: the largest number of rows of a dense A that stays dense until its sparse form is needed
MAX_DENSE_ROWS = 64
#: the least d_i that is inverted, the least normal float; and the d_i of a row without entries, its square root
MIN_DIAGONAL = float(np.finfo(np.float64).tiny)
EMPTY_ROW_SIZE = math.sqrt(MIN_DIAGONAL)


class Rows(NamedTuple):
    """Statistics of the rows of A for the sweeps and for the choice of a method.

    Attributes
    ----------
    diag : array of int, shape (n,)
        The place of each diagonal entry in A.data.
    diagonal : array of shape (n,)
        a_ii.
    off_diagonal_sums : array of shape (n,)
        Σ_{j≠i}|a_ij|.
    largest : array of shape (n,)
        max_j |a_ij|.
    below, above : int
        Lower and upper bandwidth.
    lower, upper : float
        Sums of all |a_ij| below and above the diagonal.
    """

    diag: Any
    diagonal: Vector
    off_diagonal_sums: Vector
    largest: Vector
    below: int
    above: int
    lower: float
    upper: float


def weights_of(largest: Vector) -> Vector:
    """The weights 1/d_i of rows with these `largest` |entries|, shape (n,), read-only: see `Matrix.row_weights`."""
    if largest.size and largest.min() < EMPTY_ROW_SIZE:
        largest = np.where(largest > 0.0, np.maximum(largest, MIN_DIAGONAL), EMPTY_ROW_SIZE)
    weights: Vector = 1.0 / largest
    weights.flags.writeable = False
    return weights


class Matrix(ReadOnly):
    """A as float64, every diagonal entry stored, and the facts about it.

    Parameters
    ----------
    A : array_like or sparse matrix of shape (n, n)
        The matrix.
    index : pandas.Index, optional
        The names of the rows.

    Raises
    ------
    InputError
        Where `A` is no square matrix of finite numbers.

    Notes
    -----
    A matrix with at most 64 rows is stored as `dense`, in whichever form it was given, so that the
    results do not depend on the form. Then `sparse` is made on request.
    """

    #: the names of the rows, None where they are numbers
    index: Any = None
    #: a matrix that differs in its diagonal alone, None where none is known
    origin: Matrix | None = None

    def __init__(self, A: Any, index: Any = None) -> None:
        if index is not None and not hasattr(index, "step"):  # a range is no name
            self.index = index
        if sp.issparse(A) and max(A.shape) <= MAX_DENSE_ROWS:
            A = checked_sparse(A, "A").toarray()
        square: Any = A if sp.issparse(A) else as_square(A, "A")
        self.dense = None if sp.issparse(square) or square.shape[0] > MAX_DENSE_ROWS else square
        if self.dense is None:
            self.sparse = as_csr(square, "A", keep_diagonal=True)
        self.lock()
        self._measure(self.sparse if self.dense is None else self.dense)

    @classmethod
    def of_checked(cls, A: sp.csr_array, row_weights: Vector | None = None, dense: Any = None) -> Matrix:
        """The matrix of a valid CSR array `A`, which is made read-only, but neither checked nor copied.

        Parameters
        ----------
        A : CSR array of shape (n, n)
            In the form that the constructor makes.
        row_weights : array of shape (n,), optional
            The diagonal of D⁻¹, where more than A determines it: columns that were removed, or an f.
        dense : array of shape (n, n), optional
            A as a dense array.
        """
        new = object.__new__(cls)
        new.dense = dense
        new.sparse = freeze(A)
        if row_weights is not None:
            new.row_weights = locked(row_weights)
        new._measure(A)
        return new

    def plus_diagonal(self, d: Vector, row_weights: Vector | None = None) -> Matrix:
        """A + diag(d), whose `origin` is A, or that of A.

        Parameters
        ----------
        d : array of shape (n,)
            The diagonal.
        row_weights : array of shape (n,), optional
            The diagonal of D⁻¹, where more than A + diag(d) determines it.

        Examples
        --------
        >>> Matrix([[1.0, 2.0], [3.0, 4.0]]).plus_diagonal(np.ones(2)).sparse.toarray()
        array([[2., 2.],
               [3., 5.]])
        """
        A = self.sparse
        data = A.data.copy()
        data[self.rows.diag] += d
        new = Matrix.of_checked(with_entries(A, data), row_weights)
        new.origin = self.origin or self
        new.index = self.index
        return new

    def _measure(self, A: Any) -> None:
        self.n: int = A.shape[0]
        #: the cost of a product with A in nanoseconds: the unit of all estimates
        self.product_cost = work.product_cost(self.n, A.size)

    @cached_property
    def sparse(self) -> sp.csr_array:
        """A, CSR, read-only."""
        return as_csr(self.dense, "A", keep_diagonal=True)

    @cached_property
    def nnz(self) -> int:
        """The number of stored entries of A; of nonzero entries where A is small and dense."""
        return self.sparse.nnz if self.dense is None else int(np.count_nonzero(self.dense))

    def product(self, z: Vector) -> Vector:
        """Az, on all cores where A is large."""
        work.count(self.product_cost)
        if self.dense is not None:
            image: Vector = self.dense @ z
            return image
        if self.nnz < min(THREADS_FROM, self.n**2):  # not by the number of cores: the sums would differ
            return np.asarray(self.sparse @ z)
        from ..numerics.kernels.products import product  # loads numba

        return self._row_by_row(product, z)

    def magnitude(self, z: Vector) -> Vector:
        """|A||z|, on all cores where A is large, and then without a copy of |A|."""
        if self.dense is not None or self.nnz < THREADS_FROM:
            return np.asarray(self.absolute @ np.abs(z))
        from ..numerics.kernels.products import magnitude  # loads numba

        return self._row_by_row(magnitude, z)

    def _row_by_row(self, rows: Any, z: Vector) -> Vector:
        A = self.sparse
        image = np.empty(self.n)
        z = np.ascontiguousarray(z)
        arrays = A.indptr, A.indices, A.data, z
        run_in_threads(self.n, threads_for(self.nnz), lambda low, high: rows(*arrays, low, high, image))
        return image

    @cached_property
    def absolute(self) -> sp.csr_array:
        """|A|, entry by entry; it shares the index arrays of A."""
        return absolute(self.sparse)

    @cached_property
    def rows(self) -> Rows:
        """The statistics of the rows, by one pass over A."""
        from ..numerics.kernels.products import row_statistics  # loads numba

        A = self.sparse
        n = self.n
        work.count(self.product_cost)
        arrays = np.empty(n, A.indptr.dtype), np.empty(n), np.empty(n), np.empty(n)
        matrix = (A.indptr, A.indices, A.data)
        reach = run_in_threads(n, threads_for(self.nnz), lambda low, high: row_statistics(*matrix, low, high, *arrays))
        locked(arrays)
        below, above, lower, upper = zip(*reach, strict=True)
        return Rows(*arrays, max(below), max(above), sum(lower), sum(upper))

    @cached_property
    def largest_beside(self) -> Vector:
        """max_{j≠i} |a_ij|, shape (n,)."""
        A = self.sparse
        sizes = np.abs(A.data)
        sizes[self.rows.diag] = 0.0
        largest: Vector = np.maximum.reduceat(sizes, A.indptr[:-1])
        return largest

    @cached_property
    def row_weights(self) -> Vector:
        """The diagonal of D⁻¹, d_i = max_j |a_ij|, which gives p the units of z: see `ProblemData.residual`.

        A row without entries demands q_i ≥ 0, whatever z is. Its d_i counts as nearly 0, 2⁻⁵¹¹, so that all
        units of p and z give the same result. Near underflow d_i counts as at least 2⁻¹⁰²².
        """
        return weights_of(self.rows.largest if self.dense is None else np.abs(self.dense).max(1))

    @property
    def empty_rows(self) -> Any:
        """Which rows have no entries, a mask of shape (n,)."""
        return self.row_weights == 1.0 / EMPTY_ROW_SIZE

    @cached_property
    def has_positive_diagonal(self) -> bool:
        """Whether D > 0."""
        return bool((self.rows.diagonal > 0).all())

    @cached_property
    def has_negative_diagonal(self) -> bool:
        """Whether a_ii < 0 for an i, so that A is not monotone."""
        return bool((self.rows.diagonal < 0.0).any())

    @cached_property
    def is_symmetric(self) -> bool:
        """Whether A = Aᵀ, to the last digit."""
        return is_symmetric(self.sparse) if self.origin is None else self.origin.is_symmetric

    @cached_property
    def is_nearly_symmetric(self) -> bool:
        """Whether Au = Aᵀu, up to rounding and in the units of the diagonal, for a u without pattern."""
        with np.errstate(over="ignore", invalid="ignore"):
            root = np.sqrt(self.weights)
            u = np.cos(np.arange(self.n) ** 2.0) / root
            image = self.product(u)
            difference = np.abs((image - self.sparse.T @ u) / root).max()
            return bool(difference <= ROUNDING_RTOL * np.abs(image / root).max())

    @cached_property
    def coupled_radius(self) -> float:
        """The mean row sum of `couplings`: a Rayleigh quotient for their spectral radius, the same in all units."""
        with np.errstate(over="ignore", invalid="ignore", divide="ignore"):
            mean = float(couplings(self.sparse).data.sum()) / self.n
        return mean if mean < np.inf else np.inf

    @cached_property
    def proximal_weights(self) -> Vector:
        """The diagonal of W, with p/W in the units of z and the entries of A of about the size of W.

        It is `weights` where A is nearly symmetric and no a_ii < 0, else `balanced`. Rows are first scaled to entries
        of about 1, and W is then in the units of the rows of A.
        """
        if self.is_nearly_symmetric and not self.has_negative_diagonal:
            return self.weights
        units = row_exponents(self.sparse)
        return np.ldexp(balanced(in_units(self.sparse, units)), -units)

    @cached_property
    def weights(self) -> Vector:
        """Ω with p/Ω in the units of z: |a_ii|, the largest |a_ij| of the row where that is 0, 1 in a zero row."""
        diagonal: Vector = np.abs(self.sparse.diagonal())
        if diagonal.all():
            return diagonal
        largest = np.asarray(self.absolute.max(axis=1).toarray()).reshape(-1)
        return np.where(diagonal > 0, diagonal, np.where(largest > 0, largest, 1.0))
