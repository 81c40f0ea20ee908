"""All principal minors of a small matrix, by the signs of all pivots of the intervals mid ± rad, n × n.

A is P if and only if a₁₁ > 0, A without row and column 1 is P, and so is the Schur complement
A/a₁₁. That is a binary tree. At level k the indices < k are eliminated (bits of `chosen`) or
deleted. The pivot at k is the quotient of the minors of chosen + {k} and of chosen. `base[k]` is
the slot of mids, rads, shape (n + 1, n, n), with the matrix of level k: deleting needs no copy. |true
− mid| ≤ rad throughout.
"""

from __future__ import annotations

import numpy as np

from . import compiled, inlined


@inlined
def _eliminate(mids, rads, here, k, to):
    # write to the slot `to` rows and columns > k of the Schur complement of the pivot k of the slot `here`, whose
    # interval is positive. u and tiny are twice the unit roundoff and a normal number: this surplus covers the rounding
    # of the radii. Fused multiply-adds only make the errors smaller
    u = 2.0**-52
    tiny = 2.0**-1000
    n = mids.shape[1]
    pivot = mids[here, k, k]
    radius = rads[here, k, k]
    least = (pivot - radius) * (1 - u)
    for i in range(k + 1, n):
        f = mids[here, i, k] / pivot
        f_rad = (1 + 8 * u) * ((rads[here, i, k] + abs(f) * radius) / least + u * abs(f) + tiny)
        for j in range(k + 1, n):
            b = mids[here, k, j]
            b_rad = rads[here, k, j]
            product = f * b
            new = mids[here, i, j] - product
            error = rads[here, i, j] + abs(f) * b_rad + f_rad * (abs(b) + b_rad)
            mids[to, i, j] = new
            rads[to, i, j] = (1 + 8 * u) * (error + u * (abs(product) + abs(new)) + tiny)


@compiled
def search_minors(mid, rad, max_undecided):
    # returns the index set, as bits, of a minor that is proved <= 0, or 0 if none is, and the index sets of the minors
    # whose last pivot is undecided. Such a pivot is not eliminated. The search ends at `max_undecided` of them
    n = mid.shape[0]
    mids = np.empty((n + 1, n, n))
    rads = np.empty((n + 1, n, n))
    mids[0] = mid
    rads[0] = rad
    undecided = np.empty(max_undecided, dtype=np.int64)
    base = np.zeros(n + 1, dtype=np.int64)
    level = 0
    chosen = 0
    count = 0
    while level < n or chosen:
        if level == n:  # back to the last index that is chosen, and now without it
            while not chosen >> level & 1:
                level -= 1
            chosen ^= 1 << level
            level += 1
            base[level] = base[level - 1]
            continue
        here = base[level]
        to = level + 1
        pivot = mids[here, level, level]
        radius = rads[here, level, level]
        minor = chosen | (1 << level)
        if pivot <= -radius and radius < 2.0**1000:  # not for -inf and inf
            return minor, undecided[:count]
        if not pivot > radius:  # NaN as well
            undecided[count] = minor
            base[to] = here
            level = to
            count += 1
            if count == undecided.size:
                break
            continue
        _eliminate(mids, rads, here, level, to)
        chosen = minor
        base[to] = to
        level = to
    return 0, undecided[:count]
