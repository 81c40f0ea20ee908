"""Jacobians by forward differences: column by column, or for a sparsity pattern colour by colour."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics import work
from ..numerics.arrays import Vector, with_entries
from ..numerics.rounding import SQRT_EPSILON, UNIT_ROUNDOFF
from .user_code import USER_ULPS

#: the relative step that balances rounding and curvature where both are of order 1 (Gill, Murray and Wright 1981, 8.6)
DIFFERENCE_STEP = SQRT_EPSILON
#: a change that differs from the prediction of a derivative by this share of all terms is not due to rounding
_MISFIT = 1e-3


def steps(z: Vector, least_size: float = 1.0) -> Vector:
    """The steps h_j, shape (n,), with z_j + h_j exact: a fixed share of the larger of |z_j| and `least_size`.

    Examples
    --------
    >>> bool(np.allclose(steps(np.array([0.0, 4.0])), 2.0**-26 * np.array([1, 4])))
    True
    """
    exact: Vector = (z + DIFFERENCE_STEP * np.maximum(np.abs(z), least_size)) - z
    return exact


def colours(pattern: sp.csr_array) -> NDArray[np.intp]:
    """A colour for each column of `pattern` so that no row has two entries of one colour.

    References
    ----------
    Curtis, Powell and Reid, J. Inst. Math. Appl. 13 (1974).

    Examples
    --------
    >>> colours(sp.csr_array([[1.0, 1, 0], [0, 1, 1]]))
    array([0, 1, 0])
    """
    if (np.diff(pattern.indptr) == pattern.shape[1]).any():  # no two columns can share a colour
        return np.arange(pattern.shape[1])
    touched = sp.csr_array(abs(pattern).T @ abs(pattern))
    colour = np.full(pattern.shape[1], -1, dtype=np.intp)
    for j in range(colour.size):
        used = set(colour[touched.indices[touched.indptr[j] : touched.indptr[j + 1]]].tolist())
        colour[j] = next(k for k in range(len(used) + 1) if k not in used)
    return colour


def jacobian_by_differences(
    value: Callable[[Vector], Vector], z: Vector, pattern: sp.csr_array, colour: NDArray[np.intp]
) -> sp.csr_array:
    """∂value/∂z at `z` on the entries of `pattern`, with one difference for each `colour` of its columns.

    Where a forward difference is not finite a backward one replaces it. Raises OutOfTime.

    Examples
    --------
    >>> full = sp.csr_array(np.ones((2, 2)))
    >>> J = jacobian_by_differences(
    ...     lambda z: np.array([z[0] * z[1], z[1]]),
    ...     np.array([2.0, 3.0]),
    ...     full,
    ...     np.arange(2),
    ... )
    >>> J.toarray().round(6)
    array([[3., 2.],
           [0., 1.]])
    """
    here, h, entries = value(z), steps(z), np.empty(pattern.nnz)
    of_entry = colour[pattern.indices]
    rows = np.repeat(np.arange(z.size), np.diff(pattern.indptr))
    with np.errstate(all="ignore"):
        for k in range(int(colour.max(initial=-1)) + 1):
            work.check_budget()
            chosen = of_entry == k
            moved = np.where(colour == k, h, 0.0)
            change = value(z + moved) - here
            if not np.isfinite(change[rows[chosen]]).all():
                change = np.where(np.isfinite(change), change, here - value(z - moved))
            entries[chosen] = change[rows[chosen]] / moved[pattern.indices[chosen]]
    return with_entries(pattern, entries)


def misfit_of_derivative(value: Callable[[Vector], Vector], J: sp.csr_array, z: Vector) -> int | None:
    """A row where the prediction of `J` is not between the changes of `value` to both sides of `z`; None without one.

    Examples
    --------
    >>> J = sp.csr_array([[2.0, 0.0], [0.0, 3.0]])
    >>> misfit_of_derivative(lambda z: np.array([2.0, 4.0]) * z, J, np.ones(2))
    1
    """
    with np.errstate(all="ignore"):
        # random, so that means of z and differences of neighbours change along it
        rng = np.random.default_rng(0)
        direction = rng.choice([-1.0, 1.0], z.size) * rng.uniform(1.0, 2.0, z.size)
        here = value(z)
        rounding = USER_ULPS * UNIT_ROUNDOFF * np.abs(here)
        outside = np.ones(here.size, dtype=bool)
        # in units in which all of z is small, a step of the size of 1 says nothing
        for size in (1.0, np.abs(z).max(initial=0.0) or 1.0):
            h = steps(z, size) * direction
            changes = np.stack([value(z + h) - here, here - value(z - h)])
            allowed = _MISFIT * (abs(J) @ np.abs(h) + np.abs(changes).max(axis=0)) + rounding
            expected = J @ h
            excess = np.maximum(changes.min(axis=0) - expected, expected - changes.max(axis=0))
            outside &= np.isfinite(excess) & (excess > allowed)
    return int(np.argmax(outside)) if outside.any() else None
