"""Lemke's complementary pivots on a dense dictionary, see `methods.shortcuts`.

The dictionary is that of w = q + My + d·t, where `covering` is d ≥ 0. S, r and c are what `balancing.scale` returns.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...numerics.kernels import compiled
from .dictionary import ZERO, Dictionary, exchange, leaving, mirror

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


@compiled
def _largest(T, leaves, enters):
    # row and column of the largest entry in the rows of the w_i that are basic and are to leave, and the columns of
    # the y_j that are nonbasic and may enter; -1 where all are 0
    n = T.upper.size
    D = T.D
    basic = T.basic
    nonbasic = T.nonbasic
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
def _agree(T, leaves):
    # whether the rows whose w_i is to leave, but is basic, have no obstacle and do not contradict the others
    n = T.upper.size
    for i in range(n):
        k = T.basic[i]
        if k < n and leaves[k] and not (np.isnan(T.upper[k]) and abs(T.D[i, n + 1]) <= _PERTURBATION):
            return False
    return True


@compiled
def reach(T, least):
    # pivots by which w_i leaves and y_i enters in the rows without obstacle, the largest each time. Where these are
    # singular another y_j enters, and w_j is to leave as well. Rows that depend on others, up to `least`, stay: whether
    # none of these contradicts the others
    leaves = np.isnan(T.upper)
    first = 0.0
    for _ in range(T.upper.size):
        row, column, largest = _largest(T, leaves, leaves)
        if not largest > least * first:
            outer = _largest(T, leaves, ~leaves)
            if outer[2] > largest:
                row, column, largest = outer
        if not largest > ZERO * first or (not largest > least * first and _agree(T, leaves)):
            break
        first = max(first, largest)
        leaves[T.nonbasic[column] - T.upper.size] = True
        exchange(T, row, column)
    return _agree(T, leaves)


@compiled
def _fill(T, S, q, nudge):
    # the first dictionary, t having no part in it; q is moved by up to `nudge` in every row its own way
    n = T.upper.size
    D = T.D
    upper = T.upper
    basic = T.basic
    nonbasic = T.nonbasic
    place = T.place
    mirrored = T.mirrored
    relaxed = T.relaxed
    for i in range(n):
        mirrored[i] = upper[i] == -np.inf
        relaxed[i] = False
        basic[i], nonbasic[i], place[i], place[n + i] = i, n + i, i, -1 - i
    nonbasic[n] = 2 * n
    place[2 * n] = -1 - n
    for j in range(n + 2):
        D[n, j] = 0.0
    for i in range(n):
        for j in range(n):
            D[i, j] = S[i, j]
        D[i, n] = 0.0
        D[i, n + 1] = q[i] if np.isnan(upper[i]) else q[i] + nudge * (1.0 + math.sin((i + 1.0) ** 2))
    for k in range(n):
        if mirrored[k]:
            for j in range(n + 2):
                D[k, j] = -D[k, j]
            for i in range(n):
                D[i, k] = -D[i, k]


@compiled
def start(T, S, q, covering, entering):
    # the dictionary without the rows that have no obstacle: how the run ended, and the label to enter. q is moved where
    # `entering` asks for it, so that no ties are left. d is 0 also where y_j has entered, as in a vertex of a polytope
    # that z then keeps to; and 1 where the first basis violates the row, or y_j has entered as 0
    D = T.D
    upper = T.upper
    basic = T.basic
    n = upper.size
    _fill(T, S, q, _PERTURBATION if entering == PERTURBED else 0.0)
    if not reach(T, ZERO if entering == FULL_RANK else _DEPENDENT):
        return SINGULAR, START
    row: Any = np.int64(-1)
    most = 0.0
    for i in range(n):  # the last of equal ones is the lexicographically least
        has_entered = basic[i] >= n
        k = basic[i] - n if has_entered else basic[i]
        if np.isnan(upper[k]):
            continue
        if has_entered and 0.0 <= upper[k] < D[i, n + 1]:
            mirror(T, i)
        d = 0.0 if has_entered else covering[k]
        value = D[i, n + 1]
        if d == 0.0 and (value < 0.0 or (value == 0.0 and has_entered)):
            d = 1.0
            T.relaxed[k] = has_entered
        D[i, n] = d
        if value < 0.0 and -value >= most * d:
            row = i
            most = -value / d
    if row < 0:
        return SOLVED, START
    entering = complement(basic[row], n)
    exchange(T, row, n)
    return UNFINISHED, entering


@compiled
def complement(label, n):
    # the label of y_i for that of w_i, and the other way round
    return label + n if label < n else label - n


@compiled
def pivot(T, entering, limit):
    # up to `limit` pivots; returns how they ended, and the label of the variable that is to enter
    n = T.upper.size
    D = T.D
    for _ in range(limit):
        e = -1 - T.place[entering]
        for j in range(n + 2):
            D[n, j] = 0.0
        D[n, e] = 1.0
        T.basic[n] = entering
        r = leaving(T, e)
        if r < 0:
            return RAY, entering
        if r > n:
            r -= n + 1
            mirror(T, r)
        out = T.basic[r]
        exchange(T, r, e)
        if out == 2 * n:
            return SOLVED, entering
        entering = complement(out, n)
    return UNFINISHED, entering


@compiled
def _unpack(T, e, y):
    # y where column e of the dictionary holds the basic variables, and the nonbasic ones are 0; its change per unit of
    # the variable of column e, unless that is the last one
    n = T.upper.size
    D = T.D
    upper = T.upper
    basic = T.basic
    mirrored = T.mirrored
    for i in range(n):
        if mirrored[i] and upper[i] >= 0.0 and e == n + 1:
            y[i] = upper[i]
    for i in range(n):
        if n <= basic[i] < 2 * n:
            k = basic[i] - n
            y[k] += -D[i, e] if mirrored[k] else D[i, e]


@compiled
def _refine(T, S, f, y):
    # a step of iterative refinement for the y of the dictionary, which holds the inverse of its own equations
    n = T.upper.size
    D = T.D
    basic = T.basic
    nonbasic = T.nonbasic
    mirrored = T.mirrored
    residuals = T.ratios
    for e in range(n + 1):
        residuals[e] = 0.0
        k = nonbasic[e]
        if k < n:
            residuals[e] = f[k]
            for j in range(n):
                residuals[e] += S[k, j] * y[j]
            if mirrored[k]:
                residuals[e] = -residuals[e]
    for i in range(n):
        if n <= basic[i] < 2 * n:
            k = basic[i] - n
            for e in range(n + 1):
                step = D[i, e] * residuals[e]
                y[k] += step if mirrored[k] else -step


@compiled
def continue_pivots(S, f, upper, covering, units, D, labels, work, entering, limit):
    # a start, where nothing enters yet, and up to `limit` pivots: how they ended, what is to enter, y, and of a ray
    # its direction
    n = S.shape[0]
    place = labels[4:6].reshape(-1)
    ties = labels[6:].reshape(-1)
    T = Dictionary(D, upper, labels[0], labels[1], place, labels[2], labels[3], ties, work[0], work[1])
    code = UNFINISHED
    if entering < 0:
        code, entering = start(T, S, f, covering, entering)
    if code == UNFINISHED:
        code, entering = pivot(T, entering, limit)
    y = np.zeros(n)
    ray = np.zeros(n)
    if code != SINGULAR:
        _unpack(T, n + 1, y)
    if code == SOLVED:
        _refine(T, S, f, y)
        for i in range(n):  # what is outside is rounding
            if upper[i] >= 0.0:
                y[i] = min(max(y[i], 0.0), upper[i])
            elif upper[i] == -np.inf:
                y[i] = min(y[i], 0.0)
    elif code == RAY:
        _unpack(T, -1 - T.place[entering], ray)
        if entering >= n:
            ray[entering - n] = -1.0 if T.mirrored[entering - n] else 1.0
    for i in range(n):
        y[i] = math.ldexp(y[i], units[i])
        ray[i] = math.ldexp(ray[i], units[i])
    return code, entering, y, ray


@compiled
def right(q, r, c, upper, f, units, bounds):
    # q in units in which its largest entry is about 1, and the units of y and its bounds that come with it
    size = -5000
    for i in range(q.size):
        if q[i] != 0.0:
            size = max(size, math.frexp(q[i])[1] + r[i])
    size = size if size > -5000 else 0
    for i in range(q.size):
        f[i] = math.ldexp(q[i], r[i] - size)
        units[i] = c[i] + size
        bounds[i] = math.ldexp(upper[i], -units[i])


@compiled
def work_arrays(n):
    # D, the integer arrays of a dictionary and its `slopes` and `ratios`
    return np.empty((n + 1, n + 2)), np.empty((8, n + 1), np.int64), np.empty((2, 2 * n + 2))


@compiled
def first_tableau(S, r, c, q, upper, covering):
    # all that `continue_pivots` takes but for the last two arguments
    n = S.shape[0]
    f = np.empty(n)
    units = np.empty(n, np.int64)
    bounds = np.empty(n)
    right(q, r, c, upper, f, units, bounds)
    return S, f, bounds, covering, units, *work_arrays(n)
