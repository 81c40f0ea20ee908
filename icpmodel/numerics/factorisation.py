"""Sparse factorisations."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp


def factorise(matrix: sp.csr_array) -> Any:
    """SuperLU of a sparse matrix (n × n), ordered for its pattern; None where a pivot is exactly zero."""
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
