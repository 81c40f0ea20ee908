"""The structure of a CSR matrix: its diagonal, symmetry and bandwidths."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .arrays import read_only, row_of, with_entries

#: numbers that differ by a smaller share are the same up to rounding
ROUNDING_RTOL = 1e-13


def diagonal_positions(matrix: sp.csr_array) -> NDArray[np.int32] | NDArray[np.int64]:
    """Where in `matrix.data` each row's diagonal entry stands, shape (n,); every one must be stored."""
    return np.flatnonzero(matrix.indices == row_of(matrix)).astype(matrix.indptr.dtype)


def absolute(matrix: sp.csr_array) -> sp.csr_array:
    """|A|, entry by entry, CSR; it shares the index arrays of A, which `abs` copies."""
    return with_entries(matrix, np.abs(matrix.data))


def is_diagonal(matrix: sp.csr_array) -> bool:
    """Whether all entries of a sparse matrix off its diagonal are 0."""
    return bool(np.count_nonzero(matrix.data) == np.count_nonzero(matrix.diagonal()))


def is_symmetric(matrix: sp.csr_array) -> bool:
    """Whether a sparse matrix equals its transpose, entry by entry."""
    from .kernels.graph import symmetrising_signs  # loads numba

    matrix = sp.csr_array(matrix)
    if matrix.has_canonical_format and matrix.data.all():
        sigma = symmetrising_signs(*read_only((matrix.indptr, matrix.indices, matrix.data)), 0.0)
        return sigma.size == matrix.shape[0] and bool((sigma > 0.0).all())
    return (matrix != sp.csr_array(matrix.T)).nnz == 0  # zeros may be stored on one side only


def bandwidths(matrix: sp.csr_array) -> tuple[int, int]:
    """How far the entries of a CSR matrix reach below its diagonal, and above it."""
    below = row_of(matrix) - matrix.indices
    return int(below.max(initial=0)), int(-below.min(initial=0))
