"""The scaling vector of an M-matrix by layers of its graph: `theory.scaling` says what for."""

from __future__ import annotations

import numpy as np

from . import compiled
from . import position as _at


def _layers(indptr, indices, data, first):
    # breadth-first layers along the stored nonzeros j -> indices of row j; layer -1: not reached
    n = first.size
    layer = np.full(n, -1, np.int64)
    order = np.empty(n, np.int64)
    filled = 0
    for i in range(n):
        if first[i]:
            layer[i] = 0
            order[filled] = i
            filled += 1
    at = 0
    while at < filled:
        j = order[at]
        at += 1
        for k in range(_at(indptr[j]), _at(indptr[j + 1])):
            i = indices[k]
            if layer[i] < 0 and data[k] != 0.0:
                layer[i] = layer[j] + 1
                order[filled] = i
                filled += 1
    return layer, order[:filled]


def _layer_increments(indptr, indices, data, surplus, layer, order):
    # g with f(k) = g_0 + ... + g_k and <A>f(layer) >= D1; the data is that of <A>, `surplus` is D^-1<A>1, and
    # above[k] = f(deepest) - f(k)
    deepest = layer[order[-1]]
    g = np.zeros(deepest + 1)
    above = np.zeros(deepest + 2)
    for at in range(order.size - 1, -1, -1):
        i = order[at]
        k = layer[i]
        if at < order.size - 1 and layer[order[at + 1]] != k:
            above[k] = above[k + 1] + g[k + 1]
        own, pull, hold = 0.0, 0.0, 0.0
        for e in range(_at(indptr[i]), _at(indptr[i + 1])):
            j = indices[e]
            if j == i:
                own += data[e]
            elif layer[j] > k:
                pull -= data[e] * (above[k] - above[layer[j]])
            elif layer[j] < k:
                hold -= data[e]
        if k == 0:
            hold = surplus[i] * own
        g[k] = max(g[k], (own + pull) / hold)
    return g


layers = compiled(_layers)
layer_increments = compiled(_layer_increments)
