"""Loops over the graph of A: dependence of blocks, symmetry, breadth-first layers, fill."""

from __future__ import annotations

import numpy as np

from . import compiled, inlined, one, uint


@compiled
def dependence(indptr, indices, part, rows, starts, core):
    # part k = rows[starts[k] : starts[k + 1]] depends only on parts of smaller number. Returns masks of the parts that
    # depend on a part of the `core`, and of those that the core depends on; both include the core
    follows = core.copy()
    needed = core.copy()
    for k in range(core.size):
        for i in rows[starts[k] : starts[k + 1]]:
            for e in range(indptr[i], indptr[i + 1]):
                follows[k] |= follows[part[indices[e]]]
    for k in range(core.size - 1, -1, -1):
        if needed[k]:
            for i in rows[starts[k] : starts[k + 1]]:
                for e in range(indptr[i], indptr[i + 1]):
                    needed[part[indices[e]]] = True
    return follows, needed


@compiled
def restricted_arrays(indptr, indices, data, q, rows, z):
    # A and q restricted to the unknowns `rows`, which are ascending; all others are fixed at their values in z
    m = rows.size
    place = np.empty(z.size, indices.dtype)
    for i in range(z.size):
        place[i] = -1
    entries = 0
    for t in range(m):
        place[rows[t]] = t
        entries += indptr[rows[t] + 1] - indptr[rows[t]]
    starts = np.empty(m + 1, indptr.dtype)
    columns = np.empty(entries, indices.dtype)
    values = np.empty(entries)
    inside = np.empty(m)
    at = 0
    for t in range(m):
        row = uint(rows[t])
        starts[t] = at
        known = 0.0
        for k in range(uint(indptr[row]), uint(indptr[row + uint(1)])):
            j = uint(indices[k])
            if place[j] < 0:
                known += data[k] * z[j]
            else:
                columns[at] = place[j]
                values[at] = data[k]
                at += 1
        inside[t] = known + q[row]
    starts[m] = at
    return starts, columns[:at], values[:at], inside


@inlined
def _root(i, into, sign):
    # the root of the rows that were joined with row i, and the sign of row i relative to it
    sign_i = 1.0
    while into[i] != i:
        j = into[i]
        sign[i] *= sign[j]
        into[i] = into[j]
        sign_i *= sign[i]
        i = into[i]
    return i, sign_i


@compiled
def symmetrising_signs(indptr, indices, data, same):
    # signs of the rows that make a matrix symmetric up to the relative error `same`; empty where there are none, or
    # where a_ij is stored and a_ji is not. Rows are sorted
    n = indptr.size - 1
    ahead = np.empty(n, indptr.dtype)
    into = np.arange(n)
    sign = np.ones(n)
    none = np.empty(0)
    for i in range(n):
        k = uint(indptr[i])
        stop = uint(indptr[i + 1])
        while k < stop and indices[k] < i:
            j = np.int64(indices[k])
            e = uint(ahead[j])
            if e >= uint(indptr[j + 1]) or indices[e] != i:
                return none
            ahead[j] += 1
            least = same * max(abs(data[k]), abs(data[e]))
            equal = abs(data[k] - data[e]) <= least
            opposite = abs(data[k] + data[e]) <= least
            if not (equal or opposite):
                return none
            if equal != opposite:
                (a, sign_i) = _root(i, into, sign)
                (b, sign_j) = _root(j, into, sign)
                relative = sign_i * sign_j if equal else -sign_i * sign_j
                if a != b:
                    into[a] = b
                    sign[a] = relative
                elif relative < 0.0:
                    return none
            k += one()
        ahead[i] = k + one() if k < stop and indices[k] == i else k
    for i in range(n):
        if ahead[i] < indptr[i + 1]:
            return none
    sigma = np.empty(n)
    for i in range(n):
        sigma[i] = _root(i, into, sign)[1]
    return sigma


@compiled
def fill_band(indptr, indices, data, top, band):
    # band[j, top + i - j] = a_ij for i >= j - top: the columns of LAPACK's bands are the rows of `band`
    for i in range(indptr.size - 1):
        for k in range(uint(indptr[i]), uint(indptr[i + 1])):
            place = top + i - indices[k]
            if place >= 0:
                band[uint(indices[k]), uint(place)] = data[k]


@compiled
def breadth_first_layers(indptr, indices, data, first):
    # breadth-first layers along the stored nonzeros j -> indices of row j; layer -1: not reached
    n = first.size
    layer = np.empty(n, np.int64)
    order = np.empty(n, np.int64)
    at = 0
    filled = 0
    for i in range(n):
        layer[i] = -1
        if first[i]:
            layer[i] = 0
            order[filled] = i
            filled += 1
    while at < filled:
        j = order[at]
        for k in range(uint(indptr[j]), uint(indptr[j + 1])):
            i = indices[k]
            if layer[i] < 0 and data[k] != 0.0:
                layer[i] = layer[j] + 1
                order[filled] = i
                filled += 1
        at += 1
    return layer, order[:filled]


@compiled
def layer_increments(indptr, indices, data, surplus, layer, order):
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
        diagonal_entry = 0.0
        inflow = 0.0
        hold = 0.0
        for e in range(uint(indptr[i]), uint(indptr[i + 1])):
            j = indices[e]
            if j == i:
                diagonal_entry += data[e]
            elif layer[j] > k:
                inflow -= data[e] * (above[k] - above[layer[j]])
            elif layer[j] < k:
                hold -= data[e]
        if k == 0:
            hold = surplus[i] * diagonal_entry
        g[k] = max(g[k], (diagonal_entry + inflow) / hold)
    return g


@compiled
def column_counts(indptr, indices, place):
    # the entries of L without its diagonal, and the sum of their squares column by column, where row i is eliminated
    # as number place[i]: the row subtrees of the elimination tree, see Liu, SIAM J. Matrix Anal. Appl. 11 (1990)
    n = place.size
    row = np.empty(n, np.int64)
    parent = np.empty(n, np.int64)
    seen = np.empty(n, np.int64)
    count = np.zeros(n)
    for i in range(n):
        row[place[i]] = i
        parent[i] = -1
        seen[i] = -1
    for k in range(n):
        seen[k] = k
        for e in range(indptr[row[k]], indptr[row[k] + 1]):
            j = place[indices[e]]
            while j < k and seen[j] != k:
                if parent[j] < 0:
                    parent[j] = k
                count[j] += 1.0
                seen[j] = k
                j = parent[j]
    entries = 0.0
    squares = 0.0
    for k in range(n):
        entries += count[k]
        squares += count[k] * count[k]
    return entries, squares
