"""Passes over the rows of A: products with it, statistics of its rows, and the signs of exact row sums."""

from __future__ import annotations

from functools import partial

import numpy as np

from . import compiled, one, row_sum, uint


@compiled
def row_statistics(indptr, indices, data, low, high, diag, diagonal, off_diagonal, largest):
    # rows low <= i < high: where the diagonal entry stands, its value, the sum of the other |entries|, the largest of
    # all; returns how far the entries reach below the diagonal and above it, and the sums of those there. Rows are
    # sorted, and every diagonal entry is stored.
    below = 0
    above = 0
    lower = 0.0
    whole = 0.0
    start = uint(indptr[low])
    for i in range(low, high):
        end = uint(indptr[i + 1])
        below = max(below, i - indices[start])
        above = max(above, indices[end - uint(1)] - i)
        total = 0.0
        first = 0.0
        most = 0.0
        count_below = 0
        k = start
        while k < end:
            total += abs(data[k])
            most = max(most, abs(data[k]))
            first += abs(data[k]) * (indices[k] < i)  # no branch
            count_below += indices[k] < i
            k += one()
        diagonal_entry = data[start + uint(count_below)]
        diag[i] = start + uint(count_below)
        diagonal[i] = diagonal_entry
        off_diagonal[i] = total - abs(diagonal_entry)
        largest[i] = most
        lower += first
        whole += off_diagonal[i]
        start = end
    return below, above, lower, whole - lower


@compiled
def product(indptr, indices, data, z, low, high, out):
    # rows low <= i < high of Az
    for i in range(uint(low), uint(high)):
        out[i] = row_sum(0.0, indptr[i], indptr[i + uint(1)], indices, data, z)


@compiled
def magnitude(indptr, indices, data, z, low, high, out):
    # rows low <= i < high of |A||z|
    for i in range(uint(low), uint(high)):
        total = 0.0
        for k in range(uint(indptr[i]), uint(indptr[i + uint(1)])):
            total += abs(data[k] * z[indices[k]])
        out[i] = total


@compiled
def coupling_entries(indptr, indices, data, weight):
    # sqrt|a_ij a_ji| weight_i weight_j off the diagonal, 0 on it. Rows are sorted, and i rises: the place of a_ji in
    # row j > i never moves back, nor does `at`
    n = indptr.size - 1
    at = indptr[:-1].copy()
    out = np.zeros(data.size)
    for i in range(n):
        k = uint(indptr[i])
        stop = uint(indptr[i + 1])
        while k < stop:
            j = uint(indices[k])
            if j > uint(i):
                end = indptr[j + uint(1)]
                here = at[j]
                while here < end and indices[uint(here)] < i:
                    here += 1
                at[j] = here
                if here < end and indices[uint(here)] == i:
                    size = weight[i] * weight[j]
                    out[k] = np.sqrt(abs(data[k]) * size) * np.sqrt(abs(data[uint(here)]) * size)
                    out[uint(here)] = out[k]
            k += one()
    return out


@partial(compiled, exact=True)
def sum_signs(indptr, data, parts, signs):
    # the signs of the row sums, 2 where one overflows on the way. The `parts` of a sum do not overlap, and the largest,
    # which comes last, has the sign of the sum: Shewchuk, Discrete Comput. Geom. 18 (1997)
    for i in range(signs.size):
        count = 0
        for k in range(indptr[i], indptr[i + 1]):
            x = data[k]
            nonzeros = 0
            for j in range(count):
                y = parts[j]
                if abs(x) < abs(y):
                    x, y = y, x
                high = x + y
                low = y - (high - x)
                if low != 0.0:
                    parts[nonzeros] = low
                    nonzeros += 1
                x = high
            parts[nonzeros] = x
            count = nonzeros + (x != 0.0)
        top = parts[count - 1] if count else 0.0
        signs[i] = 2 if not abs(top) < np.inf else (top > 0.0) - (top < 0.0)
