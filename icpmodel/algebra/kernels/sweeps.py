"""Sweeps over the rows of A.

A sweep makes one pass over the CSR arrays of A. It writes the next iterate to `out` and returns Res_D(z)² of the
iterate it started from, at no extra cost. `weights` are the diagonal of D⁻¹. There is no branch per stored
entry: `diag[i]` splits row i of A at its diagonal entry. So the loops over the strict lower triangle and over the
others compare no indices. ψ enters as `psi`, resolved when the loop is compiled. It is a vector ψ(z), or
(c, indptr, indices, data) for Gz + c; with an upper obstacle, an `ObstaclePair` of two such.
"""

from __future__ import annotations

from numba import types
from numba.extending import overload

from ...numerics.kernels import compiled, compiled_helper, inlined, one, row_sum, run_end, two_run_sums, uint
from ...problem.kernels.residual import larger, median


def psi_entry(psi, i, z):
    """ψ_i(z) inside a compiled loop; the form of `psi` picks the code (see the module's docstring)."""
    raise TypeError("psi_entry exists in compiled code only")


@overload(psi_entry)
def _psi_entry(psi, i, z):
    if isinstance(psi, types.Array):
        return lambda psi, i, z: psi[i]
    if isinstance(psi, types.BaseNamedTuple):
        return lambda psi, i, z: psi_entry(psi[0], i, z)
    return lambda psi, i, z: row_sum(psi[0][i], psi[1][i], psi[1][i + uint(1)], psi[2], psi[3], z)


def upper_entry(psi, i, z):
    """ψ̄_i(z), None without an upper obstacle."""
    raise TypeError("upper_entry exists in compiled code only")


@overload(upper_entry)
def _upper_entry(psi, i, z):
    if isinstance(psi, types.BaseNamedTuple):
        return lambda psi, i, z: psi_entry(psi[1], i, z)
    return lambda psi, i, z: None


@compiled_helper
def median_residual(least, zi, low, top):
    # mid(z_i - top, p, z_i - low), `least` = min(p, z_i - low); `least` where top is None
    if top is None:
        return least
    return median(least, zi - low, zi - top)


@compiled_helper
def step_residual(least, zi, top, weight):
    # max(weight (z_i - top), `least`), the median of a step; where the obstacles cross it moves z_i to the upper one,
    # and unlike `median_residual` it is continuous
    if top is None:
        return least
    return larger(least, weight * (zi - top))


@compiled_helper
def clip_above(value, top):
    # min(value, top); `value` where top is None
    if top is None:
        return value
    return top if value > top else value


@inlined
def _smaller(p, r):
    return p if p < r else r


@compiled_helper
def _next_entry(par, i, zi, own, obstacle, top, p, rest, old, new):
    # out_i. The length of `par` selects the sweep, and numba drops the other branch when it compiles. (A closure for
    # each sweep would be compiled anew by every process: numba's cache key includes the objects that it closes over,
    # and these are never the same.)
    if len(par) == 3:
        # X = diag(1/inverse) + tau * (strict lower triangle of A), and out = z - 2 X^-1 F(z):
        # out_i = z_i - inverse_i (2 F_i + tau * sum_{j<i} a_ij (out_j - z_j))
        omega, inverse, tau = par
        x = inverse[i]
        F = step_residual(_smaller(p, omega[i] * (zi - obstacle)), zi, top, omega[i])
        if tau == 0.0:  # the sums may not be finite
            return zi - (2.0 * x) * F
        return (zi + x * (tau * old - 2.0 * F)) - (x * tau) * new
    # projected SOR: max(psi_i(z), z_i - omega/a_ii (sum_{j before i} a_ij out_j + sum_{others} a_ij z_j + q_i));
    # a division costs less than one more number per row from memory
    scale = par[0] / own
    moved = (zi - scale * rest) - scale * new
    return clip_above(obstacle if moved < obstacle else moved, top)


@inlined
def _row(i, forward, indptr, indices, data, diag, weights, q, psi, par, z, out):
    # sets out_i and returns the square of the residual of row i. The sums over the entries that the sweep has passed,
    # old and new, are kept apart, so that only one multiply-add stands between one row and the next
    d = uint(diag[i])
    start = uint(indptr[i])
    end = uint(indptr[i + uint(1)])
    k = start
    last = d
    first_left = d + uint(1)
    end_left = end
    if not forward:
        k = d + uint(1)
        last = end
        first_left = start
        end_left = d
    old = 0.0
    new = 0.0
    run = run_end(k, last, indices)
    if run > k:
        old, new = two_run_sums(k, run, uint(indices[k]), data, z, out)
        k = run
    while k < last:
        a = data[k]
        j = uint(indices[k])
        old += a * z[j]
        new += a * out[j]
        k += one()
    zi = z[i]
    diagonal_entry = data[d]
    rest = row_sum(q[i] + diagonal_entry * zi, first_left, end_left, indices, data, z)
    p = rest + old
    obstacle = psi_entry(psi, i, z)
    top = upper_entry(psi, i, z)
    natural = median_residual(_smaller(weights[i] * p, zi - obstacle), zi, obstacle, top)
    out[i] = _next_entry(par, i, zi, diagonal_entry, obstacle, top, p, rest, old, new)
    return natural * natural


@compiled
def sweep_rows(indptr, indices, data, diag, weights, q, psi, par, forward, z, out):
    # one sweep, z -> out; `par` is (Ω, the inverse diagonal of X, tau), or (ω,) for the projected one
    squares = 0.0
    n = z.size
    for step in range(n):
        i = uint(step if forward else n - 1 - step)
        squares += _row(i, forward, indptr, indices, data, diag, weights, q, psi, par, z, out)
    return squares


@compiled
def repeated_sweeps(indptr, indices, data, diag, weights, q, psi, par, forward, Z, squares):
    # sweeps one after the other, Z[0] -> Z[1] -> ...
    for k in range(squares.size):
        squares[k] = sweep_rows(indptr, indices, data, diag, weights, q, psi, par, forward, Z[k], Z[k + 1])


@compiled
def substitute(start, stop, indices, data, tau, inverse, f, out):
    # X out = f for X = diag(1/inverse) + tau * T, row i of the strict lower triangle T at start[i] ... stop[i]
    for i in range(uint(f.size)):
        out[i] = inverse[i] * (f[i] - tau * row_sum(0.0, start[i], stop[i], indices, data, out))


@compiled
def bounded(indptr, indices, data, diag, scale, growth, tiny, f, v, g, out):
    # a projected sweep over `data` >= 0 for bounds, with the newest ones in the rows before: out_i is the larger
    # of g_i and (f_i + scale_i (sum_{j<i} a_ij out_j + sum_{j>i} a_ij v_j)) growth_i + tiny_i
    for i in range(uint(v.size)):
        total = row_sum(0.0, indptr[i], diag[i], indices, data, out)
        total = row_sum(total, uint(diag[i]) + uint(1), indptr[i + uint(1)], indices, data, v)
        moved = (f[i] + scale[i] * total) * growth[i] + tiny[i]
        out[i] = g[i] if moved <= g[i] else moved  # NaN stays
