"""Combinations of rows in floats, all rounding being bounded."""

from __future__ import annotations

from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import Mask, Vector
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData
from .combination_rows import SHOWN, CombinationRows

#: nanoseconds for k²m of a factorisation with pivoting of an m × k matrix, 7 s at m = 2600 and k = 1700 were measured;
#: and how many are too many
_PIVOTED = 1.0
_LONGEST = 2e9


@np.errstate(all="ignore")
def rounded_combination(problem: ProblemData, rows: CombinationRows, y: Vector) -> float | None:
    """What (Az + q)ᵀx is at most, for some x next to `y`, where that is negative, all rounding being bounded."""
    used = np.flatnonzero(y)
    y = y[used]
    right = problem.q[used]
    K = problem.A[used]
    signed = ~(rows.rises & rows.falls)[used]
    size = abs(K)
    # two more than the operations of a sum, twice, as for all sums here
    loss = 2.0 * (K.shape[0] + problem.n + 4) * UNIT_ROUNDOFF
    tiny = (K.shape[0] + problem.n) * SMALLEST
    columns = K.T @ y
    off = loss * (size.T @ np.abs(y)) + tiny
    has_low = np.isfinite(rows.low)
    has_high = np.isfinite(rows.high)
    empty = size.sum(axis=0) == 0

    def sure() -> Any:
        return ((columns - off >= 0) & has_high) | ((columns + off <= 0) & has_low) | (has_low & has_high) | empty

    open_ = np.flatnonzero(~sure())
    moved = np.zeros(y.size)
    if open_.size:
        found = _moved(K, y, signed, open_, np.abs(columns[open_]) + off[open_], loss)
        if found is None:
            return None
        basis, by = found
        moved[basis] = by
        if (signed[basis] & (np.abs(y[basis]) < by)).any():
            return None
        off += 1.01 * (size.T @ moved)
        if not np.delete(sure(), open_).all():
            return None
        columns[open_] = off[open_] = 0.0
    # the most that wᵀz can be, w anywhere within `off` of the columns, and that qᵀx can be
    low, high = (np.where(np.isfinite(end), end, 0.0) for end in (rows.low, rows.high))
    reach = np.maximum(np.abs(low), np.abs(high))
    ends = np.where(columns > 0, high, low)
    most = columns @ ends + off @ reach + right @ y + np.abs(right) @ moved
    terms = (np.abs(columns) + 2.0 * off) @ reach + np.abs(right) @ (np.abs(y) + moved)
    most += 4.0 * loss * terms + tiny
    return float(most) if most < 0.0 else None


def _moved(
    K: Any, y: Vector, signed: Mask, open_: NDArray[np.intp], wrong: Vector, loss: float
) -> tuple[NDArray[np.intp], float] | None:
    """Which entries of y are moved, and by how much at the most, so that these columns of Kᵀy are exactly 0."""
    from scipy.linalg import qr

    k = open_.size
    cost = _PIVOTED * float(k) * k * y.size
    if k > y.size or cost > min(_LONGEST, work.nanoseconds_left()) or not work.fits(24.0 * k * y.size):
        return None
    work.count(cost)
    N = K[:, open_].toarray().T
    weights = np.where(signed, np.abs(y), np.abs(y).max())
    basis = qr(N * weights, mode="r", pivoting=True)[1][:k]
    N = N[:, basis]
    try:
        R = np.linalg.inv(N)
    except np.linalg.LinAlgError:
        return None
    rounded = loss * (np.abs(R) @ np.abs(N)).sum(axis=1).max()
    alpha = 1.01 * (np.abs(np.eye(k) - R @ N).sum(axis=1).max() + rounded)
    if not alpha < 0.5:
        return None
    by = float(1.01 * np.abs(R).sum(axis=1).max() * wrong.max() / (1.0 - alpha))
    return (basis, by) if by <= SHOWN * np.abs(y).max() else None  # farther away y would not be a witness
