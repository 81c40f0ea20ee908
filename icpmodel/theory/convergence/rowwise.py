"""Projected SOR, the member of the family whose modulus uses the newest values: its rate, by one sweep over some v > 0.

**rowwise.** D > 0, 0 < ω < 2, |ψ(x) − ψ(y)| ≤ G|x − y|. A sweep makes z⁺ of z, row by row:

    z_i⁺ = max(ψ_i(z), z_i − (ω/a_ii)(Σ_{j<i} a_ij z_j⁺ + Σ_{j≥i} a_ij z_j + q_i)).

Az takes the newest values, and ψ the z at the start of the sweep. For v > 0 let T(v) = w:

    w_i = max((Gv)_i, |1 − ω|v_i + (ω/a_ii)(Σ_{j<i} |a_ij|w_j + Σ_{j>i} |a_ij|v_j)).

If |z − y| ≤ v then |z⁺ − y⁺| ≤ w. The proof is by induction over the rows, by |max(a, b) − max(c,
d)| ≤ max(|a − c|, |b − d|). Here a − c = ψ_i(z) − ψ_i(y), and

    b − d = (1 − ω)(z_i − y_i) − (ω/a_ii)(Σ_{j<i} a_ij(z_j⁺ − y_j⁺) + Σ_{j>i} a_ij(z_j − y_j)).

T is monotone and positively homogeneous, so T(v) ≤ σv makes the sweep a contraction by σ in max_i
|z_i|/v_i. With σ < 1 it has one fixed point (Banach), where min(r_i, (ω/a_ii)p_i) = 0 in every row:
the one solution.

The bound is attained. Let A be a Z-matrix, ψ = Gz + c, ω ≤ 1 and z − y = v. Then z⁺ − y⁺ = w if
both sweeps take in every row the side of the maximum that w takes. (Gw)_i in place of (Gv)_i would
be wrong, and so would v_j in place of w_j where w_j > v_j.

With an upper obstacle, z_i⁺ is the minimum of ψ̄_i(z) and that maximum. |min(a, b) − min(c, d)| has
the same bound as for two maxima. So with |ψ̄(x) − ψ̄(y)| ≤ G|x − y| all of this holds, with the
remarks of `conditions` on two obstacles.

**H₊-matrices.** Let ω ≤ 1, and ⟨A⟩v > 0 and Gv < v for some v > 0. (So A is an H₊-matrix where D >
0.) Then T(v) < v, by induction over the rows. If w_j ≤ v_j for j < i, the second argument of the
maximum is at most |1 − ω|v_i + (ω/a_ii)Σ_{j≠i}|a_ij|v_j = v_i − (ω/a_ii)(⟨A⟩v)_i < v_i. The same v
bounds the error of any z (`certificates.h_plus`).

**Distance.** z_i⁺ − z_i = −min(r_i, (ω/a_ii)(p_i + Σ_{j<i} a_ij(z_j⁺ − z_j))), and min is
nonexpansive. So d = |z⁺ − z| has d_i ≤ |F_i|/Ω_i + (ω/a_ii)Σ_{j<i}|a_ij|d_j with Ω = D/ω and F =
min(p, Ωr), or the median.

References
----------
Cryer, SIAM J. Control 9 (1971). Ahn, J. Optim. Theory Appl. 33 (1981), for nonsymmetric A. Both for
ψ = 0.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Vector
from ...numerics.factorisation import factorise
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF, product_lower_bound, product_upper_bound
from ..matrices.comparison_matrix import positive_diagonal
from .conditions import StepMatrices


class SweepMap:
    """T(v) = w of the module's docstring. No term is negative, so every row can be rounded up, or down.

    It requires D > 0, a Lipschitz matrix of ψ, and M₁ = D/ω − L.
    """

    limit = 1.0

    def __init__(self, step: StepMatrices) -> None:
        matrix = step.problem.matrix
        self._A, self._rows, self._G, self._omega = matrix.absolute, matrix.rows, step.G, step.relaxation

    @property
    def entries(self) -> int:
        return int(self._A.nnz + self._G.nnz)

    def upper(self, v: Vector) -> Vector:
        return self._swept(abs(1.0 - self._omega) * v, v, product_upper_bound(self._G, v), 1.0)

    def lower(self, v: Vector) -> Vector:
        g = np.maximum(product_lower_bound(self._G, v), 0.0)
        return np.maximum(self._swept(abs(1.0 - self._omega) * v, v, g, -1.0), 0.0)

    def solve_lower(self, b: Vector) -> Vector:
        """An upper bound of the d with d_i = b_i + (ω/a_ii)Σ_{j<i} |a_ij|d_j, `b` ≥ 0 of shape (n,)."""
        none = np.zeros(b.size)
        return self._swept(b, none, none, 1.0)

    def _swept(self, f: Vector, v: Vector, g: Vector, sign: float) -> Vector:
        from ...algebra.kernels.sweeps import bounded  # loads numba

        A = self._A
        out = np.empty(v.size)
        k = np.diff(self._A.indptr) + 8
        scale = np.nextafter(self._omega / self._rows.diagonal, np.inf if sign > 0 else 0.0)
        # a row has at most k rounding errors and k underflows; all but a few underflows are multiplied by `scale`
        growth = 1.0 + sign * 4 * k * UNIT_ROUNDOFF
        tiny = sign * (scale * (k * SMALLEST) + 4 * SMALLEST)
        bounded(A.indptr, A.indices, A.data, self._rows.diag, scale, growth, tiny, f, v, g, out)
        return out

    def resolvent(self, mu: float, v: Vector) -> Vector | None:
        # at v each row of w is one of G or one of the sweep: Kw = Hv, and (μI − K⁻¹H)⁻¹v solves (μK − H)y = Kv
        one = sp.eye_array(v.size)
        W = sp.diags_array(self._omega / self._rows.diagonal) @ self._A
        sweeps = sp.diags_array((self.upper(v) > product_upper_bound(self._G, v)).astype(np.float64))
        K = one - sweeps @ sp.tril(W, -1)
        H = (one - sweeps) @ self._G + sweeps @ (abs(1.0 - self._omega) * one + sp.triu(W, 1))
        lu = factorise(sp.csr_array(mu * K - H))
        return None if lu is None else lu.solve(K @ v)


def rowwise(step: StepMatrices) -> SweepMap | str:
    """The map T of theorem "rowwise", or why it does not apply."""
    if not (positive := positive_diagonal(step.A)).holds:
        return positive.reason
    return "it covers M1 = D/omega - L only" if np.isnan(step.relaxation) else SweepMap(step)
