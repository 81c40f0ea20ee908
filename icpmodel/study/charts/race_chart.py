"""The chart of a race: time over error, and where the time goes."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...numerics.arrays import Vector
from ...solve.driver import RTOL
from ..competitors import Entry
from .figures import Figure, legend_below, looks, new_figure

#: what an answer that is exact to the last digit is drawn at, as a share of the smallest error above 0
_EXACT = 0.1


def race_figure(
    title: str, measure: str, entries: Sequence[Entry], traces: Mapping[str, tuple[Vector, Vector]], limit: float | None
) -> Figure:
    """Left: time against error, more accurate to the right; right: build, set-up and the rest, to Res ≤ 1e-8·Res(0).

    A marker is a run to one tolerance, the bar on it the spread of the rounds, the thin line the path of one run, from
    `traces`; a hollow marker says "solved" and is not. The dashed line is one linear solve with A.
    """
    figure = new_figure(11, 6.0)
    left, right = figure.subplots(1, 2, width_ratios=(2.2, 1))
    shown = looks(list(dict.fromkeys(run.name for run in entries)))
    errors = [run.error for run in entries if run.error]
    errors += [float(e) for _, path in traces.values() for e in path if e > 0]
    floor = _EXACT * min(errors, default=1.0)
    for name, (colour, marker) in shown.items():
        _points(left, [run for run in entries if run.name == name and run.error is not None], colour, marker, floor)
        if name in traces:
            seconds, path = traces[name]
            left.plot(np.maximum(path, floor), seconds, color=colour, linewidth=0.7, alpha=0.6, zorder=1)
    if limit is not None:
        left.axhline(limit, color="0.4", linestyle="--", linewidth=1.2, label="one linear solve (PyAMG)")
    left.set(xscale="log", yscale="log", xlabel=measure, ylabel="time, s")
    left.invert_xaxis()
    left.grid(alpha=0.3)
    if any(run.wrong for run in entries):
        left.plot([], [], "o", color="0.3", markerfacecolor="white", label='says "solved", is not')
    _bars(right, entries, {name: colour for name, (colour, _) in shown.items()})
    figure.suptitle(title, fontsize=10)
    handles, labels = left.get_legend_handles_labels()
    legend_below(figure, 5, handles=handles, labels=labels)
    return figure


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
