"""The two halves of a V-cycle on one level, on the rows where `free`; the others keep the correction 0.

Gauss–Seidel goes forward before the coarser level and backward after it, so that the cycle of a symmetric matrix is
symmetric. `diag[i]` is where the diagonal entry of row i stands; P's rows are those of the finer level.
"""

from __future__ import annotations

from . import compiled
from . import position as _at


def _descend(indptr, indices, data, diag, inverse, free, f, p_indptr, p_indices, p_data, x, coarse):
    # x: one forward sweep from 0, which needs the lower triangle alone; and coarse = P'(f - Ax), where the residual of
    # a row that was just swept is the product of x with its upper triangle
    for i in range(_at(x.size)):
        total = 0.0
        if free[i]:
            total = f[i]
            for k in range(_at(indptr[i]), _at(diag[i])):
                total -= data[k] * x[_at(indices[k])]
        x[i] = total * inverse[i]
    coarse[:] = 0.0
    for i in range(_at(x.size)):
        if free[i]:
            left = 0.0
            for k in range(_at(diag[i]) + _at(1), _at(indptr[i + _at(1)])):
                left -= data[k] * x[_at(indices[k])]
            for k in range(_at(p_indptr[i]), _at(p_indptr[i + _at(1)])):
                coarse[_at(p_indices[k])] += p_data[k] * left


def _ascend(indptr, indices, data, inverse, free, f, p_indptr, p_indices, p_data, coarse, x):
    # x + P coarse, and one backward sweep
    n = x.size
    for step in range(n):
        i = _at(step)
        if free[i]:
            total = x[i]
            for k in range(_at(p_indptr[i]), _at(p_indptr[i + _at(1)])):
                total += p_data[k] * coarse[_at(p_indices[k])]
            x[i] = total
    for step in range(n):
        i = _at(n - 1 - step)
        if free[i]:
            left = f[i]
            for k in range(_at(indptr[i]), _at(indptr[i + _at(1)])):
                left -= data[k] * x[_at(indices[k])]
            x[i] += left * inverse[i]


descend = compiled(_descend)
ascend = compiled(_ascend)
