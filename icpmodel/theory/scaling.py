"""The comparison matrix ⟨A⟩ and a vector v > 0 with ⟨A⟩v > 0, which proves that A is an H-matrix."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..arrays import Vector, diagonal_positions
from ..operators import factorise

#: so many steps of a Krylov method cost less than a factorisation of any but the smallest matrices
_KRYLOV_STEPS = 200


def comparison_matrix(A: sp.csr_array) -> sp.csr_array:
    """⟨A⟩: |a_ii| on the diagonal and −|a_ij| off it.

    Parameters: `A` CSR, shape (n, n), every diagonal entry stored. Returns CSR of the same pattern.

    >>> comparison_matrix(sp.csr_array([[-2.0, 1.0], [-1.0, 3.0]])).toarray()
    array([[ 2., -1.],
           [-1.,  3.]])
    """
    data = -np.abs(A.data)
    diagonal = diagonal_positions(A)
    data[diagonal] = -data[diagonal]
    return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)


def solve_for_ones(comparison: sp.csr_array) -> Vector | None:
    """v with ⟨A⟩v ≈ 1: by a few conjugate gradient steps where they suffice, else by a factorisation.

    Parameters: `comparison` = ⟨A⟩, CSR, shape (n, n). Returns v of shape (n,), whose signs are not checked, or None
    where ⟨A⟩ is singular.

    >>> solve_for_ones(sp.csr_array([[2.0, -1.0], [-1.0, 2.0]]))
    array([1., 1.])
    """
    from scipy.sparse.linalg import bicgstab, cg

    n = comparison.shape[0]
    symmetric = (comparison != comparison.T).nnz == 0
    # a residual of at most 1/2 in every row leaves <A>v >= 1/2; the signs are checked anyway
    options: dict[str, Any] = {"rtol": 0.5 / np.sqrt(n), "atol": 0.0, "maxiter": _KRYLOV_STEPS}
    with np.errstate(all="ignore"):  # where <A> is indefinite these break down, which the check below sees
        options["M"] = sp.diags_array(1.0 / comparison.diagonal())
        v, failed = (cg if symmetric else bicgstab)(comparison, np.ones(n), **options)
    if not failed and (v > 0).all() and (comparison @ v > 0).all():
        return np.asarray(v)
    lu = factorise(comparison)
    if lu is None:
        return None
    v = np.asarray(lu.solve(np.ones(n)))
    return v if np.isfinite(v).all() else None
