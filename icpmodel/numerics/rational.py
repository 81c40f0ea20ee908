"""Elimination in rational arithmetic, for small matrices on which rounding leaves a question open."""

from __future__ import annotations

import math
from collections.abc import Sequence
from fractions import Fraction
from typing import Any

import numpy as np
import scipy.sparse as sp

from .arrays import Vector

Rationals = list[list[Fraction]]


def rationals(A: Any) -> Rationals:
    """The entries of the sparse or dense `A` as fractions, row by row; floats are fractions already."""
    dense = A.toarray() if sp.issparse(A) else np.asarray(A)
    return [[Fraction(float(entry)) for entry in row] for row in dense]


def exact_sum(entries: Any) -> Fraction | float:
    """The sum of floats, rounded once at most, so that its sign is right."""
    try:
        return math.fsum(entries)
    except OverflowError:
        return sum(map(Fraction, np.asarray(entries).tolist()), Fraction(0))


def eliminate(M: Rationals, order: Sequence[int]) -> int | None:
    """Gaussian elimination in place, diagonal pivots in the `order` given, on the rows and columns `order`.

    Stops at the first pivot ≤ 0 and returns its place in `order`: the minor of the indices up to there is ≤ 0, those
    before it are positive. Returns None where all are positive.
    """
    for step, k in enumerate(order):
        if M[k][k] <= 0:
            return step
        subtract_row(M, k, order[step + 1 :])
    return None


def subtract_row(M: Rationals, k: int, below: Sequence[int]) -> None:
    """One step of elimination with pivot `M`[k][k] in the rows and columns `below`; row k stays."""
    pivot = M[k][k]
    row = M[k]
    for i in below:
        if M[i][k]:
            factor = M[i][k] / pivot
            for j in below:
                if row[j]:
                    M[i][j] -= factor * row[j]


def substitute_back(M: Rationals, count: int, known: dict[int, Fraction | int]) -> list[Fraction]:
    """x with these entries `known`, such that the rows before `count`, eliminated in turn, give zero, and 0 elsewhere.

    Indices with pivot 0, whose row is zero, get 0.
    """
    x = [Fraction(known.get(i, 0)) for i in range(len(M))]
    for i in reversed(range(count)):
        if M[i][i]:
            x[i] = -sum((M[i][j] * x[j] for j in range(len(x)) if x[j] and M[i][j]), Fraction(0)) / M[i][i]
    return x


def m_matrix(C: Any) -> list[Fraction] | None:
    """An x ≥ 0, x ≠ 0 with Cx ≤ 0 for the Z-matrix `C`; None where it is a nonsingular M-matrix.

    It is one where its leading minors are positive. Reference: Berman and Plemmons (1994), chapter 6.
    """
    M = rationals(C)
    failed = eliminate(M, range(len(M)))
    return None if failed is None else substitute_back(M, failed, {failed: 1})


def curvature(M: Rationals) -> tuple[bool, list[Fraction] | None]:
    """Whether the symmetric `M`, which is overwritten, is semidefinite; and, unless it is definite, an x.

    x ≠ 0 has xᵀMx < 0, or = 0 where M is semidefinite.
    """
    n = len(M)
    flat = None
    for k in range(n):
        if M[k][k] < 0:
            return False, substitute_back(M, k, {k: 1})
        if M[k][k] > 0:
            subtract_row(M, k, range(k + 1, n))
        elif (partner := next((j for j in range(k + 1, n) if M[k][j]), None)) is not None:
            # along x_k the form is linear where x_partner = 1
            along: dict[int, Fraction | int] = {partner: 1, k: -(M[partner][partner] + 1) / (2 * M[k][partner])}
            return False, substitute_back(M, k, along)
        elif flat is None:
            flat = k
    return True, None if flat is None else substitute_back(M, flat, {flat: 1})


def nearest(x: Fraction | float) -> float:
    """The float nearest to `x`, infinite beyond their range."""
    try:
        return float(x)
    except OverflowError:
        return float("inf") if x > 0 else float("-inf")


def as_witness(x: list[Fraction], proves: Any) -> Vector:
    """`x` in floats if they prove what x proves, as `proves` says of a list of fractions, else in fractions."""
    largest = max(abs(entry) for entry in x)
    floats = np.array([float(entry / largest) for entry in x])
    return floats if proves([Fraction(entry) for entry in floats]) else np.array(x, dtype=object)
