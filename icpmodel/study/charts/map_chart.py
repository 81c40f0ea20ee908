"""The figure of a stability map: colour where it converges, a sign where it fails, lines around what is proved."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from ..planes import Axis
from ..stability_map import StabilityMap

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: how a run ended → the sign for it and its words; solved points have colours
_SIGNS = {
    "slow": (".", "not there after {max_iter} steps"),
    "precision limit": ("$+$", "as far as rounding allows"),
    "psi failed": ("$?$", "ψ failed"),
    "stagnated": ("_", "stagnated"),
    "cycled": ("$\\circ$", "cycled"),
    "diverged": ("x", "diverged"),
    "overflowed": ("$\\ast$", "overflowed"),
    "refused": ("$/$", "not applicable"),
}
#: theorem → colour and dashes: they often bound the same region
_LINES: dict[str, tuple[str, Any]] = {
    "4.1": ("#0072B2", (0, (6, 2))),
    "4.2": ("#D55E00", (0, (4, 2))),
    "4.3": ("#CC79A7", (0, (2, 2))),
    "4.4": ("#56B4E9", (0, (1, 1))),
    "sharper": ("black", "solid"),
    "definite": ("#E69F00", (0, (5, 1, 1, 1))),
}


def map_figure(found: StabilityMap) -> Figure:
    """Steps as colours, failures as signs on white, and a line around the points where each theorem proves convergence.

    A red line encloses what the paper, as printed, says to converge, where that is more than is proved.
    Returns a matplotlib figure.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.figure import Figure
    from matplotlib.lines import Line2D

    figure = Figure(figsize=(8.2, 5.4), layout="constrained")
    axes = figure.subplots()
    x, y = found.plane.x, found.plane.y
    steps = np.ma.masked_where(found.ends != "solved", np.maximum(found.steps, 1))
    mesh = axes.pcolormesh(_edges(x), _edges(y), steps, cmap="viridis_r", norm=LogNorm(*_range(found)))
    figure.colorbar(mesh, ax=axes, label=f"steps to Res(z) ≤ {found.rtol:g} Res(0)", pad=0.01)
    handles = []
    X, Y = np.meshgrid(x.values, y.values)
    for end, (sign, words) in _SIGNS.items():
        here = found.ends == end
        if here.any():
            axes.plot(X[here], Y[here], linestyle="", marker=sign, color="0.25", markersize=5)
            text = words.format(max_iter=found.max_iter)
            handles.append(Line2D([], [], linestyle="", marker=sign, color="0.25", markersize=7, label=text))
    for names, mask in _alike(found.proved):
        colour, dashes = _LINES[names[-1]]
        if _outline(axes, x, y, mask, colors=[colour], linestyles=[dashes], linewidths=2.0):
            label = f"proved: {', '.join(names)}"
            handles.append(Line2D([], [], color=colour, linestyle=dashes, linewidth=2.0, label=label))
    if (found.any_printed & ~found.any_proved).any():
        _outline(axes, x, y, found.any_printed, colors=["#C00000"], linewidths=3.0, zorder=1.5)
        handles.append(Line2D([], [], color="#C00000", linewidth=3.0, label="said to converge, as printed (false)"))
    for axis, set_scale in ((x, axes.set_xscale), (y, axes.set_yscale)):
        set_scale("log" if axis.log else "linear")
    axes.set_xlabel(x.label)
    axes.set_ylabel(y.label)
    axes.set_title(found.plane.title, fontsize=10)
    figure.legend(handles=handles, loc="outside lower center", ncols=3, frameon=False, fontsize=8)
    return figure


def _alike(masks: dict[str, Any]) -> list[tuple[list[str], Any]]:
    """Theorems that prove the same points, together."""
    groups: list[tuple[list[str], Any]] = []
    for name, mask in masks.items():
        for names, other in groups:
            if (mask == other).all():
                names.append(name)
                break
        else:
            groups.append(([name], mask))
    return groups


def _range(found: StabilityMap) -> tuple[int, int]:
    """The fewest and most steps of the solved points, at least a factor of ten apart."""
    steps = np.maximum(found.steps[found.ends == "solved"], 1)
    least = int(steps.min(initial=found.max_iter))
    return least, max(int(steps.max(initial=1)), 10 * least)


def _edges(axis: Axis) -> Any:
    """The borders of the cells around the values."""
    t = np.log(axis.values) if axis.log else axis.values
    middle = 0.5 * (t[1:] + t[:-1])
    edges = np.concatenate([[t[0] - (middle[0] - t[0])], middle, [t[-1] + (t[-1] - middle[-1])]])
    return np.exp(edges) if axis.log else edges


def _outline(axes: Any, x: Axis, y: Axis, mask: Any, **style: Any) -> bool:
    """A line along the borders of the cells where `mask` holds; whether there are any."""
    if not mask.any():
        return False
    from matplotlib.collections import LineCollection

    ex, ey = _edges(x), _edges(y)
    wide = np.pad(mask, 1)
    pieces = [
        [(ex[i], ey[j]), (ex[i], ey[j + 1])]
        for j, i in zip(*np.nonzero(wide[1:-1, 1:] != wide[1:-1, :-1]), strict=True)
    ]
    pieces += [
        [(ex[i], ey[j]), (ex[i + 1], ey[j])]
        for j, i in zip(*np.nonzero(wide[1:, 1:-1] != wide[:-1, 1:-1]), strict=True)
    ]
    axes.add_collection(LineCollection(pieces, **style))
    return True
