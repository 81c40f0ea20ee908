"""The chart of a race: time over error, and where the time goes."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any, NamedTuple

import numpy as np

from ...numerics.arrays import Vector
from ...present.table import Table
from ...solve.driver import RTOL
from .figures import Figure, legend_below, looks, new_figure

#: what an answer that is exact to the last digit is drawn at, as a share of the smallest error above 0
_EXACT = 0.1


class _Run(NamedTuple):
    """A row of a race's table."""

    name: str
    kind: str
    tolerance: float
    median: float
    lowest: float
    highest: float
    build: float
    setup: float | None
    error: float | None
    residual: float | None
    claim: str
    wrong: str


def race_figure(table: Table, traces: Mapping[str, tuple[Vector, Vector]]) -> Figure:
    """Left: time against error, more accurate to the right; right: build, set-up and the rest, to Res ≤ 1e-8·Res(0).

    A marker is a run to one tolerance, the bar on it the spread of the rounds, the thin line the path of one run, from
    `traces`, name → (seconds, errors); a hollow marker says "solved" and is not. The dashed line is one linear solve
    with A. Parameters: `table` and `traces` of a race. Returns a matplotlib figure.
    """
    figure = new_figure(11, 6.0)
    left, right = figure.subplots(1, 2, width_ratios=(2.2, 1))
    rows = [_Run(*row) for row in table.rows]
    runs = [row for row in rows if row.kind != "limit"]
    shown = looks(list(dict.fromkeys(run.name for run in runs)))
    errors = [run.error for run in runs if run.error] + [float(e) for _, path in traces.values() for e in path if e > 0]
    floor = _EXACT * min(errors, default=1.0)
    for name, (colour, marker) in shown.items():
        _points(left, [run for run in runs if run.name == name and run.error is not None], colour, marker, floor)
        if name in traces:
            seconds, path = traces[name]
            left.plot(np.maximum(path, floor), seconds, color=colour, linewidth=0.7, alpha=0.6, zorder=1)
    for limit in (row for row in rows if row.kind == "limit"):
        left.axhline(limit.median, color="0.4", linestyle="--", linewidth=1.2, label="one linear solve (PyAMG)")
    left.set_xscale("log")
    left.set_yscale("log")
    left.invert_xaxis()
    left.set_xlabel(table.heads[8])
    left.set_ylabel("time, s")
    left.grid(alpha=0.3)
    if any(run.wrong for run in runs):
        left.plot([], [], "o", color="0.3", markerfacecolor="white", label='says "solved", is not')
    _bars(right, runs, {name: colour for name, (colour, _) in shown.items()})
    figure.suptitle(table.title, fontsize=10)
    handles, labels = left.get_legend_handles_labels()
    legend_below(figure, 5, handles=handles, labels=labels)
    return figure


def _points(axes: Any, mine: list[_Run], colour: str, marker: str, floor: float) -> None:
    """The runs of one competitor; only the first of them is in the legend."""
    for k, run in enumerate(mine):
        assert run.error is not None
        axes.errorbar(
            [max(run.error, floor)],
            [run.median],
            yerr=[[run.median - run.lowest], [run.highest - run.median]],
            marker=marker,
            color=colour,
            markerfacecolor="white" if run.wrong else colour,
            markersize=7 if run.kind == "solve" else 5,
            linewidth=0.8,
            linestyle="",
            label=run.name if k == 0 else None,
            zorder=3 if run.kind == "solve" else 2,
        )
    if mine and mine[0].kind == "peer":  # they have no path of their own
        line = sorted((max(run.error or 0.0, floor), run.median) for run in mine)
        axes.plot(*zip(*line, strict=True), color=colour, linewidth=0.7, linestyle=":", zorder=1)


def _bars(axes: Any, runs: list[_Run], colours: dict[str, str]) -> None:
    """For each competitor the first run that reached the residual: build, dotted, set-up, striped, and the rest."""
    best: dict[str, _Run] = {}
    for run in runs:
        if run.residual is not None and run.residual <= RTOL:
            best.setdefault(run.name, run)
    slowest_first = sorted(best.items(), key=lambda item: -item[1].median)
    for k, (name, run) in enumerate(slowest_first):
        style = {"color": "white", "edgecolor": colours[name], "height": 0.6}
        axes.barh(k, run.median, color=colours[name], alpha=0.85, height=0.6)
        axes.barh(k, run.build, hatch="..", **style)
        if run.setup:
            axes.barh(k, run.setup, left=run.build, hatch="////", **style)
    axes.set_yticks(range(len(best)), [name for name, _ in slowest_first], fontsize=8)
    axes.set_xlabel(f"time to Res(z) ≤ {RTOL:g} Res(0), s\n(dots: build, stripes: set-up)")
    axes.grid(axis="x", alpha=0.3)
