"""Combinations of rows in floats, with bounds on all rounding errors."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ...numerics import work
from ...numerics.arrays import Mask, Vector
from ...numerics.equilibration import Exponents, times_rows
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ..convergence.contraction import DenseInverse
from .combination_rows import MAX_COST, MAX_MISFIT, CombinationRows


@np.errstate(all="ignore")
def rounded_combination(rows: CombinationRows, y: Vector, exponents: Exponents) -> float | None:
    """An upper bound of (Mz + m)ᵀx, for some x near 2^`exponents`·`y`, if it is negative, rounding included."""
    used = np.flatnonzero(y)
    y = y[used]
    scale = np.ldexp(1.0, exponents[used])
    chosen = rows.matrix[used]
    K = times_rows(scale, chosen)
    right = scale * rows.offset[used]
    size = abs(K)
    # twice the roundoff of a sum, with four operations more than it has, as for all sums here
    loss = 2.0 * (K.shape[0] + K.shape[1] + 6) * UNIT_ROUNDOFF
    # an entry that underflows is wrong by at most SMALLEST, a product of it with y_i by |y_i| times as much
    tiny = 2.0 * sum(K.shape) * SMALLEST * max(1.0, float(np.abs(y).max(initial=0.0)))
    columns = K.T @ y
    off = loss * (size.T @ np.abs(y)) + tiny
    # entries that are 0 only after scaling do not count as 0
    empty = np.bincount(chosen.indices[chosen.data != 0.0], minlength=chosen.shape[1]) == 0
    # columns that are not certain to have the required sign
    is_open = ~(_bounded(rows, columns, off) | empty)
    moved = np.zeros(y.size)
    if is_open.any():
        signed = ~(rows.nonnegative & rows.nonpositive)[used]
        moves = _entry_moves(K[:, is_open], y, signed, (np.abs(columns) + off)[is_open])
        if moves is None:
            return None
        moved = moves
        off = off + 1.01 * (size.T @ moved)
        if not (_bounded(rows, columns, off) | empty)[~is_open].all():
            return None
        columns[is_open] = 0.0
        off[is_open] = 0.0
    most, terms = _highest_value(rows, columns, off)
    most = most + float(right @ y) + float(np.abs(right) @ moved)
    terms += float(np.abs(right) @ (np.abs(y) + moved))
    most += 4.0 * loss * terms + tiny
    return most if most < 0.0 else None


def _highest_value(rows: CombinationRows, columns: Vector, off: Vector) -> tuple[float, float]:
    """The largest wᵀz for any w within `off` of `columns`, and the sum of the absolute values of its terms."""
    low = np.where(np.isfinite(rows.low), rows.low, 0.0)
    high = np.where(np.isfinite(rows.high), rows.high, 0.0)
    reach = np.maximum(np.abs(low), np.abs(high))
    most = float(columns @ np.where(columns > 0, high, low)) + float(off @ reach)
    return most, float((np.abs(columns) + 2.0 * off) @ reach)


def _bounded(rows: CombinationRows, columns: Vector, off: Vector) -> Mask:
    """Where w_j z_j is bounded above for every w_j within `off`_j of `columns`_j."""
    has_low = np.isfinite(rows.low)
    has_high = np.isfinite(rows.high)
    return (columns - off >= 0) & has_high | (columns + off <= 0) & has_low | has_low & has_high


def _entry_moves(columns: sp.csr_array, y: Vector, signed: Mask, misfit: Vector) -> Vector | None:
    """Bounds on |x − y|, entry by entry, for an x with Nx = 0, where |Ny| ≤ `misfit`.

    `columns` is Nᵀ; it is made dense within the work and memory limits. As many entries move as N has rows, those of a
    basis B: by |B⁻¹Ny|.

    None if a limit or B does not allow it, if y moves too far, or if the sign of a `signed` entry may change.
    """
    from scipy.linalg import qr

    m, k = columns.shape
    # nanoseconds of the factorisation with pivoting: 7 s at m = 2600 and k = 1700 were measured
    cost = float(k) * k * m
    if k > m or cost > min(MAX_COST, work.nanoseconds_left()) or not work.memory_suffices(24.0 * k * m):
        return None
    work.count(cost)
    size = np.abs(y)
    N: Any = columns.toarray().T
    if not np.isfinite(N).all():
        return None
    basis = qr(N * np.where(signed, size / size.max(), 1.0), mode="r", pivoting=True)[1][:k]
    B = sp.csr_array(N[:, basis])
    inverse = DenseInverse.of(B, abs(B))
    if inverse is None:
        return None
    moved = np.zeros(m)
    moved[basis] = inverse.upper(misfit)
    # farther away y would not be a witness
    return moved if moved.max() <= MAX_MISFIT * size.max() and not (signed & (size < moved)).any() else None
