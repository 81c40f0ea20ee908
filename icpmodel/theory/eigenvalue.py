"""Proved bounds on the eigenvalues of sparse symmetric matrices, rounding included."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..problem import SMALLEST, UNIT_ROUNDOFF
from .rounding import upper

#: shares of the estimated eigenvalue that are tried as a bound; the first one does unless rounding is felt
_SHARES = (0.99, 0.9, 0.5)
#: up to here all eigenvalues cost less than one sparse factorisation
_DENSE = 64
#: steps of the power method; each makes the bound sharper, none makes it false
_POWER_STEPS = 40


def smallest_below(M: sp.csr_array, slack: float = 0.0, lu: Any = None) -> float:
    """A lower bound of λ_min(S), S the symmetric part of a matrix that differs from `M` by at most `slack` in norm.

    An estimate of λ_min gives c < λ_min, and S − cI is factorised with diagonal pivots, P(S − cI)Pᵀ + ΔT = LU with
    |ΔT| ≤ γ|L||U|. With D = diag(U) > 0 and U = DLᵀ + ΔU it is LDLᵀ + (LΔU − ΔT), a positive definite matrix and a
    bracket that is symmetric as the other two are, so that its ∞-norm bounds its eigenvalues: λ_min(S) ≥
    c − ‖|L||ΔU|1 + γ|L||U|1‖_∞. Rounding of S and of S − cI is added.

    Parameters: `M` CSR, shape (n, n), with a diagonal of about the size 1; `lu` its `symmetric_lu`, where it is
    symmetric and that is at hand. Returns the bound, −inf where none was found; above 0 it proves S positive definite.
    Reference: Higham, Accuracy and Stability of Numerical Algorithms (2002), theorem 9.3; Rump, BIT 46 (2006).

    >>> 1.97 <= smallest_below(sp.csr_array([[3.0, -1.0], [-1.0, 3.0]])) <= 2.0
    True
    """
    S = sp.csr_array(0.5 * (M + M.T))
    n = S.shape[0]
    estimate = _estimate(S, lu)
    if not estimate > 0:
        return -np.inf
    rounding = 4 * UNIT_ROUNDOFF * float(abs(S).sum(axis=1).max()) + n * SMALLEST
    for share in _SHARES:
        c = share * estimate
        bound = c - 1.01 * (_distance_from_definite(S, c) + rounding + slack)
        if bound > 0:
            return bound
    return -np.inf


def largest_above(N: sp.csr_array) -> float:
    """An upper bound of λ_max of the symmetric part T of `N` ≥ 0: max_i (Tv)_i/v_i for a v > 0 of the power method.

    Parameters: `N` CSR, shape (n, n), with entries ≥ 0. Returns the bound.
    Reference: Collatz, Math. Z. 48 (1942).

    >>> 3.0 <= largest_above(sp.csr_array([[1.0, 4.0], [0.0, 1.0]])) <= 3.001
    True
    """
    T = sp.csr_array(0.5 * (N + N.T))
    v = np.ones(T.shape[0])
    for _ in range(_POWER_STEPS):
        w = T @ v
        largest = float(w.max())
        if not 0 < largest < np.inf:
            break
        # half of the old v keeps a bipartite T from swinging, the floor every entry positive
        v = np.maximum(0.5 * (v + w / largest), 1e-6)
    return float((upper(T, v) / v).max()) * (1 + 8 * UNIT_ROUNDOFF) + T.nnz * SMALLEST


def _estimate(S: sp.csr_array, lu: Any) -> float:
    """λ_min(S) by inverse iteration, or something not positive where S is seen to be indefinite. Proves nothing."""
    if S.shape[0] <= _DENSE:
        return float(np.linalg.eigvalsh(S.toarray())[0])
    from scipy.sparse.linalg import ArpackNoConvergence, LinearOperator, eigsh

    lu = lu or symmetric_lu(S)
    if lu is None or not lu.U.diagonal().min() > 0:
        return -np.inf
    inverse = LinearOperator(S.shape, matvec=lu.solve, dtype=np.float64)
    start = np.random.default_rng(0).random(S.shape[0])
    try:
        return 1.0 / float(eigsh(inverse, 1, which="LA", v0=start, tol=1e-3, return_eigenvectors=False)[0])
    except ArpackNoConvergence:
        return -np.inf


def _distance_from_definite(S: sp.csr_array, c: float) -> float:
    """A bound on the norm of (S − cI) − LDLᵀ with D > 0, inf where a pivot is not positive."""
    n = S.shape[0]
    shifted = sp.csr_array(S - c * sp.eye_array(n))
    lu = symmetric_lu(shifted)
    if lu is None:
        return np.inf
    L, U = sp.csr_array(lu.L), sp.csr_array(lu.U)
    D = U.diagonal()
    if not (D > 0).all():
        return np.inf
    ones = np.ones(n)
    exact = sp.csr_array(sp.diags_array(D) @ L.T)
    size = abs(U) @ ones + abs(exact) @ ones
    terms = int(np.diff(L.indptr).max()) + 8
    defect = abs(sp.csr_array(U - exact)) @ ones + 2 * terms * UNIT_ROUNDOFF * size
    rounding = 2 * UNIT_ROUNDOFF * float(np.abs(shifted.diagonal()).max())
    return float(upper(abs(L), defect).max()) + rounding


def symmetric_lu(S: sp.csr_array) -> Any:
    """SuperLU of the symmetric matrix `S` (CSR, n × n) with diagonal pivots, None where one of them is zero.

    >>> symmetric_lu(sp.csr_array([[2.0, 1.0], [1.0, 2.0]])).solve(np.array([3.0, 3.0]))
    array([1., 1.])
    """
    from scipy.sparse.linalg import splu

    try:
        lu = splu(sp.csc_array(S), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        return None
    return lu if np.array_equal(lu.perm_r, lu.perm_c) else None
