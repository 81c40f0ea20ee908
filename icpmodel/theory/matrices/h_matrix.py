"""Is A an H-matrix? Decided block by irreducible block: by its row sums, by Perron's vector, or by one linear solve.

A is an H-matrix if ⟨A⟩ is a nonsingular M-matrix. That is proved by a v > 0 with ⟨A⟩v > 0. It is
disproved by an x ≥ 0, x ≠ 0, with ⟨A⟩x ≤ 0 (were ⟨A⟩⁻¹ ≥ 0, then x = ⟨A⟩⁻¹⟨A⟩x ≤ 0). Entries
between the irreducible diagonal blocks of ⟨A⟩ do not affect the answer. In one block:

- All row sums ≥ 0, one of them > 0: H (Taussky). All ≤ 0: not H, with x = 1.
- Jx > x > 0 or Jx < x for J = |D|⁻¹|D − A| and some iterate x of the power method: not H, or H.
- v with ⟨A⟩v ≈ D1: where v > 0 it is a proof. Otherwise x = v⁻ = max(−v, 0) is always a disproof.
  Where v_i ≤ 0, (⟨A⟩v⁻)_i = (⟨A⟩v⁺)_i − (⟨A⟩v)_i with both terms ≤ 0. Elsewhere (⟨A⟩v⁻)_i has
  entries off the diagonal only.

References
----------
Berman and Plemmons, Nonnegative Matrices in the Mathematical Sciences (1994), chapter 6.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from fractions import Fraction
from functools import partial
from operator import mul

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import Mask, Vector, row_of, with_entries
from ...numerics.equilibration import in_units, natural_exponents
from ...numerics.rational import Rationals, as_witness, exact_sum, m_matrix, rationals
from ...numerics.rounding import SMALLEST, product_lower_bound, product_upper_bound
from ..answers import Answer
from .comparison_matrix import comparison_matrix, solve_for_diagonal

_MAX_POWER_STEPS = 30  #: this number of steps of the power method costs less than a linear solve
#: the largest block that rational elimination decides; all blocks together have at most the square of it in entries
_MAX_EXACT_ROWS = 40


def irreducible_blocks(A: sp.csr_array) -> tuple[int, NDArray[np.int32]]:
    """The number of irreducible diagonal blocks of `A`, and the block of each row, shape (n,).

    They are the strongly connected components of the graph with an edge (i, j) where a_ij ≠ 0.
    """
    from scipy.sparse.csgraph import connected_components

    work.charge_matrices(A.nnz, 2)
    return connected_components(without_zeros(A), connection="strong")


def without_zeros(A: sp.csr_array) -> sp.csr_array:
    """A copy of `A` that stores no zeros; `A` and what shares its arrays stay as they are."""
    copy = A.copy()
    copy.eliminate_zeros()
    return copy


def row_sum_signs(C: sp.csr_array) -> NDArray[np.int8]:
    """The sign of each row sum of `C` (CSR, shape (n, n)), without rounding: −1, 0 or 1, shape (n,)."""
    from ...numerics.kernels.products import sum_signs  # loads numba

    work.charge_matrices(C.nnz, 4)
    signs = np.empty(C.shape[0], dtype=np.int8)
    sum_signs(C.indptr, C.data, np.empty(np.diff(C.indptr).max(initial=0) + 1), signs)
    for i in np.flatnonzero(signs == 2):
        total = exact_sum(C.data[C.indptr[i] : C.indptr[i + 1]])
        signs[i] = (total > 0) - (total < 0)
    return signs


def by_row_sums(A: sp.csr_array) -> tuple[Answer, Mask]:
    """Whether A is an H-matrix, as far as D and exact row sums decide, and the rows, a mask, of the undecided blocks.

    Reference: Taussky, Amer. Math. Monthly 56 (1949).
    """
    n = A.shape[0]
    diagonal = A.diagonal()
    C = comparison_matrix(A)
    if (diagonal == 0).any():
        i = int(np.argmax(diagonal == 0))
        return Answer(False, f"A[{i}, {i}] = 0", np.eye(1, n, i)[0]), np.zeros(n, dtype=bool)
    count, block = irreducible_blocks(A)
    signs = row_sum_signs(within_blocks(C, block))
    highest = np.full(count, -1, dtype=np.int8)
    lowest = np.ones(count, dtype=np.int8)
    np.maximum.at(highest, block, signs)
    np.minimum.at(lowest, block, signs)
    if (highest <= 0).any():
        x = (block == np.argmax(highest <= 0)).astype(np.float64)
        where = "of a whole irreducible block" if count > 1 else "of A"
        return Answer(False, f"no row {where} has |a_ii| > sum of the other |a_ij|", x), np.zeros(n, dtype=bool)
    still_open = lowest[block] < 0
    if still_open.any():
        return Answer(None, "not diagonally dominant"), still_open
    return Answer(True, "every irreducible block is diagonally dominant, one row of each strictly"), still_open


def within_blocks(A: sp.csr_array, block: NDArray[np.int32]) -> sp.csr_array:
    """`A` with zeros for the entries between the blocks whose labels, shape (n,), are `block`."""
    data = np.where(block[row_of(A)] == block[A.indices], A.data, 0.0)
    return with_entries(A, data)


def h_matrix(A: sp.csr_array) -> Answer:
    """Whether `A`, every diagonal entry stored, is an H-matrix: v > 0 with ⟨A⟩v > 0, or x ≥ 0, x ≠ 0, with ⟨A⟩x ≤ 0."""
    answer, still_open = by_row_sums(A)
    if answer.holds is not None:
        return answer
    rows = np.flatnonzero(still_open)
    part = A if still_open.all() else sp.csr_array(A[rows][:, rows])
    answer = decide(comparison_matrix(part), *irreducible_blocks(part))
    if still_open.all():
        return answer
    # a v of the undecided blocks is not a v of A
    x = None if answer.holds or answer.witness is None else _spread(answer.witness, rows, A.shape[0])
    return replace(answer, witness=x)


def _spread(x: Vector, rows: NDArray[np.intp], n: int) -> Vector:
    """`x` in the `rows`, zeros in the others."""
    full = np.zeros(n, dtype=x.dtype)
    full[rows] = x
    return full


def decide(C: sp.csr_array, count: int, block: NDArray[np.int32]) -> Answer:
    """Whether the `count` diagonal blocks of `C` = ⟨C⟩ are nonsingular M-matrices; for one block, with v > 0 for C."""
    work.charge_matrices(C.nnz, 8)
    r, c = natural_exponents(C)
    S = without_zeros(in_units(within_blocks(C, block), r, c))
    if np.isfinite(S.data).all():
        for name, y in _candidates(S, block, count):
            holds = _proves(S, y)
            if holds:
                return Answer(True, f"<A>v > 0 with v from {name}", _in_old_units(y, c) if count == 1 else None)
            if holds is False:
                return Answer(False, f"<A>x <= 0 with x >= 0 from {name}", _in_old_units(y, c))
    if C.nnz <= _MAX_EXACT_ROWS**2 and np.bincount(block).max() <= _MAX_EXACT_ROWS:
        return _exactly(C, block, count)
    return Answer(None, "neither v > 0 with <A>v > 0 nor x >= 0 with <A>x <= 0 was found, rounding considered")


def _candidates(S: sp.csr_array, block: NDArray[np.int32], count: int) -> Iterator[tuple[str, Vector]]:
    """Yield (name, vector): vectors that may prove or disprove it, cheapest first."""
    diagonal = S.diagonal()
    x = np.ones(S.shape[0])
    step_cost = 3 * work.product_cost(x.size, S.nnz)

    def image(x: Vector) -> Vector:
        work.charge(step_cost)
        return x - (S @ x) / diagonal  # Jx

    with np.errstate(all="ignore"):  # for tiny diagonal entries J overflows, and NaN proves nothing
        for _ in range(_MAX_POWER_STEPS):
            x = x + np.maximum(image(x), 0.0)  # I + J has no other eigenvalue of its largest modulus
            largest = np.zeros(count)
            np.maximum.at(largest, block, x)
            x = x / largest[block]
        ratio = image(x) / x
        least = np.full(count, np.inf)
        most = np.zeros(count)
        np.minimum.at(least, block, ratio)
        np.maximum.at(most, block, ratio)
    if (least > 1).any():
        yield "Perron's vector", np.where(block == np.argmax(least), x, 0.0)
    elif (most < 1).all():
        yield "Perron's vector", x
    with np.errstate(all="ignore"):
        v = solve_for_diagonal(S)
        if v is not None:
            v = v if (v > 0).all() else np.maximum(-v, 0.0)
            v = v / v.max()
    if v is not None:
        yield "<A>^-1 D1", v


def _proves(S: sp.csr_array, y: Vector) -> bool | None:
    """True where y > 0 and Sy > 0, False where y ≥ 0, y ≠ 0 and Sy ≤ 0, for the Z-matrix `S`, rounding included.

    Entries of S may be off by the smallest float, and max(y) ≤ 1.
    """
    slack = np.diff(S.indptr) * SMALLEST
    if (y > 0).all() and (product_lower_bound(S, y) - slack > 0).all():
        return True
    # where y_i = 0, row i has entries off the diagonal only
    if (y >= 0).all() and y.any() and (np.where(y > 0, product_upper_bound(S, y) + slack, 0.0) <= 0).all():
        return False
    return None


def _in_old_units(y: Vector, c: NDArray[np.int64]) -> Vector | None:
    """D₂y, D₂ = diag(2^c) up to a factor; None where that leaves the range of floats."""
    exponents = np.clip(c - c[y > 0].max(), -4000, 0).astype(np.int32)
    with np.errstate(under="ignore"):
        x = np.ldexp(y, exponents)
        return x if (np.ldexp(x, -exponents) == y).all() else None


def _disproves(C: Rationals, x: list[Fraction]) -> bool:
    return min(x) >= 0 and any(x) and all(sum(map(mul, row, x)) <= 0 for row in C)


def _exactly(C: sp.csr_array, block: NDArray[np.int32], count: int) -> Answer:
    for b in range(count):
        rows = np.flatnonzero(block == b)
        dense = C[rows][:, rows].toarray()
        if (x := m_matrix(dense)) is not None:
            part = as_witness(x, partial(_disproves, rationals(dense)))
            reason = "a leading minor of <A> is not positive, in rational arithmetic"
            return Answer(False, reason, _spread(part, rows, C.shape[0]))
    return Answer(True, "all leading minors of <A> are positive, in rational arithmetic")
