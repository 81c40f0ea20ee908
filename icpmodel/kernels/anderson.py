"""One step of Anderson acceleration: `methods.accelerated` says what for.

It is made in blocks of rows that stay in the cache, so that every array is read once for the inner products and once
for the combination. Those products may be summed in any order ("reassoc").
"""

from __future__ import annotations

import numpy as np

from . import compiled

_BLOCK = 512


def _combine(z, image, z_last, image_last, weight, F, G, products, slot, known, least, out):
    # rows `slot` of F and G become the newest differences, and out = image - gamma G[:known] with gamma as in
    # `methods.accelerated`; False where a product is not finite, and then `out` is nothing
    n = z.size
    weighted, value = np.empty(_BLOCK), np.empty(_BLOCK)
    row, right, gamma = np.zeros(known), np.zeros(known), np.zeros(known)
    for start in range(0, n, _BLOCK):
        stop = min(start + _BLOCK, n)
        # slices, as an index into them needs no offset, which would keep the loops out of vector instructions
        zs, images, zs_last, images_last = z[start:stop], image[start:stop], z_last[start:stop], image_last[start:stop]
        weights, newest_f, newest_g = weight[start:stop], F[slot, start:stop], G[slot, start:stop]
        for i in range(stop - start):
            f = images[i] - zs[i]
            df = f - (images_last[i] - zs_last[i])
            newest_f[i] = df
            newest_g[i] = images[i] - images_last[i]
            weighted[i] = weights[i] * df
            value[i] = weights[i] * f
        for j in range(known):
            differences = F[j, start:stop]
            with_df, with_f = 0.0, 0.0
            for i in range(stop - start):
                with_df += weighted[i] * differences[i]
                with_f += value[i] * differences[i]
            row[j] += with_df
            right[j] += with_f
    for j in range(known):
        products[slot, j] = row[j]
        products[j, slot] = row[j]
    if not _solve(products, right, known, least, gamma):
        return False
    for start in range(0, n, _BLOCK):
        stop = min(start + _BLOCK, n)
        block = out[start:stop]
        block[:] = image[start:stop]
        for j in range(known):
            differences, factor = G[j, start:stop], gamma[j]
            for i in range(stop - start):
                block[i] -= factor * differences[i]
    return True


def _solve_products(products, right, known, least, gamma):
    # products gamma = right by Cholesky elimination of the equilibrated matrix, the largest pivot first; directions
    # whose pivot is at most `least` are left out
    scale = np.empty(known)
    for j in range(known):
        scale[j] = np.sqrt(products[j, j])
        if not (0.0 < scale[j] < np.inf and abs(right[j]) < np.inf):
            return False
    S = np.empty((known, known + 1))
    for j in range(known):
        for k in range(known):
            S[j, k] = products[j, k] / scale[j] / scale[k]
        S[j, known] = right[j] / scale[j]
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
            for k in range(step + 1, known):
                S[row, order[k]] -= factor * S[pivot, order[k]]
            S[row, known] -= factor * S[pivot, known]
    for step in range(used - 1, -1, -1):
        pivot = order[step]
        total = S[pivot, known]
        for k in range(step + 1, used):
            total -= S[pivot, order[k]] * gamma[order[k]]
        gamma[pivot] = total / S[pivot, pivot]
    for j in range(known):
        gamma[j] /= scale[j]
    return True


_solve = compiled(_solve_products)
combine = compiled(_combine, reassociate=True)
