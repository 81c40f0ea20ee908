"""Equilibration: rows and columns scaled by powers of two, which lose no digit, so that units decide nothing.

All functions but `balanced` use whole exponents, which `in_units` applies. Dense matrices that
are pivoted have `algebra.kernels.balancing`.
References: Curtis and Reid, J. Inst. Math. Appl. 10 (1972); Higham, Accuracy and Stability (2002), section 7.3.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from . import work
from .arrays import Vector, read_only, row_of, with_entries

Exponents = NDArray[np.int64]

#: entries within a factor 2^± this of the diagonal need no balancing
_BALANCED_RANGE = 30
#: steps of CG for least squares: a solution this far from the optimum still brings every entry into range
_MAX_STEPS = 60
#: below the exponent of every float
_ZERO_EXPONENT = np.iinfo(np.int32).min
#: the most passes, each of which moves the weights half the way to balanced rows (2^200 takes all of them); the largest
#: root of a weight; and the largest relative move of a root that ends the passes: of .03, .1 and .3, .1 took the fewest
#: proximal steps
_MAX_PASSES = 100
_MAX_WEIGHT = math.sqrt(math.sqrt(np.finfo(np.float64).max))
_SETTLED_SHARE = 0.1


def row_exponents(X: Any, columns: Any = 0) -> Exponents:
    """Whole e with 1/2 ≤ max_j 2^(e_i + c_j)|x_ij| < 1, c = `columns`, for dense or CSR `X`; 0 in zero rows."""
    if sp.issparse(X):
        shift = columns[X.indices] if np.ndim(columns) else columns
        size = np.where(X.data != 0, np.frexp(X.data)[1] + shift, _ZERO_EXPONENT)
        largest = np.full(X.shape[0], _ZERO_EXPONENT)
        stored = np.flatnonzero(np.diff(X.indptr))
        largest[stored] = np.maximum.reduceat(size, X.indptr[stored])
    else:
        largest = np.where(X != 0, np.frexp(X)[1] + columns, _ZERO_EXPONENT).max(axis=1)
    return np.where(largest > _ZERO_EXPONENT // 2, -largest, 0).astype(np.int64)


def equilibrated(X: Any) -> tuple[Any, Exponents, Exponents]:
    """(S, r, c): the entries 2^(r_i + c_j)x_ij of dense or CSR `X`, the largest of each row and column in [1/2, 1)."""
    r = row_exponents(X)
    c = row_exponents(sp.csr_array(X.T) if sp.issparse(X) else X.T, r)
    return in_units(X, r, c), r, c


def symmetric_exponents(diagonal: Vector) -> Exponents:
    """Whole e with 2^(2e_i)d_i between 1/2 and 2 for the entries d_i > 0 of `diagonal`, and e_i = 0 else."""
    return -np.rint(np.log2(np.where(diagonal > 0, diagonal, 1.0)) / 2).astype(np.int64)


def natural_exponents(A: sp.csr_array) -> tuple[Exponents, Exponents]:
    """(r, c) such that the entries 2^(r_i + c_j)a_ij of a CSR `A` with a nonzero diagonal are of moderate size.

    The diagonal is brought into [1, 2). That leaves a_ij → a_ij 2^(c_j − c_i), and c minimises the sum of
    (log₂|a_ij/a_ii| + c_j − c_i)² over the stored entries: for A = D₁SD₂ with |s_ij| = 1 this finds D₁ and D₂.
    """
    n = A.shape[0]
    size = np.frexp(A.diagonal())[1].astype(np.int64) - 1
    ratios = np.frexp(A.data)[1] - 1 - np.repeat(size, np.diff(A.indptr))
    if np.abs(ratios[A.data != 0]).max(initial=0) <= _BALANCED_RANGE:  # that of the diagonal is 0
        return -size, np.zeros(n, dtype=np.int64)
    from scipy.sparse.linalg import cg

    rows = row_of(A)
    off = (rows != A.indices) & (A.data != 0)
    i = rows[off]
    j = A.indices[off]
    ratio = ratios[off].astype(np.float64)
    edges = sp.coo_array((np.ones(i.size), (i, j)), shape=(n, n)).tocsr()
    degree = np.bincount(i, minlength=n) + np.bincount(j, minlength=n)
    laplacian = sp.diags_array(degree + 1e-6) - edges - edges.T
    right = np.bincount(i, ratio, minlength=n) - np.bincount(j, ratio, minlength=n)
    balanced, _ = cg(laplacian, right, rtol=1e-6, maxiter=_MAX_STEPS, M=sp.diags_array(1.0 / (degree + 1e-6)))
    shift = np.rint(balanced).astype(np.int64)
    return -size - shift, shift


def in_units(X: Any, r: Any, c: Any = 0) -> Any:
    """The dense or CSR matrix with entries 2^(r_i + c_j)x_ij, rounded once where they leave the normal range."""
    # one shift by the whole exponent: two would round twice
    with np.errstate(over="ignore", under="ignore"):
        if not sp.issparse(X):
            return np.ldexp(X, (r[:, None] + c).astype(np.int32))
        exponents = np.repeat(r, np.diff(X.indptr)) + (c[X.indices] if np.ndim(c) else c)
        data = np.ldexp(X.data, exponents.astype(np.int32))
    return with_entries(X, data)


def in_units_exactly(X: Any, r: Any, c: Any) -> Any:
    """The result of `in_units` if it rounds no entry, and so can be undone; else None."""
    scaled = in_units(X, r, c)
    before, after = (M.data if sp.issparse(M) else M for M in (X, in_units(scaled, -r, -c)))
    return scaled if np.array_equal(before, after) else None


def balanced(A: sp.csr_array) -> Vector:
    """The W > 0, shape (n,), that balances the rows of a CSR `A`, its indices sorted. Raises OutOfTime.

    W scales the sizes √|a_ij a_ji| to √|a_ij a_ji|/√(w_i w_j); where a_ji = 0, |a_ij| takes the
    place of the root. In every row their mean, weighted by the sizes themselves, is about 1, so
    that negligible entries do not count. From W = 1 each pass moves every w half the way, until none
    moves far. With more passes W would grow along chains of coupled rows.

    References
    ----------
    Knight, Ruiz and Uçar, SIAM J. Matrix Anal. Appl. 35 (2014), for such scalings.
    """
    from .kernels.products import coupling_entries  # loads numba

    work.charge_matrices(A.nnz, 4)
    rows = row_of(A)
    entries = coupling_entries(*read_only((A.indptr, A.indices, A.data)), np.ones(A.shape[0]))
    alone = entries == 0.0  # on the diagonal, and where a_ji = 0: there both places get |a_ij|
    entries[alone] = np.abs(A.data[alone])
    alone &= rows != A.indices
    sizes = with_entries(A, entries)
    sizes += sp.csr_array((entries[alone], (A.indices[alone], rows[alone])), shape=A.shape)
    squares = with_entries(sizes, sizes.data**2)
    roots = np.ones(A.shape[0])
    with np.errstate(all="ignore"):
        for _ in range(_MAX_PASSES):
            work.charge(2.0 * work.product_cost(A.shape[0], sizes.nnz))
            mean = roots * (squares @ roots**-2.0) / (sizes @ (1.0 / roots))
            before = roots
            roots = np.clip(np.sqrt(np.where(mean > 0.0, mean, 1.0)), 1.0 / _MAX_WEIGHT, _MAX_WEIGHT)
            if np.abs(roots / before - 1.0).max(initial=0.0) <= _SETTLED_SHARE:
                break
    return np.asarray(roots * roots)


def times_rows(d: Vector, matrix: sp.csr_array) -> sp.csr_array:
    """diag(d)·`matrix`, CSR; a product of two sparse matrices takes twenty times as long where they are small."""
    data = np.repeat(d, np.diff(matrix.indptr)) * matrix.data
    return with_entries(matrix, data)
