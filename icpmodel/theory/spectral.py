"""Estimates that steer a choice of parameters; nothing is proved by them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

#: a radius up to which its size makes no difference to any choice
SMALL_RADIUS = 0.7


def jacobi_radius(A: sp.csr_array, steps: int | None = None) -> float:
    """An estimate, usually from below, of the spectral radius of the Jacobi matrix I − D⁻¹A.

    Power steps on the symmetric matrix with entries √|a_ij a_ji|/√|a_ii a_jj|, i ≠ j, and a Rayleigh quotient. For
    symmetric M-matrices, and for those that a diagonal similarity makes symmetric (transport on a grid), this is the
    Jacobi radius itself; couplings that act in one direction only count as nothing, as they do for Gauss–Seidel.

    Parameters: `A` CSR, shape (n, n), with a nonzero diagonal; `steps` of the power method at the most, default
    min(√n, 200); none are made where the row sums already show the radius to be small.
    Returns the estimate. Reference: Young, Iterative Solution of Large Linear Systems (1971), chapter 6.

    >>> round(jacobi_radius(sp.csr_array([[2.0, -1.0], [-1.0, 2.0]])), 6)
    0.5
    """
    n, diagonal = A.shape[0], np.abs(A.diagonal())
    bound = float((abs(A) @ np.ones(n) / diagonal).max()) - 1.0
    return bound if bound <= SMALL_RADIUS else radius_of(couplings(A), steps)


def couplings(A: sp.csr_array) -> sp.csr_array:
    """The symmetric matrix with entries √|a_ij a_ji|/√|a_ii a_jj|, i ≠ j: the Jacobi matrix where a diagonal similarity
    makes A a symmetric M-matrix.

    Parameters: `A` CSR, shape (n, n), rows sorted, with a nonzero diagonal. Returns CSR with the pattern of A.
    Reference: Young, Iterative Solution of Large Linear Systems (1971), chapter 6.

    >>> couplings(sp.csr_array([[4.0, -1.0], [-4.0, 4.0]])).toarray()
    array([[0. , 0.5],
           [0.5, 0. ]])
    """
    from ..kernels.rows import couple  # loads numba

    weight = 1.0 / np.sqrt(np.abs(A.diagonal()))
    return sp.csr_array((couple(A.indptr, A.indices, A.data, weight), A.indices, A.indptr), shape=A.shape)


def radius_of(S: sp.csr_array, steps: int | None = None) -> float:
    """An estimate from below of the spectral radius of a symmetric `S` ≥ 0, CSR, shape (n, n), as in `jacobi_radius`.

    >>> round(radius_of(sp.csr_array([[0.0, 0.9], [0.9, 0.0]])), 6)
    0.9
    """
    n = S.shape[0]
    bound = float((S @ np.ones(n)).max())
    if bound <= SMALL_RADIUS:
        return bound
    v = np.full(n, 1.0 / np.sqrt(n))
    radius = 0.0
    for _ in range(steps or int(min(np.sqrt(n), 200)) + 1):
        w = S @ v
        before, radius = radius, float(v @ w)
        size = float(np.linalg.norm(w))
        if size == 0.0 or abs(radius - before) <= 1e-4 * abs(1.0 - radius):
            break
        v = w / size
    return radius
