"""The two halves of a V-cycle on one level, on the rows where `free`; the others keep the correction 0.

Gauss–Seidel goes forward before the coarser level and backward after it, so that the cycle of a symmetric matrix is
symmetric. `diag[i]` is where the diagonal entry of row i stands; P's rows are those of the finer level. Every loop
takes its rows from `low` to `high`, counted from the side where it begins.
"""

from __future__ import annotations

from . import compiled, one
from . import position as _at


@compiled
def sweep_down(indptr, indices, data, diag, inverse, free, f, x, low, high):
    # one forward sweep from x = 0, which needs the lower triangle alone
    for i in range(_at(low), _at(high)):
        total = 0.0
        if free[i]:
            total = f[i]
            k, stop = _at(indptr[i]), _at(diag[i])
            while k < stop:
                total -= data[k] * x[_at(indices[k])]
                k += one()
        x[i] = total * inverse[i]


@compiled
def restrict(indptr, indices, data, diag, free, p_indptr, p_indices, p_data, x, coarse, low, high):
    # coarse + P'(f - Ax), where the residual of a row that was just swept is the product of x with its upper triangle
    for i in range(_at(low), _at(high)):
        if free[i]:
            left = 0.0
            k, stop = _at(diag[i]) + _at(1), _at(indptr[i + _at(1)])
            while k < stop:
                left -= data[k] * x[_at(indices[k])]
                k += one()
            k, stop = _at(p_indptr[i]), _at(p_indptr[i + _at(1)])
            while k < stop:
                coarse[_at(p_indices[k])] += p_data[k] * left
                k += one()


@compiled
def interpolate(free, p_indptr, p_indices, p_data, coarse, x, low, high):
    # x + P coarse, from the last row on
    n = x.size
    for i in range(_at(n - high), _at(n - low)):
        if free[i]:
            total = x[i]
            k, stop = _at(p_indptr[i]), _at(p_indptr[i + _at(1)])
            while k < stop:
                total += p_data[k] * coarse[_at(p_indices[k])]
                k += one()
            x[i] = total


@compiled
def sweep_up(indptr, indices, data, inverse, free, f, x, low, high):
    # one backward sweep
    n = x.size
    for step in range(low, high):
        i = _at(n - 1 - step)
        if free[i]:
            left = f[i]
            k, stop = _at(indptr[i]), _at(indptr[i + _at(1)])
            while k < stop:
                left -= data[k] * x[_at(indices[k])]
                k += one()
            x[i] += left * inverse[i]
