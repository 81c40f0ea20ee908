"""Uniqueness and error bound for a few unknowns, from the matrices made of rows of A and rows of I − G.

For ψ = Gz + c and F = min(p, r), F(x) − F(y) = B_d(x − y) with B_d = ΔA + (I − Δ)(I − G), Δ =
diag(d), 0 ≤ d ≤ 1. The corners d ∈ {0, 1}ⁿ are the row representatives V of A and I − G. Let their
determinants all have the same sign and none be zero. Then ICP has exactly one solution z* for every
q; for constant ψ the condition says that A is a P-matrix. For every z

    |z_i − z*_i| ≤ max_V |V⁻¹φ|_i ≤ Σ_j |min(K_ij p_j(z), H_ij r_j(z))|.

K_ij and H_ij are the largest |V⁻¹|_ij among those V whose row j is taken from A and from I − G.

Proof: det B_d is affine in each d_k, so it keeps its sign in the cube. F is piecewise affine with
all pieces and all their mixtures nonsingular, hence a homeomorphism. Each entry of B_d⁻¹ is a
quotient of two functions affine in d_k whose denominator does not vanish. Hence it is monotone in
each d_k, and largest at a corner. So |z − z*|_i ≤ Σ_j max(K_ij, H_ij)|F_j|. With the rows of p
multiplied by any s > 0 the bound is Σ_j max(K_ij/s_j, H_ij)|min(s_j p_j, r_j)|. It is least at s_j
= K_ij/H_ij; s may be another one for every i.

The signs are compared along the edges of the cube. Two representatives V and V′ that differ in row
k have det V′/det V = (row k of V′)(column k of V⁻¹). Rows without obstacle always take the row of
A. With an obstacle above that moves alike, ψ̄ = Gz + c̄, F is the median of the three. Its
differences are means as well, and all else stays.

References
----------
Sznajder and Gowda, Linear Algebra Appl. 223/224 (1995), for the row W-property. Cottle and Dantzig,
J. Combin. Theory 8 (1970). Chen and Xiang, Math. Program. 106 (2006), for the norm of B_d⁻¹. The
proof is above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ...numerics.arrays import Vector
from ...numerics.equilibration import in_units_exactly, mean_exponents, row_exponents
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData
from ...problem.map import Map
from ...problem.matrix import Matrix
from ...problem.two_sided import TwoSidedObstacle, mid
from .proof import Proof, norm_up

LIMIT = 12  #: with so many unknowns there are 4096 representatives, inverted within a tenth of a second
_CHUNK = 512  #: representatives inverted at a time


@dataclass(frozen=True, eq=False)
class RepresentativesProof(Proof):
    """K and H of the module's docstring, (n, n), for p, r and z in units of 2^−`row_p`, 2^−`row_r` and 2^`column`."""

    K: np.ndarray
    H: np.ndarray
    row_p: np.ndarray
    row_r: np.ndarray
    column: np.ndarray

    def bound(self, problem: ProblemData, z: Vector, for_p: Vector, for_r: Vector) -> tuple[Vector, float]:
        with np.errstate(over="ignore", invalid="ignore", under="ignore"):
            p = np.ldexp(problem.p(z), self.row_p)
            error_p = np.ldexp(for_p, self.row_p) + 2 * SMALLEST
            error_r = np.ldexp(for_r, self.row_r) + 2 * SMALLEST
            r = problem.r(z)
            above = problem.r_upper(z)
            # an error counts on the side that is the median alone
            low, high = (
                mid(
                    self.K * (p + sign * error_p),
                    self._of_r(r, sign * error_r, np.inf),
                    None if above is None else self._of_r(above, sign * error_r, -np.inf),
                )
                for sign in (-1.0, 1.0)
            )
            total = np.maximum(np.abs(low), np.abs(high)) + SMALLEST
            total = total.sum(axis=1) * (1 + (z.size + 8) * UNIT_ROUNDOFF)
            delta = np.nextafter(np.ldexp(total, self.column), np.inf)
        return delta, norm_up(delta)

    def _of_r(self, r: Vector, error: Vector, none: float) -> np.ndarray:
        """H times `r` in its units with its `error`, `none` in the columns where there is no obstacle."""
        free = r == none
        return np.where(free, none, self.H * (np.ldexp(np.where(free, 0.0, r), self.row_r) + error))


def prove(matrix: Matrix, psi: Map) -> RepresentativesProof | str:
    """All 2ⁿ representatives are inverted, n ≤ 12, and the inverses enclosed."""
    n = matrix.n
    other = "I" if psi.is_constant else "I - G"
    if n > LIMIT:
        return f"n = {n} is too large to try all choices of rows from A and {other}, which is done up to n = {LIMIT}"
    if psi.linear is None:
        return "psi is neither constant nor affine, so I - G has no rows to be compared with those of A"
    A = matrix.sparse.toarray()
    (G, c) = psi.linear
    free = np.isneginf(c)
    if isinstance(psi, TwoSidedObstacle):
        if not psi.parallel or psi.upper.linear is None:
            return "the two obstacles do not move alike, so I - G has other rows for the one than for the other"
        free &= np.isposinf(psi.upper.linear[1])
    is_lcp = psi.is_constant and not free.any()
    B = np.where(free[:, None], A, np.eye(n) - G.toarray())
    column = mean_exponents(np.vstack([A, B]))
    rows_A = _unit_rows(A, column)
    rows_B = _unit_rows(B, column)
    if rows_A is None or rows_B is None:
        return f"choices of rows from A and {other} are not compared: a row is zero or has entries of too many sizes"
    yes, no = ("A is a P-matrix", "A is not a P-matrix") if is_lcp else (_HAVE, _HAVE.replace("have", "do not have"))
    corners = np.arange(2**n)
    K = np.zeros((n, n))
    H = np.zeros((n, n))
    for start in range(0, corners.size, _CHUNK):
        from_B = (corners[start : start + _CHUNK, None] >> np.arange(n)) & 1 == 1
        inverse, radius, sign = _enclosed_inverses(rows_A[0], rows_B[0], from_B)
        if (sign < 0).any():
            k = int(np.argmax((sign < 0).any(axis=0)))
            rows = f"two choices of rows from A and {other} that differ in row {k}"
            return f"{no}: {rows} have determinants of opposite signs"
        if not (sign > 0).all():
            return f"it is not proved that {yes}: a choice of rows from A and {other} is singular to working precision"
        size = (np.abs(inverse) + radius) * (1 + 4 * UNIT_ROUNDOFF)
        K = np.maximum(K, np.where(from_B[:, None, :], 0.0, size).max(axis=0))
        H = np.maximum(H, np.where(from_B[:, None, :], size, 0.0).max(axis=0))
    sentence = f"{yes} (all {corners.size} choices of rows from A and {other} have determinants of one sign)"
    return RepresentativesProof(sentence, K, H, rows_A[1], rows_B[1], column)


_HAVE = "A and I - G have the row W-property"


def _enclosed_inverses(A: np.ndarray, B: np.ndarray, from_B: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """R and ρ with |V⁻¹ − R| ≤ ρ, (m, n, n), and the signs of det V′/det V for the neighbours V′ of V, (m, n).

    `from_B` (m, n) tells which rows of V come from B. A sign that rounding leaves open is 0. With E = I − RV and
    ‖E‖_∞ ≤ η < 1, V is nonsingular and V⁻¹ − R = E(I − E)⁻¹R ≤ η/(1 − η)·max_k|R_kj|. `gamma` covers a sum of n
    products and the rounding of 1 − g_ii.
    """
    n = A.shape[0]
    gamma = (2 * n + 12) * UNIT_ROUNDOFF
    V = np.where(from_B[:, :, None], B, A)
    other = np.where(from_B[:, :, None], A, B)
    with np.errstate(all="ignore"):
        try:
            R = np.linalg.inv(V)
        except np.linalg.LinAlgError:  # one of them is singular, which one does not matter
            R = np.full(V.shape, np.nan)
        E = np.abs(np.eye(n) - R @ V) + gamma * (np.eye(n) + np.abs(R) @ np.abs(V))
        eta = E.sum(axis=2).max(axis=1) * (1 + gamma)
        factor = np.where(eta < 0.5, eta / (1.0 - eta), np.nan) * (1 + gamma)
        radius = np.broadcast_to((factor[:, None] * np.abs(R).max(axis=1))[:, None, :], R.shape)
        ratio = np.einsum("vkj,vjk->vk", other, R)
        error = np.einsum("vkj,vjk->vk", np.abs(other), radius + gamma * np.abs(R)) * (1 + gamma)
        sign = np.where(ratio > error, 1, np.where(ratio < -error, -1, 0))
    return R, radius, sign


def _unit_rows(X: np.ndarray, columns: np.ndarray) -> tuple[np.ndarray, np.ndarray] | None:
    """X scaled by 2^`columns`, its rows by powers of two to the size 1, and their exponents; None where inexact."""
    exponents = row_exponents(X, columns)
    scaled = in_units_exactly(X, exponents, columns)
    return None if scaled is None or not X.any(axis=1).all() else (scaled, exponents)
