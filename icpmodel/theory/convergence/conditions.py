"""The convergence conditions of the theorems as monotone maps: a condition holds where the spectral radius is below 1.

Notation: M̂ = M₁ + φ, N̂ = M̂ − A, X = M̂ + Ω, m̂ and D the diagonals of M̂ and A, |ψ(x) − ψ(y)| ≤ G|x − y|. ⟨·⟩ is the
comparison matrix, off(·) the part off the diagonal, and (D − Ω)⁺ = 0 in the theorems as printed, where φ₂ ≥ φ₁D.

**sharper.** The step z⁺ = z − 2X⁻¹min(p, Ωr) gives z⁺ − y⁺ = X⁻¹(Θ(X − 2A) + (I − Θ)(X − 2Ω + 2ΩΓ))(z − y) with a
diagonal 0 ≤ Θ ≤ I and |Γ| ≤ G, because min(a, b) − min(c, d) is a mean of a − c and b − d. So |z⁺ − y⁺| ≤ T(|z − y|),

    T(v) = |X⁻¹| max(|X − 2A|v, (|X − 2Ω| + 2ΩG)v).

T(v) ≤ σv with v > 0, σ < 1 makes the step a contraction by σ in max_i |z_i|/v_i. By Banach it has one fixed point,
which is the one zero of min(p, Ωr), that is the one solution, and converges to it from everywhere.

**4.1** is T with both parts replaced by |N̂| + |A − Ω| + 2ΩG, the sum L of the paper. X − 2A = N̂ − (A − Ω) and
X − 2Ω = N̂ + (A − Ω): the same v and σ serve "sharper".

**4.2.** K = 2(diag(min(m̂, D)) − (D − Ω)⁺) − off(|M̂| + |N̂| + |A|) − 2ΩG is a nonsingular M-matrix. Then its diagonal is
positive, hence m̂ > 0 and D > 0, and ⟨X⟩ = diag(m̂ + Ω) − off(|M̂|). m̂ − |m̂ − d| = 2min(m̂, d) − d and
ω − |d − ω| = 2min(d, ω) − d = d − 2(d − ω)⁺ add up to K = ⟨X⟩ − F, F = |N̂| + |A − Ω| + 2ΩG. Some v > 0 has Kv > 0, so
⟨X⟩v > Fv ≥ 0: X is an H-matrix, |X⁻¹|Fv ≤ ⟨X⟩⁻¹Fv < v, and 4.1 holds with this v. Nothing else is needed, neither that
A is an H₊-matrix (it follows) nor Ω ≥ D.

**4.3** (AOR, D > 0, φ ≥ 0, θ₁ > 0, θ₂ ≥ 0): max(θ₁, θ₂)·ρ < min(1, θ₁), ρ = ρ(D⁻¹(|B| + ΩG + (D − Ω)⁺)). Then
θ₁min(m̂, d) ≥ min(1, θ₁)d, and θ₂|l| + |θ₁ − θ₂||l| + θ₁|l| ≤ 2max(θ₁, θ₂)|l| below the diagonal, 2θ₁|u| above it, so
θ₁K ≥ 2(min(1, θ₁)D − max(θ₁, θ₂)(|B| + ΩG + (D − Ω)⁺)), an M-matrix; K is a Z-matrix above it: 4.2 holds.

**4.4** (D > 0): (⟨M̂⟩ − |N̂| − (D − Ω)⁺ − ΩG)v > 0 for some v > 0. Then |m̂| > |n̂| and m̂ − n̂ = d > 0, so m̂ > 0, and
½(⟨X⟩ − F) exceeds this matrix: on the diagonal by ½(|n̂| − n̂) ≥ 0, off it because |A| ≤ |M̂| + |N̂|. 4.1 holds with v.
Without D > 0 it is false: A = M₁ = −1, Ω = 1 has X = 0.

Reference: Kumar, Deepmala and Das, theorems 4.1 to 4.4, corrected; Berman and Plemmons (1979), chapter 6.
"""

from __future__ import annotations

from fractions import Fraction

import numpy as np
import scipy.sparse as sp

from ...algebra.splittings import AOR
from ...numerics.arrays import Vector
from ...numerics.rounding import UNIT_ROUNDOFF
from .absolute import Comparison, absolute_inverse
from .contraction import MonotoneMap
from .parts import Parts, off_diagonal

#: φ₂ ≥ φ₁D is read up to the rounding of φ₂/φ₁
_EQUAL = 1.0 - 2.0**-50


def sharper(parts: Parts) -> MonotoneMap:
    """T(v) = |X⁻¹| max(|X − 2A|v, (|X − 2Ω| + 2ΩG)v)."""
    X, omega = parts.X, sp.diags_array(parts.omega)
    first = sp.csr_array(abs(X - 2.0 * parts.A))
    second = sp.csr_array(abs(X - 2.0 * omega) + 2.0 * parts.omega_G)
    return MonotoneMap(absolute_inverse(X, parts.size), (first, second), parts.size)


def theorem_41(parts: Parts) -> MonotoneMap:
    """v ↦ Lv, L = |X⁻¹|(|N̂| + |A − Ω| + 2ΩG)."""
    F = abs(parts.N) + abs(parts.A - sp.diags_array(parts.omega)) + 2.0 * parts.omega_G
    return MonotoneMap(absolute_inverse(parts.X, parts.size), (sp.csr_array(F),), parts.size)


def theorem_42(parts: Parts) -> MonotoneMap | str:
    """v ↦ min(m̂, D)⁻¹(½off(|M̂| + |N̂| + |A|) + ΩG + (D − Ω)⁺)v, or why min(m̂, D) is not positive."""
    half = 0.5 * (off_diagonal(parts.M) + off_diagonal(parts.N) + off_diagonal(parts.A))
    diagonal = np.minimum(parts.M.diagonal(), parts.D)
    return _jacobi(parts, "min(m, a)", diagonal, half + parts.omega_G + parts.short)


def theorem_43(parts: Parts, *, as_printed: bool = False) -> MonotoneMap | str:
    """v ↦ (max(θ₁, θ₂)/min(1, θ₁))·D⁻¹(|B| + ΩG + (D − Ω)⁺)v, as printed D⁻¹|B| + φ₂G, or which sign is wrong."""
    theta = parts.splitting
    if not isinstance(theta, AOR):
        return "it is about AOR splittings only"
    B, factor = off_diagonal(parts.A), theta_factor(theta)
    if as_printed:
        if not (parts.D > 0).all():
            return f"A is not an H+-matrix: its diagonal has the entry {parts.D.min():g}"
        if not (parts.omega >= parts.D * _EQUAL).all():
            return "phi2 >= phi1 D does not hold"
        phi2_G = sp.diags_array(parts.phi1 * parts.omega) @ parts.G
        return _plain(factor * (sp.diags_array(1.0 / parts.D) @ B + phi2_G), np.ones(parts.n))
    if (parts.phi < 0).any():
        return f"phi has the negative entry {parts.phi.min():g}"
    if theta.theta2 < 0:
        return f"theta2 = {theta.theta2:g} is negative"
    return _jacobi(parts, "D", parts.D, factor * (B + parts.omega_G + parts.short))


def theorem_44(parts: Parts) -> MonotoneMap | str:
    """v ↦ m̂⁻¹(off(|M̂|) + |N̂| + (D − Ω)⁺ + ΩG)v, or which diagonal is not positive."""
    if not (parts.D > 0).all():
        return f"the diagonal of A has the entry {parts.D.min():g}, not positive"
    F = off_diagonal(parts.M) + abs(parts.N) + parts.short + parts.omega_G
    return _jacobi(parts, "the diagonal of M1 + phi", parts.M.diagonal(), F)


def printed_42(parts: Parts) -> MonotoneMap | str:
    """The H-splitting condition v ↦ |m̂|⁻¹(off(|M̂|) + |N̂|)v where the bounds on g_ij hold, or which fails.

    g_ii ≤ (|n_ii + φ_ii| − n_ii − |φ_ii|)/2ω_ii and g_ij ≤ (|m_ij| + |n_ij| − |a_ij|)/2ω_ii (φ₁ cancels), read up to
    rounding.
    """
    if not (parts.D > 0).all():
        return f"A is not an H+-matrix: its diagonal has the entry {parts.D.min():g}"
    if not (parts.omega >= parts.D * _EQUAL).all():
        return "phi2 >= phi1 D does not hold"
    n1 = parts.M1.diagonal() - parts.D
    N1 = sp.csr_array(parts.M1 - parts.A)
    bound = off_diagonal(parts.M1) + off_diagonal(N1) - off_diagonal(parts.A)
    bound = sp.csr_array(bound + sp.diags_array(np.abs(n1 + parts.phi) - n1 - np.abs(parts.phi)))
    half = sp.diags_array(0.5 / parts.omega)
    # up to rounding: for most splittings the bounds are zero
    excess = sp.coo_array(parts.G - half @ (bound + (16 * UNIT_ROUNDOFF) * parts.size))
    if excess.nnz and excess.data.max() > 0:
        k = int(np.argmax(excess.data))
        i, j = int(excess.coords[0][k]), int(excess.coords[1][k])
        return f"g[{i}, {j}] = {parts.G[i, j]:g} exceeds its bound {0.5 * bound[i, j] / parts.omega[i]:.3g}"
    return _h_splitting(parts)


def printed_44(parts: Parts) -> MonotoneMap | str:
    """(⟨φ₁M₁ + φ⟩ − |φ₁N₁ + φ| − φ₂G − (φ₁D − φ₂)⁺)v > 0 with an H-splitting that the same v proves.

    Case (1) has φ₂ ≥ φ₁D in every row, case (2) φ₂ < φ₁D in every row. φ stands as printed, not multiplied by φ₁.
    """
    above = parts.omega >= parts.D * _EQUAL
    if above.any() and not above.all():
        return "neither phi2 >= phi1 D nor phi2 < phi1 D holds in every row"
    splitting = _h_splitting(parts)
    if isinstance(splitting, str):
        return splitting
    phi1, phi = sp.diags_array(parts.phi1), sp.diags_array(parts.phi)
    M, N = phi1 @ parts.M1 + phi, phi1 @ (parts.M1 - parts.A) + phi
    F = off_diagonal(sp.csr_array(M)) + abs(N) + phi1 @ parts.omega_G
    diagonal = np.abs(M.diagonal())
    if not above.all():
        F = F + phi1 @ parts.short
    if not (diagonal > 0).all():
        return "phi1 m + phi has a zero on its diagonal"
    both = (splitting.parts[0], sp.csr_array(sp.diags_array(1.0 / diagonal) @ F))
    size = sp.csr_array(both[0] + both[1] + sp.eye_array(parts.n))
    return MonotoneMap(absolute_inverse(sp.csr_array(sp.eye_array(parts.n)), size), both, size)


def theta_factor(theta: AOR) -> float:
    """max(θ₁, θ₂)/min(1, θ₁), rounded up."""
    above, below = float(max(theta.theta1, theta.theta2)), float(min(1.0, theta.theta1))
    factor = above / below
    exact = np.isfinite(factor) and Fraction(factor) * Fraction(below) == Fraction(above)
    return factor if exact else float(np.nextafter(factor, np.inf))


def _h_splitting(parts: Parts) -> MonotoneMap | str:
    """⟨M̂⟩ − |N̂| is a nonsingular M-matrix."""
    diagonal = np.abs(parts.M.diagonal())
    if not (diagonal > 0).all() or not (parts.D > 0).all():
        return "no H-splitting of an H+-matrix: a diagonal entry of A is not positive or one of M1 + phi is zero"
    return _plain(off_diagonal(parts.M) + abs(parts.N), diagonal)


def _plain(F: sp.csr_array, diagonal: Vector) -> MonotoneMap:
    F = sp.csr_array(sp.diags_array(1.0 / diagonal) @ F)
    one = sp.csr_array(sp.eye_array(diagonal.size))
    size = sp.csr_array(F + one)
    return MonotoneMap(Comparison(one, size), (F,), size)


def _jacobi(parts: Parts, name: str, diagonal: Vector, F: sp.csr_array) -> MonotoneMap | str:
    """v ↦ diag(`diagonal`)⁻¹Fv: below 1 exactly where diag − F is a nonsingular M-matrix."""
    if not (diagonal > 0).all():
        i = int(np.argmin(diagonal > 0))
        return f"{name} is {diagonal[i]:g} in row {i}, not positive"
    F, S = sp.csr_array(F), sp.csr_array(sp.diags_array(diagonal))
    # F is at most a few times the size, which the factor of theorem 4.3 may exceed
    size = sp.csr_array(parts.size + F)
    return MonotoneMap(Comparison(S, size), (F,), size)
