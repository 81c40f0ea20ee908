"""Uniqueness and error bound where A is an H₊-matrix and ψ contracts in the same norm.

Let A be an H₊-matrix and v > 0 with α = ⟨A⟩v > 0 and β = (I − G)v > 0. Then ICP has exactly one
solution z*, and for every z

    max_i |z_i − z*_i|/v_i ≤ max_i |min(p_i(z)/α_i, r_i(z)/β_i)|.

Proof: rows of p and of r may be scaled, so take F = min(α⁻¹p, β⁻¹r). F(z) − F(z*) = (Θα⁻¹A + (I −
Θ)β⁻¹(I − Γ))(z − z*) with a diagonal 0 ≤ Θ ≤ I and |Γ| ≤ G. The comparison matrix of the bracket
times v is at least 1 in every row. No other scaling of the rows gives a smaller bound: |min(sp,
r)|/min(sα, β) is smallest at s = β/α. Rows without obstacle have Θ_i = 1.

With an upper obstacle, let |ψ̄(x) − ψ̄(y)| ≤ G|x − y| too. F is the median mid(β⁻¹(z − ψ̄), α⁻¹p,
β⁻¹r). Its differences are means of the differences of its three arguments, as those of the minimum
are of its two. The rest of the proof holds. As F has one zero, there is one solution if ψ ≤ ψ̄ there.

References
----------
Chen and Xiang, Math. Program. 106 (2006), for ψ = 0. The proof above is for ψ with Lipschitz matrix
G.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import chain

import numpy as np
import scipy.sparse as sp

from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.equilibration import in_units, natural_exponents, times_rows
from ...numerics.factorisation import factorise
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF, product_lower_bound, product_upper_bound
from ...problem.data import ProblemData
from ...problem.map import Map
from ...problem.matrix import Matrix
from ..matrices.comparison_matrix import comparison_matrix, positive_diagonal, scaling_vectors
from .proof import MAX_POLICY_STEPS, Proof, natural_map, no_lipschitz, norm_up

_POLICY_UP_TO = 200_000  #: beyond this size the factorisations of a policy iteration cost too much


@dataclass(frozen=True, eq=False)
class HPlusProof(Proof):
    """`v` > 0 with `alpha` ≤ ⟨A⟩v, `beta` ≤ (I − G)v, both positive; all of shape (n,)."""

    v: Vector
    alpha: Vector
    beta: Vector

    def bound(self, problem: ProblemData, z: Vector, rounding_p: Vector, rounding_r: Vector) -> tuple[Vector, float]:
        with np.errstate(over="ignore", invalid="ignore"):
            F = np.abs(natural_map(problem, z, self.alpha, self.beta))
            # two quotients may have underflowed
            factor = float(np.max(F + np.maximum(rounding_p / self.alpha, rounding_r / self.beta))) + SMALLEST
            delta = np.nextafter(self.v * (factor * (1 + 8 * UNIT_ROUNDOFF)), np.inf)
        return delta, norm_up(delta)


@np.errstate(over="ignore", under="ignore")  # a v that is not positive and finite is refused
def prove(matrix: Matrix, psi: Map) -> HPlusProof | str:
    """Search for v among `scaling_vectors`, by policy iteration, by both in natural units, or say why none is found.

    The best v solves v = max(D⁻¹|B|v, Gv) + 1, B the off-diagonal part of A: in each row one of two equations holds. A
    choice of equations is a linear system. Its solution is positive for every choice if and only if some v satisfies
    both conditions. The solutions then grow from choice to choice (Howard's policy iteration). The signs of α and β
    are checked, rounding included.
    """
    G = psi.lipschitz
    if not (positive := positive_diagonal(matrix.sparse)).holds:
        return f"A is not an H+-matrix: {positive.reason}"
    if G is None:
        return no_lipschitz(psi)
    dominated = False
    for name, v, alpha in _diagonal_scaling(matrix, G):
        dominated = True
        # a row of psi without obstacle would need no beta, but which rows those are may change with z
        beta = v - product_upper_bound(G, v) - 2 * UNIT_ROUNDOFF * v
        if (beta > 0).all():
            return HPlusProof(f"A is an H+-matrix ({name})", v, alpha, beta)
    if dominated:
        return "A is an H+-matrix, but no v > 0 found gives both <A>v > 0 and (I - G)v > 0: psi moves too much"
    return "A is not proved to be an H+-matrix: no v > 0 found gives <A>v > 0"


def _diagonal_scaling(matrix: Matrix, G: sp.csr_array) -> Iterator[tuple[str, Vector, Vector]]:
    """Yield (name, v, α) for v = 1 and the `_candidates`, if ⟨A⟩v ≥ α > 0; v = 1 takes the row sums of |A| alone.

    If ⟨A⟩1 < 0 there is no such v: divided by its least entry v_i it would have (⟨A⟩v)_i ≤ (⟨A⟩1)_i < 0.
    """
    A = matrix.sparse
    ones = np.ones(matrix.n)
    work.charge(2.0 * matrix.product_cost)
    size = matrix.magnitude(ones)
    diagonal = A.diagonal()
    # the sums commit errors of at most γ times `size`, and nothing underflows in them
    rounding = 2 * (np.diff(A.indptr) + 4) * UNIT_ROUNDOFF * size
    alpha = (diagonal - size) + diagonal - rounding
    if (alpha > 0).all():
        yield "v = 1", ones, alpha
    if (alpha + 2 * rounding < 0).all():
        return
    comparison = comparison_matrix(A)
    for name, v in _candidates(comparison, G):
        work.charge(4.0 * matrix.product_cost)
        # a lower bound costs three times as much
        if (comparison @ v > 0).all() and (
            (alpha := product_lower_bound(comparison, v, matrix.magnitude(v))) > 0
        ).all():
            yield name, v, alpha


def _candidates(comparison: sp.csr_array, G: sp.csr_array) -> Iterator[tuple[str, Vector]]:
    """Yield candidates v for A, then for A and ψ, then in natural units: else ⟨A⟩v may be below its rounding error."""
    yield from scaling_vectors(comparison)
    diagonal = comparison.diagonal()
    if (diagonal < np.finfo(np.float64).tiny).any():
        return
    rows = times_rows(1.0 / diagonal, comparison)
    yield from _policy_iteration(rows, G)
    work.charge_matrices(rows.nnz + G.nnz, 6)
    c = natural_exponents(sp.csr_array(abs(rows) + G))[1]
    if not c.any():
        return
    rows = in_units(rows, -c, c)
    G = in_units(G, -c, c)
    ones = ("v = 1", np.ones(diagonal.size))
    for name, v in chain([ones], scaling_vectors(rows), _policy_iteration(rows, G)):
        yield f"{name} in natural units", np.ldexp(v, c)


def _policy_iteration(rows: sp.csr_array, G: sp.csr_array) -> Iterator[tuple[str, Vector]]:
    """Yield the iterates of policy iteration for v = max(D⁻¹|B|v, Gv) + 1 while they are positive; `rows` = D⁻¹⟨A⟩."""
    n = rows.shape[0]
    if not G.nnz or n > _POLICY_UP_TO:
        return
    moving = sp.csr_array(sp.eye_array(n) - G)
    v = np.ones(n)
    before = None
    for _ in range(MAX_POLICY_STEPS):
        choice = moving @ v < rows @ v
        if before is not None and np.array_equal(choice, before):
            return
        before = choice
        by_psi = sp.diags_array(choice.astype(np.float64))
        lu = factorise(sp.csr_array(rows + by_psi @ (moving - rows)))
        if lu is None or not ((v := lu.solve(np.ones(n))) > 0).all():
            return
        yield "v from A and G", v
