"""Uniqueness and error bound where A is an H₊-matrix and ψ contracts in the same norm.

A an H₊-matrix and v > 0 with α = ⟨A⟩v > 0 and β = (I − G)v > 0: ICP has exactly one solution z*, and for every z

    max_i |z_i − z*_i|/v_i ≤ max_i |min(p_i(z)/α_i, r_i(z)/β_i)|.

Proof: rows of p and of r may be scaled, so take F = min(α⁻¹p, β⁻¹r). F(z) − F(z*) = (Θα⁻¹A + (I − Θ)β⁻¹(I − Γ))(z − z*)
with a diagonal 0 ≤ Θ ≤ I and |Γ| ≤ G, and the comparison matrix of the bracket maps v above 1. No other scaling of the
rows gives less: |min(sp, r)|/min(sα, β) is smallest at s = β/α. Rows without obstacle have Θ_i = 1.

Reference: Chen and Xiang, Math. Program. 106 (2006), for ψ = 0; the proof above for ψ with Lipschitz matrix G.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ..arrays import Vector
from ..problem import ICP, UNIT_ROUNDOFF
from .proof import Proof, norm_up
from .rounding import lower, upper
from .scaling import comparison_matrix, solve_for_ones


@dataclass(frozen=True, eq=False)
class HPlusProof(Proof):
    """`v` > 0 with `alpha` ≤ ⟨A⟩v, `beta` ≤ (I − G)v, both positive; all of shape (n,).

    >>> prove(ICP([[2.0, -1.0], [-1.0, 2.0]], [0.0, 0.0])).v
    array([1., 1.])
    """

    sentence: str
    v: Vector
    alpha: Vector
    beta: Vector

    def bound(self, problem: ICP, z: Vector, for_p: Vector, for_r: Vector) -> tuple[Vector, float]:
        """See `Proof.bound`."""
        with np.errstate(over="ignore", invalid="ignore"):
            F = np.abs(np.minimum(problem.p(z) / self.alpha, problem.r(z) / self.beta))
            factor = float(np.max(F + np.maximum(for_p / self.alpha, for_r / self.beta)))
            delta = np.nextafter(self.v * (factor * (1 + 8 * UNIT_ROUNDOFF)), np.inf)
        return delta, norm_up(delta)


def prove(problem: ICP) -> HPlusProof | str:
    """v = 1 is tried first, then v = ⟨A⟩⁻¹1 (one linear solve); the signs are checked, rounding included.

    Returns the proof, or the reason why no v was found. It is made of A and ψ alone and remembered for all problems
    that share them.

    >>> prove(ICP([[0.0]], [1.0]))
    'A is not an H+-matrix: A[0, 0] = 0 is not positive'
    """
    if "h plus" not in problem._memory:
        problem._memory["h plus"] = _prove(problem)
    return problem._memory["h plus"]


def _prove(problem: ICP) -> HPlusProof | str:
    A, G = problem.A, problem.psi.lipschitz
    diagonal = A.diagonal()
    if (diagonal <= 0).any():
        i = int(np.argmax(diagonal <= 0))
        return f"A is not an H+-matrix: A[{i}, {i}] = {diagonal[i]:g} is not positive"
    if G is None:
        return "no Lipschitz matrix of psi is known: give `lipschitz`"
    comparison = comparison_matrix(A)
    reasons = []
    for name, make in (("v = 1", lambda C: np.ones(C.shape[0])), ("v = <A>^-1 1", solve_for_ones)):
        v = make(comparison)
        if v is None or not (v > 0).all():
            reasons.append(f"{name}: A is not an H+-matrix (<A>^-1 1 is not positive)")
            continue
        alpha = lower(comparison, v)
        # a row of psi without obstacle would need no beta, but which rows those are may change with z
        beta = v - upper(G, v)
        beta -= 2 * UNIT_ROUNDOFF * v
        for symbol, vector in (("<A>v", alpha), ("(I - G)v", beta)):
            if not (vector > 0).all():
                i = int(np.argmin(vector))
                reasons.append(f"{name}: {symbol} is {vector[i]:.3g} in row {i}, not positive")
                break
        else:
            return HPlusProof(f"A is an H+-matrix ({name})", v, alpha, beta)
    return "no certificate: " + "; ".join(reasons)
