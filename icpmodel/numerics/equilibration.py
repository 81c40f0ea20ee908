"""Units that a matrix has of itself: powers of two for rows and columns, so that ill-scaled input decides nothing."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .arrays import row_of

#: entries within 2^±so many of the diagonal need no balancing
_TAME = 30
#: least squares this far from the optimum still bring every entry into range
_STEPS = 60


def natural_units(A: sp.csr_array) -> tuple[NDArray[Any], NDArray[Any]]:
    """Whole exponents (r, c) such that the entries 2^(r_i + c_j) a_ij are of moderate size.

    The diagonal is brought into [1, 2). That leaves a_ij → a_ij 2^(c_j − c_i), and c minimises the sum of
    (log₂|a_ij/a_ii| + c_j − c_i)² over the stored entries: for A = D₁SD₂ with |s_ij| = 1 this finds D₁ and D₂.
    Neither P- nor H-matrices can tell the difference.

    Parameters: `A` CSR, shape (n, n), with a nonzero diagonal. Returns two arrays of whole numbers of shape (n,).
    Reference: Curtis and Reid, J. Inst. Math. Appl. 10 (1972).
    """
    n = A.shape[0]
    _, exponents = np.frexp(A.data)
    size = np.frexp(A.diagonal())[1].astype(np.int64) - 1
    rows, columns = row_of(A), A.indices
    off = (rows != columns) & (A.data != 0)
    i, j = rows[off], columns[off]
    ratio = exponents[off] - 1.0 - size[i]
    shift = np.zeros(n, dtype=np.int64)
    if ratio.size and np.abs(ratio).max() > _TAME:
        shift = _balance(i, j, ratio, n)
    return -size - shift, shift


def _balance(i: Any, j: Any, ratio: Any, n: int) -> NDArray[Any]:
    from scipy.sparse.linalg import cg

    edges = sp.coo_array((np.ones(i.size), (i, j)), shape=(n, n)).tocsr()
    degree = np.bincount(i, minlength=n) + np.bincount(j, minlength=n)
    laplacian = sp.diags_array(degree + 1e-6) - edges - edges.T
    right = np.bincount(i, ratio, minlength=n) - np.bincount(j, ratio, minlength=n)
    preconditioner = sp.diags_array(1.0 / (degree + 1e-6))
    shift, _ = cg(laplacian, right, rtol=1e-6, maxiter=_STEPS, M=preconditioner)
    return np.rint(shift).astype(np.int64)


def in_units(A: sp.csr_array, r: Any, c: Any) -> sp.csr_array:
    """The CSR matrix with entries 2^(r_i + c_j) a_ij: exact, but for entries below the normal range.

    There the error is at most the smallest float; an entry beyond the range becomes infinite.
    """
    # one shift by the whole exponent: two would round twice
    with np.errstate(over="ignore", under="ignore"):
        data = np.ldexp(A.data, (r[row_of(A)] + c[A.indices]).astype(np.int32))
    return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)
