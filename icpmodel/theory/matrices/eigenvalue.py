"""Proved bounds on the eigenvalues of symmetric matrices, CSR or dense, rounding included."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import Vector, norm
from ...numerics.factorisation import array_factors, factorise
from ...numerics.fill import SymbolicAnalysis, dense_cost
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF, product_upper_bound
from ...numerics.sparse_structure import is_symmetric
from ...numerics.threads import one_blas_thread
from ...problem.matrix import MAX_DENSE_ROWS

#: shares of the estimated eigenvalue that are tried as a bound; the first one succeeds unless rounding matters
_TRIED_SHARES = (0.99, 0.5)
_MAX_FACTORISATION_COST = 5e9  #: in counted nanoseconds
_TRIDIAGONALISATION_COST = 4  #: the time to make a dense matrix tridiagonal, in factorisations
#: steps of the inverse iteration, where an eigenvalue near the smallest one is good enough, and of the power method,
#: where more steps make the bound sharper
_MAX_STEPS = 40


def smallest_eigenvalue_bound(S: Any, c: float, slack: float = 0.0) -> float:
    """A lower bound c − ε of λ_min of a symmetric matrix by a factorisation of S − cI, −inf where a pivot is not > 0.

    Dense S: a complete Cholesky factorisation has RᵀR = S − cI + Δ, |Δ| ≤ γ/(1 − γ)ddᵀ with
    γ = γ_{n+1} and d_i = √(s_ii − c). So ‖Δ‖₂ ≤ γ/(1 − γ)trace(S − cI), and RᵀR ≥ 0 proves λ_min(S) ≥
    c − ‖Δ‖₂. The code takes n + 8 terms, as quotients may be products with a reciprocal.

    Sparse S: P(S − cI)Pᵀ + ΔT = LU by diagonal pivots with |ΔT| ≤ γ|L||U|. Let D = diag(U) > 0 and
    U = DLᵀ + ΔU. Then LU is LDLᵀ + LΔU, and P(S − cI)Pᵀ is LDLᵀ + (LΔU − ΔT). LDLᵀ is positive
    definite. The bracket is symmetric, as the other two matrices are, so its ∞-norm bounds its
    eigenvalues. That norm is at most ‖|L||ΔU|1 + γ|L||U|1‖_∞.

    `S` is known to one rounding of its entries and to `slack` in norm. Its largest entries are
    above 1e-280, so that underflow does not matter.

    References
    ----------
    Higham, Accuracy and Stability of Numerical Algorithms (2002), theorems 9.3, 10.5. Rump, BIT 46
    (2006).
    """
    S = in_storage(S)
    n = S.shape[0]
    diagonal = S.diagonal() - c
    error = _distance_from_definite(S, c) if sp.issparse(S) else _error_of_cholesky(S, c, float(diagonal.sum()))
    rounding = 4 * UNIT_ROUNDOFF * (float(abs(S).sum(axis=1).max()) + float(np.abs(diagonal).max()))
    return c - 1.01 * (error + rounding + slack + n * SMALLEST)


def smallest_below(M: Any, slack: float = 0.0, lu: Any = None) -> float:
    """A lower bound of λ_min(S), S the symmetric part of a matrix that differs from `M` by at most `slack` in norm.

    The diagonal of M is about 1, `lu` are the `definite_factors` of S, if known, and a dense M is symmetric. −inf if no
    bound above 0 is found.
    """
    S = in_storage(M if not sp.issparse(M) or is_symmetric(M) else sp.csr_array(0.5 * (M + M.T)))
    estimate = _estimate(S, lu) if np.isfinite(S.data if sp.issparse(S) else S).all() else -np.inf
    if not estimate > 0:
        return -np.inf
    bounds = (smallest_eigenvalue_bound(S, share * estimate, slack) for share in _TRIED_SHARES)
    return next((bound for bound in bounds if bound > 0), -np.inf)


def largest_above(N: sp.csr_array) -> float:
    """An upper bound of λ_max of the symmetric part T of `N` ≥ 0: max_i (Tv)_i/v_i for a v > 0 of the power method.

    Reference: Collatz, Math. Z. 48 (1942).
    """
    T = sp.csr_array(0.5 * (N + N.T))
    v = np.ones(T.shape[0])
    for _ in range(_MAX_STEPS):
        work.charge(work.product_cost(v.size, T.nnz))
        w = T @ v
        largest = float(w.max())
        if not 0 < largest < np.inf:
            break
        # half of the old v keeps a bipartite T from oscillating, and the floor keeps every entry positive
        v = np.maximum(0.5 * (v + w / largest), 1e-6)
    return float((product_upper_bound(T, v) / v).max()) * (1 + 8 * UNIT_ROUNDOFF) + T.nnz * SMALLEST / float(v.min())


def negative_direction(S: sp.csr_array) -> Vector | None:
    """An x ≠ 0, shape (n,), that is likely to have xᵀSx < 0; None if the symmetric `S` (CSR) seems to have none."""
    if is_dense(S):
        value, x = _least_pair(S.toarray())
        return x if value < 0 else None
    from scipy.sparse.linalg import spsolve_triangular

    lu = factorise(S, definite=True, triangles=True)
    if lu is None or (pivots := lu.pivots).min() > 0:
        return None
    k = int(np.argmin(pivots))
    # L^T y = e_k gives y^T (P S P^T) y = pivot_k
    y = spsolve_triangular(sp.csr_array(lu.lu.L.T), np.eye(1, S.shape[0], k)[0], lower=False)
    return lu.in_order(y)


def _least_pair(S: NDArray[np.float64]) -> tuple[float, Vector | None]:
    """The least λ with Sx = λx, and x, for a dense S; −inf and None where that fails."""
    from scipy.linalg import LinAlgError, eigh

    work.charge(_TRIDIAGONALISATION_COST * dense_cost(S.shape[0]), 16.0 * S.shape[0] ** 2)
    try:
        with one_blas_thread():
            value, x = eigh(S, subset_by_index=(0, 0))
    except LinAlgError:
        return -np.inf, None
    return float(value[0]), x[:, 0]


def is_dense(S: sp.csr_array) -> bool:
    """Whether dense factorisations of `S` (CSR) are quicker than sparse ones."""
    n = S.shape[0]
    return n <= MAX_DENSE_ROWS or 8 * S.nnz >= n * n


def in_storage(S: Any) -> Any:
    """`S` (CSR) as a dense array where dense factorisations are quicker; S itself elsewhere, or where it is dense."""
    if not sp.issparse(S) or not is_dense(S):
        return S
    work.check_budget(memory=8.0 * S.shape[0] ** 2)
    return S.toarray()


def within_reach(S: sp.csr_array) -> bool:
    """Whether the symmetric `S` (CSR) is expected to be factorised in seconds, such as a plane grid of 10⁶ rows."""
    if is_dense(S):
        return dense_cost(S.shape[0]) <= _MAX_FACTORISATION_COST
    return not SymbolicAnalysis(S, lambda: True).costs_more(_MAX_FACTORISATION_COST)


def definite_factors(S: Any) -> Any:
    """Factors of the symmetric `S`: Cholesky if dense, else with diagonal pivots; None unless all pivots are > 0."""
    lu = factorise(S, definite=True) if sp.issparse(S) else array_factors(S.copy().T, cholesky=True)
    return lu if lu is not None and lu.pivots.min() > 0 else None


def _estimate(S: Any, lu: Any) -> float:
    """An estimate of the smallest eigenvalue, without proof; a number ≤ 0 if S seems to be indefinite."""
    if S.shape[0] <= MAX_DENSE_ROWS:
        return _least_pair(S)[0]
    lu = lu or definite_factors(S)
    if lu is None:
        return -np.inf
    x = np.random.default_rng(0).random(S.shape[0])
    largest = np.inf
    with one_blas_thread():
        for _ in range(_MAX_STEPS):
            x = x / norm(x)
            image = lu.solve(x)
            largest = float(x @ image)
            x = image
    return 1.0 / largest if largest > 0 else -np.inf


def _error_of_cholesky(S: NDArray[np.float64], c: float, trace: float) -> float:
    """A bound on the norm of S − cI − RᵀR, R the computed Cholesky factor, inf where there is none."""
    n = S.shape[0]
    work.check_budget(memory=8.0 * n**2)
    shifted = S.copy()
    shifted.flat[:: n + 1] -= c
    if array_factors(shifted.T, cholesky=True) is None:
        return np.inf
    return (n + 8) * (UNIT_ROUNDOFF * trace + 8 * n * SMALLEST)


def _distance_from_definite(S: sp.csr_array, c: float) -> float:
    """A bound on the norm of S − cI − LDLᵀ with D > 0, inf where a pivot is not positive."""
    lu = factorise(sp.csr_array(S - c * sp.eye_array(S.shape[0])), definite=True, triangles=True)
    if lu is None or not ((D := lu.pivots) > 0).all():
        return np.inf
    L = sp.csr_array(lu.lu.L)
    U = sp.csr_array(lu.lu.U)
    ones = np.ones(S.shape[0])
    exact = sp.csr_array(sp.diags_array(D) @ L.T)
    size = abs(U) @ ones + abs(exact) @ ones
    terms = int(np.diff(L.indptr).max()) + 8
    defect = abs(sp.csr_array(U - exact)) @ ones + 2 * terms * UNIT_ROUNDOFF * size
    return float(product_upper_bound(abs(L), defect).max())
