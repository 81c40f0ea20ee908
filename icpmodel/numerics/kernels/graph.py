"""Loops over the graph of A: what hangs on what, what lies near, and in which layer."""

from __future__ import annotations

import numpy as np

from . import compiled, one, uint


@compiled
def linked(indptr, indices):
    # whether every row but the first has an entry before its diagonal with one opposite to it: then each hangs on one
    # of a smaller number and that one on it, and all are one strong component
    for i in range(1, indptr.size - 1):
        found, k, stop = False, uint(indptr[i]), uint(indptr[i + 1])
        while k < stop and indices[k] < i and not found:
            j = uint(indices[k])
            e, end = uint(indptr[j]), uint(indptr[j + uint(1)])
            while e < end and indices[e] < i:
                e += one()
            found = bool(e < end and indices[e] == i)
            k += one()
        if not found:
            return False
    return True


@compiled
def stages(indptr, indices, part, rows, starts, core):
    # part k = rows[starts[k] : starts[k + 1]] hangs on parts of smaller number only. Returns how many of `core` follow
    # one another up to each part, itself included, and which parts are needed by one of `core`, those included
    depth, before = np.zeros(core.size, np.int64), core.copy()
    for k in range(core.size):
        for i in rows[starts[k] : starts[k + 1]]:
            for e in range(indptr[i], indptr[i + 1]):
                depth[k] = max(depth[k], depth[part[indices[e]]])
        depth[k] += core[k]
    for k in range(core.size - 1, -1, -1):
        if before[k]:
            for i in rows[starts[k] : starts[k + 1]]:
                for e in range(indptr[i], indptr[i + 1]):
                    before[part[indices[e]]] = True
    return depth, before


@compiled
def spread(indptr, indices, chosen, seeds, most):
    # `chosen` with the `seeds` and, in layers around these, up to so many more: columns that rows have entries in
    chosen, queue, first = chosen | seeds, np.empty(chosen.size, np.int32), np.flatnonzero(seeds)
    at, end = 0, first.size
    queue[:end] = first
    most += end
    while at < end <= most:
        layer = end
        while at < layer:
            for e in range(indptr[queue[at]], indptr[queue[at] + 1]):
                j = indices[e]
                if not chosen[j]:
                    chosen[j], queue[end] = True, j
                    end += 1
            at += 1
        if end > most:
            chosen[queue[layer:end]] = False
    return chosen


@compiled
def cut(indptr, indices, data, q, rows, z):
    # A and q in the unknowns `rows` alone, these ascending, all others being what they are in z
    place, m = np.full(z.size, -1, indices.dtype), rows.size
    place[rows], entries = np.arange(m), np.sum(indptr[rows + 1] - indptr[rows])
    starts, columns, values = np.empty(m + 1, indptr.dtype), np.empty(entries, indices.dtype), np.empty(entries)
    inside, at = np.empty(m), 0
    for t in range(m):
        i, starts[t] = uint(rows[t]), at
        known = 0.0
        for k in range(uint(indptr[i]), uint(indptr[i + uint(1)])):
            j = uint(indices[k])
            if place[j] < 0:
                known += data[k] * z[j]
            else:
                columns[at], values[at] = place[j], data[k]
                at += 1
        inside[t] = known + q[i]
    starts[m] = at
    return starts, columns[:at], values[:at], inside


@compiled
def layers(indptr, indices, data, first):
    # breadth-first layers along the stored nonzeros j -> indices of row j; layer -1: not reached
    layer, order, start = np.where(first, 0, -1), np.empty(first.size, np.int64), np.flatnonzero(first)
    at, filled = 0, start.size
    order[:filled] = start
    while at < filled:
        j = order[at]
        at += 1
        for k in range(uint(indptr[j]), uint(indptr[j + 1])):
            i = indices[k]
            if layer[i] < 0 and data[k] != 0.0:
                layer[i] = layer[j] + 1
                order[filled] = i
                filled += 1
    return layer, order[:filled]


@compiled
def layer_increments(indptr, indices, data, surplus, layer, order):
    # g with f(k) = g_0 + ... + g_k and <A>f(layer) >= D1; the data is that of <A>, `surplus` is D^-1<A>1, and
    # above[k] = f(deepest) - f(k)
    deepest = layer[order[-1]]
    g, above = np.zeros(deepest + 1), np.zeros(deepest + 2)
    for at in range(order.size - 1, -1, -1):
        i = order[at]
        k = layer[i]
        if at < order.size - 1 and layer[order[at + 1]] != k:
            above[k] = above[k + 1] + g[k + 1]
        own, pull, hold = 0.0, 0.0, 0.0
        for e in range(uint(indptr[i]), uint(indptr[i + 1])):
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
