"""What is asked of the rows of a matrix before the first sweep, in one pass: `operators.rows_of` says what for."""

from __future__ import annotations

import numpy as np

from . import compiled
from . import position as _at


def _look(indptr, indices, data):
    # where each row's diagonal entry stands, its value, the sum of the other |entries|; how far the entries reach below
    # the diagonal and above it. Rows are sorted, and every diagonal entry is stored.
    n = indptr.size - 1
    diag, diagonal, rest = np.empty(n, indptr.dtype), np.empty(n), np.empty(n)
    below, above = 0, 0
    start = _at(indptr[0])
    for i in range(n):
        end = _at(indptr[i + 1])
        below = max(below, i - indices[start])
        above = max(above, indices[end - _at(1)] - i)
        total, left = 0.0, 0
        for k in range(start, end):
            total += abs(data[k])
            left += indices[k] < i  # no branch
        own = data[start + _at(left)]
        diag[i], diagonal[i], rest[i] = start + _at(left), own, total - abs(own)
        start = end
    return diag, diagonal, rest, below, above


look = compiled(_look)
