"""Two theorems that rest on structure and not on size: isotone steps, and positive definite A.

**monotone.** Let X = M₁ + φ + Ω be diagonal, X ≥ 2D, X ≥ 2Ω, A a Z-matrix and ψ isotone (x ≤ y gives ψ(x) ≤ ψ(y)).
In row i the step z⁺ = z − 2X⁻¹min(p, Ωr) is the larger of z_i − (2/x_i)p_i(z) and z_i − (2ω_i/x_i)(z_i − ψ_i(z)), whose
coefficients 1 − 2d_i/x_i, −2a_ij/x_i and 1 − 2ω_i/x_i are ≥ 0: the step is isotone. If F(s) = min(p(s), r(s)) ≥ 0 (s a
supersolution), the step goes down from s, hence by induction always; with a subsolution t ≤ s (F(t) ≤ 0) it stays above
t, so it converges, and the limit is a solution because ψ is continuous: the largest one between t and s. From t it goes
up to the smallest. For M₁ = D the condition on X is φ ≥ |D − Ω|.

**definite.** Let A be positive definite (xᵀAx > 0, symmetric or not), ψ constant (rows without obstacle included),
M₁ = A, φ = 0, Ω any positive diagonal. Write A' = Ω^(−½)AΩ^(−½), also positive definite, and e = Ω^½(z − z*). Then
e⁺ = (I − 2(A' + I)⁻¹(ΘA' + I − Θ))e = (A' + I)⁻¹(I − 2Θ)(A' − I)e with a diagonal 0 ≤ Θ ≤ I, so y = (A' − I)e has
‖y⁺‖₂ ≤ σ‖y‖₂, σ = ‖(A' − I)(A' + I)⁻¹‖₂, and ‖(A' + I)x‖² − ‖(A' − I)x‖² = 4xᵀA'x gives
σ² ≤ 1 − 4λ/(‖A'‖₂ + 1)² < 1, λ the smallest eigenvalue of the symmetric part of A'. Hence
‖eᵏ‖ ≤ ‖(A' + I)⁻¹‖σᵏ⁻¹‖(A' − I)e⁰‖. It is a Peaceman–Rachford iteration.

Reference: Bensoussan and Lions, Impulse Control and Quasi-Variational Inequalities (1984); Peaceman and Rachford, J.
SIAM 3 (1955); Ortega and Rheinboldt (1970), section 13.2, for monotone convergence.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..arrays import row_of
from ..intervention import Intervention
from ..maps import Affine, Constant, Map
from ..problem import UNIT_ROUNDOFF
from .absolute import DENSE, is_diagonal
from .answers import Answer
from .definiteness import definiteness
from .parts import Parts

MONOTONE = (
    "If A is a Z-matrix, ψ is continuous and isotone and X = M₁ + φ + Ω is diagonal with X ≥ 2D and X ≥ 2Ω "
    "(for M₁ = D: φ ≥ |D − Ω|), the step is isotone and converges downwards from every supersolution that lies above "
    "a subsolution, upwards from that subsolution; global convergence also needs A1 ≥ 0, ψ(z + t) ≤ ψ(z) + t for "
    "t ≥ 0, ψ convex and a strict supersolution, which are not checked here"
)
DEFINITE = (
    "If A is positive definite, ψ constant, M₁ = A and φ = 0, the method converges from every start for every "
    "diagonal Ω > 0; with Ω = ωI and y = (A − ωI)(z − z*), ‖y⁺‖₂ ≤ σ‖y‖₂, σ = ‖(A − ωI)(A + ωI)⁻¹‖₂ < 1"
)


def monotone(parts: Parts) -> Answer:
    """Whether the step is isotone; X ≥ 2D and X ≥ 2Ω are read up to the rounding of φ and Ω.

    >>> from icpmodel import ICP, MNMJ
    >>> monotone(Parts(ICP([[2, -1], [-1, 2]], [0, 0]), MNMJ(phi2=1.0))).reason
    'M1 + phi + Omega is 3 in row 0, less than 4: for M1 = D, phi >= |D - Omega| is needed'
    """
    A = parts.A
    off = A.data[A.indices != row_of(A)]
    if (off > 0).any():
        return Answer(False, f"A is not a Z-matrix: it has the entry {off.max():g} off its diagonal")
    if not is_diagonal(parts.M1):
        return Answer(False, "M1 is not diagonal")
    X, least = parts.X.diagonal(), 2.0 * np.maximum(parts.D, parts.omega)
    size = np.abs(parts.M1.diagonal()) + np.abs(parts.phi) + parts.omega
    short = least - X > 4 * UNIT_ROUNDOFF * size
    if short.any():
        i = int(np.argmax(short))
        need = f"M1 + phi + Omega is {X[i]:g} in row {i}, less than {least[i]:g}"
        return Answer(False, need + ": for M1 = D, phi >= |D - Omega| is needed")
    isotone = _isotone(parts.problem.psi)
    if isotone is None:
        return Answer(None, "it is not known whether psi is isotone")
    if not isotone:
        return Answer(False, "psi is not isotone: psi.G has a negative entry")
    return Answer(True, "the step is isotone: monotone convergence from super- and subsolutions")


def definite(parts: Parts) -> Answer:
    """Whether A is positive definite and the rest fits; `number` is a proved σ for n ≤ 300, else None.

    >>> from icpmodel import ICP, MNMMOD
    >>> found = definite(Parts(ICP([[2, -1], [-1, 2]], [0, 0]), MNMMOD(theta1=2.0)))
    >>> found.holds, round(found.number, 6)
    (True, 0.333333)
    """
    if not parts.problem.is_lcp:
        return Answer(False, "psi is not constant")
    if parts.phi.any():
        return Answer(False, "phi is not zero")
    difference = parts.M1 - parts.A
    if difference.nnz and difference.data.any():
        return Answer(False, "M1 is not A")
    A = parts.A
    found = definiteness(sp.csr_array(A + A.T))
    if found.definite is not True:
        # a matrix that is semidefinite up to rounding may still be definite
        holds = False if found.semidefinite is False else None
        return Answer(holds, f"A is not known to be positive definite: A + A' is {found.reason}", found.witness)
    sigma = _sigma(parts) if parts.n <= DENSE else None
    return Answer(True, f"A is positive definite: A + A' is {found.reason}", None, sigma)


def _isotone(psi: Map) -> bool | None:
    """Whether x ≤ y gives ψ(x) ≤ ψ(y); a function that returns the best of its jumps is taken at its word."""
    if isinstance(psi, Constant | Intervention):
        return True
    if isinstance(psi, Affine):
        return bool((psi.G.data >= 0).all())
    return None


def _sigma(parts: Parts) -> float | None:
    """An upper bound of ‖(A' − I)(A' + I)⁻¹‖₂, rounding included, or None where it is not below 1.

    With R about (A' + I)⁻¹, Q = (A' − I)R and E = I − (A' + I)R, the norm is at most ‖Q‖/(1 − ‖E‖), and s²I − QᵀQ is
    shown to be positive definite by its factorisation.
    """
    n = parts.n
    identity, u = np.eye(n), 8 * (n + 8) * UNIT_ROUNDOFF
    with np.errstate(all="ignore"):
        root = np.sqrt(parts.omega)
        A = parts.A.toarray() / root[:, None] / root
        try:
            R = np.linalg.inv(A + identity)
        except np.linalg.LinAlgError:
            return None
        # Frobenius norms bound the 2-norms of the rounding errors
        size = np.linalg.norm(np.abs(A) + identity) * np.linalg.norm(R)
        E = float(np.linalg.norm(identity - (A + identity) @ R)) + u * (size + n)
        Q = (A - identity) @ R
        if not E < 0.5:
            return None
        s = float(np.linalg.norm(Q, 2))
        error = u * (n + np.linalg.norm(Q) ** 2)
        for inflation in (1e-13, 1e-10, 1e-7, 1e-5):
            bound = s * (1 + inflation) + inflation
            gap = (bound * bound - error) * identity - Q.T @ Q
            if definiteness(sp.csr_array(gap)).definite is True:
                sigma = (bound + u * size) / (1 - E) * (1 + 4 * UNIT_ROUNDOFF)
                return float(sigma) if sigma < 1 else None
    return None
