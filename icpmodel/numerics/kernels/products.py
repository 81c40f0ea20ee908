"""Products with a matrix, natural residuals, and what is asked of the rows before the first sweep."""

from __future__ import annotations

import numpy as np

from . import compiled, one, row_sum, uint


@compiled
def look(indptr, indices, data, low, high, diag, diagonal, rest):
    # rows low <= i < high: where the diagonal entry stands, its value, the sum of the other |entries|; returns how far
    # the entries reach below the diagonal and above it, and the sums of those there. Rows are sorted, and every
    # diagonal entry is stored.
    below, above, lower, whole = 0, 0, 0.0, 0.0
    start = uint(indptr[low])
    for i in range(low, high):
        end = uint(indptr[i + 1])
        below = max(below, i - indices[start])
        above = max(above, indices[end - uint(1)] - i)
        total, first, left = 0.0, 0.0, 0
        k = start
        while k < end:
            total += abs(data[k])
            first += abs(data[k]) * (indices[k] < i)  # no branch
            left += indices[k] < i
            k += one()
        own = data[start + uint(left)]
        diag[i], diagonal[i], rest[i] = start + uint(left), own, total - abs(own)
        lower += first
        whole += rest[i]
        start = end
    return below, above, lower, whole - lower


@compiled
def product(indptr, indices, data, z, low, high, out):
    # rows low <= i < high of Az
    for i in range(uint(low), uint(high)):
        out[i] = row_sum(0.0, indptr[i], indptr[i + uint(1)], indices, data, z)


@compiled
def natural(indptr, indices, data, q, psi, z, low, high):
    # the sum of min(p, r)^2 over the rows low <= i < high, p = Az + q and r = z - psi; NaN where one of them is
    squares = 0.0
    for i in range(uint(low), uint(high)):
        p, r = row_sum(q[i], indptr[i], indptr[i + uint(1)], indices, data, z), z[i] - psi[i]
        least = r if r <= p or r != r else p
        squares += least * least
    return squares


@compiled
def couple(indptr, indices, data, weight):
    # sqrt|a_ij a_ji| weight_i weight_j off the diagonal, 0 on it. Rows are sorted, and i rises: what row j > i is asked
    # for is at or behind what it was asked for last, so that `at` only ever moves on
    n = indptr.size - 1
    at, out = indptr[:-1].copy(), np.zeros(data.size)
    for i in range(n):
        k, stop = uint(indptr[i]), uint(indptr[i + 1])
        while k < stop:
            j = uint(indices[k])
            if j > uint(i):
                end, here = indptr[j + uint(1)], at[j]
                while here < end and indices[uint(here)] < i:
                    here += 1
                at[j] = here
                if here < end and indices[uint(here)] == i:
                    size = weight[i] * weight[j]
                    out[k] = np.sqrt(abs(data[k]) * size) * np.sqrt(abs(data[uint(here)]) * size)
                    out[uint(here)] = out[k]
            k += one()
    return out
