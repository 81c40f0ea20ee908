"""Estimates that steer a choice of parameters; nothing is proved by them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from .arrays import inner, norm

#: a radius up to which its size makes no difference to any choice
SMALL_RADIUS = 0.7
#: it is looked at whenever so many more Lanczos steps are made, and where they bring it no nearer to 1 than by this
#: share of what is left it will do, as after the last number of steps
_LOOK, _SHARE, _MOST = 4, 0.3, 60


def jacobi_radius(A: sp.csr_array, share: float = _SHARE) -> float:
    """An estimate, usually from below, of the spectral radius ρ of the Jacobi matrix I − D⁻¹A.

    Lanczos steps on the symmetric matrix with entries √|a_ij a_ji|/√|a_ii a_jj|, i ≠ j, from the vector of ones. For
    symmetric M-matrices, and for those that a diagonal similarity makes symmetric (transport on a grid), its radius is
    the Jacobi radius itself; couplings that act in one direction only count as nothing, as they do for Gauss–Seidel.
    `share` of 1 − ρ is what four more steps must gain for the next four to be made, up to 60; none are made where the
    row sums of D⁻¹A, D nonzero, already show the radius to be small.
    References: Young, Iterative Solution of Large Linear Systems (1971), chapter 6; Saad, Numerical Methods for Large
    Eigenvalue Problems (2011), chapter 6.
    """
    n, diagonal = A.shape[0], np.abs(A.diagonal())
    bound = float((abs(A) @ np.ones(n) / diagonal).max()) - 1.0
    return bound if bound <= SMALL_RADIUS else radius_of(couplings(A), share=share)


def couplings(A: sp.csr_array) -> sp.csr_array:
    """√|a_ij a_ji|/√|a_ii a_jj|, i ≠ j, with the pattern of A, whose rows are sorted: see `jacobi_radius`."""
    from .kernels.products import couple  # loads numba

    weight = 1.0 / np.sqrt(np.abs(A.diagonal()))
    return sp.csr_array((couple(A.indptr, A.indices, A.data, weight), A.indices, A.indptr), shape=A.shape)


def radius_of(S: sp.csr_array, steps: int = _MOST, share: float = _SHARE) -> float:
    """An estimate from below of the spectral radius of a symmetric `S` ≥ 0, CSR, shape (n, n), as in `jacobi_radius`.

    At most so many `steps` are made; inf where an entry is not finite.
    """
    n = S.shape[0]
    sums = S @ np.ones(n)
    bound = float(sums.max())
    if not SMALL_RADIUS < bound < np.inf:
        return bound if bound <= SMALL_RADIUS else np.inf
    before, v, radius = np.zeros(n), np.full(n, 1.0 / np.sqrt(n)), float(sums.mean())  # vᵀSv
    own: list[float] = []
    next_to: list[float] = []
    w = sums / np.sqrt(n)
    last = min(steps, n)
    for step in range(1, last + 1):
        own.append(inner(v, w))
        w -= own[-1] * v
        size = norm(w)
        invariant = size <= 1e-12 * bound
        if invariant or step == last or step % _LOOK == 0:
            known, radius = radius, _largest(own, next_to)
            if invariant or radius - known <= share * abs(1.0 - radius):
                break
        next_to.append(size)
        before, v = v, w / size
        w = S @ v - size * before
    return radius


def _largest(own: list[float], next_to: list[float]) -> float:
    """The largest eigenvalue of the symmetric tridiagonal matrix with the diagonal `own`."""
    T = np.diag(own) + np.diag(next_to, -1)
    return float(np.linalg.eigvalsh(T)[-1])  # which reads the lower triangle
