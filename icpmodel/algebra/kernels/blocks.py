"""Small blocks of rows, solved in turn: single rows by a maximum, larger blocks by pivoting."""

from __future__ import annotations

import math

import numpy as np

from ...numerics.kernels import compiled
from .balancing import scale
from .dictionary import near_and_far
from .pivoting import SOLVED, START, continue_pivots, first_dictionary


@compiled
def row(indptr, indices, data, i, z):
    # (the diagonal entry of row i, the sum over its other columns of the entry times z)
    diagonal_entry = 0.0
    others = 0.0
    for k in range(indptr[i], indptr[i + 1]):
        if indices[k] == i:
            diagonal_entry += data[k]
        else:
            others += data[k] * z[indices[k]]
    return diagonal_entry, others


@compiled
def _block(indptr, indices, data, q, c, slopes, above, block, place, z):
    # the LCP of the rows in `block` with z fixed in all others: its matrix, q, and the obstacles as `near_and_far`
    # returns them
    b = block.size
    M = np.zeros((b, b))
    f = np.empty(b)
    near = np.empty(b)
    far = np.empty(b)
    for at in range(b):
        i = block[at]
        place[i] = at
        high = np.inf
        if above is not None:
            high = above[1][i] + row(*above[0], i, z)[1]
        near[at], far[at] = near_and_far(c[i] + row(*slopes, i, z)[1], high)
    for at in range(b):
        i = block[at]
        f[at] = q[i]
        for e in range(indptr[i], indptr[i + 1]):
            if place[indices[e]] >= 0:
                M[at, place[indices[e]]] += data[e]
            else:
                f[at] += data[e] * z[indices[e]]
    for at in range(b):
        place[block[at]] = -1
    return M, f, near, far


@compiled
def solve_blocks(indptr, indices, data, q, c, slopes, above, rows, starts, selected, pivots, z):
    # solves the selected blocks k, rows[starts[k] : starts[k + 1]], in turn, and writes to z: single rows by a maximum,
    # larger blocks, in which G = `slopes` must have no entry, by at most (b + 1) * `pivots` pivots, b their rows.
    # Returns which are solved: single rows where z is unique and finite, larger blocks where the pivots end in a
    # solution. `above` is None, or (slopes, d) of the upper obstacle
    solved = np.zeros(selected.size, np.bool_)
    place = np.empty(z.size, np.int32)
    for i in range(z.size):
        place[i] = -1
    for k in range(selected.size):
        if not selected[k]:
            continue
        block = rows[starts[k] : starts[k + 1]]
        b = block.size
        i = block[0]
        if b == 1:
            diagonal_entry, p = row(indptr, indices, data, i, z)
            slope, r = row(*slopes, i, z)
            z[i] = max((r + c[i]) / (1.0 - slope), -(p + q[i]) / diagonal_entry)
            if above is not None:
                slope, r = row(*above[0], i, z)
                z[i] = min((r + above[1][i]) / (1.0 - slope), z[i])
            solved[k] = diagonal_entry > 0.0 and slope < 1.0 and math.isfinite(z[i])
            continue
        M, f, near, far = _block(indptr, indices, data, q, c, slopes, above, block, place, z)
        finite = True
        for at in range(b):
            finite = finite and math.isfinite(f[at]) and math.isfinite(near[at])
        if finite:
            dictionary = first_dictionary(*scale(M), f, near, far, np.ones(b))
            code, _, solution, _ = continue_pivots(*dictionary, np.int64(START), pivots * (b + 1))
            solved[k] = code == SOLVED
            for at in range(b):
                z[block[at]] = solution[at]
    return solved
