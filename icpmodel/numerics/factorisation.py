"""Sparse factorisations, by SuperLU."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from .arrays import is_symmetric


def factorise(matrix: sp.csr_array, *, diagonal_pivots: bool = False) -> Any:
    """SuperLU of a sparse matrix (n × n), ordered for its pattern; None where it is singular, or not finite.

    With `diagonal_pivots`, for a symmetric matrix, it is None as well where SuperLU exchanged rows. Raises MemoryError.
    """
    from scipy.sparse.csgraph import structural_rank
    from scipy.sparse.linalg import splu

    n = matrix.shape[0]
    if not np.isfinite(matrix.data).all():
        return None
    # a full diagonal has full structural rank
    if np.count_nonzero(matrix.diagonal()) < n and structural_rank(matrix) < n:
        return None
    # threshold pivoting keeps the fill of the symmetric ordering where the diagonal is not small
    options: dict[str, Any] = {"permc_spec": "MMD_AT_PLUS_A", "diag_pivot_thresh": 0.1}
    if diagonal_pivots:
        options |= {"diag_pivot_thresh": 0.0, "options": {"SymmetricMode": True}}
    elif not is_symmetric(sp.csr_array((np.ones(matrix.nnz), matrix.indices, matrix.indptr), shape=matrix.shape)):
        options = {"permc_spec": "COLAMD"}
    try:
        lu = splu(sp.csc_array(matrix), **options)
    except RuntimeError:
        return None
    return None if diagonal_pivots and not np.array_equal(lu.perm_r, lu.perm_c) else lu
