"""The figures of a race."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...numerics.arrays import Vector
from ...numerics.rounding import UNIT_ROUNDOFF
from ...solve.goal import RTOL
from ..competitors import Entry
from ..race import Race
from .figures import COLOURS, GREY, ZERO_SHARE, Drawing, Panel, drawing, styles

#: the largest number of competitors beside solve() in one panel, each in its own colour
_MAX_SERIES = len(COLOURS)
#: the height of a line of times in a single panel, in inches; the axes take the height of four lines more
_LINE_HEIGHT = 0.24
#: the factor by which the axis extends beyond the largest time, for the numbers beside the times
_LABEL_ROOM = 30.0
#: colour and marker of a competitor
Style = tuple[str, str]


@drawing.register
def _(race: Race) -> Drawing:
    """Time against error, more accurate to the right, in panels; then the times to Res_D ≤ 1e-8·Res_D(0)."""
    kinds = {run.name: run.kind for run in race.entries}
    ordered = sorted(kinds, key=lambda name: ("solve", "own", "peer").index(kinds[name]))
    style_of = styles(ordered)
    limits = _limits(race)
    panels = [
        Panel(
            draw=partial(_times, race, {name: style_of[name] for name in names}, limits, heading),
            caption=_HOW_TIMES if k == 0 else "The same for others, with solve() once more.",
            alt=f"Time against {race.measure}. {race.winner}",
        )
        for k, (heading, names) in enumerate(_parts(kinds))
    ]
    first = race.quickest(RTOL)
    took = ", ".join(f"{name} {in_seconds(run.median)}" for name, run in first.items())
    times = Panel(
        draw=partial(_quickest, first, style_of),
        caption="The time to the accuracy that solve() aims at by default, the shortest at the top, on a logarithmic "
        "axis. In brackets: how much of it goes by before the first step.",
        alt=f"Times to the default accuracy. {took or 'None reached it'}.",
        height=_LINE_HEIGHT * (4 + max(len(first), 4)),
    )
    count = len(panels)
    return Drawing(
        panels=(*panels, times),
        size=(11.5, max(4.4, 3.7 * count)),
        mosaic=[[k, count] for k in range(count)],
        layout={"width_ratios": (1.5, 1)},
        title=race.title,
    )


_HOW_TIMES = (
    "Each marker is a run to one tolerance, its bar the spread of the rounds; further right is more accurate, further "
    "down is faster. A hollow marker claims success, and is above the tolerance in our measure; the dashed line is one "
    "solve of a linear system with A."
)


def _parts(kinds: Mapping[str, str]) -> list[tuple[str, list[str]]]:
    """(title, competitors) of each panel, solve() in each; a single panel without title if all fit into it."""
    if len(kinds) <= _MAX_SERIES + 1:
        return [("", [*kinds])]
    parts = []
    for kind, heading in (("own", "methods of this package"), ("peer", "independent solvers")):
        names = [name for name, one in kinds.items() if one == kind]
        parts += [(heading, ["solve()", *names[k : k + _MAX_SERIES]]) for k in range(0, len(names), _MAX_SERIES)]
    return [(heading, [name for name in group if name in kinds]) for heading, group in parts]


def _limits(race: Race) -> dict[str, Any]:
    """The limits of the axes, and the `floor`: smaller errors, 0 included, are drawn there."""
    errors = [run.error for run in race.entries if run.error]
    times = [second for run in race.entries if run.error is not None for second in run.seconds]
    times += [race.limit] if race.limit else []
    floor = max(ZERO_SHARE * min(errors, default=1.0), UNIT_ROUNDOFF * max(errors, default=1.0))
    return {
        "floor": floor,
        "xlim": (2 * max(errors, default=1.0), floor / 2),
        "ylim": (min(times, default=1.0) / 1.6, 1.6 * max(times, default=1.0)),
    }


def _times(
    race: Race, style_by_name: Mapping[str, Style], limits: dict[str, Any], heading: str, axes: Any
) -> list[Any]:
    """Draw the runs as markers, with a legend in the order of the times of the most accurate runs."""
    exact = ", 0 at the right end" if any(run.error == 0.0 for run in race.entries) else ""
    axes.set(xscale="log", yscale="log", ylabel="time, s", xlabel=f"{race.measure}{exact}   (more accurate →)")
    axes.set(xlim=limits["xlim"], ylim=limits["ylim"])
    axes.set_title(heading, fontsize=10)
    ends = []
    for name, style in style_by_name.items():
        runs = [run for run in race.entries if run.name == name and run.error is not None]
        runs.sort(key=lambda run: -(run.error or 0.0))
        if runs:
            errors = np.maximum([run.error or 0.0 for run in runs], limits["floor"])
            ends.append((runs[-1].median, _runs(axes, runs, errors, *style)))
    if race.limit is not None:
        line = axes.axhline(race.limit, color=GREY, linestyle="--", linewidth=1.2, label="one linear solve")
        ends.append((race.limit, line))
    ends.sort(key=lambda end: -end[0])
    if any(run.loose for run in race.entries if run.name in style_by_name):
        hollow = {"color": GREY, "markerfacecolor": "none", "label": "claims success,\nnot in our measure"}
        ends += [(0.0, line) for line in axes.plot([], [], "o", **hollow)]
    legend_style = {"loc": "center left", "bbox_to_anchor": (1.0, 0.5), "fontsize": 8, "frameon": False}
    axes.legend(handles=[line for _, line in ends], **legend_style)
    axes.grid(alpha=0.3)
    return []


def _runs(axes: Any, runs: Sequence[Entry], errors: Vector, colour: str, marker: str) -> Any:
    """Draw the runs of one competitor with the spread of their times, hollow for loose claims; return a handle."""
    medians = np.array([run.median for run in runs])
    loose = np.array([run.loose for run in runs])
    style = {"color": colour, "zorder": 3 if runs[0].kind == "solve" else 2}
    spread = [min(run.seconds) for run in runs], [max(run.seconds) for run in runs]
    axes.vlines(errors, *spread, linewidth=0.8, **style)
    axes.plot(errors, medians, linestyle=":", linewidth=0.8, label="_", **style)
    style |= {"linestyle": "", "marker": marker, "markersize": 7 if runs[0].kind == "solve" else 5}
    axes.plot(errors[loose], medians[loose], markerfacecolor="none", label=runs[0].name, **style)
    return axes.plot(errors[~loose], medians[~loose], label=runs[0].name, **style)[0]


def _quickest(first: Mapping[str, Entry], style_of: Mapping[str, Style], axes: Any) -> list[Any]:
    """Draw the shortest times as markers: a bar has no length on a logarithmic axis."""
    times = [run.median for run in first.values()]
    axes.hlines(range(len(first)), min(times, default=1.0) / 3, times, color=GREY, linewidth=0.6, linestyle=":")
    for k, run in enumerate(first.values()):
        colour, marker = style_of[run.name]
        axes.plot([run.median], [k], color=colour, marker=marker, markersize=7, linestyle="", label=run.name)
        before = (run.build + (run.setup or 0.0)) / run.median
        axes.text(1.3 * run.median, k, f"{in_seconds(run.median)} ({before:.0%})", va="center", fontsize=8)
    axes.set(xscale="log", xlim=(min(times, default=1.0) / 3, _LABEL_ROOM * max(times, default=1.0)))
    axes.set_yticks(range(len(first)), list(first), fontsize=8)
    axes.invert_yaxis()
    axes.margins(y=0.1)
    axes.set_xlabel(f"time to Res_D(z) ≤ {RTOL:g} Res_D(0), s\n(in brackets the share before the first step)")
    axes.grid(axis="x", alpha=0.3)
    if not first:
        axes.text(0.5, 0.5, "no run got there", ha="center", transform=axes.transAxes)
    return []


def in_seconds(t: float) -> str:
    """`t` seconds to two digits, below 1 s in ms, µs or ns."""
    from matplotlib.ticker import EngFormatter

    t = float(f"{t:.1e}")
    return f"{t:g} s" if t >= 1.0 else str(EngFormatter("s")(t))
