"""Solves with a sparse triangular factor."""

from __future__ import annotations

import numpy as np

from . import compiled


@compiled
def reached_rows(indptr, indices, rows):
    # the rows of L⁻¹B that may be nonzero, ascending; the arrays hold the columns of L − I, and B has entries in `rows`
    n = indptr.size - 1
    is_reached = np.zeros(n, np.bool_)
    is_reached[rows] = True
    for j in range(n):
        if is_reached[j]:
            is_reached[indices[indptr[j] : indptr[j + 1]]] = True
    return np.flatnonzero(is_reached)


@compiled
def forward_solve(indptr, indices, data, reached, rows, columns, values, width):
    # the `reached` rows of L⁻¹B, where B has these entries and `width` columns. The first rows have few nonzeros, in
    # adjacent columns
    place = np.empty(indptr.size - 1, np.int64)
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
    return X
