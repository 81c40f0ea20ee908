"""Estimates that steer a choice of parameters; nothing is proved by them."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from . import work
from .arrays import inner, norm

#: a radius up to which its size makes no difference to any choice
SMALL_RADIUS = 0.7
#: it is looked at whenever so many more Lanczos steps are made, and where they bring it no nearer to 1 than by this
#: share of what is left it will do, as after the last number of steps
_LOOK, _SHARE, _MOST = 4, 0.3, 60
#: nanoseconds for which a_ji is found, in rows of thousands of entries
_COUPLE = 40.0


def couplings(A: sp.csr_array) -> sp.csr_array:
    """√|a_ij a_ji|/√|a_ii a_jj|, i ≠ j, with the pattern of A, whose rows are sorted.

    For symmetric M-matrices, and those that a diagonal similarity makes symmetric, their spectral radius is that of the
    Jacobi matrix I − D⁻¹A; what acts in one direction only counts as nothing, as it does for Gauss–Seidel.
    Reference: Young, Iterative Solution of Large Linear Systems (1971), chapter 6.
    """
    from .kernels.products import couple  # loads numba

    work.afford(_COUPLE * A.nnz)
    weight = 1.0 / np.sqrt(np.abs(A.diagonal()))
    return sp.csr_array((couple(A.indptr, A.indices, A.data, weight), A.indices, A.indptr), shape=A.shape)


def radius_of(S: sp.csr_array, share: float = _SHARE) -> float:
    """An estimate, usually from below, of the spectral radius ρ of a symmetric `S` ≥ 0; inf if it is not finite.

    By Lanczos steps from the vector of ones; `share` of 1 − ρ is what four more of them must gain for the next four to
    be made. Reference: Saad, Numerical Methods for Large Eigenvalue Problems (2011), chapter 6.
    """
    n = S.shape[0]
    price = work.product(n, S.nnz) + 6 * work.COSTS.vector * n
    work.spend(price)
    sums = S @ np.ones(n)
    bound = float(sums.max())
    if not SMALL_RADIUS < bound < np.inf:
        return bound if bound <= SMALL_RADIUS else np.inf
    before, v, radius = np.zeros(n), np.full(n, 1.0 / np.sqrt(n)), float(sums.mean())  # vᵀSv
    own: list[float] = []
    next_to: list[float] = []
    w = sums / np.sqrt(n)
    last = min(_MOST, n)
    for step in range(1, last + 1):
        own.append(inner(v, w))
        w -= own[-1] * v
        size = norm(w)
        invariant = size <= 1e-12 * bound
        if invariant or step == last or step % _LOOK == 0:
            # eigvalsh reads the lower triangle
            try:
                known, radius = radius, float(np.linalg.eigvalsh(np.diag(own) + np.diag(next_to, -1))[-1])
            except np.linalg.LinAlgError:  # what overflowed
                return np.inf
            if invariant or radius - known <= share * abs(1.0 - radius):
                break
        next_to.append(size)
        before, v = v, w / size
        work.afford(price)
        w = S @ v - size * before
        work.add(price)
    return radius
