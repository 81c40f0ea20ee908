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


def eliminate(M: Rationals, order: Sequence[int], rest: Sequence[int] = ()) -> int | None:
    """Gaussian elimination in place, diagonal pivots in the `order` given, on the rows and columns `order` and `rest`.

    Stops at the first pivot ≤ 0 and returns its place in `order`: the minor of the indices up to there is ≤ 0, those
    before it are positive. Returns None where all are positive; `M` then holds the Schur complement in `rest`.
    """
    for step, k in enumerate(order):
        if M[k][k] <= 0:
            return step
        below = [*order[step + 1 :], *rest]
        subtract_row(M, k, below)
    return None


def subtract_row(M: Rationals, k: int, below: Sequence[int]) -> None:
    """One step of elimination with pivot `M`[k][k] in the rows and columns `below`; row k stays."""
    pivot, row = M[k][k], M[k]
    for i in below:
        if M[i][k]:
            factor = M[i][k] / pivot
            for j in below:
                if row[j]:
                    M[i][j] -= factor * row[j]


def substitute_back(M: Rationals, done: Sequence[int], x: list[Fraction]) -> None:
    """Fill in x at the eliminated indices `done`, in place, such that their rows of the original matrix give zero.

    Indices with pivot 0, whose row is zero, get 0.
    """
    for i in reversed(done):
        if M[i][i]:
            later = [j for j in range(len(x)) if x[j] and M[i][j]]
            x[i] = -sum((M[i][j] * x[j] for j in later), Fraction(0)) / M[i][i]


def m_matrix(C: Any) -> tuple[bool, list[Fraction] | None]:
    """Whether the Z-matrix `C` is a nonsingular M-matrix, that is whether its leading minors are positive.

    If not, also an x ≥ 0, x ≠ 0 with Cx ≤ 0. Reference: Berman and Plemmons (1994), chapter 6.
    """
    M = rationals(C)
    n = len(M)
    failed = eliminate(M, range(n))
    if failed is None:
        return True, None
    x = [Fraction(0)] * n
    x[failed] = Fraction(1)
    substitute_back(M, range(failed), x)
    return False, x


def curvature(S: Any) -> tuple[bool, bool, list[Fraction] | None]:
    """Whether the symmetric `S` is semidefinite, whether it is definite, and if not an x ≠ 0 with xᵀSx < 0, or = 0."""
    M = S if isinstance(S, list) else rationals(S)
    n, flat = len(M), None
    for k in range(n):
        x = [Fraction(0)] * n
        x[k] = Fraction(1)
        partner = next((j for j in range(k + 1, n) if M[k][j]), None)
        if M[k][k] < 0 or (M[k][k] == 0 and partner is not None):
            if M[k][k] == 0 and partner is not None:  # along x_k the form is linear where x_partner = 1
                x[partner] = Fraction(1)
                x[k] = -(M[partner][partner] + 1) / (2 * M[k][partner])
            substitute_back(M, range(k), x)
            return False, False, x
        if M[k][k] == 0:
            flat = k if flat is None else flat
        else:
            subtract_row(M, k, range(k + 1, n))
    if flat is None:
        return True, True, None
    x = [Fraction(0)] * n
    x[flat] = Fraction(1)
    substitute_back(M, range(flat), x)
    return True, False, x


def nearest(x: Fraction | float) -> float:
    """The float nearest to `x`, infinite beyond their range."""
    try:
        return float(x)
    except OverflowError:
        return float("inf") if x > 0 else float("-inf")


def as_witness(x: list[Fraction], proves: Any) -> Vector:
    """`x` in floats if they prove what x proves, else as an array of fractions.

    Parameters: `proves` takes a list of fractions and says whether they do.
    """
    largest = max(abs(entry) for entry in x)
    floats = np.array([float(entry / largest) for entry in x])
    return floats if proves([Fraction(entry) for entry in floats]) else np.array(x, dtype=object)
