"""One step of Anderson acceleration: `methods.accelerated` says what for.

It is made in blocks of rows that stay in the cache, so that every array is read once for the inner products and once
for the combination. Those products may be summed in any order ("reassoc").
"""

from __future__ import annotations

from functools import partial

import numpy as np

from . import compiled

_BLOCK = 512


@partial(compiled, reassociate=True)
def combine(F, G, known, newest, weight, least, out):
    # rows 0 ... known - 1 of F and G are values of f and g, and out = G[newest] - gamma dG with gamma as in
    # `methods.accelerated`. dG and dF are differences of the other rows to the newest. Returns False, with a
    # meaningless `out`, where a product is not finite
    n = weight.size
    last = known - 1
    # `order` lists the rows with `newest` last; the last row takes its place
    order = np.arange(known)
    order[newest], order[last] = last, newest
    products = np.zeros((last, last))
    right = np.zeros(last)
    gamma = np.zeros(last)
    differences = np.empty((last, _BLOCK))
    weighted = np.empty(_BLOCK)
    for start in range(0, n, _BLOCK):
        size = min(_BLOCK, n - start)
        # slices, as they are indexed without an offset, which would keep the loops from being vectorised
        f = F[newest, start : start + size]
        weights = weight[start : start + size]
        for j in range(last):
            other = F[order[j], start : start + size]
            difference = differences[j]
            with_f = 0.0
            for i in range(size):
                difference[i] = f[i] - other[i]
                weighted[i] = weights[i] * difference[i]
                with_f += weighted[i] * f[i]
            right[j] += with_f
            for k in range(j + 1):
                one = differences[k]
                total = 0.0
                for i in range(size):
                    total += weighted[i] * one[i]
                products[j, k] += total
                products[k, j] = products[j, k]
    if not _solve(products, right, last, least, gamma):
        return False
    for start in range(0, n, _BLOCK):
        size = min(_BLOCK, n - start)
        block = out[start : start + size]
        image = G[newest, start : start + size]
        for i in range(size):
            block[i] = image[i]
        for j in range(last):
            other = G[order[j], start : start + size]
            factor = gamma[j]
            for i in range(size):
                block[i] -= factor * (image[i] - other[i])
    return True


@compiled
def _solve(products, right, known, least, gamma):
    # products gamma = right by Cholesky elimination of the equilibrated matrix, the largest pivot first; directions
    # whose pivot is at most `least` are left out
    # (loops, as the array expressions of NumPy take five times as long to compile)
    scale = np.empty(known)
    S = np.empty((known, known + 1))
    for j in range(known):
        scale[j] = np.sqrt(products[j, j])
        if not (0.0 < scale[j] < np.inf and abs(right[j]) < np.inf):
            return False
    for j in range(known):
        S[j, known] = right[j] / scale[j]
        for k in range(known):
            S[j, k] = products[j, k] / scale[j] / scale[k]
    order = np.arange(known)
    used = known
    for step in range(known):
        best = step
        for j in range(step + 1, known):
            if S[order[j], order[j]] > S[order[best], order[best]]:
                best = j
        order[step], order[best] = order[best], order[step]
        pivot = order[step]
        if not S[pivot, pivot] > least:
            used = step
            break
        for j in range(step + 1, known):
            row = order[j]
            factor = S[row, pivot] / S[pivot, pivot]
            for k in range(known + 1):
                S[row, k] -= factor * S[pivot, k]
    for step in range(used - 1, -1, -1):
        pivot = order[step]
        total = S[pivot, known]
        for k in range(step + 1, used):
            total -= S[pivot, order[k]] * gamma[order[k]]
        gamma[pivot] = total / S[pivot, pivot]
    for j in range(known):
        gamma[j] /= scale[j]
    return True
