"""All principal minors of a small matrix, by the signs of all pivots of the intervals mid[0] ± rad[0], n × n.

A is P iff a₁₁ > 0, A without row and column 1 is P, and so is the Schur complement A/a₁₁. That is a binary tree: at
level k the indices < k are eliminated (bits of `chosen`) or deleted, and the pivot at k is the quotient of the minors
of chosen + {k} and of chosen. `base[k]` is the slot of mid, rad, shape (n + 1, n, n), with the matrix of level k:
deleting needs no copy. |true − mid| ≤ rad throughout.
"""

from __future__ import annotations

from typing import Any

from . import compiled


@compiled
def search_pivots(mid: Any, rad: Any, base: Any, state: Any, undecided: Any) -> Any:
    # returns the index set, as bits, of a minor that is proved ≤ 0, or 0, and how many pivots are undecided; their
    # index sets stand in `undecided`, the last index being k. Below an undecided pivot no Schur complement is looked
    # at. Where `undecided` is full, the search ends.
    # u and tiny are twice the unit roundoff and a normal number: what is generous in them pays for the rounding of the
    # radii. Fused multiply-adds only make the errors smaller.
    u, tiny = 2.0**-52, 2.0**-1000
    n = mid.shape[1]
    level, chosen, count = 0, 0, 0
    state[0], base[0] = 0, 0
    while level >= 0:
        if level == n or state[level] == 2:
            level -= 1
            continue
        here = base[level]
        if state[level] == 1:  # delete
            chosen &= ~(1 << level)
            state[level] = 2
            level += 1
            if level < n:
                base[level], state[level] = here, 0
            continue
        pivot, radius = mid[here, level, level], rad[here, level, level]
        state[level] = 1
        if pivot <= -radius and radius < 1 / tiny:  # not for -inf and inf
            return chosen | (1 << level), count
        if not pivot > radius:  # NaN as well
            undecided[count] = chosen | (1 << level)
            count += 1
            if count == undecided.size:
                return 0, count
            continue
        to = level + 1
        least = (pivot - radius) * (1 - u)
        for i in range(to, n):
            f = mid[here, i, level] / pivot
            f_rad = (1 + 8 * u) * ((rad[here, i, level] + abs(f) * radius) / least + u * abs(f) + tiny)
            for j in range(to, n):
                b, b_rad = mid[here, level, j], rad[here, level, j]
                product = f * b
                new = mid[here, i, j] - product
                error = rad[here, i, j] + abs(f) * b_rad + f_rad * (abs(b) + b_rad)
                mid[to, i, j] = new
                rad[to, i, j] = (1 + 8 * u) * (error + u * (abs(product) + abs(new)) + tiny)
        chosen |= 1 << level
        level = to
        if level < n:
            base[level], state[level] = to, 0
    return 0, count
