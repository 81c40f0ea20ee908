"""The dense dictionary of Lemke's pivots, with variables that may have two bounds.

x_B = D[:n, : n + 1] x_N + D[:n, n + 1] has one row per basic variable; row n is for the one that enters. Labels of the
variables: w_i is i, y_i is n + i, the artificial t is 2n. `place[label]` is the row of a basic variable, and −1 minus
the column of a nonbasic one.

y_i is between 0 and `bound[i]`, which has either sign; ±∞ means no bound, NaN that y_i has any sign. The variable with
the label of y_i is ±y_i or the distance from the bound, so that it is ≥ 0. Where it falls as y_i rises, `mirrored[i]`
is set, and the label of w_i stands for −w_i. So all variables are ≥ 0, and nonbasic ones are 0. Where `relaxed[i]` is
set, the bound is further away by t.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from ...numerics.kernels import compiled
from ...numerics.sparse_structure import ROUNDING_RTOL

#: entries of a column of the dictionary that are smaller than this share of its largest one count as zero
ZERO = 1e-11


class Dictionary(NamedTuple):
    """The arrays, as compiled loops take them."""

    D: Any
    bound: Any
    basic: Any
    nonbasic: Any
    place: Any
    mirrored: Any
    relaxed: Any
    ties: Any
    slopes: Any
    ratios: Any


@compiled
def near_and_far(low, high):
    # the smaller obstacle, from which z is measured so that q loses few digits, and the other one; (0, NaN) for none
    if low == -np.inf and high == np.inf:
        return 0.0, np.nan
    if abs(low) <= abs(high):
        return low, max(low, high)
    return high, min(low, high)


@compiled
def nearest_obstacles(low, high):
    # `near_and_far` of each row
    near = np.empty(low.size)
    far = np.empty(low.size)
    for i in range(low.size):
        near[i], far[i] = near_and_far(low[i], high[i])
    return near, far


@compiled
def exchange(T, r, e):
    # the variable of column e becomes basic in row r, and that of the row nonbasic
    D = T.D
    pivot = D[r, e]
    D[r, e] = -1.0
    for j in range(D.shape[1]):
        D[r, j] /= -pivot
    for i in range(D.shape[0]):
        factor = D[i, e]
        if i != r and factor != 0.0:
            D[i, e] = 0.0
            for j in range(D.shape[1]):
                D[i, j] += factor * D[r, j]
    T.basic[r], T.nonbasic[e] = T.nonbasic[e], T.basic[r]
    T.place[T.basic[r]], T.place[T.nonbasic[e]] = r, -1 - e


@compiled
def mirror(T, i):
    # the y_k of row i becomes its distance from its bound, and w_k, which is nonbasic, changes sign
    n = T.bound.size
    k = T.basic[i] - n
    for j in range(n + 2):
        T.D[i, j] = -T.D[i, j]
        if T.relaxed[k]:
            T.D[i, j] += T.D[T.place[2 * n], j]
    T.D[i, n + 1] += abs(T.bound[k])
    T.mirrored[k] = not T.mirrored[k]
    e = -1 - T.place[k]
    for row in range(n + 1):
        T.D[row, e] = -T.D[row, e]


@compiled
def _blocking(T, e):
    # finds the variables that reach 0 or their bound as that of column e grows, and returns their number: writes their
    # rows, plus n + 1 for a bound, to `ties`, their rates of decrease to `slopes`, and their ratios to `ratios`
    n = T.bound.size
    D = T.D  # (a field of T costs as much as some operations)
    bound = T.bound
    basic = T.basic
    relaxed = T.relaxed
    ties = T.ties
    slopes = T.slopes
    ratios = T.ratios
    t = T.place[2 * n]
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(D[i, e]))
    count = 0
    for i in range(n + 1):
        label = basic[i]
        k = label if label < n else label - n
        if k < n and np.isnan(bound[k]):
            continue
        value = D[i, n + 1]
        slope = -D[i, e]
        for code in range(i, i + n + 2, n + 1):
            if code > n:
                if not (n <= label < 2 * n and abs(bound[k]) < np.inf):
                    break
                value = abs(bound[k]) - value
                slope = -slope
                if relaxed[k]:
                    value += D[t, n + 1]
                    slope -= D[t, e]
            if slope > ZERO * largest:
                ties[count] = code
                slopes[count] = slope
                ratios[count] = max(value, 0.0) / slope
                count += 1
    return count


@compiled
def _least(T, count):
    # moves those of the first `count` entries of `ties` with the least ratio to the front, and returns their number
    ties = T.ties
    slopes = T.slopes
    ratios = T.ratios
    least = np.inf
    for at in range(count):
        least = min(least, ratios[at])
    tied = 0
    for at in range(count):
        if ratios[at] <= least + ROUNDING_RTOL * (1.0 + abs(least)):
            ties[tied] = ties[at]
            slopes[tied] = slopes[at]
            tied += 1
    return tied


@compiled
def leaving(T, e):
    # the row whose variable first reaches 0 as that of column e grows, plus n + 1 where it reaches its bound; -1 for
    # none. t leaves before all others; other ties are broken by the inverse of the basis, in the columns of w: the
    # lexicographically least ratio is unique
    n = T.bound.size
    t = T.place[2 * n]
    count = _least(T, _blocking(T, e))
    for at in range(count):
        if T.ties[at] == t:
            return t
    for k in range(n):
        if count <= 1:
            break
        if np.isnan(T.bound[k]):
            continue
        for at in range(count):
            T.ratios[at] = _of_inverse(T, T.ties[at], k) / T.slopes[at]
        count = _least(T, count)
    return T.ties[0] if count else -1


@compiled
def _of_inverse(T, code, k):
    # entry (code, k) of the inverse of the basis: the column of w_k, with the sign of the equations
    n = T.bound.size
    if T.place[k] >= 0:
        value = 1.0 if T.place[k] == code else 0.0
    else:
        column = -1 - T.place[k]
        i = code if code <= n else code - n - 1
        value = -T.D[i, column]
        if code > n:
            value = -value
            if T.relaxed[T.basic[i] - n]:
                value -= T.D[T.place[2 * n], column]
    return -value if T.mirrored[k] else value
