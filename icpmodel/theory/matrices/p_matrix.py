"""Is A a P-matrix, that is, are all of its principal minors positive? Then every LCP(q, A) has exactly one solution.

The general question is co-NP-complete, so the answer may be unknown. It is decided for each
irreducible diagonal block:

- Sufficient: H₊; a positive definite symmetric part. For Z-matrices H₊ is necessary, for symmetric
  ones definiteness.
- Up to `MAX_BLOCK_SIZE` rows: the signs of all pivots, in about 6·2ⁿ operations with bounds on their
  rounding. A is P if and only if a₁₁ > 0 and two matrices are P: A without row and column 1, and
  the Schur complement A/a₁₁. Where a bound leaves the sign of a minor open, it is computed in
  rational arithmetic. "Yes" and "no" are proofs.
- Beyond: a minor of order 2 over the pattern may disprove it.

References
----------
Coxson, Math. Program. 64 (1994), on the complexity. Tsatsomeros and Li, Linear Algebra Appl. 330
(2001), on the recursion.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import row_of
from ...numerics.equilibration import in_units, natural_exponents
from ...numerics.rational import leading_minor, rationals
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ..answers import Answer
from .h_matrix import by_row_sums, irreducible_blocks

MAX_BLOCK_SIZE = 26  #: irreducible blocks up to this size are decided by all of their minors: a second or two
_RATIONAL_UP_TO = 10  #: rows up to which all minors are computed in rational arithmetic: half a second
_MINOR_COST = 15.0  #: nanoseconds that a minor takes
_MAX_EXACT_PAIRS = 1000  #: the largest number of nearly singular pairs checked in rational arithmetic

Indices = NDArray[np.intp]


def open_blocks(A: sp.csr_array) -> Iterator[tuple[Indices, sp.csr_array]]:
    """Yield (rows, block): the irreducible blocks that their row sums do not prove to be H₊, small ones first."""
    answer, still_open = by_row_sums(A)
    count, block = irreducible_blocks(A)
    size = np.bincount(block)
    rows = np.flatnonzero((size[block] > 1) & (still_open | np.bool_(answer.holds is False)))
    rows = rows[np.lexsort((block[rows], size[block[rows]]))]
    ends = np.flatnonzero(np.diff(block[rows], append=-1)) + 1
    permuted = A if count == 1 else sp.csr_array(A[rows][:, rows])
    for start, end in zip([0, *ends[:-1]], ends, strict=True):
        yield rows[start:end], sp.csr_array(permuted[start:end, start:end])


def minor_of_order_two(A: sp.csr_array) -> Indices | None:
    """Indices i < j with a_ii a_jj ≤ a_ij a_ji, or None if no such stored pair was found."""
    work.charge_matrices(A.nnz, 8)
    S = in_units(A, *natural_exponents(A))
    with np.errstate(all="ignore"):
        product = sp.csr_array(S * sp.csr_array(S.T))
        i = row_of(product)
        j = product.indices
        diagonal = S.diagonal()
        ratio = product.data / (diagonal[i] * diagonal[j])
    near = np.flatnonzero((i < j) & ~(ratio < 1 - 16 * UNIT_ROUNDOFF))
    for k in near[np.argsort(-ratio[near])][:_MAX_EXACT_PAIRS]:
        pair = np.array([i[k], j[k]], dtype=np.intp)
        minor = [[A[row, column] for column in pair] for row in pair]
        if leading_minor(rationals(minor)) is not None:
            return pair
    return None


def by_pivots(A: sp.csr_array) -> Answer:
    """Decide by the signs of all pivots, rounding included, for n ≤ 60 or so; the time doubles with each row."""
    from ...numerics.kernels.principal_minors import search_minors  # loads numba

    n = A.shape[0]
    work.charge(_MINOR_COST * 2.0**n)
    r, c = natural_exponents(A)
    scaled = in_units(A, r, c).toarray()
    # an entry that left the normal range is known up to the smallest float, or not at all
    lost = np.where((A.toarray() != 0) & (np.abs(scaled) < 2.0**-1000), SMALLEST, 0.0)
    rad = np.where(np.isfinite(scaled), lost, np.inf)
    index_set, undecided = search_minors(scaled, rad, 10**6 // n**3 + 1)
    if index_set:
        return _not_p(_members(index_set))
    exactly = undecided.size > 0 and n <= _RATIONAL_UP_TO
    for bits in range(1, 2**n) if exactly else undecided:
        chosen = _members(bits)
        failed = leading_minor(rationals(A[chosen][:, chosen]))
        if failed is not None:  # mostly it is 0
            return _not_p(chosen[: failed[0] + 1])
    if exactly:
        return Answer(True, "all principal minors are positive, exactly")
    if undecided.size:
        return Answer(None, "undecided within rounding: some of its principal minors are nearly zero")
    return Answer(True, "all principal minors are positive, rounding considered")


def _members(bits: int) -> list[int]:
    return [k for k in range(int(bits).bit_length()) if int(bits) >> k & 1]


def _not_p(minor: list[int]) -> Answer:
    reason = f"the principal minor of the {len(minor)} rows and columns of the witness is not positive"
    return Answer(False, reason, np.array(sorted(minor), dtype=np.intp))
