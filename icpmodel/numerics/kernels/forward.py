"""Solves with the sparse triangular factor of a symmetric matrix."""

from __future__ import annotations

import numpy as np

from . import compiled


@compiled
def forward_solve(indptr, indices, data, rows, columns, values, width):
    # L⁻¹B, where the columns of L − I are stored, and B has these entries and `width` columns: the rows that are not 0,
    # ascending, and what they hold. Rows that L reaches early hold few of the columns, those next to one another
    n = indptr.size - 1
    is_reached = np.zeros(n, np.bool_)
    is_reached[rows] = True
    for j in range(n):
        if is_reached[j]:
            is_reached[indices[indptr[j] : indptr[j + 1]]] = True
    reached = np.flatnonzero(is_reached)
    place = np.empty(n, np.int64)
    place[reached] = np.arange(reached.size)
    X = np.zeros((reached.size, width))
    for e in range(rows.size):
        X[place[rows[e]], columns[e]] += values[e]
    for t in range(reached.size):
        held = np.flatnonzero(X[t])
        if held.size:
            first = held[0]
            end = held[-1] + 1
            for k in range(indptr[reached[t]], indptr[reached[t] + 1]):
                i = place[indices[k]]
                for c in range(first, end):
                    X[i, c] -= data[k] * X[t, c]
    return reached, X
