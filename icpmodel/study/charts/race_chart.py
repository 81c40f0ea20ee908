"""The chart of a race: time over error, and where the time goes."""

from __future__ import annotations

from itertools import chain, cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from ...solve.driver import RTOL
from ..racing import Entry, Race
from .table_charts import COLOURS, MARKERS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: what an answer that is exact to the last digit is drawn at, as a share of the smallest error above 0
_EXACT = 0.1


def race_figure(found: Race) -> Figure:
    """Left: time against error, more accurate to the right; right: build, set-up and the rest, to Res ≤ 1e-8·Res(0).

    A marker is a run to one tolerance, the bar on it the spread of the rounds, the thin line the path of one run; a
    hollow marker says "solved" and is not. The dashed line is one linear solve with A. Returns a matplotlib figure.
    """
    from matplotlib.figure import Figure

    figure = Figure(figsize=(11, 6.0), layout="constrained")
    left, right = figure.subplots(1, 2, width_ratios=(2.2, 1))
    names = list(dict.fromkeys(entry.name for entry in found.entries))
    # solve() is always the first
    colours = dict(zip(names, chain(["black"], cycle(COLOURS)), strict=False))
    markers = dict(zip(names, chain(["o"], cycle(MARKERS)), strict=False))
    floor = _floor(found)
    for name in names:
        mine = [entry for entry in found.entries if entry.name == name and entry.error is not None]
        _points(left, mine, colours[name], markers[name], floor)
        if name in found.traces:
            seconds, errors = found.traces[name]
            left.plot(np.maximum(errors, floor), seconds, color=colours[name], linewidth=0.7, alpha=0.6, zorder=1)
    if found.limit is not None:
        left.axhline(found.limit, color="0.4", linestyle="--", linewidth=1.2, label="one linear solve (PyAMG)")
    left.set_xscale("log")
    left.set_yscale("log")
    left.invert_xaxis()
    left.set_xlabel(found.measure)
    left.set_ylabel("time, s")
    left.grid(alpha=0.3)
    if any(entry.wrong for entry in found.entries):
        left.plot([], [], "o", color="0.3", markerfacecolor="white", label='says "solved", is not')
    _bars(right, found, colours)
    figure.suptitle(found.title, fontsize=10)
    handles, labels = left.get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside lower center", ncols=5, frameon=False, fontsize=8)
    return figure


def _floor(found: Race) -> float:
    errors = [entry.error for entry in found.entries if entry.error] + [
        float(e) for _, trace in found.traces.values() for e in trace if e > 0
    ]
    return _EXACT * min(errors, default=1.0)


def _points(axes: Any, mine: list[Entry], colour: str, marker: str, floor: float) -> None:
    """The runs of one competitor; only the first of them is in the legend."""
    for k, entry in enumerate(mine):
        assert entry.error is not None
        spread = [[entry.median - min(entry.seconds)], [max(entry.seconds) - entry.median]]
        face = "white" if entry.wrong else colour
        axes.errorbar(
            [max(entry.error, floor)],
            [entry.median],
            yerr=spread,
            marker=marker,
            color=colour,
            markerfacecolor=face,
            markersize=7 if entry.kind == "solve" else 5,
            linewidth=0.8,
            linestyle="",
            label=entry.name if k == 0 else None,
            zorder=3 if entry.kind == "solve" else 2,
        )
    if mine and mine[0].kind == "peer":  # they have no path of their own
        line = sorted((max(entry.error or 0.0, floor), entry.median) for entry in mine)
        axes.plot(*zip(*line, strict=True), color=colour, linewidth=0.7, linestyle=":", zorder=1)


def _bars(axes: Any, found: Race, colours: dict[str, str]) -> None:
    """For each competitor the first run that reached the residual: build, dotted, set-up, striped, and the rest."""
    best: dict[str, Entry] = {}
    for entry in found.entries:
        if entry.residual is not None and entry.residual <= RTOL and entry.name not in best:
            best[entry.name] = entry
    slowest_first = sorted(best.items(), key=lambda item: -item[1].median)
    for k, (name, entry) in enumerate(slowest_first):
        axes.barh(k, entry.median, color=colours[name], alpha=0.85, height=0.6)
        axes.barh(k, entry.build, color="white", edgecolor=colours[name], hatch="....", height=0.6)
        if entry.setup:
            style = {"color": "white", "edgecolor": colours[name], "hatch": "////", "height": 0.6}
            axes.barh(k, entry.setup, left=entry.build, **style)
    axes.set_yticks(range(len(best)), [name for name, _ in slowest_first], fontsize=8)
    axes.set_xlabel(f"time to Res(z) ≤ {RTOL:g} Res(0), s\n(dots: build, stripes: set-up)")
    axes.grid(axis="x", alpha=0.3)
