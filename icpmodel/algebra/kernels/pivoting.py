"""Lemke's complementary pivots on a dense dictionary, see `methods.shortcuts`.

The dictionary of w = q + My + d·t, where `covering` is d ≥ 0, has one row per basic variable:
x_B = D[:, :n + 1] x_N + D[:, n + 1]. Labels of the variables: w_i is i, y_i is n + i, the artificial t is 2n.
`place[label]` is the row of a basic variable, and −1 less its column for the others. S, r and c are what
`balancing.scale` returns.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...numerics.kernels import compiled

#: the ends of a run of pivots
SOLVED, RAY, UNFINISHED, SINGULAR = range(4)
#: in place of a label that is to enter: begin; with a q that is moved by `_PERTURBATION` of its size, and up to which
#: an equation contradicts no others; or with the equations that `START` leaves out, as they depend on others up to
#: `_DEPENDENT`. Of 400 linear programs with rows that depend up to 1e-8 … 1e-10 both starts solve 399
START = -1
PERTURBED = -2
FULL_RANK = -3
_PERTURBATION = 1e-8
_DEPENDENT = 1e-7
#: in a column of the dictionary, a smaller share of its largest entry counts as zero; ratios so near are ties
_ZERO = 1e-11
_TIE = 1e-13


@compiled
def exchange(D, r, e, basic, nonbasic, place):
    # the variable of column e becomes basic in row r, and that of the row nonbasic
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
    basic[r], nonbasic[e] = nonbasic[e], basic[r]
    place[basic[r]], place[nonbasic[e]] = r, -1 - e


@compiled
def leaving(D, e, free, basic, place, ties):
    # the row whose variable reaches 0 first as that of column e grows, or -1; ties are broken by the inverse of the
    # basis, in the columns of w: the lexicographically least ratio is unique. In rows without obstacle nothing leaves
    n = D.shape[0]
    count = 0
    largest = 0.0
    least = np.inf
    for i in range(n):
        largest = max(largest, abs(D[i, e]))
    for i in range(n):
        if -D[i, e] > _ZERO * largest and not (basic[i] < 2 * n and free[basic[i] % n]):
            ties[count] = i
            count += 1
            least = min(least, max(D[i, n + 1], 0.0) / -D[i, e])
    tied = 0
    most = least + _TIE * (1.0 + least)
    for at in range(count):
        i = ties[at]
        if max(D[i, n + 1], 0.0) <= most * -D[i, e]:
            if basic[i] == 2 * n:
                return i
            ties[tied] = i
            tied += 1
    count = tied
    if count == 0:
        return -1
    for k in range(n):
        if count == 1:
            break
        if free[k]:
            continue
        least = np.inf
        for at in range(count):
            least = min(least, _of_inverse(D, ties[at], k, place) / -D[ties[at], e])
        tied = 0
        for at in range(count):
            i = ties[at]
            if _of_inverse(D, i, k, place) / -D[i, e] <= least + _TIE * (1.0 + abs(least)):
                ties[tied] = i
                tied += 1
        count = tied
    return ties[0]


@compiled
def _of_inverse(D, i, k, place):
    # entry (i, k) of the inverse of the basis: the column of w_k, with the sign of the equations
    if place[k] >= 0:
        return 1.0 if place[k] == i else 0.0
    return -D[i, -1 - place[k]]


@compiled
def _largest(D, basic, nonbasic, leaves, enters):
    # row and column of the largest entry in the rows of the w_i that are basic and are to leave, and the columns of
    # the y_j that are nonbasic and may enter; -1 where all are 0
    n = D.shape[0]
    row: Any = np.int64(-1)
    column: Any = np.int64(-1)
    largest = 0.0
    for i in range(n):
        if basic[i] < n and leaves[basic[i]]:
            for j in range(n):
                if nonbasic[j] >= n and enters[nonbasic[j] - n] and abs(D[i, j]) > largest:
                    row = i
                    column = j
                    largest = abs(D[i, j])
    return row, column, largest


@compiled
def _agree(D, free, leaves, basic):
    # whether the rows whose w_i is to leave, but is basic, have no obstacle and do not contradict the others
    n = D.shape[0]
    for i in range(n):
        if basic[i] < n and leaves[basic[i]] and not (free[basic[i]] and abs(D[i, n + 1]) <= _PERTURBATION):
            return False
    return True


@compiled
def reach(D, free, basic, nonbasic, place, least):
    # pivots by which w_i leaves and y_i enters in the rows without obstacle, the largest each time. Where these are
    # singular another y_j enters, and w_j is to leave as well. Rows that depend on others, up to `least`, stay: whether
    # none of these contradicts the others
    leaves = free.copy()
    first = 0.0
    for _ in range(D.shape[0]):
        row, column, largest = _largest(D, basic, nonbasic, leaves, leaves)
        if not largest > least * first:
            outer = _largest(D, basic, nonbasic, leaves, ~leaves)
            if outer[2] > largest:
                row, column, largest = outer
        if not largest > _ZERO * first or (not largest > least * first and _agree(D, free, leaves, basic)):
            break
        first = max(first, largest)
        leaves[nonbasic[column] - D.shape[0]] = True
        exchange(D, row, column, basic, nonbasic, place)
    return _agree(D, free, leaves, basic)


@compiled
def start(S, q, free, covering, D, basic, nonbasic, place, entering):
    # the dictionary without the rows that have no obstacle: how the run ended, and the label to enter. q is moved by up
    # to `_PERTURBATION` in every row its own way where `entering` asks for it, so that no ties are left. d is 0 also
    # where y_j has entered, as in a vertex of a polytope that z then keeps to; and 1 where the first basis violates the
    # row, or y_j has entered as 0
    n = S.shape[0]
    nudge = _PERTURBATION if entering == PERTURBED else 0.0
    for i in range(n):
        for j in range(n):
            D[i, j] = S[i, j]
        D[i, n] = 0.0
        D[i, n + 1] = q[i] if free[i] else q[i] + nudge * (1.0 + math.sin((i + 1.0) ** 2))
        basic[i], nonbasic[i], place[i], place[n + i] = i, n + i, i, -1 - i
    nonbasic[n] = 2 * n
    place[2 * n] = -1 - n
    if not reach(D, free, basic, nonbasic, place, _ZERO if entering == FULL_RANK else _DEPENDENT):
        return SINGULAR, START
    row: Any = np.int64(-1)
    most = 0.0
    for i in range(n):  # the last of equal ones is the lexicographically least
        if free[basic[i] % n]:
            continue
        d = covering[basic[i] % n] if basic[i] < n else 0.0
        needs_cover = D[i, n + 1] < 0.0 or (D[i, n + 1] == 0.0 and basic[i] >= n)
        D[i, n] = 1.0 if d == 0.0 and needs_cover else d
        if D[i, n + 1] < 0.0 and -D[i, n + 1] >= most * D[i, n]:
            row = i
            most = -D[i, n + 1] / D[i, n]
    if row < 0:
        return SOLVED, START
    entering = complement(basic[row], n)
    exchange(D, row, n, basic, nonbasic, place)
    return UNFINISHED, entering


@compiled
def complement(label, n):
    # the label of y_i for that of w_i, and the other way round
    return label + n if label < n else label - n


@compiled
def pivot(D, free, basic, nonbasic, place, ties, entering, limit):
    # up to `limit` pivots; returns how they ended, and the label of the variable that is to enter
    n = D.shape[0]
    for _ in range(limit):
        e = -1 - place[entering]
        r = leaving(D, e, free, basic, place, ties)
        if r < 0:
            return RAY, entering
        out = basic[r]
        exchange(D, r, e, basic, nonbasic, place)
        if out == 2 * n:
            return SOLVED, entering
        entering = complement(out, n)
    return UNFINISHED, entering


@compiled
def _unpack(D, e, basic, y):
    # to y, what column e of the dictionary holds in the rows of the y that are basic
    n = D.shape[0]
    for i in range(n):
        if n <= basic[i] < 2 * n:
            y[basic[i] - n] = D[i, e]


@compiled
def _refine(S, f, D, basic, nonbasic, y, work):
    # a step of iterative refinement for the y of the dictionary, which holds the inverse of its own equations
    n = S.shape[0]
    for e in range(n + 1):
        work[e] = 0.0
        k = nonbasic[e]
        if k < n:
            work[e] = f[k]
            for j in range(n):
                work[e] += S[k, j] * y[j]
    for i in range(n):
        if n <= basic[i] < 2 * n:
            for e in range(n + 1):
                y[basic[i] - n] -= D[i, e] * work[e]


@compiled
def continue_pivots(S, f, free, covering, units, D, labels, work, entering, limit):
    # a start, where nothing enters yet, and up to `limit` pivots: how they ended, what is to enter, y, and of a ray
    # its direction
    n = S.shape[0]
    basic = labels[:n]
    nonbasic = labels[n : 2 * n + 1]
    place = labels[2 * n + 1 : 4 * n + 2]
    ties = labels[4 * n + 2 :]
    code = UNFINISHED
    if entering < 0:
        code, entering = start(S, f, free, covering, D, basic, nonbasic, place, entering)
    if code == UNFINISHED:
        code, entering = pivot(D, free, basic, nonbasic, place, ties, entering, limit)
    y = np.zeros(n)
    ray = np.zeros(n)
    if code != SINGULAR:
        _unpack(D, n + 1, basic, y)
    if code == SOLVED:
        _refine(S, f, D, basic, nonbasic, y, work)
        for i in range(n):
            y[i] = y[i] if free[i] else max(y[i], 0.0)  # what is below 0 is rounding
    elif code == RAY:
        _unpack(D, -1 - place[entering], basic, ray)
        if entering >= n:
            ray[entering - n] = 1.0
    for i in range(n):
        y[i] = math.ldexp(y[i], units[i])
        ray[i] = math.ldexp(ray[i], units[i])
    return code, entering, y, ray


@compiled
def right(q, r, c, f, units):
    # q in units in which its largest entry is about 1, and the units of y that come with it
    size = -5000
    for i in range(q.size):
        if q[i] != 0.0:
            size = max(size, math.frexp(q[i])[1] + r[i])
    size = size if size > -5000 else 0
    for i in range(q.size):
        f[i] = math.ldexp(q[i], r[i] - size)
        units[i] = c[i] + size


@compiled
def first_tableau(S, r, c, q, free, covering):
    # all that `continue_pivots` takes but for the last two arguments
    n = S.shape[0]
    f = np.empty(n)
    units = np.empty(n, np.int64)
    right(q, r, c, f, units)
    return S, f, free, covering, units, np.empty((n, n + 2)), np.empty(5 * n + 2, np.int64), np.empty(n + 1)
