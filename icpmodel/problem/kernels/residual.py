"""Bounds on the exact natural residual.

Products and sums are computed as pairs of floats; the bounds on their errors are zero where nothing was rounded.

References: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.1; Ogita, Rump and Oishi, SIAM J.
Sci. Comput. 26 (2005).
"""

from __future__ import annotations

import math
from functools import partial
from typing import Any

import numba
import numpy as np
from numba.extending import intrinsic

from ...numerics.kernels import compiled, inlined, one, uint
from ...numerics.rounding import MIN_EXACT_PRODUCT, SMALLEST, UNIT_ROUNDOFF


@inlined
def larger(least, above):
    # max(least, above); NaN stays
    return above if above > least or above != above else least


@inlined
def median(least, below, above):
    # of below, p and above, `least` = min(p, below), as `two_sided.mid` has it; NaN stays
    if above > below:
        return above if abs(above) > abs(below) else below
    return larger(least, above)


def _fma(typing_context: Any, a: Any, b: Any, c: Any) -> Any:
    return numba.float64(*[numba.float64] * 3), lambda context, builder, signature, operands: builder.fma(*operands)


fma: Any = intrinsic(_fma)


@inlined
def row_sum(start, left, k, stop, sign, indices, data, z):
    # start + left + sign times a row of Az, with the rounding errors of all products and sums added up separately, and
    # a bound on the error of the result
    total = start
    rest = left
    size = abs(left)
    entries = 3
    lost = 0.0
    while k < stop:
        a = sign * data[k]
        b = z[uint(indices[k])]
        term = a * b
        after = total + term
        part = after - total
        low = fma(a, b, -term)
        error = (total - (after - part)) + (term - part)
        total = after
        rest = rest + (low + error)
        size = size + (abs(low) + abs(error))
        entries = entries + 2
        if abs(term) < MIN_EXACT_PRODUCT and a != 0.0 and b != 0.0:
            lost += SMALLEST
        k += one()
    value = total + rest
    return value, lost + entries * UNIT_ROUNDOFF * size + (4.0 * UNIT_ROUNDOFF * abs(value) if size > 0.0 else 0.0)


@inlined
def gap(i, indptr, indices, data, c, known, z):
    # (z - c - Gz)_i, where c has a relative error of up to `known`, and a bound on its error; infinite where c is
    if abs(c[i]) == np.inf:
        return -c[i], 0.0
    start = z[i] - c[i]
    part = start - z[i]
    left = (z[i] - (start - part)) - (c[i] + part)
    k = uint(indptr[i])
    stop = uint(indptr[i + uint(1)])
    r, rounding_r = row_sum(start, left, k, stop, -1.0, indices, data, z)
    return r, rounding_r + known * abs(c[i])


@inlined
def weighted(weight, value, error):
    # weight * value and a bound on its error, where `weight` is 1/d to an ulp and `error` a bound on that of the value
    product = weight * value
    if value == 0.0 and error == 0.0:
        return product, error
    if weight * (abs(value) - error) == np.inf:  # p is larger than every float, so r is the smaller one
        return product, 0.0
    return product, (1.0 + 4.0 * UNIT_ROUNDOFF) * (weight * error) + 4.0 * UNIT_ROUNDOFF * abs(product) + SMALLEST


@inlined
def is_undefined(value, error):
    # after an overflow the value and the bound on its error are infinite, and their difference is NaN
    return math.isnan(value - error) or math.isnan(value + error)


@inlined
def largest_median(p_with_error, r_with_error, s_with_error):
    # the largest possible |median of p, r and s|, s <= r, given (value, bound on its error) of each; where r and s may
    # cross, at least the largest possible |r| and |s|. Without an upper obstacle s is -inf, and it is |min(p, r)|
    (p, rounding_p) = p_with_error
    (r, rounding_r) = r_with_error
    (s, rounding_s) = s_with_error
    if is_undefined(p, rounding_p) or is_undefined(r, rounding_r) or is_undefined(s, rounding_s):
        return np.inf
    low = max(s - rounding_s, min(p - rounding_p, r - rounding_r))
    high = max(s + rounding_s, min(p + rounding_p, r + rounding_r))
    size = max(abs(low), abs(high))
    if s + rounding_s > r - rounding_r:
        size = max(size, abs(r) + rounding_r, abs(s) + rounding_s)
    return size


@partial(compiled, exact=True)
def raise_to_bounds(
    indptr, indices, data, weights, Q, G_indptr, G_indices, G_data, C, known, Z, tolerances, residuals, upper, left
):
    # replaces residuals within their tolerances by bounds on the exact ones, if the bounds exceed the tolerances. Row
    # by row p = weight (Az + q + left) and r = z - c - Gz, where c has a relative error of up to `known`; `left` is
    # None for 0, `upper` is None or (indptr, indices, data, C, known) of the upper obstacle. `data` and `weights` have
    # a row for each row of Q, or one for all
    for row in range(Z.shape[0]):
        q = Q[row]
        c = C[row]
        z = Z[row]
        if not residuals[row] <= tolerances[row]:
            continue
        own = row if data.shape[0] > 1 else 0
        entries = data[own]
        weight = weights[own]
        scale = 0.0
        squares = 0.0
        for i in range(uint(z.size)):
            k = uint(indptr[i])
            stop = uint(indptr[i + uint(1)])
            p, rounding_p = row_sum(q[i], 0.0 if left is None else left[row, i], k, stop, 1.0, indices, entries, z)
            p_with_error = weighted(weight[i], p, rounding_p)
            r_with_error = gap(i, G_indptr, G_indices, G_data, c, known, z)
            s_with_error = -np.inf, 0.0
            if upper is not None:
                s_with_error = gap(i, upper[0], upper[1], upper[2], upper[3][row], upper[4], z)
            size = largest_median(p_with_error, r_with_error, s_with_error)
            if size > scale:
                squares = 1.0 + squares * (scale / size) ** 2
                scale = size
            elif size > 0.0:
                squares += (size / scale) ** 2
        rounding = 1.0 + 8.0 * (z.size + 8) * UNIT_ROUNDOFF
        bound = scale * math.sqrt(squares) * rounding if scale < np.inf else np.inf
        if bound > tolerances[row]:
            residuals[row] = bound
