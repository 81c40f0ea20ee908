"""Is (A + Aᵀ)/2 positive (semi)definite? By exact row sums, by pivots with a margin, or in rational arithmetic."""

from __future__ import annotations

from fractions import Fraction
from math import fsum
from operator import mul

import numpy as np
import scipy.sparse as sp

from ..arrays import Vector, as_csr, row_of
from ..problem import SMALLEST, UNIT_ROUNDOFF
from . import exact
from .answers import Answer
from .definiteness import definiteness
from .h_matrix import by_row_sums, row_sum_signs
from .scaling import comparison_matrix

#: what rational elimination (rows) and a dense Cholesky factorisation are asked to decide
_RATIONAL, _DENSE = 30, 1000


def curvature(A: sp.csr_array) -> tuple[Answer, Answer]:
    """Whether the symmetric part of `A` (CSR, shape (n, n), diagonal stored) is positive definite, and semidefinite.

    True rests on the row sums of S = A + Aᵀ, taken without rounding, or on positive pivots of S less 2(n + 8)²u times
    its diagonal, u the unit roundoff: that is more than the rounding of S and of its factorisation. Up to n = 30, what
    is left open is decided in rational arithmetic.
    The witness of False is an x, shape (n,), with xᵀAx ≤ 0 (definite), xᵀAx < 0 (semidefinite), checked.
    Reference: Rump, BIT Numer. Math. 46 (2006).

    >>> definite, semidefinite = curvature(sp.csr_array([[1.0, -1.0], [-1.0, 1.0]]))
    >>> definite.holds, semidefinite.holds
    (False, True)
    """
    n, S = A.shape[0], _twice_symmetric_part(A)
    semidefinite = definite = Answer(None, "positive and negative pivots within rounding")
    if S is not None and (S.diagonal() >= 0).all():
        rows, _ = by_row_sums(S)
        if rows.holds:
            return (answer := Answer(True, f"H+-matrix: {rows.reason}")), answer
        if (row_sum_signs(comparison_matrix(S)) >= 0).all():
            semidefinite = Answer(True, "diagonally dominant with nonnegative diagonal")
        if rows.holds is False and _sum_within(A, rows.witness) <= 0:
            definite = Answer(False, "x'Ax <= 0 for the witness x", rows.witness)
    if semidefinite.holds is None or definite.holds is None:
        found = _by_pivots(A)
        if found.holds is not None:
            return found, found
        if n <= _RATIONAL:
            return _in_fractions(A)
    return definite, semidefinite


def _twice_symmetric_part(A: sp.csr_array) -> sp.csr_array | None:
    """A + Aᵀ with its diagonal stored if no entry was rounded, else None."""
    T = sp.csr_array(A.T)
    if (A != T).nnz == 0:
        return A
    with np.errstate(all="ignore"):
        S = sp.csr_array(A + T)
        # x = fl(a + b) is exact if x - a is b and x - b is a
        if not np.isfinite(S.data).all() or ((S - A) != T).nnz or ((S - T) != A).nnz:
            return None
    return as_csr(S, "A + A'", keep_diagonal=True)


def _by_pivots(A: sp.csr_array) -> Answer:
    """Positive definite, or indefinite with a witness, or None."""
    n = A.shape[0]
    # in units of the largest entry nothing overflows
    with np.errstate(under="ignore"):
        data = np.ldexp(A.data, -int(np.frexp(np.abs(A.data).max())[1]))
    unit = sp.csr_array((data, A.indices, A.indptr), shape=A.shape)
    S = sp.csr_array(unit + unit.T)
    diagonal = S.diagonal()
    margin = 2 * UNIT_ROUNDOFF * (n + 8) ** 2
    if n <= _DENSE and (diagonal > 2.0**-900).all():
        weight = 1.0 / np.sqrt(diagonal)
        try:
            np.linalg.cholesky(weight[:, None] * S.toarray() * weight - margin * np.eye(n))
            return Answer(True, "all pivots of its Cholesky factorisation are positive, less a margin for rounding")
        except np.linalg.LinAlgError:
            pass
    with np.errstate(all="ignore"):
        found = definiteness(sp.csr_array(S - sp.diags_array(margin * np.abs(diagonal))))
    if found.definite and n > _DENSE and (diagonal > 2.0**-900).all():
        return Answer(True, found.reason)
    if found.witness is not None and _is_negative(unit, found.witness):
        return Answer(False, "x'Ax < 0 for the witness x", found.witness)
    return Answer(None, found.reason)


def _is_negative(A: sp.csr_array, x: Vector) -> bool:
    """Whether xᵀAx < 0, rounding included; the entries of `A` and of `x` are at most 1."""
    k = int(np.diff(A.indptr).max()) + 4
    size = fsum(np.abs(x) * (abs(A) @ np.abs(x)))
    return fsum(x * (A @ x)) + 2 * k * UNIT_ROUNDOFF * size + A.shape[0] * k * SMALLEST < 0


def _sum_within(A: sp.csr_array, x: Vector) -> Fraction:
    """xᵀAx for a vector of zeros and ones, exactly."""
    inside = A.data[(x[row_of(A)] != 0) & (x[A.indices] != 0)]
    try:
        return Fraction(fsum(inside))  # of the right sign
    except OverflowError:
        return sum(map(Fraction, inside.tolist()), Fraction(0))


def _in_fractions(A: sp.csr_array) -> tuple[Answer, Answer]:
    M = exact.rationals(A)

    def form(x: list[Fraction]) -> Fraction:
        return sum((x_i * sum(map(mul, row, x)) for x_i, row in zip(x, M, strict=True)), Fraction(0))

    S = [[M[i][j] + M[j][i] for j in range(len(M))] for i in range(len(M))]
    semidefinite, _, x = exact.curvature(S)
    how = "pivots in rational arithmetic"
    if x is None:
        return (answer := Answer(True, f"positive {how}")), answer
    if semidefinite:
        witness = exact.as_witness(x, lambda x: form(x) == 0)
        return Answer(False, "x'Ax = 0 for the witness x", witness), Answer(True, f"nonnegative {how}")
    answer = Answer(False, "x'Ax < 0 for the witness x", exact.as_witness(x, lambda x: form(x) < 0))
    return answer, answer
