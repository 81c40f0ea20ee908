"""Is (A + Aᵀ)/2 positive (semi)definite? By exact row sums, by a factorisation with its error, in rational arithmetic.

Every yes and no is proved, rounding included. The factorisation is that of S = (A + Aᵀ)/2 in units,
powers of two, in which its diagonal lies between 1/2 and 2. So large rows do not hide small ones:
congruence with a positive diagonal keeps the signs of all eigenvalues (Sylvester). The docstring of
`eigenvalue.smallest_eigenvalue_bound` states what it proves.
"""

from __future__ import annotations

from fractions import Fraction
from math import fsum
from operator import mul

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import Vector, as_csr, row_of
from ...numerics.equilibration import in_units, row_exponents, symmetric_exponents
from ...numerics.rational import as_witness, curvature, exact_sum, rationals
from ...numerics.rounding import SMALLEST, SQRT_EPSILON, UNIT_ROUNDOFF
from ...numerics.sparse_structure import is_symmetric
from ..answers import Answer
from .comparison_matrix import comparison_matrix
from .eigenvalue import negative_direction, smallest_eigenvalue_bound, within_reach
from .h_matrix import by_row_sums, row_sum_signs

_SHIFT = 2.0**-38  #: S − cI is factorised with this c, about as large as rounding requires, or with a larger one
#: up to this number of rows LDLᵀ in fractions decides; 30 rows take .2 s
RATIONAL_UP_TO = 30


def definiteness(A: sp.csr_array) -> tuple[Answer, Answer]:
    """Whether the symmetric part of `A` (CSR, shape (n, n), diagonal stored) is positive definite, and semidefinite.

    An exactly singular matrix may stay open beyond n = 30.
    The witness of False is an x, shape (n,), with xᵀAx ≤ 0 (definite), xᵀAx < 0 (semidefinite), checked.
    """
    n = A.shape[0]
    diagonal = A.diagonal()
    definite = semidefinite = Answer(None, "")
    i = int(np.argmin(diagonal))
    if diagonal[i] <= 0:
        sign = "negative" if diagonal[i] < 0 else "not positive"
        definite = Answer(False, f"its diagonal entry {diagonal[i]:g} in row {i} is {sign}", np.eye(1, n, i)[0])
        if diagonal[i] < 0:
            return definite, definite
    S = _twice_symmetric_part(A)
    if S is not None:
        rows, _ = by_row_sums(S)
        if rows.holds:
            return (Answer(True, f"its symmetric part is an H+-matrix: {rows.reason}"),) * 2
        if (row_sum_signs(comparison_matrix(S)) >= 0).all():
            semidefinite = Answer(True, "its symmetric part is diagonally dominant with nonnegative diagonal")
        # x'Ax of a vector of zeros and ones
        if rows.holds is False and exact_sum(A.data[(rows.witness[[row_of(A), A.indices]] != 0).all(axis=0)]) <= 0:
            definite = Answer(False, "x'Ax <= 0 for the witness x", rows.witness)
    if definite.holds is None or semidefinite.holds is None:
        by_pivots = _by_pivots(A)
        if by_pivots.holds is not None:
            return by_pivots, by_pivots
        if n <= RATIONAL_UP_TO:
            return _in_fractions(A)
        definite, semidefinite = (by_pivots if answer.holds is None else answer for answer in (definite, semidefinite))
    return definite, semidefinite


def semidefinite_up_to_rounding(A: sp.csr_array) -> Answer:
    """Whether the symmetric part of `A` is semidefinite up to rounding, as a computed BᵀB is: True or None.

    True proves that all eigenvalues, with the diagonal scaled to about 1, are at least `number`, above −2⁻²⁶.
    """
    T, _, _ = _in_own_units(A)
    if (T.diagonal() >= 0).all() and within_reach(T):
        bound = smallest_eigenvalue_bound(T, -_rounding_of(T))
        if bound > -SQRT_EPSILON:
            reason = f"semidefinite up to rounding: no eigenvalue is below {bound:.2g} of its diagonal"
            return Answer(True, reason, None, bound)
    return Answer(None, "not shown to be semidefinite up to rounding")


def _twice_symmetric_part(A: sp.csr_array) -> sp.csr_array | None:
    """A + Aᵀ with its diagonal stored if no entry was rounded, else None."""
    work.charge_matrices(A.nnz, 4)
    if is_symmetric(A):
        return A
    T = sp.csr_array(A.T)
    with np.errstate(all="ignore"):
        S = sp.csr_array(A + T)
        # x = fl(a + b) is exact if x - a is b and x - b is a
        if not np.isfinite(S.data).all() or ((S - A) != T).nnz or ((S - T) != A).nnz:
            return None
    return as_csr(S, "A + A'", keep_diagonal=True)


def _in_own_units(A: sp.csr_array) -> tuple[sp.csr_array, sp.csr_array, NDArray[np.int64]]:
    """((M + Mᵀ)/2, M, e) with m_ij = 2^(e_i + e_j)a_ij, a diagonal of about 1 where a_ii > 0, and |m_ij| ≤ 2^900.

    Where both cannot be, the diagonal is far smaller than the other entries of its row or column: A is indefinite.
    """
    work.charge_matrices(A.nnz, 5)
    columns = A if is_symmetric(A) else sp.csr_array(A.T)
    largest = -np.minimum(row_exponents(A), row_exponents(columns))
    # (900 - E_i)/2 + (900 - E_j)/2 + min(E_i, E_j) is at most 900
    limit = (900 - largest) // 2
    diagonal = A.diagonal()
    e = np.where(diagonal > 0, np.minimum(symmetric_exponents(diagonal), limit), limit)
    M = in_units(A, e, e)
    with np.errstate(under="ignore"):
        return M if columns is A else sp.csr_array(0.5 * M + 0.5 * M.T), M, e


def _rounding_of(T: sp.csr_array) -> float:
    return 8 * (T.shape[0] + 8) * UNIT_ROUNDOFF * float(abs(T).sum(axis=1).max())


def _by_pivots(A: sp.csr_array) -> Answer:
    """Positive definite, or indefinite with a witness, or None."""
    n = A.shape[0]
    (T, M, e) = _in_own_units(A)
    if not within_reach(T):
        return Answer(None, f"not diagonally dominant, and with n = {n} too large to be factorised")
    if (T.diagonal() > 0).all():
        bound = smallest_eigenvalue_bound(T, _SHIFT)
        if -np.inf < bound <= 0:  # rounding exceeds the shift: if any shift is enough, twice the rounding is
            bound = smallest_eigenvalue_bound(T, 2 * (_SHIFT - bound))
        if bound > 0:
            return Answer(True, "all pivots are positive, less a margin for rounding")
    # the shift keeps zero pivots away
    x = negative_direction(sp.csr_array(T + _rounding_of(T) * sp.eye_array(n)))
    if x is not None and np.isfinite(x).all():
        with np.errstate(under="ignore"):
            shift = e - e[x != 0].max()
            x = np.ldexp(x / np.abs(x).max(), shift)
            # the entries that are not lost in the units of A are scaled back without rounding
            if proves_negative(M, np.ldexp(x, -shift)):
                return Answer(False, "indefinite: x'Ax < 0 for the witness x", x)
    return Answer(None, "its factorisation met a pivot of either sign within rounding")


def proves_negative(A: sp.csr_array, x: Vector) -> bool:
    """Whether xᵀAx < 0, rounding included, `A` known to the smallest float; |a_ij| ≤ 2^900 and |x_i| ≤ 1."""
    k = int(np.diff(A.indptr).max()) + 4
    size = fsum(np.abs(x) * (abs(A) @ np.abs(x)))
    return fsum(x * (A @ x)) + 2 * k * UNIT_ROUNDOFF * size + A.shape[0] * k * SMALLEST < 0


def _in_fractions(A: sp.csr_array) -> tuple[Answer, Answer]:
    M = rationals(A)

    def form(x: list[Fraction]) -> Fraction:
        return sum((x_i * sum(map(mul, row, x)) for x_i, row in zip(x, M, strict=True)), Fraction(0))

    S = [[M[i][j] + M[j][i] for j in range(len(M))] for i in range(len(M))]
    semidefinite, x = curvature(S)
    how = "pivots in rational arithmetic"
    if x is None:
        return (Answer(True, f"positive {how}"),) * 2
    if semidefinite:
        witness = as_witness(x, lambda x: form(x) == 0)
        return Answer(False, "x'Ax = 0 for the witness x", witness), Answer(True, f"nonnegative {how}")
    return (Answer(False, "indefinite: x'Ax < 0 for the witness x", as_witness(x, lambda x: form(x) < 0)),) * 2
