"""Uniqueness and error bound for impulse control, from a strict supersolution.

Let A be a Z-matrix with A1 ≥ 0 and Av > 0 for some v > 0. Let ψ be a best jump: a maximum over
jumps, isotone, convex, ψ(z + t1) ≤ ψ(z) + t1. Let F = min(p/a, r) with any a > 0, and let some s
have F(s) ≥ m > 0. Then ICP has exactly one solution z*, z* ≤ s, and for every z with −δ ≤ F(z) ≤ u,
δ ≥ 0 ≤ u:

    z* − z ≤ δ/(δ + m)·(s − z)⁺    and, where u < m,    z − z* ≤ u/(m − u)·(s − z).

Proof. Comparison: F(x) > F(y) in every row implies x ≥ y. Else t = max(y − x) > 0 is attained in a
row i. There p_i(y) ≥ p_i(x) + t(A1)_i ≥ p_i(x) and y_i − ψ_i(y) ≥ x_i + t − ψ_i(x + t1) ≥ x_i −
ψ_i(x). So F_i(y) ≥ F_i(x).

Along a segment p/a and r are concave. So w = (1 − τ)z + τs has F(w) > 0 = F(z*) for τ just above
δ/(δ + m), hence z* ≤ w. Likewise w = (1 − σ)z* + σs has F(w) ≥ σm > u ≥ F(z) for σ ≤ 1 just above
u/m. Hence z ≤ w, that is (1 − σ)(z − z*) ≤ σ(s − z). For u ≥ m nothing bounds z from above. With
jumps 1 ⇄ 2 at the cost u each way every z = (t, t) has r = u, and no supersolution has m > u.

Existence: the map z ↦ the larger of ψ(z) and of the row by row solution of p = 0 is isotone and
continuous. It takes s down and −A⁻¹q ≤ s up, so it has a fixed point between; that is a solution.

s solves min(p/a, r) = m by policy iteration; F(s) ≥ m > 0 is verified, rounding included.

References
----------
Bensoussan and Lions, Impulse Control and Quasi-Variational Inequalities (1984). Azimzadeh and
Forsyth, SIAM J. Numer. Anal. 54 (2016), for policy iteration. The proof is above.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import scipy.sparse as sp

from ...algebra.equations import newton_matrix
from ...errors import MapError
from ...numerics.arrays import Vector
from ...numerics.equilibration import times_rows
from ...numerics.factorisation import factorise
from ...numerics.rational import exact_sum, nearest
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF, product_lower_bound, rounded_down
from ...problem.data import ProblemData
from ...problem.intervention import Intervention
from ..matrices.comparison_matrix import positive_diagonal, z_matrix
from ..matrices.h_matrix import row_sum_signs
from .proof import MAX_POLICY_STEPS, Proof, natural_map, norm_up

#: the ratio of two successive margins m, tried from the size of the data downwards: large ones bound the error of a
#: bad z as well
_MARGIN_RATIO = 0.25


@dataclass(frozen=True, eq=False)
class SupersolutionProof(Proof):
    """A `margin` m > 0 and a supersolution s with min(p(s)/a, r(s)) ≥ m, `weight` = a and s of shape (n,)."""

    weight: Vector
    margin: float
    s: Vector

    # on a grid F contains second differences of the error, divided by h², and the bound takes its largest entry
    needs_sharpening = True

    def bound(self, problem: ProblemData, z: Vector, rounding_p: Vector, rounding_r: Vector) -> tuple[Vector, float]:
        """As `Proof.bound`; not finite if F(z) reaches the margin in some row."""
        with np.errstate(over="ignore", invalid="ignore"):
            F, error = _natural_map(problem, self.weight, z, rounding_p, rounding_r)
            below = max(float(np.max(error - F)), 0.0)
            above = max(float(np.max(F + error)), 0.0)
            delta = np.full(z.size, np.inf)
            m = self.margin
            if above < m:
                share = max(below / (below + m), above / (m - above)) * (1 + 16 * UNIT_ROUNDOFF) + SMALLEST
                delta = np.nextafter(share * np.maximum(self.s - z, 0.0), np.inf)
        return delta, norm_up(delta)

    def newton_step(self, problem: ProblemData, z: Vector) -> Vector | None:
        with np.errstate(over="ignore", invalid="ignore"):
            return _policy_step(problem, self.weight, 0.0, z)


def prove(problem: ProblemData) -> SupersolutionProof | str:
    """Search for m and s by policy iteration and verify them, or say why there is no proof; it depends on q as well."""
    A = problem.A
    psi = problem.psi
    if not isinstance(psi, Intervention) or psi.best != "max":
        return 'psi is no best jump: an Intervention with best="max" is needed for a proof by a supersolution'
    if not (answer := z_matrix(A)).holds:
        return f"A is no Z-matrix: {answer.reason}"
    if not (positive := positive_diagonal(A)).holds:
        return f"A is not a nonsingular M-matrix: {positive.reason}"
    negative = np.flatnonzero(row_sum_signs(A) < 0)
    if negative.size:
        i = int(negative[0])
        total = nearest(exact_sum(A.data[A.indptr[i] : A.indptr[i + 1]]))
        return f"A1 >= 0 is needed: row {i} of A has the sum {total:.3g}"
    diagonal = A.diagonal()
    unit = sp.csr_array(sp.diags_array(1.0 / diagonal) @ A)
    ones = np.ones(problem.n)
    lu = factorise(unit)
    v = None if lu is None else lu.solve(ones)
    if v is None or not (v > 0).all() or not (product_lower_bound(A, v) > 0).all():
        return "A is not proved to be a nonsingular M-matrix: no v > 0 with Av > 0 was found"
    # a in the units of p, with A^-1 a about 1: the row sums where they are not small
    weight = np.maximum(unit @ ones, 1.0 / v.max())
    weight *= diagonal / lu.solve(weight).max()
    try:
        strict = _supersolution(problem, weight, lu.solve(-problem.q / diagonal))
    except MapError as error:  # ψ need not have a value where s is sought
        return f"no strict supersolution was found: {error}"
    if strict is None:
        return "no strict supersolution was found by policy iteration"
    m, s = strict
    margin = f"margin {rounded_down(m)}"
    sentence = f"A is an M-matrix with A1 >= 0, psi a best jump, and a strict supersolution exists ({margin})"
    return SupersolutionProof(sentence, weight, m, s)


def _supersolution(problem: ProblemData, weight: Vector, start: Vector) -> tuple[float, Vector] | None:
    """A margin m and an s with min(p/a, r) ≥ m, by policy iteration for decreasing margins; None if none is found."""
    r = problem.r(start)
    size = max(float(np.abs(start).max()), float(np.abs(r[np.isfinite(r)]).max(initial=0.0))) or 1.0
    least = float(np.sqrt(UNIT_ROUNDOFF)) * size
    target = _MARGIN_RATIO * size
    while target > least:
        s = start
        for _ in range(MAX_POLICY_STEPS):
            new = _policy_step(problem, weight, target, s)
            if new is None:
                break
            step = float(np.abs(new - s).max())
            s = new
            if step <= 1e-9 * target:
                F, error = _natural_map(problem, weight, s, *problem.rounding(s))
                if (m := float((F - error).min())) > 0.5 * target:
                    return m, s
                break
        target = _MARGIN_RATIO * target
    return None


def _policy_step(problem: ProblemData, weight: Vector, m: float, s: Vector) -> Vector | None:
    """A policy iteration step for min(p/a, r) = m: rows with r < p/a take their best jump at `s`; None if it fails."""
    psi = problem.psi.value(s)
    jumps = s - psi < problem.p(s) / weight
    J = problem.psi.jacobian(s)
    assert J is not None  # of a best jump
    lu = factorise(times_rows(np.where(jumps, 1.0, 1.0 / weight), newton_matrix(problem, jumps, J)))
    if lu is None:
        return None
    # the iterate, not a correction of s: with the same jumps it is the same to the last digit
    new: Vector = lu.solve(np.where(jumps, psi - J @ s, -problem.q / weight) + m)
    return new if np.isfinite(new).all() else None


def _natural_map(
    problem: ProblemData, weight: Vector, z: Vector, rounding_p: Vector, rounding_r: Vector
) -> tuple[Vector, Vector]:
    """F = min(p/a, r) at `z` and a bound on its error."""
    F = natural_map(problem, z, weight, 1.0)
    error = np.maximum(rounding_p / weight, rounding_r) * (1 + 4 * UNIT_ROUNDOFF) + 4 * UNIT_ROUNDOFF * np.abs(F)
    return F, error + SMALLEST  # the quotients may have underflowed
