"""The figures of a solution, of a scene and of the path of a run."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ...algebra.equations import pattern_at
from ...errors import InputError
from ...numerics.arrays import Vector
from ...scenes import Scene
from ...scenes import scene as scene_called
from ...scenes.registry import points_of
from ...solve.solution import History, Solution
from .figures import BLUE, GREEN, ORANGE, PURPLE, Drawing, drawing

#: more points than this are thinned out before they are drawn: a figure has fewer pixels
_DRAWN = 200_000
#: dots on points of no grid cover half of a panel, which is about 3 inches square, in squared points
_PANEL = (3 * 72) ** 2
#: what is 0 on a logarithmic axis is drawn at, as a share of the smallest value above 0
_ZERO = 0.1
#: contact with the obstacle below and with the one above, where there are two; how they are shaded and outlined
_BELOW, _ABOVE = "contact below", "contact above"
_SHADES = {"contact set": "0.85", _BELOW: "0.85", _ABOVE: "#EBD3E1"}
_OUTLINES = {"contact set": "white", _BELOW: "white", _ABOVE: ORANGE}


@drawing.register
def _(solution: Solution, points: Any = None) -> Drawing:
    """z, ψ(z) and p where the unknowns are: on a line as curves, on a plane as two fields, else against the row number.

    The contact set, the rows where z is at its obstacle rather than in balance, is shaded on a line and outlined in the
    plane; where there is an obstacle above, ψ̄(z) is drawn as well, and contact with it in another colour.
    """
    n = solution.problem.n
    points = points_of(solution.problem) if points is None else np.asarray(points)
    if points is not None and points.shape not in ((n,), (n, 2)):
        raise InputError(f"points has shape {points.shape}; ({n},) or ({n}, 2) was expected")
    _, active, above = pattern_at(solution.problem, solution.z)
    contacts = {"contact set": active} if above is None else {_BELOW: active & ~above, _ABOVE: above}
    return (_line if points is None or points.ndim == 1 else _plane)(solution, points, contacts)


@drawing.register
def _(scene: Scene, points: Any = None) -> Drawing:
    return drawing(scene.solution(), points)


@drawing.register
def _(name: str, points: Any = None) -> Drawing:
    return drawing(scene_called(name), points)


@drawing.register
def _(history: History, points: Any = None) -> Drawing:
    """Res(z) of every tested iterate."""

    def residuals(axes: Any) -> list[Any]:
        above_0 = history.residual[history.residual > 0.0]
        shown = np.maximum(history.residual, _ZERO * above_0.min() if above_0.size else 1.0)
        style = {"marker": "o", "markersize": 3} if shown.size <= 60 else {}
        axes.plot(history.iteration, shown, color=BLUE, linewidth=1.2, **style)
        lowest = ", 0 at the lower end" if above_0.size < shown.size else ""
        axes.set(yscale="log", xlabel="iteration", ylabel=f"residual Res(z){lowest}")
        axes.locator_params(axis="x", integer=True)
        axes.grid(alpha=0.3)
        return []

    return Drawing(panels=(residuals,), size=(6.4, 4.0))


def _line(solution: Solution, points: Vector | None, contacts: dict[str, Any]) -> Drawing:
    problem, n = solution.problem, solution.problem.n
    x = np.arange(n, dtype=np.float64) if points is None else points
    style: dict[str, Any] = {"drawstyle": "steps-mid"} if points is None else {}
    if n <= 60:
        style["marker"] = "o"
    keep = np.unique(np.linspace(0, n - 1, min(n, _DRAWN)).astype(int))
    middles = (x[:-1] + x[1:]) / 2
    ends = np.concatenate([x[:1], middles, x[-1:]]) if n > 1 else x[0] + np.array([-0.5, 0.5])

    def dressed(axes: Any, label: str) -> None:
        across = {"transform": axes.get_xaxis_transform(), "fill": True, "linewidth": 0, "zorder": 0}
        for name, rows in contacts.items():  # a single row is shaded, too
            shade = axes.stairs(rows.astype(float), ends, color=_SHADES[name], **across)
            shade.sticky_edges.y.clear()  # or the axis would begin at 0
        axes.grid(alpha=0.3)
        axes.set(ylabel=label, xlabel="row" if points is None else "x")
        if points is None:
            axes.locator_params(axis="x", integer=True)

    def heights(axes: Any) -> list[Any]:
        for psi, colour, label in ((problem.psi, ORANGE, "obstacle ψ(z)"), (problem.upper, PURPLE, "obstacle above")):
            if psi is not None:
                value = psi.value(solution.z)
                value = np.where(np.isfinite(value), value, np.nan)
                axes.plot(x[keep], value[keep], color=colour, label=label, linewidth=2.5, markersize=5, **style)
        axes.plot(x[keep], solution.z[keep], color=BLUE, label="z", linewidth=1.5, markersize=3, **style)
        dressed(axes, "z")
        for name, rows in contacts.items():
            if rows.any():
                axes.fill_between([], [], facecolor=_SHADES[name], edgecolor="0.5", linewidth=0.5, label=name)
        axes.legend(loc="best", frameon=False)
        return []

    def forces(axes: Any) -> list[Any]:
        axes.plot(x[keep], solution.p[keep], color=GREEN, markersize=3, **style)
        dressed(axes, "force p")
        return []

    layout = {"nrows": 2, "ncols": 1, "sharex": True, "height_ratios": (2, 1)}
    return Drawing(panels=(heights, forces), size=(8.2, 5.0), layout=layout)


def _plane(solution: Solution, points: Any, contacts: dict[str, Any]) -> Drawing:
    x, y = points[:, 0], points[:, 1]
    columns, rows = np.unique(x), np.unique(y)
    regular = columns.size * rows.size == x.size

    def field(values: Any) -> Any:
        found = np.empty((rows.size, columns.size))
        found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
        return found

    def half(values: Vector, title: str, colours: str, outlined: dict[str, Any], axes: Any) -> list[Any]:
        if regular:
            shown = axes.pcolormesh(columns, rows, field(values), cmap=colours, shading="nearest", rasterized=True)
        else:
            size = max(_PANEL / (2 * x.size), 1.0)
            shown = axes.scatter(x, y, c=values, cmap=colours, s=size, rasterized=True)
        axes.figure.colorbar(shown, ax=axes, pad=0.01)
        axes.set(title=title, aspect="equal", xlabel="x", ylabel="y")
        for name, contact in outlined.items():
            if regular and contact.any() and not contact.all() and min(columns.size, rows.size) > 1:
                axes.contour(columns, rows, field(contact), [0.5], colors=_OUTLINES[name], linewidths=1.5)
        return []

    title = f"z, {_outlined(contacts)}" if regular else "z"
    heights = partial(half, solution.z, title, "viridis", contacts)
    layout = {"nrows": 1, "ncols": 2, "sharex": True, "sharey": True}
    return Drawing(panels=(heights, partial(half, solution.p, "p", "cividis", {})), size=(9.6, 4.2), layout=layout)


def _outlined(contacts: dict[str, Any]) -> str:
    """What has which outline."""
    if len(contacts) == 1:
        return "contact set outlined"
    colours = {_BELOW: "below (white)", _ABOVE: "above (orange)"}
    return "contact " + " and ".join(colours[name] for name, rows in contacts.items() if rows.any())
