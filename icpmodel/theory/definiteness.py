"""Is a symmetric matrix positive definite? Decided by Gershgorin's discs or a factorisation, with a witness if not."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ..arrays import Vector, row_of
from ..problem import UNIT_ROUNDOFF


@dataclass(frozen=True)
class Definiteness:
    """What is known of the smallest eigenvalue of a symmetric matrix S.

    `semidefinite` is True (S ≥ 0 up to rounding), False (proved by `witness`, a unit vector x with xᵀSx < 0) or None
    (undecided); `definite` likewise for S > 0; `reason` is a sentence.

    >>> definiteness(sp.csr_array([[2.0, -1.0], [-1.0, 2.0]])).definite
    True
    """

    semidefinite: bool | None
    definite: bool | None
    reason: str
    witness: Vector | None = None


def definiteness(S: sp.csr_array) -> Definiteness:
    """Decide whether the symmetric matrix `S` (CSR, n × n) is positive (semi)definite.

    Gershgorin: s_ii ≥ Σ|s_ij| in every row proves semidefiniteness, with > definiteness. Otherwise S, its
    diagonal scaled to 1, plus δI, δ the size of the factorisation's own rounding, is factorised with diagonal pivots:
    that is LDLᵀ up to a symmetric permutation, and by Sylvester's law D has the signs of the eigenvalues. A negative
    pivot gives a vector x, which is checked. S is called definite only if the pivots with −δI are positive as well: a
    positive pivot of S itself is no eigenvalue.

    >>> found = definiteness(sp.csr_array([[1.0, 2.0], [2.0, 1.0]]))
    >>> found.semidefinite, bool(found.witness @ [[1.0, 2.0], [2.0, 1.0]] @ found.witness < 0)
    (False, True)
    >>> definiteness(sp.csr_array((3, 3))).semidefinite
    True
    >>> definiteness(sp.csr_array([[1.0, -1.0], [-1.0, 1.0]])).definite is None
    True
    """
    S = sp.csr_array(S)
    n = S.shape[0]
    diagonal = S.diagonal()
    radius = np.asarray(abs(S).sum(axis=1)).reshape(-1) - np.abs(diagonal)
    if (diagonal > radius).all():
        return Definiteness(True, True, "strictly diagonally dominant with positive diagonal (Gershgorin)")
    semidefinite = bool((diagonal >= radius).all())
    if (diagonal < 0).any():
        i = int(np.argmin(diagonal))
        return Definiteness(
            False, False, f"its diagonal entry {diagonal[i]:g} in row {i} is negative", np.eye(1, n, i)[0]
        )
    if not S.nnz or not S.data.any():
        return Definiteness(True, False, "zero matrix")
    witness = _witness_of_two(S, diagonal)
    if witness is not None:
        return _indefinite(S, witness)
    # the same inertia with a diagonal of ones, so that large rows do not hide small ones
    weight = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
    scaled = sp.csr_array(sp.diags_array(weight) @ S @ sp.diags_array(weight))
    delta = 8 * n * UNIT_ROUNDOFF * float(np.asarray(abs(scaled).sum(axis=1)).max())
    smallest, witness = _smallest_pivot(sp.csr_array(scaled + delta * sp.eye_array(n)))
    if smallest is not None and smallest > 0:
        lower, _ = _smallest_pivot(sp.csr_array(scaled - delta * sp.eye_array(n)))
        definite = True if lower is not None and lower > 0 else None
        name = "definite" if definite else "semidefinite up to rounding"
        return Definiteness(True, definite, f"positive {name}: all pivots of its LDL^T factorisation are positive")
    if semidefinite:
        return Definiteness(True, None, "diagonally dominant with nonnegative diagonal (Gershgorin)")
    if witness is not None:
        return _indefinite(S, weight * witness)
    return Definiteness(None, None, _UNDECIDED)


_UNDECIDED = "its factorisation met a pivot of either sign within rounding"


def _indefinite(S: sp.csr_array, x: Vector) -> Definiteness:
    """Indefinite with the witness `x`, brought to unit length, if xᵀSx is indeed negative."""
    x = x / np.abs(x).max()
    x /= np.linalg.norm(x)
    curvature = float(x @ (S @ x))
    if not curvature < 0:
        return Definiteness(None, None, _UNDECIDED)
    return Definiteness(False, False, f"indefinite: x'Sx = {curvature:.3g} for a unit vector x", x)


def _witness_of_two(S: sp.csr_array, diagonal: Vector) -> Vector | None:
    """x with two nonzero entries and xᵀSx < 0 where |s_ij| > √(s_ii s_jj) plainly; no semidefinite S has that."""
    rows, root = row_of(S), np.sqrt(diagonal)
    off = rows != S.indices
    excess = np.abs(S.data) > root[rows] * root[S.indices] * (1 + 1e-8)
    found = np.flatnonzero(off & excess & (S.data != 0))
    if not found.size:
        return None
    k = int(found[np.argmax(np.abs(S.data[found]))])
    i, j, s = int(rows[k]), int(S.indices[k]), float(S.data[k])
    if diagonal[i] == 0:
        i, j = j, i
    x = np.zeros(S.shape[0])
    if diagonal[j] > 0:  # both are positive: in their units the value is 2 - 2|s|/sqrt(s_ii s_jj)
        x[i], x[j] = 1.0 / root[i], -np.sign(s) / root[j]
    else:  # linear in x_j: far enough out it is negative
        x[i], x[j] = 1.0, -np.sign(s) * (diagonal[i] / abs(s) + 1.0)
    return x


def _smallest_pivot(S: sp.csr_array) -> tuple[float | None, Vector | None]:
    """The smallest pivot of S = LDLᵀ (diagonal pivots only) and, where it is negative, a unit x with xᵀSx < 0."""
    from scipy.sparse.linalg import splu, spsolve_triangular

    try:
        lu = splu(sp.csc_array(S), permc_spec="MMD_AT_PLUS_A", diag_pivot_thresh=0.0, options={"SymmetricMode": True})
    except RuntimeError:
        return None, None
    if not np.array_equal(lu.perm_r, lu.perm_c):
        return None, None
    pivots = lu.U.diagonal()
    k = int(np.argmin(pivots))
    if pivots[k] > 0:
        return float(pivots[k]), None
    # L^T y = e_k gives y^T (P S P^T) y = pivot_k
    y = spsolve_triangular(sp.csr_array(lu.L.T), np.eye(1, S.shape[0], k)[0], lower=False)
    x = np.asarray(y)[lu.perm_c]
    return float(pivots[k]), x / np.linalg.norm(x)
