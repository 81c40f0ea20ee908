"""The figure of a stability map."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ...numerics.arrays import Vector
from ..planes import Axis
from ..stability_map import StabilityMap
from .figures import SKY, Drawing, Panel, drawing
from .places import edges, outline

#: end of a run → its marker and its label; solved points are coloured
END_SIGNS = {
    "slow": (".", "not there after {max_iter} steps"),
    "memory limit": ("$m$", "no memory for it"),
    "precision limit": ("$+$", "as far as rounding allows"),
    "map failed": ("$?$", "ψ or f failed"),
    "obstacles cross": ("1", "the obstacles cross"),
    "infeasible": ("2", "infeasible"),
    "stagnated": ("_", "stagnated"),
    "cycled": ("$\\circ$", "cycled"),
    "diverged": ("x", "diverged"),
    "overflowed": ("$\\ast$", "overflowed"),
    "refused": ("$/$", "not applicable"),
    "not run": ("$\\ldots$", "not run"),
}
_INK = "0.25"
_PLATE = "0.97"
_FALSE = "#C00000"
#: the theorems of the paper, corrected
_PAPER = ("4.1", "4.2", "4.3", "4.4")


@drawing.register
def _(result: StabilityMap) -> Drawing:
    ends = {end: int((result.ends == end).sum()) for end in np.unique(result.ends)}
    counts = ", ".join(f"{count} {end}" for end, count in sorted(ends.items(), key=lambda pair: -pair[1]))
    caption = (
        "Each cell is a pair of parameters; its colour is the number of steps, its sign how it failed. "
        "Within a line it is proved that the method converges, whatever the start."
    )
    alt = f"Map over {result.plane.x.label} and {result.plane.y.label}. Of {result.ends.size} points {counts}."
    panel = Panel(draw=partial(_map, result), caption=caption, alt=alt, height=5.2)
    return Drawing(panels=(panel,), size=(8.2, 5.6), columns=2, title=result.plane.title)


def _map(result: StabilityMap, axes: Any) -> list[Any]:
    """Draw steps as colours, other ends as markers, and lines around the points where convergence is proved.

    A red line encloses the points where the paper as printed claims convergence, if that is not proved at all of them.
    Returns the handles of the legend.
    """
    x = result.plane.x
    y = result.plane.y
    axes.set_facecolor(_PLATE)
    _steps(result, axes)
    handles = []
    X, Y = np.meshgrid(x.values, y.values)
    for end, (sign, words) in END_SIGNS.items():
        selected = result.ends == end
        if selected.any():
            signs = {"linestyle": "", "marker": sign, "label": words.format(max_iter=result.max_iter)}
            handles += axes.plot(X[selected], Y[selected], markersize=5, color=_INK, **signs)
    paper = np.any([result.proved[name] for name in _PAPER], axis=0)
    false = result.any_printed if (result.any_printed & ~result.any_proved).any() else np.zeros_like(paper)
    for words, mask, colour, dashes, width in (
        ("said to converge, as printed (false)", false, _FALSE, "-", 3.0),
        ("proved to converge", result.any_proved, "#1a1a1a", "-", 2.0),
        ("by the paper, corrected", paper, SKY, (0, (2, 1)), 2.0),
    ):
        if mask.any():
            style: dict[str, Any] = {"color": colour, "linestyle": dashes, "linewidth": width, "label": words}
            handles += axes.plot(*outline(_edges(x), _edges(y), mask), **style)
    axes.set(xscale="log" if x.log else "linear", yscale="log" if y.log else "linear", xlabel=x.label, ylabel=y.label)
    for words, place, marker, size in _marked_places(result):
        stars = {"marker": marker, "color": "white", "markeredgecolor": "#1a1a1a", "linestyle": ""}
        handles += axes.plot(*[[at] for at in place], label=words, markersize=size, zorder=4, **stars)
    return handles


def _steps(result: StabilityMap, axes: Any) -> None:
    """Draw the steps of the solved points as colours, whose scale spans at least a factor of ten."""
    from matplotlib.colors import LogNorm

    solved = result.ends == "solved"
    counts = np.ma.masked_where(~solved, np.maximum(result.steps, 1))
    least = int(counts.min()) if solved.any() else result.max_iter
    norm = LogNorm(least, max(int(counts.max()) if solved.any() else 1, 10 * least))
    mesh = axes.pcolormesh(_edges(result.plane.x), _edges(result.plane.y), counts, cmap="viridis_r", norm=norm)
    axes.figure.colorbar(mesh, ax=axes, label=f"steps to Res_D(z) ≤ {result.rtol:g} Res_D(0)", pad=0.01)


def _marked_places(result: StabilityMap) -> list[tuple[str, tuple[float, float], str, int]]:
    """(label, point, marker, size) of a method's default and of its fewest steps; empty if the problem varies."""
    if result.plane.default is None:
        return []
    places = [("default", result.plane.default, "o", 8)]
    if (result.ends == "solved").any():
        j, i = np.unravel_index(np.where(result.ends == "solved", result.steps, np.inf).argmin(), result.ends.shape)
        inside = 0 < j < result.ends.shape[0] - 1 and 0 < i < result.ends.shape[1] - 1
        words = f"fewest steps: {result.steps[j, i]}" + ("" if inside else ", at the rim of the map")
        places.append((words, (float(result.plane.x.values[i]), float(result.plane.y.values[j])), "*", 12))
    return places


def _edges(axis: Axis) -> Vector:
    """The borders of the cells around the values of `axis`."""
    return np.exp(edges(np.log(axis.values))) if axis.log else edges(axis.values)
