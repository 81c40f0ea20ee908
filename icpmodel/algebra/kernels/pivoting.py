"""Lemke's complementary pivots on a dense dictionary, see `methods.shortcuts`.

The dictionary is that of w = q + My + d·t, where `covering` is d ≥ 0. S, r and c are what `balancing.scale` returns.
"""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from ...numerics.kernels import compiled
from ...numerics.rounding import SQRT_EPSILON
from .dictionary import ZERO, Dictionary, exchange, leaving, mirror

#: how a run of pivots ends
SOLVED, RAY, UNFINISHED, SINGULAR = range(4)
#: each of these, in place of the label that enters, begins a run. `START` leaves out equations that depend on others up
#: to `_SMALL`, `FULL_RANK` keeps them, and `PERTURBED` moves q by the share `_SMALL` of its size. Up to `_SMALL` an
#: equation contradicts no others. Of 400 linear programs with rows that depend on others up to 1e-8 … 1e-10, `START`
#: and `FULL_RANK` solve 399
FULL_RANK, PERTURBED, START = range(-3, 0)
_SMALL = SQRT_EPSILON


@compiled
def _largest(T, leaves, enters):
    # row and column of the largest entry in the rows of the w_i that are basic and are to leave, and the columns of
    # the y_j that are nonbasic and may enter; -1 where all are 0
    n = T.bound.size
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
def _is_consistent(T, leaves):
    # whether all rows whose w_i is to leave but is still basic have no obstacle and do not contradict the others
    n = T.bound.size
    for i in range(n):
        k = T.basic[i]
        if k < n and leaves[k] and not (np.isnan(T.bound[k]) and abs(T.D[i, n + 1]) <= _SMALL):
            return False
    return True


@compiled
def eliminate_equations(T, least):
    # makes w_i leave and y_i enter in the rows without obstacle, with the largest pivot each time. Where these rows are
    # singular another y_j enters, and then w_j is to leave as well. Rows that depend on others up to `least` keep w_i
    # basic. Returns whether none of these contradicts the others
    leaves = np.isnan(T.bound)
    first = 0.0
    for _ in range(T.bound.size):
        row, column, largest = _largest(T, leaves, leaves)
        if not largest > least * first:
            outer = _largest(T, leaves, ~leaves)
            if outer[2] > largest:
                row, column, largest = outer
        if not largest > ZERO * first or (not largest > least * first and _is_consistent(T, leaves)):
            break
        first = max(first, largest)
        leaves[T.nonbasic[column] - T.bound.size] = True
        exchange(T, row, column)
    return _is_consistent(T, leaves)


@compiled
def _fill(T, S, q, perturbation):
    # fills the first dictionary, its column of t with 0; in rows with an obstacle q is moved by different amounts from
    # 0 to twice `perturbation`
    n = T.bound.size
    D = T.D
    bound = T.bound
    basic = T.basic
    nonbasic = T.nonbasic
    place = T.place
    mirrored = T.mirrored
    relaxed = T.relaxed
    for i in range(n):
        mirrored[i] = bound[i] < 0.0
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
        D[i, n + 1] = q[i] if np.isnan(bound[i]) else q[i] + perturbation * (1.0 + math.sin((i + 1.0) ** 2))
    for k in range(n):
        if mirrored[k]:
            for j in range(n + 2):
                D[k, j] = -D[k, j]
            for i in range(n):
                D[i, k] = -D[i, k]


@compiled
def start(T, S, q, covering, entering):
    # begins a run: eliminates the rows without obstacle and makes t enter. Returns how the run ended, and the label
    # that enters next. If `entering` is PERTURBED q is moved, so that no ties are left. d is also 0 where y_j has
    # entered, as at a vertex of a polytope, in which z then stays; and 1 where the first basis violates the row, or y_j
    # entered as 0
    D = T.D
    bound = T.bound
    basic = T.basic
    n = bound.size
    _fill(T, S, q, _SMALL if entering == PERTURBED else 0.0)
    if not eliminate_equations(T, ZERO if entering == FULL_RANK else _SMALL):
        return SINGULAR, START
    row: Any = np.int64(-1)
    most = 0.0
    for i in range(n):  # the last of equal ones is the lexicographically least
        has_entered = basic[i] >= n
        k = basic[i] - n if has_entered else basic[i]
        if np.isnan(bound[k]):
            continue
        if has_entered and D[i, n + 1] > abs(bound[k]):
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
    # makes up to `limit` pivots; returns how they ended, and the label of the variable that is to enter
    n = T.bound.size
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
    # adds to y what column e of the dictionary holds in the rows of the y that are basic
    n = T.bound.size
    D = T.D
    basic = T.basic
    mirrored = T.mirrored
    for i in range(n):
        if n <= basic[i] < 2 * n:
            k = basic[i] - n
            y[k] += -D[i, e] if mirrored[k] else D[i, e]


@compiled
def _refine(T, S, g, z):
    # a step of iterative refinement of g + Sz = 0 for the basic y of the dictionary, which holds the inverse of these
    # equations
    n = T.bound.size
    D = T.D
    basic = T.basic
    nonbasic = T.nonbasic
    mirrored = T.mirrored
    residuals = T.ratios
    for e in range(n + 1):
        residuals[e] = 0.0
        k = nonbasic[e]
        if k < n:
            residuals[e] = g[k]
            for j in range(n):
                residuals[e] += S[k, j] * z[j]
            if mirrored[k]:
                residuals[e] = -residuals[e]
    for i in range(n):
        if n <= basic[i] < 2 * n:
            k = basic[i] - n
            for e in range(n + 1):
                step = D[i, e] * residuals[e]
                z[k] += step if mirrored[k] else -step


@compiled
def continue_pivots(S, f, g, near, far, covering, units, D, labels, work, entering, limit):
    # begins a run if `entering` < 0, then makes up to `limit` pivots. Returns how they ended, the label that enters
    # next, z = near + y in its own units, and the direction of a ray. D, `labels` and `work` hold the dictionary, and
    # change
    n = S.shape[0]
    place = labels[4:6].reshape(-1)
    ties = labels[6:].reshape(-1)
    bound = np.empty(n)
    for i in range(n):  # (an array expression takes seconds to compile)
        bound[i] = far[i] - near[i]
    T = Dictionary(D, bound, labels[0], labels[1], place, labels[2], labels[3], ties, work[0], work[1])
    code = UNFINISHED
    if entering < 0:
        code, entering = start(T, S, f, covering, entering)
    if code == UNFINISHED:
        code, entering = pivot(T, entering, limit)
    z = near.copy()
    ray = np.zeros(n)
    if code != SINGULAR:
        for i in range(n):  # y_i is measured from the bound
            if T.mirrored[i] != (bound[i] < 0.0):
                z[i] = far[i]
        _unpack(T, n + 1, z)
    if code == SOLVED:
        _refine(T, S, g, z)
        for i in range(n):  # z leaves its bounds by rounding errors only
            if not np.isnan(far[i]):
                z[i] = min(max(z[i], min(near[i], far[i])), max(near[i], far[i]))
    elif code == RAY:
        _unpack(T, -1 - T.place[entering], ray)
        if entering >= n:
            ray[entering - n] = -1.0 if T.mirrored[entering - n] else 1.0
    for i in range(n):
        z[i] = math.ldexp(z[i], units[i])
        ray[i] = math.ldexp(ray[i], units[i])
    return code, entering, z, ray


@compiled
def scaled_vectors(S, r, c, q, near, far, units):
    # (f, g, near, far) in units in which the largest entry of f is about 1: f = q + M near, which is p at z = near, and
    # g = q. Writes the exponents of the units of z to `units`
    n = q.size
    f = np.empty(n)
    g = np.empty(n)
    scaled_near = np.empty(n)
    scaled_far = np.empty(n)
    for i in range(n):
        scaled_near[i] = math.ldexp(near[i], -c[i])
    size = -5000
    for i in range(n):
        f[i] = math.ldexp(q[i], r[i])
        for j in range(n):
            f[i] += S[i, j] * scaled_near[j]
        if f[i] != 0.0:
            size = max(size, math.frexp(f[i])[1])
    size = size if size > -5000 else 0
    for i in range(n):
        f[i] = math.ldexp(f[i], -size)
        g[i] = math.ldexp(q[i], r[i] - size)
        units[i] = c[i] + size
        scaled_near[i] = math.ldexp(near[i], -units[i])
        scaled_far[i] = math.ldexp(far[i], -units[i])
    return f, g, scaled_near, scaled_far


@compiled
def work_arrays(n):
    # D, the integer arrays of a dictionary and its `slopes` and `ratios`
    return np.empty((n + 1, n + 2)), np.empty((8, n + 1), np.int64), np.empty((2, 2 * n + 2))


@compiled
def first_dictionary(S, r, c, q, near, far, covering):
    # the arguments of `continue_pivots` except the last two
    n = S.shape[0]
    units = np.empty(n, np.int64)
    arrays = scaled_vectors(S, r, c, q, near, far, units)
    return S, *arrays, covering, units, *work_arrays(n)
