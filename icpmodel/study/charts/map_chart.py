"""The figure of a stability map: colour where it converges, a sign where it fails, lines around what is proved."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..planes import Axis, Plane
from .figures import BLUE, ORANGE, PURPLE, SKY, YELLOW, Figure, legend_below, new_figure

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
    "4.1": (BLUE, (0, (6, 2))),
    "4.2": (ORANGE, (0, (4, 2))),
    "4.3": (PURPLE, (0, (2, 2))),
    "4.4": (SKY, (0, (1, 1))),
    "sharper": ("black", "solid"),
    "definite": (YELLOW, (0, (5, 1, 1, 1))),
}
_FALSE = "#C00000"


def map_figure(
    plane: Plane, ends: Any, steps: Any, proved: dict[str, Any], printed: Any, max_iter: int, rtol: float
) -> Figure:
    """Steps as colours, failures as signs on white, and a line around the points where each theorem proves convergence.

    A red line encloses what the paper, as printed, says to converge, where that is more than is proved; `printed` is
    the mask of all its theorems together.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.lines import Line2D

    figure = new_figure(8.2, 5.4)
    axes = figure.subplots()
    x, y = plane.x, plane.y
    solved = ends == "solved"
    counts = np.ma.masked_where(~solved, np.maximum(steps, 1))
    least = int(counts.min()) if solved.any() else max_iter
    norm = LogNorm(least, max(int(counts.max()) if solved.any() else 1, 10 * least))  # at least a factor of ten apart
    mesh = axes.pcolormesh(_edges(x), _edges(y), counts, cmap="viridis_r", norm=norm)
    figure.colorbar(mesh, ax=axes, label=f"steps to Res(z) ≤ {rtol:g} Res(0)", pad=0.01)
    handles = []
    X, Y = np.meshgrid(x.values, y.values)
    for end, (sign, words) in _SIGNS.items():
        here = ends == end
        if here.any():
            style: dict[str, Any] = {"linestyle": "", "marker": sign, "color": "0.25"}
            axes.plot(X[here], Y[here], markersize=5, **style)
            handles.append(Line2D([], [], markersize=7, label=words.format(max_iter=max_iter), **style))
    alike: dict[bytes, list[str]] = {}  # theorems that prove the same points have one line
    for name, mask in proved.items():
        alike.setdefault(mask.tobytes(), []).append(name)
    for names in alike.values():
        mask, (colour, dashes) = proved[names[0]], _LINES[names[-1]]
        if mask.any():
            _outline(axes, x, y, mask, colors=[colour], linestyles=[dashes], linewidths=2.0)
            label = f"proved: {', '.join(names)}"
            handles.append(Line2D([], [], color=colour, linestyle=dashes, linewidth=2.0, label=label))
    if (printed & ~np.any([*proved.values()], axis=0)).any():
        _outline(axes, x, y, printed, colors=[_FALSE], linewidths=3.0, zorder=1.5)
        handles.append(Line2D([], [], color=_FALSE, linewidth=3.0, label="said to converge, as printed (false)"))
    axes.set(xscale="log" if x.log else "linear", yscale="log" if y.log else "linear", xlabel=x.label, ylabel=y.label)
    axes.set_title(plane.title, fontsize=10)
    legend_below(figure, 3, handles=handles)
    return figure


def _edges(axis: Axis) -> Any:
    """The borders of the cells around the values."""
    t = np.log(axis.values) if axis.log else axis.values
    middle = 0.5 * (t[1:] + t[:-1])
    edges = np.concatenate([[2.0 * t[0] - middle[0]], middle, [2.0 * t[-1] - middle[-1]]])
    return np.exp(edges) if axis.log else edges


def _outline(axes: Any, x: Axis, y: Axis, mask: Any, **style: Any) -> None:
    """A line along the borders of the cells where `mask` holds."""
    from matplotlib.collections import LineCollection

    ex, ey = _edges(x), _edges(y)
    wide = np.pad(mask, 1)
    pieces = [[(ex[i], ey[j]), (ex[i], ey[j + 1])] for j, i in np.argwhere(wide[1:-1, 1:] != wide[1:-1, :-1])] + [
        [(ex[i], ey[j]), (ex[i + 1], ey[j])] for j, i in np.argwhere(wide[1:, 1:-1] != wide[:-1, 1:-1])
    ]
    axes.add_collection(LineCollection(pieces, **style))
