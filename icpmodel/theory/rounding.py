"""Matrix–vector products with a proved direction of rounding."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ..arrays import Vector
from ..problem import SMALLEST, UNIT_ROUNDOFF


def lower(matrix: sp.csr_array, v: Vector) -> Vector:
    """A lower bound of `matrix` @ `v`, entry by entry, shape (n,), whatever the order of summation.

    The computed product minus γ_k|matrix||v| and k times the smallest float, k two more than the entries of the row;
    NaN or −inf where it overflows.
    Reference: Higham, Accuracy and Stability of Numerical Algorithms (2002), section 3.5.

    >>> bool(lower(sp.csr_array([[0.1, 0.2]]), np.ones(2))[0] < 0.3)
    True
    """
    k = np.diff(matrix.indptr) + 2
    with np.errstate(over="ignore", invalid="ignore"):
        result: Vector = matrix @ v - 2 * k * UNIT_ROUNDOFF * (abs(matrix) @ np.abs(v)) - k * SMALLEST
    return result


def upper(matrix: sp.csr_array, v: Vector) -> Vector:
    """An upper bound of `matrix` @ `v`, entry by entry, shape (n,): the mirror image of `lower`.

    >>> bool(upper(sp.csr_array([[0.1, 0.2]]), np.ones(2))[0] > 0.3)
    True
    """
    k = np.diff(matrix.indptr) + 2
    with np.errstate(over="ignore", invalid="ignore"):
        result: Vector = matrix @ v + 2 * k * UNIT_ROUNDOFF * (abs(matrix) @ np.abs(v)) + k * SMALLEST
    return result
