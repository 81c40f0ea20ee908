"""The figures of a race and of a stability map."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...solve.goal import RTOL
from ..competitors import Entry
from ..planes import Axis
from ..race import Race
from ..stability_map import StabilityMap
from .figures import BLUE, ORANGE, PURPLE, SKY, YELLOW, Drawing, drawing, looks

#: what an answer that is exact to the last digit is drawn at, as a share of the smallest error above 0
_EXACT = 0.1
#: how a run ended → the sign for it and its words; solved points have colours
_SIGNS = {
    "slow": (".", "not there after {max_iter} steps"),
    "precision limit": ("$+$", "as far as rounding allows"),
    "psi failed": ("$?$", "ψ failed"),
    "obstacles cross": ("1", "the obstacles cross"),
    "infeasible": ("2", "infeasible"),
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
    "rowwise": ("black", "solid"),
    "h-plus": (BLUE, (0, (6, 2))),
    "definite": (YELLOW, (0, (5, 1, 1, 1))),
}
_FALSE = "#C00000"


@drawing.register
def _(found: Race, points: Any = None) -> Drawing:
    """Left: time against error, more accurate to the right; right: build, set-up and the rest, to Res ≤ 1e-8·Res(0)."""
    shown = looks(list(dict.fromkeys(run.name for run in found.entries)))
    colours = {name: colour for name, (colour, _) in shown.items()}

    def bars(axes: Any) -> list[Any]:
        _bars(axes, found.entries, colours)
        return []

    layout = {"nrows": 1, "ncols": 2, "width_ratios": (2.2, 1)}
    panels = (lambda axes: _times(axes, found, shown), bars)
    return Drawing(panels=panels, size=(11, 6.0), layout=layout, columns=5, title=found.title)


def _times(axes: Any, found: Race, shown: dict[str, tuple[str, str]]) -> list[Any]:
    """A marker is a run to one tolerance, the bar on it the spread of the rounds, the thin line the path of one run; a
    hollow marker says "solved" and is not. The dashed line is one linear solve with A."""
    entries, traces = found.entries, found.traces
    errors = [run.error for run in entries if run.error]
    errors += [float(e) for _, path in traces.values() for e in path if e > 0]
    floor = _EXACT * min(errors, default=1.0)
    for name, (colour, marker) in shown.items():
        _points(axes, [run for run in entries if run.name == name and run.error is not None], colour, marker, floor)
        if name in traces:
            seconds, path = traces[name]
            axes.plot(np.maximum(path, floor), seconds, color=colour, linewidth=0.7, alpha=0.6, zorder=1)
    if found.limit is not None:
        axes.axhline(found.limit, color="0.4", linestyle="--", linewidth=1.2, label="one linear solve (PyAMG)")
    axes.set(xscale="log", yscale="log", xlabel=found.measure, ylabel="time, s")
    axes.xaxis.set_inverted(True)
    axes.grid(alpha=0.3)
    if any(run.wrong for run in entries):
        axes.plot([], [], "o", color="0.3", markerfacecolor="white", label='says "solved", is not')
    return list(axes.get_legend_handles_labels()[0])


def _points(axes: Any, mine: list[Entry], colour: str, marker: str, floor: float) -> None:
    """The runs of one competitor; only the first of them is in the legend."""
    places = [(max(run.error or 0.0, floor), run.median) for run in mine]
    for k, (run, (error, median)) in enumerate(zip(mine, places, strict=True)):
        size, order = (7, 3) if run.kind == "solve" else (5, 2)
        spread = [[median - min(run.seconds)], [max(run.seconds) - median]]
        style = {"color": colour, "marker": marker, "markersize": size, "linestyle": "", "linewidth": 0.8}
        style |= {"markerfacecolor": "white" if run.wrong else colour, "zorder": order}
        axes.errorbar([error], [median], yerr=spread, label=run.name if k == 0 else None, **style)
    if mine and mine[0].kind == "peer":  # they have no path of their own
        axes.plot(*zip(*sorted(places), strict=True), color=colour, linewidth=0.7, linestyle=":", zorder=1)


def _bars(axes: Any, runs: Sequence[Entry], colours: dict[str, str]) -> None:
    """For each competitor the first run that reached the residual: build, dotted, set-up, striped, and the rest."""
    best: dict[str, Entry] = {}
    for run in runs:
        if run.residual is not None and run.residual <= RTOL:
            best.setdefault(run.name, run)
    slowest_first = sorted(best.values(), key=lambda run: -run.median)
    for k, run in enumerate(slowest_first):
        style = {"color": "white", "edgecolor": colours[run.name], "height": 0.6}
        axes.barh(k, run.median, color=colours[run.name], alpha=0.85, height=0.6)
        axes.barh(k, run.build, hatch="..", **style)
        if run.setup:
            axes.barh(k, run.setup, left=run.build, hatch="////", **style)
    axes.set_yticks(range(len(best)), [run.name for run in slowest_first], fontsize=8)
    axes.set_xlabel(f"time to Res(z) ≤ {RTOL:g} Res(0), s\n(dots: build, stripes: set-up)")
    axes.grid(axis="x", alpha=0.3)


@drawing.register
def _(found: StabilityMap, points: Any = None) -> Drawing:
    return Drawing(panels=(lambda axes: _map(axes, found),), size=(8.2, 5.4), title=found.plane.title)


def _map(axes: Any, found: StabilityMap) -> list[Any]:
    """Steps as colours, failures as signs on white, and a line around the points where each theorem proves convergence.

    A red line encloses what the paper, as printed, says to converge, where that is more than is proved.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.lines import Line2D

    x, y, ends, proved, printed = found.plane.x, found.plane.y, found.ends, found.proved, found.any_printed
    solved = ends == "solved"
    counts = np.ma.masked_where(~solved, np.maximum(found.steps, 1))
    least = int(counts.min()) if solved.any() else found.max_iter
    norm = LogNorm(least, max(int(counts.max()) if solved.any() else 1, 10 * least))  # at least a factor of ten apart
    mesh = axes.pcolormesh(_edges(x), _edges(y), counts, cmap="viridis_r", norm=norm)
    axes.figure.colorbar(mesh, ax=axes, label=f"steps to Res(z) ≤ {found.rtol:g} Res(0)", pad=0.01)
    handles = []
    X, Y = np.meshgrid(x.values, y.values)
    for end, (sign, words) in _SIGNS.items():
        here = ends == end
        if here.any():
            style: dict[str, Any] = {"linestyle": "", "marker": sign, "color": "0.25"}
            axes.plot(X[here], Y[here], markersize=5, **style)
            handles.append(Line2D([], [], markersize=7, label=words.format(max_iter=found.max_iter), **style))
    alike: dict[bytes, list[str]] = {}  # theorems that prove the same points have one line
    for name, mask in proved.items():
        alike.setdefault(mask.tobytes(), []).append(name)
    for names in alike.values():
        mask, (colour, dashes) = proved[names[0]], _LINES[names[-1]]
        if mask.any():
            _outline(axes, x, y, mask, colors=[colour], linestyles=[dashes], linewidths=2.0)
            label = f"proved: {', '.join(names)}"
            handles.append(Line2D([], [], color=colour, linestyle=dashes, linewidth=2.0, label=label))
    if (printed & ~found.any_proved).any():
        _outline(axes, x, y, printed, colors=[_FALSE], linewidths=3.0, zorder=1.5)
        handles.append(Line2D([], [], color=_FALSE, linewidth=3.0, label="said to converge, as printed (false)"))
    axes.set(xscale="log" if x.log else "linear", yscale="log" if y.log else "linear", xlabel=x.label, ylabel=y.label)
    return handles


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
