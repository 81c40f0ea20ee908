"""The picture of a solution: z over its obstacle and the force p, on a line, on a plane, or row by row."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...algebra.equations import nearer_to_obstacle
from ...errors import InputError
from ...numerics.arrays import Vector, described
from ...solve.solution import Solution
from .figures import BLUE, GREEN, ORANGE, Figure, new_figure

#: more points than this are thinned out before they are drawn: a figure has fewer pixels
_DRAWN = 200_000


def solution_figure(solution: Solution, points: Vector | None = None) -> Figure:
    """z, ψ(z) and p where the unknowns are: on a line as curves, on a plane as two fields, else against the row number.

    The contact set, the rows where z is at its obstacle rather than in balance, is shaded on a line and outlined in the
    plane. Parameters: `solution`; `points` the coordinates of the unknowns, shape (n,), (n, 2) or None, as
    `Scene.points` has them. Returns a matplotlib figure. Raises InputError for points of another shape.

    >>> square = icp.scenes.membrane(n=100)
    >>> [axes.get_title() for axes in icp.study.solution_figure(square.problem.solve(), square.points).axes[:2]]
    ['z, contact set outlined', 'p']
    """
    if not isinstance(solution, Solution):
        raise InputError(f"solution is {described(solution)}; a Solution was expected")
    n = solution.problem.n
    if points is not None and np.shape(points) not in ((n,), (n, 2)):
        raise InputError(f"points has shape {np.shape(points)}; ({n},) or ({n}, 2) was expected")
    contact = nearer_to_obstacle(solution.problem, solution.z)
    flat = points is None or np.ndim(points) == 1
    return _line(solution, points, contact) if flat else _plane(solution, points, contact)


def _line(solution: Solution, points: Vector | None, contact: Any) -> Figure:
    figure, n = new_figure(8.2, 5.0), solution.problem.n
    x = np.arange(n, dtype=np.float64) if points is None else points
    style = {"drawstyle": "steps-mid"} if points is None else {}
    if n <= 60:
        style["marker"] = "o"
    keep = np.unique(np.linspace(0, n - 1, min(n, _DRAWN)).astype(int))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    psi = solution.problem.psi.value(solution.z)
    psi = np.where(np.isfinite(psi), psi, np.nan)
    above.plot(x[keep], psi[keep], color=ORANGE, label="obstacle ψ(z)", linewidth=2.5, markersize=5, **style)
    above.plot(x[keep], solution.z[keep], color=BLUE, label="z", linewidth=1.5, markersize=3, **style)
    below.plot(x[keep], solution.p[keep], color=GREEN, markersize=3, **style)
    for k, axes in enumerate((above, below)):
        across = {"transform": axes.get_xaxis_transform(), "color": "0.85", "linewidth": 0, "zorder": 0}
        axes.fill_between(x, 0.0, 1.0, where=contact, step="mid", **across)
        axes.grid(alpha=0.3)
        axes.set_ylabel(("z", "force p")[k])
    if contact.any():
        above.fill_between([], [], color="0.85", label="contact set")
    above.legend(loc="best", frameon=False)
    below.set_xlabel("row" if points is None else "x")
    if points is None:
        below.locator_params(axis="x", integer=True)
    return figure


def _plane(solution: Solution, points: Any, contact: Any) -> Figure:
    figure = new_figure(9.6, 4.2)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    x, y = points[:, 0], points[:, 1]
    columns, rows = np.unique(x), np.unique(y)
    regular = columns.size * rows.size == x.size

    def field(values: Any) -> Any:
        found = np.empty((rows.size, columns.size))
        found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
        return found

    halves = (left, solution.z, "z, contact set outlined", "viridis"), (right, solution.p, "p", "cividis")
    for axes, values, title, colours in halves:
        if regular:
            shown = axes.pcolormesh(columns, rows, field(values), cmap=colours, shading="nearest", rasterized=True)
        else:
            shown = axes.scatter(x, y, c=values, cmap=colours, s=4, rasterized=True)
        figure.colorbar(shown, ax=axes, pad=0.01)
        axes.set(title=title, aspect="equal", xlabel="x")
    left.set_ylabel("y")
    if regular and contact.any() and not contact.all() and min(columns.size, rows.size) > 1:
        left.contour(columns, rows, field(contact), [0.5], colors="white", linewidths=1.5)
    return figure
