"""Sweeps over the rows of A.

A sweep makes one pass over the CSR arrays of A: it writes the next iterate to `out` and returns Res(z)² of the iterate
it started from, which falls out for free. There is no branch per stored entry: `diag[i]` splits row i of A at its
diagonal entry, so that the loop over the strict lower triangle and the loop over the rest need no comparison of
indices. ψ enters as `psi`, resolved when the loop is compiled: a vector ψ(z), (c, indptr, indices, data) for Gz + c, or
(c, f) for f(z_i) + c_i with f compiled by numba.
"""

from __future__ import annotations

import math

import numba
import numpy as np
from numba import types
from numba.extending import overload

from . import compiled, one
from . import position as _at


def psi_entry(psi, i, z):
    """ψ_i(z) inside a compiled loop; the form of `psi` picks the code (see the module's docstring)."""
    raise TypeError("psi_entry exists in compiled code only")


@overload(psi_entry)
def _psi_entry(psi, i, z):
    if isinstance(psi, types.Array):
        return lambda psi, i, z: psi[i]
    if isinstance(psi, types.BaseTuple) and len(psi) == 4:

        def affine(psi, i, z):
            c, indptr, indices, data = psi
            value = c[i]
            k, stop = _at(indptr[i]), _at(indptr[i + _at(1)])
            while k < stop:
                value += data[k] * z[_at(indices[k])]
                k += one()
            return value

        return affine
    return lambda psi, i, z: psi[1](z[i]) + psi[0][i]


# A row of a sweep: it sets out_i and returns the square of the natural residual. Entries first ... last are those that
# the sweep has passed, k0 ... k1 those to come, d is the diagonal one. The sums over old and new entries are kept
# apart, so that only one multiply-add stands between one row and the next.
_inlined = numba.njit(fastmath={"contract"}, error_model="numpy", nogil=True, inline="always")


@_inlined
def _row_aor(i, d, first, last, k0, k1, indices, data, q, psi, par, z, out):
    # row i of X = diag(1/inverse) + tau * (strict lower triangle of A), and out = z - 2 X^-1 F(z):
    # out_i = z_i - inverse_i (2 F_i + tau * sum_{j<i} a_ij (out_j - z_j))
    omega, inverse, tau = par
    old, new = 0.0, 0.0
    k = first
    while k < last:
        a, j = data[k], _at(indices[k])
        old += a * z[j]
        new += a * out[j]
        k += one()
    zi = z[i]
    rest = q[i] + data[d] * zi
    k = k0
    while k < k1:
        rest += data[k] * z[_at(indices[k])]
        k += one()
    p = rest + old
    r = zi - psi_entry(psi, i, z)
    natural = p if p < r else r
    scaled = omega[i] * r
    F = p if p < scaled else scaled
    x = inverse[i]
    out[i] = (zi + x * (tau * old - 2.0 * F)) - (x * tau) * new
    return natural * natural


@_inlined
def _row_projected(i, d, first, last, k0, k1, indices, data, q, psi, par, z, out):
    # projected SOR: out_i = max(psi_i(z), z_i - omega/a_ii (sum_{j before i} a_ij out_j + sum_{others} a_ij z_j + q_i))
    old, new = 0.0, 0.0
    k = first
    while k < last:
        a, j = data[k], _at(indices[k])
        old += a * z[j]
        new += a * out[j]
        k += one()
    zi, own = z[i], data[d]
    rest = q[i] + own * zi
    k = k0
    while k < k1:
        rest += data[k] * z[_at(indices[k])]
        k += one()
    p = rest + old
    obstacle = psi_entry(psi, i, z)
    r = zi - obstacle
    natural = p if p < r else r
    # a division costs less than one more number per row from memory
    scale = par[0] / own
    moved = (zi - scale * rest) - scale * new
    out[i] = obstacle if moved < obstacle else moved
    return natural * natural


# `par` tells which sweep it is: (Ω, the inverse diagonal of X, tau), or (ω,) for the projected one. numba drops the
# other branch when it compiles. (What a function of the row makes would be compiled anew by every process: numba takes
# what it closes over for a part of its name, and that is never the same.)


def _in_order(indptr, indices, data, diag, q, psi, par, forward, z, out):
    # one sweep, z -> out
    squares = 0.0
    n = z.size
    for step in range(n):
        i = _at(step if forward else n - 1 - step)
        d, start, end = _at(diag[i]), _at(indptr[i]), _at(indptr[i + _at(1)])
        first, last, k0, k1 = start, d, d + _at(1), end
        if not forward:
            first, last, k0, k1 = d + _at(1), end, start, d
        if len(par) == 3:
            squares += _row_aor(i, d, first, last, k0, k1, indices, data, q, psi, par, z, out)
        else:
            squares += _row_projected(i, d, first, last, k0, k1, indices, data, q, psi, par, z, out)
    return squares


_sweep = numba.njit(_in_order, fastmath={"contract"}, error_model="numpy", nogil=True)


def _some_in_order(indptr, indices, data, diag, q, psi, par, forward, Z, squares):
    # sweeps one after the other, Z[0] -> Z[1] -> ..., for problems so small that to call one costs more than to make it
    for k in range(squares.size):
        squares[k] = _sweep(indptr, indices, data, diag, q, psi, par, forward, Z[k], Z[k + 1])


@compiled
def still_needed(half, last, goal, steps):
    # how many more sweeps it takes from the residual `last` to `goal` at the rate of the `steps` since `half`; the same
    # number for three squares
    speed = math.log(half / last) / steps
    return math.log(last / goal) / speed if speed > 0.0 else np.inf


def _two_in_order(indptr, indices, data, diag, q, psi, par, lag, z, one, two, low, high):
    # rows low <= i < high of the sweep z -> one, and rows low - lag <= i < high - lag of the next one, one -> two: no
    # row of A reaches further above its diagonal than `lag`, and a row's entries come from memory once for both. The
    # two sweeps do not wait for each other.
    squares, more = 0.0, 0.0
    n, lag = _at(z.size), _at(lag)
    for i in range(_at(low), _at(high)):
        if i < n:
            d, start, end = _at(diag[i]), _at(indptr[i]), _at(indptr[i + _at(1)])
            if len(par) == 3:
                squares += _row_aor(i, d, start, d, d + _at(1), end, indices, data, q, psi, par, z, one)
            else:
                squares += _row_projected(i, d, start, d, d + _at(1), end, indices, data, q, psi, par, z, one)
        if i >= lag:
            j = i - lag
            d, start, end = _at(diag[j]), _at(indptr[j]), _at(indptr[j + _at(1)])
            if len(par) == 3:
                more += _row_aor(j, d, start, d, d + _at(1), end, indices, data, q, psi, par, one, two)
            else:
                more += _row_projected(j, d, start, d, d + _at(1), end, indices, data, q, psi, par, one, two)
    return squares, more


def _sweep_diagonal(indptr, indices, data, q, psi, omega, inverse, z, out):
    # X = diag(1/inverse): the rows do not wait for each other
    squares = 0.0
    start = _at(indptr[0])
    for i in range(_at(z.size)):
        end = _at(indptr[i + _at(1)])
        p = q[i]
        k = start
        while k < end:
            p += data[k] * z[_at(indices[k])]
            k += one()
        start = end
        zi = z[i]
        r = zi - psi_entry(psi, i, z)
        natural = p if p < r else r
        squares += natural * natural
        scaled = omega[i] * r
        F = p if p < scaled else scaled
        out[i] = zi - (2.0 * inverse[i]) * F
    return squares


def _sweep_triangular(indptr, indices, data, q, psi, omega, start, stop, x_indices, x_data, inverse, forward, z, out):
    # X = diag(1/inverse) + T with T strictly triangular, its row i at start[i] ... stop[i] of x_indices, x_data
    squares = 0.0
    n = z.size
    for step in range(n):
        i = _at(step if forward else n - 1 - step)
        p = q[i]
        k, end = _at(indptr[i]), _at(indptr[i + _at(1)])
        while k < end:
            p += data[k] * z[_at(indices[k])]
            k += one()
        total = 0.0
        k, end = _at(start[i]), _at(stop[i])
        while k < end:
            j = _at(x_indices[k])
            total += x_data[k] * (out[j] - z[j])
            k += one()
        zi = z[i]
        r = zi - psi_entry(psi, i, z)
        natural = p if p < r else r
        squares += natural * natural
        scaled = omega[i] * r
        F = p if p < scaled else scaled
        out[i] = zi - inverse[i] * (2.0 * F + total)
    return squares


@compiled
def substitute(start, stop, indices, data, tau, inverse, forward, f, out):
    # X out = f for X = diag(1/inverse) + tau * T, row i of the strictly triangular T at start[i] ... stop[i]
    n = f.size
    for step in range(n):
        i = _at(step if forward else n - 1 - step)
        total = 0.0
        k, end = _at(start[i]), _at(stop[i])
        while k < end:
            total += data[k] * out[_at(indices[k])]
            k += one()
        out[i] = inverse[i] * (f[i] - tau * total)


class Sweeps:
    """The sweeps, compiled alike: in the order of the rows, some one after the other, two in one pass; the others."""

    def __init__(self, *, cache: bool) -> None:
        self.in_order = compiled(_in_order, cache=cache)
        self.some_in_order = compiled(_some_in_order, cache=cache)
        self.two_in_order = compiled(_two_in_order, cache=cache)
        self.diagonal = compiled(_sweep_diagonal, cache=cache)
        self.triangular = compiled(_sweep_triangular, cache=cache)


#: for ψ given by arrays, kept on disk between runs
SWEEPS = Sweeps(cache=True)
#: for ψ that calls a user's compiled function: numba cannot find those again in its cache
USER_SWEEPS = Sweeps(cache=False)
