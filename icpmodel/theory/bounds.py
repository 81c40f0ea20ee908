"""A posteriori: how wrong can z be?

A an H₊-matrix and v > 0 with α = ⟨A⟩v > 0 and β = (I − G)v > 0: ICP has exactly one solution z*, and for every z

    max_i |z_i − z*_i|/v_i ≤ max_i |min(p_i(z)/α_i, r_i(z)/β_i)|.

Proof: rows of p and of r may be scaled, so take F = min(α⁻¹p, β⁻¹r). F(z) − F(z*) = (Θα⁻¹A + (I − Θ)β⁻¹(I − Γ))(z − z*)
with a diagonal 0 ≤ Θ ≤ I and |Γ| ≤ G, and the comparison matrix of the bracket maps v above 1. No other scaling of the
rows gives less: |min(sp, r)|/min(sα, β) is smallest at s = β/α. Rows without obstacle have Θ_i = 1.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..arrays import Vector, diagonal_positions
from ..operators import factorise
from ..problem import ICP, SMALLEST, UNIT_ROUNDOFF

#: so many steps of a Krylov method cost less than a factorisation of any but the smallest matrices
_KRYLOV_STEPS = 200


@dataclass(frozen=True)
class ErrorBound:
    """How far z can be from the solution.

    `componentwise` δ with |z − z*| ≤ δ, shape (n,), and its largest entry `value`, in the units of z; both None
    where there is no certificate, and then `reason` says why. `scaling` names the v that was used.

    >>> bound = error_bound(ICP([[2.0]], [-2.0]), [1.25])
    >>> bound.value >= 0.25, bound.scaling
    (True, 'v = 1')
    """

    value: float | None
    componentwise: Vector | None
    scaling: str
    reason: str

    @property
    def unique(self) -> bool:
        """Whether the certificate holds, which proves that the solution exists and is the only one.

        >>> error_bound(ICP([[0.0]], [1.0]), [0.0]).unique
        False
        """
        return self.value is not None


def comparison_matrix(A: sp.csr_array) -> sp.csr_array:
    """⟨A⟩: |a_ii| on the diagonal and −|a_ij| off it.

    Parameters: `A` CSR, shape (n, n), every diagonal entry stored. Returns CSR of the same pattern.

    >>> comparison_matrix(sp.csr_array([[-2.0, 1.0], [-1.0, 3.0]])).toarray()
    array([[ 2., -1.],
           [-1.,  3.]])
    """
    data = -np.abs(A.data)
    diagonal = diagonal_positions(A)
    data[diagonal] = -data[diagonal]
    return sp.csr_array((data, A.indices, A.indptr), shape=A.shape)


def error_bound(problem: ICP, z: Any) -> ErrorBound:
    """A bound on |z − z*| from one evaluation of the natural map, or the reason why there is none.

    v = 1 is tried first, then v = ⟨A⟩⁻¹1 (one linear solve, remembered for all problems that share A and ψ).
    A bound on the rounding error of F(z), α and β is included (`ICP.rounding`); it takes ψ and its Lipschitz matrix at
    the user's word. Parameters: `z` shape (n,). Returns an `ErrorBound`.
    Reference: Chen and Xiang, Math. Program. 106 (2006), for ψ = 0; the proof above for ψ with Lipschitz matrix G.

    >>> problem = ICP([[2, -1], [-1, 2]], [-1, -1])
    >>> bound = error_bound(problem, [1.0, 1.001])
    >>> 0.001 <= bound.value <= 0.0031
    True
    """
    z = problem.vector(z)
    if "scaling" not in problem._memory:
        problem._memory["scaling"] = _scaling(problem)
    found = problem._memory["scaling"]
    if isinstance(found, str):
        return ErrorBound(None, None, "none", found)
    name, v, alpha, beta = found
    for_p, for_r = problem.rounding(z)
    with np.errstate(over="ignore", invalid="ignore"):
        F = np.abs(np.minimum(problem.p(z) / alpha, problem.r(z) / beta))
        factor = float(np.max(F + np.maximum(for_p / alpha, for_r / beta)))
    if not np.isfinite(factor):
        return ErrorBound(None, None, name, "F(z) is not finite at this z")
    delta = np.nextafter(v * (factor * (1 + 8 * UNIT_ROUNDOFF)), np.inf)
    return ErrorBound(float(delta.max()), delta, name, "")


def _scaling(problem: ICP) -> tuple[str, Vector, Vector, Vector] | str:
    """(name, v, α, β), the last two rounded down, or the reason why no v was found."""
    A, G = problem.A, problem.psi.lipschitz
    diagonal = A.diagonal()
    if (diagonal <= 0).any():
        i = int(np.argmax(diagonal <= 0))
        return f"A is not an H+-matrix: A[{i}, {i}] = {diagonal[i]:g} is not positive"
    if G is None:
        return "no Lipschitz matrix of psi is known: give `lipschitz`"
    comparison = comparison_matrix(A)
    reasons = []
    for name, make in (("v = 1", _ones), ("v = <A>^-1 1", _solve_for_ones)):
        v = make(comparison)
        if v is None or not (v > 0).all():
            reasons.append(f"{name}: A is not an H+-matrix (<A>^-1 1 is not positive)")
            continue
        alpha = _lower(comparison, v)
        # a row of psi without obstacle would need no beta, but which rows those are may change with z
        beta = v - _upper(G, v)
        for symbol, vector in (("<A>v", alpha), ("(I - G)v", beta)):
            if not (vector > 0).all():
                i = int(np.argmin(vector))
                reasons.append(f"{name}: {symbol} is {vector[i]:.3g} in row {i}, not positive")
                break
        else:
            return name, v, alpha, beta
    return "no certificate: " + "; ".join(reasons)


def _ones(comparison: sp.csr_array) -> Vector:
    return np.ones(comparison.shape[0])


def _solve_for_ones(comparison: sp.csr_array) -> Vector | None:
    """v with ⟨A⟩v ≈ 1: by a few conjugate gradient steps where they suffice, else by a factorisation."""
    from scipy.sparse.linalg import bicgstab, cg

    n = comparison.shape[0]
    symmetric = (comparison != comparison.T).nnz == 0
    # a residual of at most 1/2 in every row leaves <A>v >= 1/2; the signs are checked anyway
    options: dict[str, Any] = {"rtol": 0.5 / np.sqrt(n), "atol": 0.0, "maxiter": _KRYLOV_STEPS}
    with np.errstate(all="ignore"):  # where <A> is indefinite these break down, which the check below sees
        options["M"] = sp.diags_array(1.0 / comparison.diagonal())
        v, failed = (cg if symmetric else bicgstab)(comparison, np.ones(n), **options)
    if not failed and (v > 0).all() and (comparison @ v > 0).all():
        return np.asarray(v)
    lu = factorise(comparison)
    if lu is None:
        return None
    v = np.asarray(lu.solve(np.ones(n)))
    return v if np.isfinite(v).all() else None


def _lower(matrix: sp.csr_array, v: Vector) -> Vector:
    """A lower bound of matrix @ v, rounding included."""
    k = np.diff(matrix.indptr) + 2
    result: Vector = matrix @ v - 2 * k * UNIT_ROUNDOFF * (abs(matrix) @ v) - k * SMALLEST
    return result


def _upper(matrix: sp.csr_array, v: Vector) -> Vector:
    """An upper bound of matrix @ v for matrix, v ≥ 0, rounding included."""
    k = np.diff(matrix.indptr) + 3
    result: Vector = (matrix @ v) * (1 + 2 * k * UNIT_ROUNDOFF) + k * SMALLEST
    return result
