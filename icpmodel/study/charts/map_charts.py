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

#: how a run ended → the sign for it and its words; solved points have colours
SIGNS = {
    "slow": (".", "not there after {max_iter} steps"),
    "precision limit": ("$+$", "as far as rounding allows"),
    "map failed": ("$?$", "ψ or f failed"),
    "obstacles cross": ("1", "the obstacles cross"),
    "infeasible": ("2", "infeasible"),
    "stagnated": ("_", "stagnated"),
    "cycled": ("$\\circ$", "cycled"),
    "diverged": ("x", "diverged"),
    "overflowed": ("$\\ast$", "overflowed"),
    "refused": ("$/$", "not applicable"),
}
_INK = "0.25"
_PLATE = "0.97"
_FALSE = "#C00000"
#: the theorems of the paper, corrected
_PAPER = ("4.1", "4.2", "4.3", "4.4")


@drawing.register
def _(found: StabilityMap) -> Drawing:
    ends = {end: int((found.ends == end).sum()) for end in np.unique(found.ends)}
    counted = ", ".join(f"{many} {end}" for end, many in sorted(ends.items(), key=lambda pair: -pair[1]))
    caption = (
        "Each cell is a pair of parameters; its colour is the number of steps, its sign how it failed. "
        "Within a line it is proved that the method converges, whatever the start."
    )
    alt = f"Map over {found.plane.x.label} and {found.plane.y.label}. Of {found.ends.size} points {counted}."
    panel = Panel(draw=partial(_map, found), caption=caption, alt=alt, height=5.2)
    return Drawing(panels=(panel,), size=(8.2, 5.6), columns=2, title=found.plane.title)


def _map(found: StabilityMap, axes: Any) -> list[Any]:
    """Steps as colours, failures as signs on a plate, and lines around the points where convergence is proved.

    A red line encloses what the paper, as printed, says to converge, where that is more than is proved.
    """
    x = found.plane.x
    y = found.plane.y
    axes.set_facecolor(_PLATE)
    _steps(found, axes)
    handles = []
    X, Y = np.meshgrid(x.values, y.values)
    for end, (sign, words) in SIGNS.items():
        here = found.ends == end
        if here.any():
            signs = {"linestyle": "", "marker": sign, "label": words.format(max_iter=found.max_iter)}
            handles += axes.plot(X[here], Y[here], markersize=5, color=_INK, **signs)
    paper = np.any([found.proved[name] for name in _PAPER], axis=0)
    false = found.any_printed if (found.any_printed & ~found.any_proved).any() else np.zeros_like(paper)
    for words, mask, colour, dashes, width in (
        ("said to converge, as printed (false)", false, _FALSE, "-", 3.0),
        ("proved to converge", found.any_proved, "#1a1a1a", "-", 2.0),
        ("by the paper, corrected", paper, SKY, (0, (2, 1)), 2.0),
    ):
        if mask.any():
            style: dict[str, Any] = {"color": colour, "linestyle": dashes, "linewidth": width, "label": words}
            handles += axes.plot(*outline(_edges(x), _edges(y), mask), **style)
    axes.set(xscale="log" if x.log else "linear", yscale="log" if y.log else "linear", xlabel=x.label, ylabel=y.label)
    for words, place, marker, size in _marked_places(found):
        stars = {"marker": marker, "color": "white", "markeredgecolor": "#1a1a1a", "linestyle": ""}
        handles += axes.plot(*[[at] for at in place], label=words, markersize=size, zorder=4, **stars)
    return handles


def _steps(found: StabilityMap, axes: Any) -> None:
    """The steps of the solved points as colours, whose scale spans a factor of ten at least."""
    from matplotlib.colors import LogNorm

    solved = found.ends == "solved"
    counts = np.ma.masked_where(~solved, np.maximum(found.steps, 1))
    least = int(counts.min()) if solved.any() else found.max_iter
    norm = LogNorm(least, max(int(counts.max()) if solved.any() else 1, 10 * least))
    mesh = axes.pcolormesh(_edges(found.plane.x), _edges(found.plane.y), counts, cmap="viridis_r", norm=norm)
    axes.figure.colorbar(mesh, ax=axes, label=f"steps to Res_D(z) ≤ {found.rtol:g} Res_D(0)", pad=0.01)


def _marked_places(found: StabilityMap) -> list[tuple[str, tuple[float, float], str, int]]:
    """(words, point, marker, size), of a plane of a method: its default, and where it needs the fewest steps."""
    if found.plane.default is None:
        return []
    places = [("default", found.plane.default, "o", 8)]
    if (found.ends == "solved").any():
        j, i = np.unravel_index(np.where(found.ends == "solved", found.steps, np.inf).argmin(), found.ends.shape)
        inside = 0 < j < found.ends.shape[0] - 1 and 0 < i < found.ends.shape[1] - 1
        words = f"fewest steps: {found.steps[j, i]}" + ("" if inside else ", at the rim of the map")
        places.append((words, (float(found.plane.x.values[i]), float(found.plane.y.values[j])), "*", 12))
    return places


def _edges(axis: Axis) -> Vector:
    """The borders of the cells around the values."""
    return np.exp(edges(np.log(axis.values))) if axis.log else edges(axis.values)
