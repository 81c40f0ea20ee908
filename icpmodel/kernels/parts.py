"""Loops over the graph of A: what hangs on what, and what lies near."""

from __future__ import annotations

import numpy as np

from . import compiled


def _stages(indptr, indices, part, rows, starts, core):
    # part k = rows[starts[k] : starts[k + 1]] hangs on parts of smaller number only. Returns which parts hang on one of
    # `core`, and which are needed by one, those themselves included
    after, before = core.copy(), core.copy()
    for k in range(core.size):
        for i in rows[starts[k] : starts[k + 1]]:
            for e in range(indptr[i], indptr[i + 1]):
                after[k] |= after[part[indices[e]]]
    for k in range(core.size - 1, -1, -1):
        if before[k]:
            for i in rows[starts[k] : starts[k + 1]]:
                for e in range(indptr[i], indptr[i + 1]):
                    before[part[indices[e]]] = True
    return after, before


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
