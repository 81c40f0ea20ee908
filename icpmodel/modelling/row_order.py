"""Put rows of conditions and equations in the order of z, so that row i of r is ρz_i − …, ρ > 0.

A row of r that has no such z_i is replaced by a new unknown s, with the equation s − r(z) = 0.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics.arrays import Vector, row_of, with_entries
from ..numerics.rounding import UNIT_ROUNDOFF
from .affine_rows import AffineRows
from .matching import arranged, left_over, own_entries, resemblance_to_r


class OrderedRows(NamedTuple):
    """All rows in the order of z, and their origin.

    Attributes
    ----------
    p, r : AffineRows
    lower, upper : AffineRows or None
        The bounds of r; None is 0 for the lower one, and no bound for the upper one.
    owned_columns : ndarray of int, shape (m,)
        The entry of z that each row of a condition owns.
    sign : ndarray, shape (m,)
        −1 where the row of a condition was multiplied by −1, else 1.
    replaced : AffineRows
        The rows of r that the last entries of z replace.
    sources : ndarray of int, shape (n,)
        Row → the number of its row of a condition, or m plus that of its equation.
    """

    p: AffineRows
    r: AffineRows
    lower: AffineRows | None
    upper: AffineRows | None
    owned_columns: NDArray[np.intp]
    sign: Vector
    replaced: AffineRows
    sources: NDArray[np.intp]


def in_order(
    p: AffineRows, r: AffineRows, equations: AffineRows, lower: AffineRows | None, upper: AffineRows | None
) -> OrderedRows:
    """Put the rows in the order of z; change signs and add unknowns where needed."""
    m = r.Z.shape[0]
    sign = _signs(r.Z)
    if (sign < 0).any():
        p = p.times(sign)
        r = r.times(sign)
        lower, upper = _swap_bounds(lower or r.constants(m, 0.0), upper or r.constants(m, np.inf), sign)
    owned_columns, unowned, (p, r, equations, *bounds), replaced = _match_rows(p, r, equations, lower, upper)
    parts: list[Any] = [p, r, *bounds]
    owners = owned_columns
    n = r.Z.shape[1]
    if n > m:
        owners = np.concatenate([owned_columns, np.setdiff1d(np.arange(n), owned_columns)])
        free = r.constants(n - m, np.inf)._replace(Z=sp.eye_array(n, format="csr")[owners[m:]])
        ends = equations, free, equations.constants(n - m, -np.inf), free.constants(n - m, np.inf)
        parts = [one and one.stacked_on(end) for one, end in zip(parts, ends, strict=True)]
    rows = np.argsort(owners)
    if not np.array_equal(owners, np.arange(n)):
        parts = [one and one.of(rows) for one in parts]
    sources = np.concatenate([np.arange(n - unowned.size), unowned])[rows]
    if n > m:
        places, factor = arranged(parts[0].Z, rows >= m)
        parts[0] = parts[0].of(places).times(factor)
        sources = sources[places]
    return OrderedRows._make([*parts, owned_columns, sign, replaced, sources])


def _match_rows(
    p: AffineRows, r: AffineRows, equations: AffineRows, *bounds: AffineRows | None
) -> tuple[NDArray[np.intp], NDArray[np.intp], tuple[Any, ...], AffineRows]:
    """The entry of z that each row of r owns; rows without one; all parts with new unknowns for these; these rows."""
    parts: tuple[Any, ...] = (p, r, equations, *bounds)
    owned_columns = own_entries(r.Z)
    if owned_columns is not None:
        rows = np.zeros(0, dtype=np.intp)
    else:
        positive = r.Z.data > 0
        rows = left_over(row_of(r.Z)[positive], r.Z.indices[positive], r.Z.shape)[0]
        parts = _with_unknowns(rows, *parts)
        owned_columns = own_entries(parts[1].Z)
        assert owned_columns is not None, "each row that had no entry of z has an unknown for itself now"
    return owned_columns, rows, parts, r.of(rows)


def _with_unknowns(
    rows: NDArray[np.intp], p: AffineRows, r: AffineRows, equations: AffineRows, *bounds: AffineRows | None
) -> tuple[Any, ...]:
    """The conditions and equations with a new unknown s in place of each of the `rows` of r, and s − r(z) = 0."""
    k = rows.size
    p, r, equations = p.wider(k), r.wider(k), equations.wider(k)
    unknowns = r.constants(k, 0.0)
    unknowns = unknowns._replace(Z=sp.eye_array(k, r.Z.shape[1], k=r.Z.shape[1] - k, format="csr"))
    equations = equations.stacked_on(unknowns.plus(r.of(rows).times(np.full(k, -1.0))))
    return p, r.replaced(rows, unknowns), equations, *(one and one.wider(k) for one in bounds)


def _signs(R: sp.csr_array) -> Vector:
    """−1 for the rows that own a negative entry if entries of either sign may be owned, else 1."""
    sign = np.ones(R.shape[0])
    i = row_of(R)
    there = R.data != 0.0
    matched = np.setdiff1d(np.arange(R.shape[0]), left_over(i[there], R.indices[there], R.shape)[0])
    R = R[matched]
    R.eliminate_zeros()
    # of two entries of the same size the positive one is owned
    sizes = np.where(R.data > 0.0, R.data, (np.sqrt(UNIT_ROUNDOFF) - 1.0) * R.data)
    owned = own_entries(with_entries(R, sizes))
    if owned is not None:
        i = row_of(R)
        turned = (R.indices == owned[i]) & (R.data < 0.0)
        sign[matched[i[turned]]] = -1.0
    return sign


def _swap_bounds(lower: AffineRows, upper: AffineRows, sign: Vector) -> tuple[AffineRows, AffineRows]:
    """The bounds of the rows times `sign`: lower and upper change places where it is −1."""
    turned = np.flatnonzero(sign < 0)
    low, high = (one.of(turned).times(sign[turned]) for one in (lower, upper))
    return lower.replaced(turned, high), upper.replaced(turned, low)


def p_before_r(Z: sp.csr_array, sizes: Sequence[int], may_swap: Sequence[bool]) -> NDArray[np.intp]:
    """The order of the rows of `Z` in which all p come before all r, where r is the side that is more like z − ψ(z).

    `Z` has all first and then all second sides of conditions with these `sizes`, which may swap where `may_swap`.
    """
    order = np.arange(Z.shape[0])
    m = sum(sizes)
    done = 0
    for size, free in zip(sizes, may_swap, strict=True):
        first, second = (slice(start, start + size) for start in (done, m + done))
        if free and resemblance_to_r(Z[first]) > resemblance_to_r(Z[second]):
            order[first], order[second] = order[second], order[first].copy()
        done += size
    return order
