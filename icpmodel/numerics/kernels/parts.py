"""Loops over the graph of A: what hangs on what, and what lies near."""

from __future__ import annotations

import numpy as np

from . import compiled, one
from . import position as _at


def _linked(indptr, indices):
    # whether every row but the first has an entry before its diagonal with one opposite to it: then each hangs on one
    # of a smaller number and that one on it, and all are one strong component
    for i in range(1, indptr.size - 1):
        found, k, stop = False, _at(indptr[i]), _at(indptr[i + 1])
        while k < stop and indices[k] < i and not found:
            j = _at(indices[k])
            e, end = _at(indptr[j]), _at(indptr[j + _at(1)])
            while e < end and indices[e] < i:
                e += one()
            found = bool(e < end and indices[e] == i)
            k += one()
        if not found:
            return False
    return True


linked = compiled(_linked)


def _stages(indptr, indices, part, rows, starts, core):
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


stages = compiled(_stages)


def _spread(indptr, indices, chosen, seeds, most):
    # `chosen` with the `seeds` and, in layers around these, up to so many more: columns that rows have entries in
    chosen, queue, at, end = chosen | seeds, np.empty(chosen.size, np.int32), 0, 0
    for i in range(chosen.size):
        if seeds[i]:
            queue[end] = i
            end += 1
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


spread = compiled(_spread)


def _certain(indptr, indices, data, q, c, v, z, unit, least):
    # The rows that are certain to touch the obstacle c: p_i(z) - e |A|v_i > 0, where |z - z*| <= e v is the bound of an
    # H+-matrix, e = max_i |min(p_i / (<A>v)_i, r_i / v_i)|; rounding included. None where <A>v > 0 does not hold.
    n = z.size
    margin, e = np.empty(n), 0.0
    none = np.zeros(n, np.bool_)
    for i in range(n):
        p, size, own, others = q[i], abs(q[i]), 0.0, 0.0
        for k in range(_at(indptr[i]), _at(indptr[i + 1])):
            a, j = data[k], _at(indices[k])
            p += a * z[j]
            size += abs(a * z[j])
            if j == _at(i):
                own = a * v[j]
            else:
                others += abs(a) * v[j]
        terms = 2.0 * (indptr[i + 1] - indptr[i] + 3)
        alpha = own - others - terms * (unit * (own + others) + least)
        if not (alpha > 0.0 and abs(p) < np.inf):
            return none
        off, r = terms * (unit * size + least), z[i] - c[i]
        off_r = 2.0 * unit * abs(r) if r < np.inf else 0.0
        e = max(e, abs(min(p / alpha, r / v[i])) + max(off / alpha, off_r / v[i]))
        margin[i] = (p - off) / ((own + others) * (1.0 + terms * unit) + terms * least)
    e = e * (1.0 + 32.0 * unit) + least
    for i in range(n):
        none[i] = margin[i] > e
    return none


certain = compiled(_certain)


def _cut(indptr, indices, data, q, rows, z):
    # A and q in the unknowns `rows` alone, these ascending, all others being what they are in z
    place, m, entries = np.full(z.size, -1, indices.dtype), rows.size, 0
    for t in range(m):
        place[rows[t]] = t
        entries += indptr[rows[t] + 1] - indptr[rows[t]]
    starts, columns, values = np.empty(m + 1, indptr.dtype), np.empty(entries, indices.dtype), np.empty(entries)
    inside, at = np.empty(m), 0
    for t in range(m):
        i, starts[t] = _at(rows[t]), at
        known = 0.0
        for k in range(_at(indptr[i]), _at(indptr[i + _at(1)])):
            j = _at(indices[k])
            if place[j] < 0:
                known += data[k] * z[j]
            else:
                columns[at], values[at] = place[j], data[k]
                at += 1
        inside[t] = known + q[i]
    starts[m] = at
    return starts, columns[:at], values[:at], inside


cut = compiled(_cut)
