"""Two theorems on the structure of A, not on the size of its entries: isotone steps, and positive definite A.

**monotone.** Let X = M₁ + φ + Ω be diagonal, X ≥ 2D, X ≥ 2Ω, A a Z-matrix and ψ isotone (x ≤ y
gives ψ(x) ≤ ψ(y)). In row i the step z⁺ = z − 2X⁻¹min(p, Ωr) is the larger of two numbers:

    z_i − (2/x_i)p_i(z)   and   z_i − (2ω_i/x_i)(z_i − ψ_i(z)).

Their coefficients 1 − 2d_i/x_i, −2a_ij/x_i and 1 − 2ω_i/x_i are ≥ 0, so the step is isotone. Let
F(s) = min(p(s), r(s)) ≥ 0 (s is a supersolution). Then the step decreases from s, and by induction
all steps do. With a subsolution t ≤ s (F(t) ≤ 0) it stays above t, so it converges. The limit is a
solution because ψ is continuous: the largest one between t and s. From t it increases to the
smallest. For M₁ = D the condition on X is φ ≥ |D − Ω|.

For projected SOR the modulus uses the newest values. There D > 0 and ω ≤ 1 replace the conditions
on X. Row by row z_i⁺ is the larger of ψ_i(z) and (1 − ω)z_i − (ω/a_ii)(Σ_{j≠i} a_ij z_j + q_i),
with the newest z, whose coefficients are ≥ 0. Where z_j⁺ ≤ s_j for j < i the newest p_i is at least
p_i(s) ≥ 0, so a sweep from s decreases.

With an isotone upper obstacle ψ̄, z_i⁺ is the minimum of the above and (1 − 2ω_i/x_i)z_i +
(2ω_i/x_i)ψ̄_i(z), or ψ̄_i(z) in projected SOR. So it is isotone too. F is then max(z − ψ̄, min(p,
r)). F(s) ≥ 0 says in each row that s_i ≥ ψ̄_i(s), or p_i ≥ 0 and r_i ≥ 0. The rest holds, but the
limit is a solution only if ψ ≤ ψ̄ there, see `conditions`.

**definite.** Let A be positive definite (xᵀAx > 0, symmetric or not), M₁ = A, φ = 0, Ω any positive
diagonal. Let ψ, and ψ̄ where there is one, be constant (rows without obstacle included). Write A' =
Ω^(−½)AΩ^(−½), also positive definite, K = A' + I and e = Ω^½(z − z*). Then with a diagonal 0 ≤ Θ ≤
I

    e⁺ = (I − 2K⁻¹(ΘA' + I − Θ))e = K⁻¹(I − 2Θ)(A' − I)e.

So w = Ke has ‖w⁺‖₂ ≤ σ‖w‖₂, σ = ‖(A' − I)K⁻¹‖₂. Let H be the symmetric part of A', and ‖Kx‖² − ‖(A'
− I)x‖² = 4xᵀHx. For symmetric A' with eigenvalues λ, σ = max|1 − λ|/(1 + λ). For others σ² ≤ 1 −
4λ_min(H)/(‖A'‖₂ + 1)². ‖Kx‖² = ‖x‖² + 2xᵀHx + ‖A'x‖² ≥ ‖x‖², hence ‖eᵏ‖₂ ≤ σᵏ‖Ke⁰‖₂. It is a
Peaceman–Rachford iteration.

References
----------
Bensoussan and Lions, Impulse Control and Quasi-Variational Inequalities (1984). Peaceman and
Rachford, J. SIAM 3 (1955). Ortega and Rheinboldt (1970), section 13.2, for monotone convergence.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import row_of
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF, rounded_up
from ...numerics.sparse_structure import is_symmetric
from ..answers import Answer
from ..certificates.bounds import classes_of
from ..certificates.definite import MAX_UNKNOWNS
from ..matrices.comparison_matrix import positive_diagonal, z_matrix
from ..matrices.eigenvalue import largest_above, smallest_below, within_reach
from .conditions import StepMatrices

MONOTONE = (
    "Let A be a Z-matrix and ψ continuous and isotone. Let X = M₁ + φ + Ω be diagonal with X ≥ 2D and X ≥ 2Ω "
    "(for M₁ = D: φ ≥ |D − Ω|), or the method projected SOR with ω ≤ 1, D > 0. Then the step is isotone. It converges "
    "downwards from every supersolution that lies above a subsolution, upwards from that subsolution. Global "
    "convergence also needs A1 ≥ 0, ψ(z + t) ≤ ψ(z) + t for t ≥ 0, ψ convex and a strict supersolution. These are not "
    "checked here. With an upper obstacle, isotone too, the limit is a solution if ψ ≤ ψ̄ there"
)
DEFINITE = (
    "If A is positive definite, the obstacles constant, M₁ = A and φ = 0, the method converges from every start for "
    "every diagonal Ω > 0. With Ω = ωI and w = (A + ωI)(z − z*), ‖w⁺‖₂ ≤ σ‖w‖₂, σ = ‖(A − ωI)(A + ωI)⁻¹‖₂ < 1"
)


def monotone(step: StepMatrices) -> Answer:
    """Whether the step is isotone; X ≥ 2D and X ≥ 2Ω are checked up to the rounding of φ and Ω."""
    if not (answer := z_matrix(step.A)).holds:
        return Answer(False, f"A is not a Z-matrix: {answer.reason}")
    if (reason := _no_isotone_sweep(step) if step.sees_newest else _no_isotone_step(step)) is not None:
        return Answer(False, reason)
    reasons = {
        None: "it is not known whether psi is isotone",
        False: "psi is not isotone: its G has a negative entry",
        True: "the step is isotone: monotone convergence from super- and subsolutions",
    }
    isotone = step.problem.psi.isotone()
    return Answer(isotone, reasons[isotone])


def _no_isotone_sweep(step: StepMatrices) -> str | None:
    if not (positive := positive_diagonal(step.A)).holds:
        return positive.reason
    return None if step.relaxation <= 1.0 else f"omega = {step.relaxation:g} is above 1"


def _no_isotone_step(step: StepMatrices) -> str | None:
    if step.M1.data[step.M1.indices != row_of(step.M1)].any():
        return "M1 is not diagonal"
    X = step.X.diagonal()
    least = 2.0 * np.maximum(step.D, step.omega)
    size = np.abs(step.M1.diagonal()) + np.abs(step.phi) + step.omega
    short = least - X > 4 * UNIT_ROUNDOFF * size
    if short.any():
        i = int(np.argmax(short))
        need = f"M1 + phi + Omega is {X[i]:g} in row {i}, less than {least[i]:g}"
        return need + ": for M1 = D, phi >= |D - Omega| is needed"
    return None


def definite(step: StepMatrices) -> Answer:
    """Whether theorem "definite" applies; if a σ < 1 is found, for n ≤ 50 000, with σ and the witness v = Ω^(−½).

    Then |zᵏ − z*| ≤ σᵏ‖Ω^(−½)(A + Ω)(z⁰ − z*)‖₂ v.
    """
    if not step.problem.psi.is_constant:
        return Answer(False, "psi is not constant" if step.problem.upper is None else "an obstacle is not constant")
    if step.phi.any():
        return Answer(False, "phi is not zero")
    if (step.M1 != step.A).nnz:
        return Answer(False, "M1 is not A")
    sigma = contraction_factor(step)
    if sigma is not None:
        v = (1 + 4 * UNIT_ROUNDOFF) / np.sqrt(step.omega)
        return Answer(True, f"A is positive definite and sigma is at most {rounded_up(sigma, 6, below=1.0)}", v, sigma)
    answer = classes_of(step.problem).definite
    known = {True: "is", False: "is not", None: "is not known to be"}[answer.holds]
    # the witness of a theorem that holds is a vector v
    reason = f"A {known} positive definite: {answer.reason}"
    return Answer(answer.holds, reason, None if answer.holds else answer.witness)


def contraction_factor(step: StepMatrices) -> float | None:
    """An upper bound of σ = ‖(A' − I)(A' + I)⁻¹‖₂, rounding included, or None where none below 1 was found.

    σ = max|1 − λ|/(1 + λ) for symmetric A', else σ² ≤ 1 − 4λ_min(H)/(‖A'‖₂ + 1)², from bounds on A' and H.
    """
    if step.n > MAX_UNKNOWNS:
        return None
    half = sp.diags_array(1.0 / np.sqrt(step.omega))
    A = sp.csr_array(half @ step.A @ half)
    if not np.isfinite(A.data).all() or not within_reach(sp.csr_array(A + A.T)):
        return None
    size = sp.csr_array(abs(A))
    rows = float(size.sum(axis=1).max())
    columns = float(size.sum(axis=0).max())
    slack = 16 * UNIT_ROUNDOFF * max(rows, columns) + A.nnz * SMALLEST
    low = smallest_below(A, slack)
    if not low > 0:
        return None
    if is_symmetric(step.A):
        high = largest_above(size) + slack
        sigma = max((1 - low) / (1 + low), (high - 1) / (high + 1), 0.0) * (1 + 8 * UNIT_ROUNDOFF) + SMALLEST
    else:
        norm = float(np.sqrt(rows * columns)) * (1 + A.shape[0] * UNIT_ROUNDOFF) + slack
        sigma = float(np.sqrt(1 - 4 * low / (norm + 1) ** 2 + 8 * UNIT_ROUNDOFF))
    return sigma if sigma < 1 else None
