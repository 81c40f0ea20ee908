"""Uniqueness and error bound where A is positive definite, symmetric or not, or AᵀB is, with B = I − G.

Let r(x) − r(y) = B(x − y) − g with |g| ≤ L|x − y|: B = I − G, L = 0 for ψ = Gz + c, B = I for any
other ψ with Lipschitz matrix L. Let H be the symmetric part of AᵀB and λ ≤ λ_min(H). Let κ be at
least the largest eigenvalue of the symmetric part of |A|ᵀL. If λ > κ, ICP has exactly one solution
z* for every q, and t = ‖z − z*‖₂ satisfies

    (λ − κ)t² ≤ (√λ‖Bᵀu + Aᵀw‖ + ‖Lᵀ|u|‖₂)t − uᵀw,    ‖g‖² = gᵀH⁻¹g ≤ ‖g‖₂²/λ.

The second formula is the norm in the first. It holds for every z and any u and w for which p' = p −
u ≥ 0, r' = r − w ≥ 0 and p'ᵀr' = 0. These are chosen row by row: r' = 0 with w = r, u = min(p, 0),
or p' = 0 with u = p, w = min(r, 0). The larger root of the quadratic is the bound.

Proof: no term of Σ(p' − p*)(r' − r*) is positive. With e = z − z*, p' − p* = Ae − u and r' − r* =
Be − g − w. So E = √(eᵀHe) ≥ √λ·t has (1 − κ/λ)E² ≤ (‖Bᵀu + Aᵀw‖ + ‖Lᵀ|u|‖₂/√λ)E − uᵀw. That is the
quadratic for E/√λ. A row without obstacle has u = p, w = 0, so p' = p* = 0.

F = min(p, r) has F(x) − F(y) = (ΔA + (I − Δ)(B − Γ))(x − y) with a diagonal 0 ≤ Δ ≤ I and |Γ| ≤ L.
A null vector x of the bracket has (Ax)_i((B − Γ)x)_i ≤ 0 in every row, hence (λ − κ)‖x‖² ≤ 0. So F
and its inverse are Lipschitz, and F is a homeomorphism of Rⁿ.

‖g‖ is bounded with a computed y ≈ H⁻¹g: ‖g‖ ≤ √(yᵀHy) + ‖g − Hy‖₂/√λ for every y. The bound
‖g‖₂/√λ alone would divide by λ_min what A multiplies by λ_max, the curvature of an error.

With an upper obstacle, a row may also have p' ≤ 0 and z' = ψ̄, w = z − ψ̄ and u = max(p, 0). Then
B = I − G if ψ̄ = Gz + c̄ has the same G as ψ, else B = I. Take any two points with p ≥ 0 at ψ, p ≤ 0
at ψ̄ and p = 0 in between, and ψ ≤ ψ̄ at both. Then no term (p' − p*)(Be − w − g) is positive. Here
g with |g| ≤ L|x − y| is the change of ψ or of ψ̄, or a number between the two.

Units: the unknowns are scaled by S = diag(A)^(−1/2) and the rows of p by S, those of r by σS⁻¹,
which keeps the form. σ makes the largest entry of B about 1. t is then the norm of S⁻¹e. S and σ
are powers of two, so scaling causes no rounding error.

References
----------
Pang, Math. Oper. Res. 12 (1987), for the idea of such bounds. Nesterov and Scrimali, Discrete
Contin. Dyn. Syst. 31 (2011), for κ = ‖A‖‖L‖, which is never smaller where A ≥ 0. The proof is
above.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...numerics import work
from ...numerics.arrays import Vector
from ...numerics.equilibration import in_units_exactly, row_exponents, symmetric_exponents, times_rows
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF, product_upper_bound, rounded_down, rounded_up, terms_of
from ...numerics.threads import one_blas_thread
from ...problem.data import ProblemData
from ...problem.map import Map
from ...problem.matrix import Matrix
from ...problem.two_sided import sides_of
from ..matrices.comparison_matrix import positive_diagonal
from ..matrices.eigenvalue import definite_factors, in_storage, is_dense, largest_above, smallest_below, within_reach
from ..matrices.h_matrix import without_zeros
from .proof import Proof, no_lipschitz, norm_up

#: up to here the factorisations take a second on a two-dimensional grid, but half a minute on a three-dimensional one
MAX_UNKNOWNS = 50_000
_MAX_PRODUCTS = 2_000_000  #: the largest number of products in AᵀB where B is not I; AᵀB has no more entries


@dataclass(frozen=True, eq=False)
class DefiniteProof(Proof):
    """The data of the proof, for the problem scaled by 2^`exponent`, the rows of r by 2^`exponent_r`.

    `smallest` ≤ λ and `gap` ≤ λ − κ. The attributes `A`, `B` and `L` hold the transposes Aᵀ, Bᵀ and Lᵀ of the scaled
    problem, and `sizes` |A|ᵀ, |B|ᵀ and |H|. `H` differs from the symmetric part of AᵀB by at most `slack` in norm, and
    `factors` are its computed factors. A and H are dense or CSR, the others CSR.
    """

    smallest: float
    gap: float
    exponent: np.ndarray
    exponent_r: np.ndarray
    A: Any
    B: sp.csr_array
    L: sp.csr_array
    H: Any
    slack: float
    factors: Any
    sizes: tuple[Any, sp.csr_array, Any]

    needs_sharpening = True  # δ bounds the Euclidean norm of the error only

    def bound(self, problem: ProblemData, z: Vector, rounding_p: Vector, rounding_r: Vector) -> tuple[Vector, float]:
        with np.errstate(over="ignore", invalid="ignore", under="ignore"), one_blas_thread():
            p, r, sign, room = _reflect(problem, z)
            exponents = np.array([self.exponent, self.exponent_r])
            scaled = np.ldexp([p, r], exponents)
            balance = scaled[0] < scaled[1]  # the rows with u = p
            uw = sign * np.array([np.where(balance, p, np.minimum(p, 0.0)), np.where(balance, np.minimum(r, 0.0), r)])
            # min(x, 0) = 0 for certain where x exceeds its error
            certain = np.array([~balance & (p > rounding_p), balance & (room >= rounding_r)])
            errors = np.where(certain, 0.0, [rounding_p, rounding_r])
            uw = np.ldexp(uw, exponents)
            errors = np.ldexp(errors, exponents) + SMALLEST
            # in these units all terms of the quadratic are about 1, so no square over- or underflows
            size = int(np.frexp((np.abs(uw) + errors).max())[1])
            (u, w), (error_u, error_w) = np.ldexp(uw, -size), np.ldexp(errors, -size) + 2 * SMALLEST
            root = np.full(z.size, self._larger_root(u, error_u, w, error_w))
            delta = np.nextafter(np.ldexp(root, self.exponent + size), np.inf)
        return delta, float(delta.max())

    def _larger_root(self, u: Vector, error_u: Vector, w: Vector, error_w: Vector) -> float:
        """The larger root of the quadratic, rounded up, with u and w known to `error_u` and `error_w`.

        Bᵀu + Aᵀw of k terms is wrong by at most |B|ᵀδu + |A|ᵀδw + γ_k(|B|ᵀ|u| + |A|ᵀ|w|). A sum of k numbers ≥ 0 is at
        most 1 + γ_k times its computed value (Higham, 2002, section 3.1).
        """
        U = np.abs(u) + error_u
        W = np.abs(w) + error_w
        abs_A, abs_B, _ = self.sizes
        terms = terms_of(self.A) + terms_of(self.B) + 4
        rounding = 2 * UNIT_ROUNDOFF * terms
        error = (
            (1 + rounding) * (abs_B @ error_u + abs_A @ error_w)
            + rounding * (abs_B @ U + abs_A @ W)
            + 4 * terms * SMALLEST
        )
        b = self._dual(self.B @ u + self.A @ w) + norm_up(error)
        if self.L.nnz:
            b += norm_up(product_upper_bound(self.L, U))
        errors = float(np.sum(U * error_w + W * error_u)) + (u.size + 4) * UNIT_ROUNDOFF * float(np.sum(U * W))
        product = float(u @ w) - 2 * errors - 4 * u.size * SMALLEST
        square = b * b
        rest = 4 * self.gap * product
        root = np.sqrt(max(square - rest, 0.0) + 8 * UNIT_ROUNDOFF * (square + abs(rest)) + 8 * SMALLEST)
        return (b + float(root)) / (2 * self.gap) * (1 + 8 * UNIT_ROUNDOFF)

    def _dual(self, g: Vector) -> float:
        """An upper bound of √λ·√(gᵀH⁻¹g), not above that of ‖g‖₂."""
        y = self.factors.solve(g)
        n = g.size
        gamma = 2 * UNIT_ROUNDOFF * (n + 8)
        underflow = (n + 8) * SMALLEST
        image = self.H @ y
        size = self.sizes[2] @ np.abs(y)
        energy = float(y @ image) + gamma * float(np.abs(y) @ size) + underflow * (1.0 + float(np.abs(y).sum()))
        rest = norm_up(np.abs(g - image) + gamma * (np.abs(g) + size) + underflow)
        lost = 2 * self.slack * norm_up(y)
        energy += lost * norm_up(y)
        root = float(np.sqrt(max(self.smallest * energy, 0.0) + 8 * SMALLEST))
        return float(np.fmin(root * (1 + 8 * UNIT_ROUNDOFF) + rest + lost, norm_up(g)))


def prove(matrix: Matrix, psi: Map) -> DefiniteProof | str:
    """Prove λ > κ, or say why not: λ by factorisations of the symmetric part of AᵀB, κ by the power method."""
    A = matrix.sparse
    n = matrix.n
    is_full = is_dense(A)
    if not (positive := positive_diagonal(A)).holds:
        return f"A is not positive definite: {positive.reason}"
    if psi.lipschitz is None:
        return no_lipschitz(psi)
    B, L = _slopes(psi, n)
    products = int(np.diff(A.indptr) @ (np.diff(B.indptr) + np.diff(L.indptr)))
    coupled = (sp.eye_array(n) != B).nnz > 0
    if (n > MAX_UNKNOWNS and not is_full) or (products > _MAX_PRODUCTS and (coupled or L.nnz)):
        return f"A is not tested for definiteness: with n = {n} and {A.nnz} entries it is too large to be factorised"
    work.charge_matrices(products, 12)
    A = in_storage(A)
    exponent = symmetric_exponents(A.diagonal())
    # σ: where B is not I, AᵀB is about 1 as well
    exponent_r = -exponent + (int((row_exponents(B, exponent) + exponent).min()) if coupled else 0)
    scaled = [in_units_exactly(X, left, exponent) for X, left in ((A, exponent), (B, exponent_r), (L, exponent_r))]
    if any(X is None for X in scaled):
        return "A is not tested for definiteness: scaled to a diagonal of 1, its entries or those of psi underflow"
    A, B, L = scaled
    return _proof(A, B, L, exponent, exponent_r, matrix.is_symmetric, coupled)


def _proof(
    A: Any,
    B: sp.csr_array,
    L: sp.csr_array,
    exponent: np.ndarray,
    exponent_r: np.ndarray,
    is_symmetric: bool,
    coupled: bool,
) -> DefiniteProof | str:
    """The proof for scaled matrices, or why there is none."""
    n = L.shape[0]
    At = sp.csr_array(A.T) if sp.issparse(A) else A.T
    gamma = 2 * (int(np.max(terms_of(At))) + 4) * UNIT_ROUNDOFF
    name = "A'(I - G)" if coupled else "A"
    if is_symmetric and not coupled:
        At = H = A
        slack = 0.0
    else:
        H, slack = _symmetric_part(At, B if coupled else None, gamma)
    if sp.issparse(H) and not within_reach(H):
        return f"{name} is not tested for definiteness: with n = {n} it is too large to be factorised"
    factors = definite_factors(H)
    smallest = -np.inf if factors is None else smallest_below(H, slack, factors)
    if not smallest > 0:
        return f"{name} is not proved positive definite: its symmetric part has no eigenvalue bound above 0"
    # rounding of the product included
    kappa = largest_above(sp.csr_array(abs(At) @ L)) * (1 + gamma) + n * n * SMALLEST if L.nnz else 0.0
    gap = float(np.nextafter(smallest - kappa, -np.inf))
    if not gap > 0:
        reach = (
            f"the eigenvalues of |A|'G are at most {rounded_up(kappa)}, those of A at least {rounded_down(smallest)}"
        )
        return f"psi is too steep: {reach}"
    sentence = (
        f"{name} is positive definite (the symmetric part, its diagonal scaled to 1, is >= {rounded_down(smallest)})"
    )
    Bt = sp.csr_array(B.T)
    Lt = sp.csr_array(L.T)
    abs_A = abs(At)
    sizes = abs_A, abs(Bt), abs_A if At is H else abs(H)
    return DefiniteProof(sentence, smallest, gap, exponent, exponent_r, At, Bt, Lt, H, slack, factors, sizes)


def _symmetric_part(At: Any, B: sp.csr_array | None, gamma: float) -> tuple[Any, float]:
    """The symmetric part of AᵀB, of Aᵀ where `B` is None, and a bound on the norm of its error."""
    n = At.shape[0]
    slack = n * n * SMALLEST
    M = At
    if B is not None:  # rounding of the product
        M = At @ B
        ones = np.ones(n)
        rows = abs(At) @ (abs(B) @ ones)
        columns = abs(B).T @ (abs(At).T @ ones)
        slack += gamma * float((rows + columns).max())
    H = 0.5 * (M + M.T)
    H = sp.csr_array(H) if sp.issparse(H) else H
    return H, slack + 4 * UNIT_ROUNDOFF * float(abs(H).sum(axis=1).max())


def _reflect(problem: ProblemData, z: Vector) -> tuple[Vector, Vector, Any, Vector]:
    """(p, r, sign, room): where `sign` is −1, the row is seen from the upper obstacle, p is −p and r is ψ̄ − z.

    `room` ≥ 0 where z is between the obstacles; with one obstacle it is r. Where z is above the upper obstacle the row
    is seen from the upper one, where it is below the lower obstacle from the lower one. In between the sign of p
    decides.
    """
    p = problem.p(z)
    r = problem.r(z)
    r_upper = problem.r_upper(z)
    if r_upper is None:
        return p, r, 1.0, r
    is_upper = (r_upper > 0) | ((p < 0) & (r >= 0))
    sign = np.where(is_upper, -1.0, 1.0)
    return sign * p, np.where(is_upper, -r_upper, r), sign, np.minimum(r, -r_upper)


def _slopes(psi: Map, n: int) -> tuple[sp.csr_array, sp.csr_array]:
    """B and L with r(x) − r(y) = B(x − y) − g, |g| ≤ L|x − y|; L includes the rounding errors of I − G."""
    identity = sp.csr_array(sp.eye_array(n))
    if psi.linear is None or not psi.parallel:
        assert psi.lipschitz is not None
        return identity, psi.lipschitz
    ends = [side.linear[1] for side in sides_of(psi) if side.linear is not None]
    bound = without_zeros(times_rows(np.isfinite(ends).any(axis=0).astype(float), psi.linear[0]))
    B = sp.csr_array(identity - bound)
    g = bound.diagonal()
    b = B.diagonal()
    # the error of 1 - g, exactly (Knuth)
    lost = np.abs((1.0 - (b - (b - 1.0))) - (g + (b - 1.0)))
    return B, without_zeros(sp.csr_array(sp.diags_array(lost)))
