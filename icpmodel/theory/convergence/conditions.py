"""The convergence conditions of the theorems as monotone maps: a condition holds where the spectral radius is below 1.

Notation: M̂ = M₁ + φ, N̂ = M̂ − A, X = M̂ + Ω, m̂ and D the diagonals of M̂ and A, |ψ(x) − ψ(y)| ≤
G|x − y|. ⟨·⟩ is the comparison matrix, off(·) the part off the diagonal. In the theorems as printed
(D − Ω)⁺ = 0 and φ₂ ≥ φ₁D.

**sharper.** Let z⁺ = z − 2X⁻¹min(p, Ωr). As min(a, b) − min(c, d) is a weighted mean of a − c and
b − d, with some diagonal 0 ≤ Θ ≤ I and |Γ| ≤ G the difference of two steps is:

    z⁺ − y⁺ = X⁻¹(Θ(X − 2A) + (I − Θ)(X − 2Ω + 2ΩΓ))(z − y).

So |z⁺ − y⁺| ≤ T(|z − y|) with

    T(v) = |X⁻¹| max(|X − 2A|v, (|X − 2Ω| + 2ΩG)v).

T(v) ≤ σv with v > 0, σ < 1 makes the step a contraction by σ in max_i |z_i|/v_i. By Banach it has
one fixed point and converges to it from everywhere. The fixed point is the one zero of min(p, Ωr),
that is the one solution.

**Two obstacles.** Let ψ̄ be an upper obstacle, |ψ̄(x) − ψ̄(y)| ≤ G|x − y|. Then the same T serves.
The step z⁺ = z − 2X⁻¹F has F = max(Ω(z − ψ̄), min(p, Ωr)), the median mid(Ω(z − ψ̄), p, Ωr) where ψ
≤ ψ̄. The difference of two maxima is, like that of two minima, a mean of the differences of their
arguments. So F(z) − F(y) is in every row a mean of three differences, with weights that depend on z
and y. Those of the obstacles, Ω(I − Γ)(z − y) and Ω(I − Γ̄)(z − y), have a mean of the same form.
The same holds of mid with any rows scaled, hence of the error bounds in `certificates`. It also
holds of maxima and minima of two isotone functions.

The one zero z° of F says less than with one obstacle. Every solution is a zero of F, and a zero is
a solution if and only if ψ(z°) ≤ ψ̄(z°). For F_i = 0 says there that p_i ≥ 0 and z_i = ψ_i, or p_i
≤ 0 and z_i = ψ̄_i, or p_i = 0 between them. Where ψ_i > ψ̄_i it says z_i = ψ̄_i. So there is one
solution, z°, if ψ ≤ ψ̄ there, and else there is none; the method converges to z° in both cases.

**4.1** is T with both parts replaced by |N̂| + |A − Ω| + 2ΩG, the sum L of the paper. As X − 2A =
N̂ − (A − Ω) and X − 2Ω = N̂ + (A − Ω), the same v and σ serve "sharper".

**4.2.** The condition is that K = 2(diag(min(m̂, D)) − (D − Ω)⁺) − off(|M̂| + |N̂| + |A|) − 2ΩG is
a nonsingular M-matrix. Then its diagonal is positive, hence m̂ > 0 and D > 0, and ⟨X⟩ = diag(m̂ +
Ω) − off(|M̂|). With d in D and ω in Ω,
m̂ − |m̂ − d| = 2min(m̂, d) − d and ω − |d − ω| = 2min(d, ω) − d = d − 2(d − ω)⁺. They add up to
K = ⟨X⟩ − F, F = |N̂| + |A − Ω| + 2ΩG. Some v > 0 has Kv > 0, so ⟨X⟩v > Fv ≥ 0. So X is an
H-matrix, |X⁻¹|Fv ≤ ⟨X⟩⁻¹Fv < v, and 4.1 holds with this v. Nothing else is needed: neither that A
is an H₊-matrix (it follows) nor Ω ≥ D.

**4.3** (AOR, D > 0, φ ≥ 0, θ₁ > 0, θ₂ ≥ 0). The condition is max(θ₁, θ₂)·ρ < min(1, θ₁), ρ =
ρ(D⁻¹(|B| + ΩG + (D − Ω)⁺)). Then θ₁min(m̂, d) ≥ min(1, θ₁)d. Below the diagonal θ₂|l| + |θ₁ −
θ₂||l| + θ₁|l| ≤ 2max(θ₁, θ₂)|l|, and above it the sum is 2θ₁|u|. So θ₁K ≥ 2(min(1, θ₁)D − max(θ₁,
θ₂)(|B| + ΩG + (D − Ω)⁺)), an M-matrix. K is a Z-matrix above it, so 4.2 holds.

**4.4** (D > 0). The condition is (⟨M̂⟩ − |N̂| − (D − Ω)⁺ − ΩG)v > 0 for some v > 0. Then |m̂| >
|n̂| and m̂ − n̂ = d > 0, so m̂ > 0. ½(⟨X⟩ − F) exceeds this matrix, on the diagonal by ½(|n̂| − n̂)
≥ 0, and off it because |A| ≤ |M̂| + |N̂|. So 4.1 holds with v. Without D > 0 it is false: A = M₁ =
−1, Ω = 1 has X = 0.

References
----------
Kumar, Deepmala and Das, theorems 4.1 to 4.4, corrected. Berman and Plemmons (1979), chapter 6.
"""

from __future__ import annotations

from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...algebra.splittings import AOR, Member
from ...errors import InputError
from ...numerics import work
from ...numerics.arrays import Mask, Vector, as_csr, as_vector, described, row_of, with_entries
from ...numerics.equilibration import times_rows
from ...numerics.rounding import UNIT_ROUNDOFF
from ...numerics.sparse_structure import absolute, diagonal_positions
from ...problem.data import ProblemData, as_problem
from ..matrices.comparison_matrix import positive_diagonal
from .contraction import ComparisonInverse, MonotoneMap, absolute_inverse


class StepMatrices:
    """M₁, M̂ = M₁ + φ, N̂ = M̂ − A, X = M̂ + Ω as CSR and D, φ, φ₁, Ω as vectors, of `member` on `problem`.

    M₁, M̂ and X store every diagonal entry. Every matrix that a theorem makes of these is at most 2·`size`, entry by
    entry; `rounding_bound` covers its rounding errors. Where the modulus uses the newest values, no X is ever inverted.
    """

    def __init__(self, problem: ProblemData, member: Member) -> None:
        problem = as_problem(problem)
        if isinstance(member, str | type):
            raise InputError(f"member is {described(member)}; a Method object was expected, such as MNMGS()")
        if not (hasattr(member, "splitting_of") and hasattr(member, "omega_of")):
            expected = "a method of the modulus family, such as icpmodel.MNMGS()"
            raise InputError(f"member is {member!r}; {expected}, was expected")
        self.problem = problem
        self.G: Any = problem.psi.lipschitz  # None where it is not known: then there is no `size`
        self.A, self.n = problem.A, problem.n
        self.D = problem.A.diagonal()
        self.splitting = member.splitting_of()
        self.sees_newest = bool(getattr(member, "sees_newest", False))
        self.omega = member.omega_of(problem)
        self.phi = as_vector(member.phi, self.n, "phi")
        self.phi1 = as_vector(getattr(member, "phi1", 1.0), self.n, "phi1")
        work.charge_matrices(self.A.nnz, 6)
        with np.errstate(all="ignore"):  # what overflows proves nothing
            self.M1 = as_csr(self.splitting.matrix(self.A), "M1", keep_diagonal=True)
            diagonal = diagonal_positions(self.M1)
            self.M = _add_to_diagonal(self.M1, diagonal, self.phi)
            self.N = sp.csr_array(self.M - self.A)
            self.X = _add_to_diagonal(self.M, diagonal, self.omega)
            #: (D − Ω)⁺, without entries where Ω ≥ D
            self.omega_deficit = sp.csr_array(sp.diags_array(np.maximum(self.D - self.omega, 0.0)))
        #: a theorem's number is improved until it is below this one: 1 if only whether it holds is needed
        self.target = 0.0
        #: vectors v > 0 that proved one theorem and may prove the next
        self.vectors: list[Vector] = []

    @property
    def relaxation(self) -> float:
        """ω where M₁ = D/ω − L; NaN for any other M₁."""
        sor = self.splitting
        return float(sor.theta1) if isinstance(sor, AOR) and sor.theta1 == sor.theta2 else np.nan

    @cached_property
    def omega_G(self) -> sp.csr_array:
        """ΩG."""
        return times_rows(self.omega, self.G)

    @cached_property
    def size(self) -> sp.csr_array:
        """|M₁| + |φ| + Ω + |A| + |D| + ΩG."""
        diagonal = np.abs(self.phi) + self.omega + np.abs(self.D)
        return total(absolute(self.M1), absolute(self.A), self.omega_G, sp.diags_array(diagonal))


def off_diagonal(matrix: sp.csr_array) -> sp.csr_array:
    """|`matrix`| with a zero diagonal."""
    data = np.abs(matrix.data)
    own = matrix.indices == row_of(matrix)
    data[own] -= data[own]  # NaN where it is infinite
    return with_entries(matrix, data)


def total(*terms: Any) -> sp.csr_array:
    """The sum of sparse matrices; those without entries cost nothing."""
    return sp.csr_array(sum([one for one in terms if one.nnz] or terms[:1]))


def _add_to_diagonal(matrix: sp.csr_array, positions: Any, by: Vector) -> sp.csr_array:
    data = matrix.data.copy()
    data[positions] += by
    return with_entries(matrix, data)


def sharper(step: StepMatrices) -> MonotoneMap:
    """T(v) = |X⁻¹| max(|X − 2A|v, (|X − 2Ω| + 2ΩG)v)."""
    work.charge_matrices(step.size.nnz, 6)
    X = step.X
    omega = sp.diags_array(step.omega)
    first = sp.csr_array(abs(X - 2.0 * step.A))
    second = total(abs(X - 2.0 * omega), 2.0 * step.omega_G)
    return MonotoneMap(absolute_inverse(X, step.size), (first, second), step.size)


def theorem_41(step: StepMatrices) -> MonotoneMap:
    """v ↦ Lv, L = |X⁻¹|(|N̂| + |A − Ω| + 2ΩG)."""
    work.charge_matrices(step.size.nnz, 6)
    F = total(absolute(step.N), abs(step.A - sp.diags_array(step.omega)), 2.0 * step.omega_G)
    return MonotoneMap(absolute_inverse(step.X, step.size), (F,), step.size)


def theorem_42(step: StepMatrices) -> MonotoneMap | str:
    """v ↦ min(m̂, D)⁻¹(½off(|M̂| + |N̂| + |A|) + ΩG + (D − Ω)⁺)v, or why min(m̂, D) is not positive."""
    half = 0.5 * (off_diagonal(step.M) + off_diagonal(step.N) + off_diagonal(step.A))
    diagonal = np.minimum(step.M.diagonal(), step.D)
    return _jacobi(step, "min(m, a)", diagonal, total(half, step.omega_G, step.omega_deficit))


def theorem_43(step: StepMatrices, *, as_printed: bool = False) -> MonotoneMap | str:
    """v ↦ (max(θ₁, θ₂)/min(1, θ₁))·D⁻¹(|B| + ΩG + (D − Ω)⁺)v, as printed D⁻¹|B| + φ₂G, or why 4.3 does not apply."""
    theta = step.splitting
    if not isinstance(theta, AOR):
        return "it is about AOR splittings only"
    parts = [off_diagonal(step.A), step.omega_G, step.omega_deficit]
    if as_printed:
        if reason := _not_as_printed(step):
            return reason
        parts[1:] = [times_rows(step.phi1 * step.D, step.omega_G)]
    elif (step.phi < 0).any():
        return f"phi has the negative entry {step.phi.min():g}"
    elif theta.theta2 < 0:
        return f"theta2 = {theta.theta2:g} is negative"
    factor = theta_factor(theta)
    return _jacobi(step, "D", step.D, factor * total(*parts), limit=1.0 / factor)


def theorem_44(step: StepMatrices) -> MonotoneMap | str:
    """v ↦ m̂⁻¹(off(|M̂|) + |N̂| + (D − Ω)⁺ + ΩG)v, or which diagonal is not positive."""
    if not (positive := positive_diagonal(step.A)).holds:
        return positive.reason
    F = total(off_diagonal(step.M), absolute(step.N), step.omega_deficit, step.omega_G)
    return _jacobi(step, "the diagonal of M1 + phi", step.M.diagonal(), F)


def printed_42(step: StepMatrices) -> MonotoneMap | str:
    """The H-splitting condition v ↦ |m̂|⁻¹(off(|M̂|) + |N̂|)v where the bounds on g_ij hold, or what fails.

    g_ii ≤ (|n_ii + φ_ii| − n_ii − |φ_ii|)/2ω_ii and g_ij ≤ (|m_ij| + |n_ij| − |a_ij|)/2ω_ii (φ₁ cancels), checked up to
    rounding.
    """
    if reason := _not_as_printed(step):
        return reason
    n1 = step.M1.diagonal() - step.D
    N1 = sp.csr_array(step.M1 - step.A)
    bound = off_diagonal(step.M1) + off_diagonal(N1) - off_diagonal(step.A)
    bound = sp.csr_array(bound + sp.diags_array(np.abs(n1 + step.phi) - n1 - np.abs(step.phi)))
    # up to rounding: for most splittings the bounds are zero
    excess = sp.coo_array(step.G - times_rows(0.5 / step.omega, bound + (16 * UNIT_ROUNDOFF) * step.size))
    if excess.nnz and excess.data.max() > 0:
        k = int(np.argmax(excess.data))
        i = int(excess.coords[0][k])
        j = int(excess.coords[1][k])
        return f"g[{i}, {j}] = {step.G[i, j]:g} exceeds its bound {0.5 * bound[i, j] / step.omega[i]:.3g}"
    splitting = _h_splitting(step)
    return splitting if isinstance(splitting, str) else _jacobi(step, "|m|", *splitting)


def printed_44(step: StepMatrices) -> MonotoneMap | str:
    """(⟨φ₁M₁ + φ⟩ − |φ₁N₁ + φ| − φ₂G − (φ₁D − φ₂)⁺)v > 0 with an H-splitting that the same v proves, or what fails.

    Case (1) has φ₂ ≥ φ₁D in every row, case (2) φ₂ < φ₁D in every row. φ stands as printed, not multiplied by φ₁.
    """
    above = _reaches_diagonal(step)
    if above.any() and not above.all():
        return "neither phi2 >= phi1 D nor phi2 < phi1 D holds in every row"
    splitting = _h_splitting(step)
    if isinstance(splitting, str):
        return splitting
    phi = sp.diags_array(step.phi)
    M, N = (sp.csr_array(times_rows(step.phi1, part) + phi) for part in (step.M1, step.M1 - step.A))
    F = total(off_diagonal(M), abs(N), *(times_rows(step.phi1, one) for one in (step.omega_G, step.omega_deficit)))
    scale = np.abs(M.diagonal())
    if not (scale > 0).all():
        return "phi1 m + phi has a zero on its diagonal"
    diagonal, part = splitting
    return _jacobi(step, "|m|", diagonal, part, times_rows(diagonal / scale, F))


def _not_as_printed(step: StepMatrices) -> str:
    """Which of D > 0 and φ₂ ≥ φ₁D, required by 4.2 and 4.3 as printed, does not hold; empty if both hold."""
    if not (positive := positive_diagonal(step.A)).holds:
        return f"A is not an H+-matrix: {positive.reason}"
    return "" if _reaches_diagonal(step).all() else "phi2 >= phi1 D does not hold"


def _reaches_diagonal(step: StepMatrices) -> Mask:
    """Where φ₂ ≥ φ₁D, up to the rounding of φ₂/φ₁."""
    return step.omega >= step.D * (1.0 - 8.0 * UNIT_ROUNDOFF)


def theta_factor(theta: AOR) -> float:
    """max(θ₁, θ₂)/min(1, θ₁), rounded up."""
    above = float(max(theta.theta1, theta.theta2))
    below = float(min(1.0, theta.theta1))
    return above / below if below in (1.0, above) else float(np.nextafter(above / below, np.inf))


def _h_splitting(step: StepMatrices) -> tuple[Vector, sp.csr_array] | str:
    """|m̂| and off(|M̂|) + |N̂|, whose difference is ⟨M̂⟩ − |N̂|; or which diagonal rules out an H-splitting."""
    diagonal = np.abs(step.M.diagonal())
    if not (diagonal > 0).all() or not (step.D > 0).all():
        return "no H-splitting of an H+-matrix: a diagonal entry of A is not positive or one of M1 + phi is zero"
    return diagonal, sp.csr_array(off_diagonal(step.M) + absolute(step.N))


def _jacobi(
    step: StepMatrices, name: str, diagonal: Vector, *parts: sp.csr_array, limit: float = 1.0
) -> MonotoneMap | str:
    """v ↦ max_k diag(`diagonal`)⁻¹F_kv, F_k the `parts`; or which entry of the diagonal is not positive.

    Its radius is below 1 if and only if one v > 0 proves all diag(`diagonal`) − F_k to be M-matrices.
    """
    if not (diagonal > 0).all():
        i = int(np.argmin(diagonal > 0))
        return f"{name} is {diagonal[i]:g} in row {i}, not positive"
    work.charge_matrices(step.size.nnz, 4)
    S = sp.csr_array(sp.diags_array(diagonal))
    # a part is at most a few times `size`, except that the factor of theorem 4.3 may be large
    size = total(step.size, *parts)
    return MonotoneMap(ComparisonInverse(S, size), parts, size, limit)
