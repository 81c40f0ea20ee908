"""Where the unknowns of a problem are drawn: by row number, on a line, or in planes."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from math import prod
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...errors import InputError
from ...numerics.arrays import Mask, Vector, as_float64, as_list, as_number, described
from ...problem.data import ProblemData
from ...scenes.registry import placement_of

#: a curve with more points, or a field with more cells, is thinned out: a figure has fewer pixels
PIXELS = 200_000
#: the largest number of points or rows drawn one by one
MAX_MARKED_POINTS = 60
#: the names of the axes of a grid that is known by its shape
_GRID_AXES = ("column", "row", "layer")

Rows = NDArray[np.intp]


@dataclass(frozen=True, eq=False)
class Slice:
    """The unknowns in one plane.

    Parameters
    ----------
    rows : array of int
        The unknowns. On a grid they are ordered by y, then by x.
    x, y : array
        Their coordinates.
    labels : tuple of str
        The names of the two axes.
    at : str
        The position of the plane in three dimensions, such as "z = 0.5"; empty in two.
    """

    rows: Rows
    x: Vector
    y: Vector
    labels: tuple[str, str]
    at: str = ""

    @cached_property
    def axes(self) -> tuple[Vector, Vector]:
        """The distinct values of x and of y, ascending."""
        return np.unique(self.x), np.unique(self.y)

    @property
    def is_grid(self) -> bool:
        """Whether there is one unknown for each pair of an x and a y."""
        return prod(axis.size for axis in self.axes) == self.rows.size

    @property
    def cells(self) -> tuple[int, int]:
        """The shape (ny, nx) of a field on the grid."""
        return self.axes[1].size, self.axes[0].size

    def marked(self, mask: Mask) -> tuple[Vector, Vector]:
        """The outline of the cells whose unknowns are in `mask`, or these points themselves where there is no grid."""
        inside = mask[self.rows]
        if not self.is_grid:
            return self.x[inside], self.y[inside]
        columns, rows = self.axes
        return outline(edges(columns), edges(rows), inside.reshape(self.cells))


@dataclass(frozen=True, eq=False)
class Places:
    """The places at which unknowns are drawn: on a line, or in planes.

    Parameters
    ----------
    rows : array of int
        The unknowns drawn on a line, in the order of `x`; empty for planes.
    x : array
        Their coordinates, or row numbers.
    label : str
        The name of the axis of x.
    unknown : str
        The name of z.
    planes : sequence of Slice
        Instead of a line: the plane, or the three slices through the middle in three dimensions.
    by_row : bool
        Whether x are row numbers.
    """

    rows: Rows
    x: Vector
    label: str
    unknown: str
    planes: Sequence[Slice] = ()
    by_row: bool = False


def places_of(problem: ProblemData, points: Any = None, shape: Any = None) -> Places:
    """Choose the places of the unknowns of `problem`, about `PIXELS` of them at most.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    points : array_like of shape (n,), (n, 2) or (n, 3), optional
        Coordinates, by default those of the scene that A is from, else, for n > 60, those of a grid
        whose neighbours A couples.
    shape : tuple of int, optional
        Shape (ny, nx) or (nz, ny, nx) of the grid, in place of `points`.

    Returns
    -------
    Places
        The places, on a line by row number where no coordinates are known.

    Raises
    ------
    InputError
        Where points or shape do not fit the problem.
    """
    known = placement_of(problem)
    unknown = known.unknown if known else "z"
    labels: tuple[str, ...] = ("x", "y", "z")
    if points is not None and shape is not None:
        raise InputError("points and shape are both given; the unknowns are placed by one of them")
    if points is None and shape is None:
        if known is not None:
            points, labels = known.points, known.coordinates
        elif problem.n > MAX_MARKED_POINTS:  # a curve over the rows of a grid is a zigzag
            shape = _grid_shape(problem)
    if shape is not None:
        points, labels = _grid_points(problem.n, shape), _GRID_AXES
    step = -(-problem.n // PIXELS)
    if points is None:
        rows = np.arange(0, problem.n, step)
        return Places(rows, rows.astype(np.float64), "row", unknown, by_row=True)
    points = as_float64(points, "points")
    if points.shape[:1] != (problem.n,) or points.ndim > 2 or not 1 <= points.size // problem.n <= 3:
        raise InputError(f"points has shape {points.shape}; ({problem.n},), (n, 2) or (n, 3) was expected")
    points = points.reshape(problem.n, -1)
    if points.shape[1] == 1:
        rows = np.argsort(points[:, 0], kind="stable")[::step]
        return Places(rows, points[rows, 0], labels[0], unknown)
    return Places(np.arange(0), np.zeros(0), "", unknown, _planes(points, labels))


def _grid_points(n: int, shape: Any) -> Vector:
    sizes = [int(as_number(size, "shape", minimum=1, whole=True)) for size in as_list(shape, "shape")]
    if len(sizes) not in (2, 3) or prod(sizes) != n:
        raise InputError(f"shape is {described(shape)}; (ny, nx) or (nz, ny, nx) with the product {n} was expected")
    return np.indices(sizes).reshape(len(sizes), n)[::-1].T.astype(np.float64)


def _planes(points: Vector, labels: Sequence[str]) -> list[Slice]:
    """The plane of points in two dimensions; in three, the slice through the middle of each axis."""
    if points.shape[1] == 2:
        return [_plane(points, np.arange(len(points)), labels)]
    planes = []
    for axis in (2, 1, 0):
        values = np.unique(points[:, axis])
        middle = values[values.size // 2]
        rows = np.flatnonzero(points[:, axis] == middle)
        others = np.delete(labels, axis).tolist()
        planes.append(_plane(np.delete(points, axis, 1), rows, others, f"{labels[axis]} = {middle:.3g}"))
    return planes


def _plane(points: Vector, rows: Rows, labels: Sequence[str], at: str = "") -> Slice:
    """The slice of `rows` by y, then x: every k-th place along both axes, so that about `PIXELS` are left."""
    step = int(np.ceil(np.sqrt(rows.size / PIXELS)))
    places = np.array([np.unique(one, return_inverse=True)[1] for one in points[rows].T])
    rows = rows[(places % step == 0).all(axis=0)]
    rows = rows[np.lexsort(points[rows].T)]
    x, y = points[rows].T
    return Slice(rows, x, y, (labels[0], labels[1]), at)


def _grid_shape(problem: ProblemData) -> tuple[int, ...] | None:
    """The shape of the grid on which A couples each unknown with its neighbours only; None if there is none.

    Neighbours are 1 apart in a row, m in a column, and the size of a layer from one layer to the next.
    """
    if problem.A.nnz > 7 * problem.n:  # itself and six neighbours
        return None
    rows, columns = problem.A.nonzero()
    steps = np.unique(columns - rows)
    steps = steps[steps > 0]
    shape = tuple(int(size) for size in (np.append(steps[1:], problem.n) // steps)[::-1])
    if len(shape) not in (2, 3) or prod(shape) != problem.n:
        return None
    grid = np.arange(problem.n).reshape(shape)
    for axis, step in enumerate(steps[::-1]):
        coupled_rows = np.flatnonzero(problem.A.diagonal(step))
        if not np.array_equal(coupled_rows, np.delete(grid, -1, axis).ravel()):
            return None
    return shape


def edges(values: Vector) -> Vector:
    """The borders of the cells around the increasing `values`."""
    if values.size == 1:
        return np.array([values[0] - 0.5, values[0] + 0.5])
    middle = 0.5 * (values[1:] + values[:-1])
    return np.concatenate([[2.0 * values[0] - middle[0]], middle, [2.0 * values[-1] - middle[-1]]])


def outline(x: Vector, y: Vector, mask: NDArray[np.bool_]) -> tuple[Vector, Vector]:
    """The borders, between the edges `x` and `y`, of the cells in `mask`, as one line with gaps at NaN."""
    padded = np.pad(mask, 1)
    vertical = np.argwhere(padded[1:-1, 1:] != padded[1:-1, :-1])
    horizontal = np.argwhere(padded[1:, 1:-1] != padded[:-1, 1:-1])
    gap = np.nan
    pieces = [((x[i], x[i], gap), (y[j], y[j + 1], gap)) for j, i in vertical]
    pieces += [((x[i], x[i + 1], gap), (y[j], y[j], gap)) for j, i in horizontal]
    x_line, y_line = np.array(pieces, dtype=np.float64).reshape(-1, 2, 3).transpose(1, 0, 2).reshape(2, -1)
    return x_line, y_line
