"""Finite differences that several scenes share. No scene is registered here."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics.arrays import Vector
from ..problem.by_rows import LocalRows

#: for each axis of a grid, the indices of some unknowns along it
Index = tuple[NDArray[np.int64], ...]


def side(n: int, axes: int = 2) -> int:
    """The side m of the square grid, or the cubic one, whose number of points is nearest to `n`."""
    m = int(n ** (1.0 / axes))
    return min(max(m, 1), m + 1, key=lambda m: abs(m**axes - n))


def index(shape: tuple[int, ...], lo: int, hi: int) -> Index:
    """The grid indices of the unknowns lo ≤ k < hi, which are numbered with the last axis fastest."""
    return tuple(np.unravel_index(np.arange(lo, hi), shape))


def rows_of(n: int, lo: int, hi: int, entries: dict[int, Any]) -> sp.csr_array:
    """Rows lo ≤ i < hi of the n × n matrix that has entries[d] in column i + d.

    Each of the `entries` is a number or an array of shape (hi − lo,). It is dropped where there is
    no column i + d. Zeros are not stored.
    """
    offsets = sorted(entries)
    kind = sp.get_index_dtype(maxval=max(n, (hi - lo) * len(offsets)))
    columns = np.arange(lo, hi, dtype=kind)[:, None] + np.array(offsets, dtype=kind)
    values = np.stack([np.broadcast_to(entries[offset], hi - lo) for offset in offsets], axis=1)
    inside = (values != 0.0) & (columns >= 0) & (columns < n)
    indptr = np.zeros(hi - lo + 1, dtype=kind)
    np.cumsum(inside.sum(axis=1), out=indptr[1:])
    matrix = sp.csr_array((values[inside], columns[inside], indptr), shape=(hi - lo, n))
    matrix.has_canonical_format = True
    return matrix


def difference_rows(shape: tuple[int, ...], at: Index, lo: int, middle: float, skew: float = 0.0) -> sp.csr_array:
    """The rows of the second differences on a grid for the unknowns with the indices `at`, the first of them `lo`.

    They have `middle` on the diagonal and, along each axis, −(1+s) for the neighbour before and −(1−s) for the one
    after, s = `skew`.
    """
    stride = 1
    entries: dict[int, Any] = {0: middle}
    for where, m in zip(reversed(at), reversed(shape), strict=True):
        if m > 1:
            entries[-stride] = np.where(where > 0, -(1.0 + skew), 0.0)
            entries[stride] = np.where(where < m - 1, -(1.0 - skew), 0.0)
        stride *= m
    return rows_of(stride, lo, lo + at[0].size, entries)


def five_point(m: int, mu: float = 0.0, skew: float = 0.0) -> sp.csr_array:
    """h² times the 5-point operator on m × m interior points with zero boundary values, plus `mu` on the diagonal.

    It is Tridiag(−(1+s)I, S, −(1−s)I) + μI with S = tridiag(−(1+s), 4, −(1−s)) and s = `skew`, CSR. Unknown i·m + j
    is at (x, y) = ((j + 1)h, (i + 1)h). s = 0 is h²(−Δ); s ≠ 0 adds a flow of velocity (b, b), s = bh/2.
    """
    return difference_rows((m, m), index((m, m), 0, m * m), 0, 4.0 + mu, skew)


def points(low: float, high: float, shape: tuple[int, ...], at: Index) -> Vector:
    """Coordinates of the grid indices `at` on the interior points of [low, high]ᵈ, shape (k, d).

    x runs along the last axis. The indices −1 and m of an axis of length m are on the edge.
    """
    along = zip(reversed(at), reversed(shape), strict=True)
    return np.column_stack([(i + 1.0) * ((high - low) / (m + 1)) + low for i, m in along])


def rows_on_grid(
    shape: tuple[int, ...], low: float, high: float, psi: Any, edge: Any, stencil: tuple[float, ...], lo: int, hi: int
) -> LocalRows:
    """Rows lo ≤ k < hi of the obstacle problem −Δu ≥ 0, u ≥ `psi` in [low, high]ᵈ, times h².

    On the edge u = `edge`, or 0 if `edge` is None. Both functions take points of shape (k, d).
    `stencil` holds the diagonal and the skew of `difference_rows`.
    """
    at = index(shape, lo, hi)
    q = np.zeros(hi - lo)
    for axis, m in enumerate(shape):
        for last, outside in ((0, -1), (m - 1, m)) if edge else ():
            rows = np.flatnonzero(at[axis] == last)
            neighbours = [i[rows] for i in at]
            neighbours[axis] = np.full(rows.size, outside)
            q[rows] -= edge(points(low, high, shape, tuple(neighbours)))
    return LocalRows(difference_rows(shape, at, lo, *stencil), q, psi(points(low, high, shape, at)))


def adjacency(m: int) -> sp.csr_array:
    """The adjacency matrix of the m × m grid: 1 for each pair of neighbouring points."""
    return -five_point(m, -4.0)


def tridiagonal(n: int, left: Any = -1.0, middle: Any = 2.0, right: Any = -1.0) -> sp.csr_array:
    """The n × n tridiagonal matrix with these entries in each row: numbers, or arrays of shape (n,).

    The first of `left` and the last of `right` are dropped. Zeros are not stored.
    """
    return rows_of(n, 0, n, {-1: left, 0: middle, 1: right})


def value_equation(n: int, h: float, rate: float, drift: float, volatility: float) -> tuple[Vector, Vector, Vector]:
    """The entries left of, on and right of the diagonal of ρV − ½σ²V″ − μV′ by central differences, for `tridiagonal`.

    V(X) is the value of a process dX = μdt + σdW, discounted at the rate ρ.
    """
    diffusion = 0.5 * volatility**2 / h**2
    flow = 0.5 * drift / h
    return np.full(n, flow - diffusion), np.full(n, rate + 2.0 * diffusion), np.full(n, -flow - diffusion)


def square_points(m: int, low: float = 0.0, high: float = 1.0) -> Vector:
    """Coordinates of the m × m interior points of [low, high]², shape (m², 2), in the order of `five_point`."""
    return points(low, high, (m, m), index((m, m), 0, m * m))


def smooth_fit(x: Vector, z: Vector, first: int, slope: float) -> float:
    """The x at which z has this `slope`, by a parabola through the slopes of three cells from `first` on.

    NaN where there are not three, and where their slopes are not strictly monotone.
    """
    from scipy.interpolate import krogh_interpolate

    h = x[1] - x[0]
    cells = slice(first, first + 3)
    slopes = (np.diff(z) / h)[cells]
    bends = np.diff(slopes)
    if slopes.size != 3 or not ((bends > 0).all() or (bends < 0).all()):
        return float("nan")
    return float(krogh_interpolate(slopes, x[:-1][cells] + h / 2, slope))
