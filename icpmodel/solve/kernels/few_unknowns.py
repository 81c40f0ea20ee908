"""An ICP of few unknowns with an affine obstacle, or two fixed ones, from its arrays to the judged answer."""

from __future__ import annotations

import math
from functools import partial

import numpy as np

from ...algebra.kernels.balancing import scale
from ...algebra.kernels.batched_lcps import solve_lcps
from ...methods.contract import SAFE_SIZE
from ...numerics.kernels import compiled
from ...numerics.rounding import SMALLEST
from ...problem.kernels.residual import raise_to_bounds


@partial(compiled, exact=True)
def _squared_residuals(A, G, q, c, d, z, weights):
    # returns Res_D(z)² and the square of its scale, NaN if a row counts as empty or obstacles cross; sets `weights`.
    # `residual`, `residual_scale` and `Matrix.row_weights` compute the same, but for so few unknowns their calls take
    # longer than the pivots
    squares = 0.0
    squares_0 = 0.0
    least = np.inf
    for i in range(q.size):
        p = q[i]
        r = z[i] - c[i]
        largest = 0.0
        for j in range(q.size):
            p += A[i, j] * z[j]
            largest = max(largest, abs(A[i, j]))
        for k in range(G[0][i], G[0][i + 1]):
            r -= G[2][k] * z[G[1][k]]
        if largest < SAFE_SIZE or not c[i] <= d[i]:
            return np.nan, np.nan
        weights[i] = 1.0 / largest
        squares += max(z[i] - d[i], min(weights[i] * p, r)) ** 2
        squares_0 += max(-d[i], min(weights[i] * q[i], -c[i])) ** 2
        for size in (abs(weights[i] * q[i]), abs(c[i]), abs(d[i])):
            if 0.0 < size < least:
                least = size
    if squares_0 == 0.0 and least < np.inf:
        squares_0 = least * least
    return squares, squares_0


@partial(compiled, exact=True)
def solve_few(A, q, G, c, d, M, inverse, rtol, limit):
    # returns (z, Res_D(z), its tolerance) for the ICP of A and q between the obstacles Gz + c and d, where G is 0 or d
    # is inf. The last two are NaN where z has to be judged elsewhere: `_squared_residuals` are NaN, or may over- or
    # underflow. With a G, `inverse` is that of I - G, and M is A times it; else it is empty, and M is A
    n = q.size
    Q = q.reshape(1, n)
    C = c.reshape(1, n)
    D = d.reshape(1, n)
    Z = np.empty((1, n))
    S, r, units = scale(M)
    solve_lcps(S, r, units, np.ones(n), Q, C, D, limit, Z)
    z = Z[0]
    if inverse.size:
        x = z.copy()
        for i in range(n):
            z[i] = 0.0
            for j in range(n):
                z[i] += inverse[i, j] * x[j]
    weights = np.empty((1, n))
    squares, squares_0 = _squared_residuals(A, G, q, c, d, z, weights[0])
    size_0 = math.sqrt(squares_0)
    if not SAFE_SIZE < size_0 < 1.0 / SAFE_SIZE or not squares < 1.0 / SAFE_SIZE**2:
        return z, np.nan, np.nan
    residual = np.full(1, math.sqrt(squares))
    # as `rounded_share` rounds it
    tolerance = np.full(1, max(rtol * size_0 - SMALLEST, 0.0))
    indptr = np.arange(0, n * n + 1, n).astype(np.int32)
    indices = np.empty(n * n, np.int32)
    for k in range(n * n):
        indices[k] = k % n
    above = (np.zeros(n + 1, np.int32), np.empty(0, np.int32), np.empty(0), D, 0.0)
    raise_to_bounds(indptr, indices, A.reshape(1, -1), weights, Q, *G, C, 0.0, Z, tolerance, residual, above, None)
    return z, residual[0], tolerance[0]
