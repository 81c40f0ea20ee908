"""Factorisations of sparse matrices at a predicted cost, by LAPACK, QDLDL or SuperLU.

LAPACK takes bands and what fills up, QDLDL symmetric matrices, SuperLU the others.
"""

from __future__ import annotations

from collections.abc import Callable
from contextlib import nullcontext
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from . import work
from .arrays import Vector, row_of
from .fill import Fill, SymbolicAnalysis, dense_cost, factor_cost, least_factor_cost, signs_of_symmetry, solve_cost
from .half_solves import half_solve, inner_products
from .rounding import SQRT_EPSILON
from .symmetric_factors import SymmetricFactors
from .threads import one_blas_thread, run_with_deadline

#: rows are exchanged where a pivot is smaller than this share of the largest entry of its column: √ε, so that a pivot
#: costs at most half of the digits, which a step of refinement restores. The predicted fill has no exchanges: with .01
#: price equilibria fill up 58 times as much, control problems three times; with √ε neither does. The backward error was
#: at most 2e-12, and 2e-16 after refinement, on all that were tried
_PIVOT_THRESHOLD = SQRT_EPSILON
#: entries of at least this share of the largest one of their column are good pivots
_GOOD_PIVOT_SHARE = 0.1
#: the number of diagonals on one side up to which LAPACK's factorisation of a band uses no blocks
_UNBLOCKED_BAND = 32
#: bytes per predicted entry of the factors, doubled for exchanges of rows, which are not predicted
FACTOR_BYTES = 2 * work.ENTRY_BYTES


class Factors:
    """SuperLU's L and U of A with its rows and columns in another order, and solves with them.

    Parameters
    ----------
    lu : SuperLU
        The factors.
    rows, columns : array of shape (n,)
        The orders: SuperLU factorised A[rows][:, columns].
    """

    def __init__(self, lu: Any, rows: NDArray[Any], columns: NDArray[Any]) -> None:
        self.lu = lu
        self._orders = rows, columns

    @property
    def pivots(self) -> Vector:
        """The diagonal of U."""
        pivots: Vector = self.lu.U.diagonal()
        return pivots

    def solve(self, f: Vector, trans: str = "N") -> Vector:
        """A⁻¹f, or A⁻ᵀf with `trans` = "T"; `f` of shape (n,) or (n, k)."""
        columns = f.size / f.shape[0]
        work.count(columns * solve_cost(Fill(f.shape[0], self.lu.nnz, 0.0, True)))
        before, after = self._orders if trans == "N" else self._orders[::-1]
        f = np.asarray(f, dtype=np.float64)
        x = np.empty(f.shape)
        x[after] = self.lu.solve(f[before], trans)
        return x

    def product(self, B: sp.csr_array, C: sp.csr_array) -> NDArray[np.float64]:
        """BA⁻¹C, shape (k, k), for `B` of shape (k, n) and `C` of shape (n, k); raises OutOfTime and OutOfMemory."""
        work.check_budget(memory=3.0 * work.ENTRY_BYTES * self.lu.nnz)
        work.charge_matrices(self.lu.nnz, 2)
        rows, columns = (
            perm[np.argsort(order)] for perm, order in zip((self.lu.perm_r, self.lu.perm_c), self._orders, strict=True)
        )
        U = self.lu.U
        pivots = U.diagonal()
        upper = sp.tril((sp.diags_array(1.0 / pivots) @ U).T, -1, format="csc")
        left = half_solve(upper, columns, sp.coo_array(B.T))
        right = half_solve(sp.tril(self.lu.L, -1, format="csc"), rows, sp.coo_array(C))
        return inner_products(left, right, pivots)

    def in_order(self, y: Vector) -> Vector:
        """The entries of `y`, which are in the order of the columns of U, in that of the columns of A; shape (n,)."""
        x = np.empty(y.shape)
        x[self._orders[1]] = y[self.lu.perm_c]
        return x


class DenseFactors:
    """L and U, or Cholesky's factor, of a dense matrix or a band by LAPACK.

    Parameters
    ----------
    solve : callable
        (f, whether transposed) ↦ (x, …), from LAPACK.
    pivots : array of shape (n,)
        The diagonal of U.
    entries : int
        How many entries are stored.
    """

    def __init__(self, solve: Callable[[Vector, bool], Any], pivots: Vector, entries: int) -> None:
        self.pivots = pivots
        self._solve = solve
        self._cost = work.COSTS.call + work.COSTS.solve_entry * entries

    def solve(self, f: Vector, trans: str = "N") -> Vector:
        """A⁻¹f, or A⁻ᵀf with `trans` = "T"; `f` of shape (n,) or (n, k)."""
        work.count(f.size / f.shape[0] * self._cost)
        return np.asarray(self._solve(f, trans == "T")[0])


def factorise(
    matrix: sp.csr_array, *, definite: bool = False, triangles: bool = False, analysis: SymbolicAnalysis | None = None
) -> Any:
    """Factors of a sparse matrix (n × n) in the cheapest form, or None where it is singular or not finite.

    Parameters
    ----------
    matrix : CSR array of shape (n, n)
        The matrix.
    definite : bool, default False
        Whether it is expected to be definite, symmetric or not. Then the result is None also where
        a matrix that is symmetric, up to the signs of its rows, proves not to be definite, and
        where SuperLU exchanged rows. It may be `SymmetricFactors`, which solves for f of shape (n,) alone.
    triangles : bool, default False
        Whether L and U by SuperLU are needed.
    analysis : SymbolicAnalysis, optional
        Symbolic analysis of the matrix, where there is one.

    Returns
    -------
    Factors, DenseFactors, SymmetricFactors or None
        The factors.

    Raises
    ------
    OutOfMemory
        Before a factorisation that does not fit into the free memory.
    OutOfTime
        Where it takes more time than is left.

    References
    ----------
    Li, ACM TOMS 31 (2005), for SuperLU and its mode for pivots near the diagonal.
    """
    if not np.isfinite(matrix.data).all():
        return None
    analysis = analysis or SymbolicAnalysis(matrix)
    if not triangles and analysis.is_dense:
        return dense_factors(matrix, definite and analysis.is_symmetric)
    if not triangles and analysis.is_band:
        return _band_factors(matrix, analysis, definite)
    if triangles or not definite:
        return _by_superlu(matrix, analysis, definite)
    signs = analysis.signs if analysis.matrix is matrix else signs_of_symmetry(matrix)
    if signs is None or not (fill := _fill_of(analysis, symmetric=True)).symmetric:
        return _by_superlu(matrix, analysis, definite)
    factors = SymmetricFactors(matrix, fill, signs).factors(matrix.data)
    return factors if factors is not None and factors.pivots.min() > 0.0 else None


def dense_factors(matrix: sp.csr_array, cholesky: bool = False) -> DenseFactors | None:
    """Dense factors of a sparse matrix, or None, as `array_factors`; raises OutOfTime and OutOfMemory."""
    n = matrix.shape[0]
    work.check_budget(dense_cost(n, cholesky), 16.0 * n**2)
    return array_factors(np.asfortranarray(matrix.toarray()), cholesky)  # toarray(order="F") goes by CSC


def array_factors(M: NDArray[np.float64], cholesky: bool = False) -> DenseFactors | None:
    """Dense factors of `M`, an array in Fortran order, which is overwritten. Raises OutOfTime.

    Returns None where M is singular or, with `cholesky`, which takes M for symmetric, not definite.
    """
    # lu_factor warns of a zero pivot, and takes longer than LAPACK does on a small matrix
    from scipy.linalg.lapack import dgetrf, dgetrs, dpotrf, dpotrs

    work.charge(dense_cost(M.shape[0], cholesky))
    with one_blas_thread():
        if cholesky:
            factors, failed = dpotrf(M, lower=1, overwrite_a=1)
        else:
            factors, rows, failed = dgetrf(M, overwrite_a=1)
    pivots = factors.diagonal()
    if failed or not np.isfinite(pivots).all():
        return None
    if cholesky:
        return DenseFactors(lambda f, transposed: dpotrs(factors, f, lower=1), pivots**2, M.size)
    return DenseFactors(lambda f, transposed: dgetrs(factors, rows, f, trans=int(transposed)), pivots, M.size)


def _band_factors(matrix: sp.csr_array, analysis: SymbolicAnalysis, definite: bool) -> DenseFactors | None:
    from scipy.linalg.lapack import dgbtrf, dgbtrs, dpbtrf, dpbtrs

    from .kernels.graph import fill_band

    n = matrix.shape[0]
    below, above = analysis.reach
    arrays = (matrix.indptr, matrix.indices, matrix.data)
    work.charge(factor_cost(analysis.band), 8.0 * analysis.band.entries)
    # on narrow bands LAPACK calls no BLAS that would use threads
    with one_blas_thread() if max(below, above) > _UNBLOCKED_BAND else nullcontext():
        if below == above and analysis.is_symmetric:
            half = np.zeros((n, below + 1))
            fill_band(*arrays, 0, half)
            factor, failed = dpbtrf(half.T, lower=1, overwrite_ab=1)
            if not failed and np.isfinite(factor[0]).all():
                return DenseFactors(lambda f, transposed: dpbtrs(factor, f, lower=1), factor[0] ** 2, half.size)
            if definite:
                return None
        band = np.zeros((n, 2 * below + above + 1))
        fill_band(*arrays, below + above, band)
        factors, rows, failed = dgbtrf(band.T, below, above, overwrite_ab=1)
    pivots = factors[below + above]
    if failed or not np.isfinite(pivots).all():
        return None
    return DenseFactors(
        lambda f, transposed: dgbtrs(factors, below, above, f, rows, trans=int(transposed)), pivots, band.size
    )


def _by_superlu(matrix: sp.csr_array, analysis: SymbolicAnalysis, diagonal_pivots: bool) -> Factors | None:
    n = matrix.shape[0]
    work.check_budget(least_factor_cost(n, matrix.nnz, symmetric=False))
    rows = None
    if np.count_nonzero(matrix.diagonal()) < n:
        rows = None if diagonal_pivots else _onto_diagonal(matrix)
        if rows is None:
            return None
        matrix = sp.csr_array(matrix[rows])
        analysis = SymbolicAnalysis(matrix)
    fill = _fill_of(analysis)
    order = analysis.order
    lu = _superlu(sp.csr_array(matrix[order][:, order]), fill, diagonal_pivots)
    return None if lu is None else Factors(lu, order if rows is None else rows[order], order)


def _superlu(matrix: sp.csr_array, fill: Fill, diagonal_pivots: bool) -> Any:
    from scipy.sparse.linalg import splu

    n = matrix.shape[0]
    work.check_budget(factor_cost(fill))
    by_superlu = partial(
        splu,
        sp.csc_array(matrix),
        permc_spec="NATURAL",
        diag_pivot_thresh=0.0 if diagonal_pivots else _PIVOT_THRESHOLD,
        options={"SymmetricMode": True},
    )
    try:
        # exchanges of rows can fill the whole matrix
        lu = run_with_deadline(by_superlu, factor_cost(Fill(n, n**2, n**3 / 3.0, True)))
    except RuntimeError:
        # the predicted time, or twice that, where few pivots are 0; 80 times where many are, which `linear` avoids
        work.count(2.0 * factor_cost(fill))
        return None
    # exchanges of rows take more multiplications than predicted
    flops = fill.flops * max(lu.nnz / fill.entries, 1.0) ** 1.5
    work.count(factor_cost(Fill(n, lu.nnz, flops, True)))
    return None if diagonal_pivots and not np.array_equal(lu.perm_r, lu.perm_c) else lu


def _fill_of(analysis: SymbolicAnalysis, symmetric: bool = False) -> Fill:
    """The fill of matrices with the pattern of the `analysis`; raises OutOfTime and OutOfMemory as `factorise`."""
    work.check_budget(factor_cost(analysis.fill))
    fill = analysis.complete
    work.check_budget(memory=FACTOR_BYTES * fill.entries)
    return fill._replace(symmetric=symmetric and fill.symmetric)


def _onto_diagonal(matrix: sp.csr_array) -> NDArray[np.int32] | None:
    """An order of the rows with nonzero entries on the diagonal, large ones if possible.

    None where the matrix is structurally singular, which SuperLU must not be given.
    """
    from scipy.sparse.csgraph import maximum_bipartite_matching

    size = np.abs(matrix.data)
    largest = largest_of_columns(matrix)
    large = np.maximum(_GOOD_PIVOT_SHARE * largest[matrix.indices], np.finfo(np.float64).tiny)
    for chosen in (size >= large, size > 0.0):
        candidates = sp.csr_array((size[chosen], (row_of(matrix)[chosen], matrix.indices[chosen])), shape=matrix.shape)
        rows = maximum_bipartite_matching(candidates, perm_type="row")
        if (rows >= 0).all():
            return np.asarray(rows, dtype=np.int32)
    return None


def largest_of_columns(matrix: sp.csr_array) -> Vector:
    """The largest |entry| of each column, shape (n,)."""
    largest = np.zeros(matrix.shape[1])
    np.maximum.at(largest, matrix.indices, np.abs(matrix.data))
    return largest
