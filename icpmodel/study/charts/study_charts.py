"""The figures of a race and of a stability map."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...numerics.arrays import Vector
from ...numerics.rounding import UNIT_ROUNDOFF
from ...solve.goal import RTOL
from ..competitors import Entry
from ..planes import Axis
from ..race import Race
from ..stability_map import StabilityMap
from .figures import ACCURATE, GREY, SKY, Drawing, Panel, drawing, name_lines, styles
from .places import edges, outline

#: what an answer that is exact to the last digit is drawn at, as a share of the smallest error above 0
_EXACT = 0.1
#: so many competitors beside solve() are in one panel, each in a colour of its own
_SERIES = 6
#: what a panel on its own needs for a line of times, in inches, and for the axes around them
_LINE = 0.24
_AROUND = 1.0
#: room for the numbers beside the times, as a factor
_NUMBERS = 30.0
#: how a run ended → the sign for it and its words; solved points have colours
SIGNS = {
    "slow": (".", "not there after {max_iter} steps"),
    "precision limit": ("$+$", "as far as rounding allows"),
    "map failed": ("$?$", "map failed"),
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


#: colour and marker of a competitor
Look = tuple[str, str]


@drawing.register
def _(race: Race) -> Drawing:
    """Time against error, more accurate to the right, in panels; then the times to Res_D ≤ 1e-8·Res_D(0)."""
    kinds = {run.name: run.kind for run in race.entries}
    ordered = sorted(kinds, key=lambda name: ("solve", "own", "peer").index(kinds[name]))
    look = styles(ordered)
    limits = _limits(race)
    panels = [
        Panel(
            draw=partial(_times, race, {name: look[name] for name in shown}, limits, heading),
            caption=_HOW_TIMES if k == 0 else "The same for others, with solve() once more.",
            alt=_times_in_words(race, shown),
        )
        for k, (heading, shown) in enumerate(_parts(kinds))
    ]
    first = race.quickest(RTOL)
    took = ", ".join(f"{name} {in_seconds(run.median)}" for name, run in first.items())
    times = Panel(
        draw=partial(_quickest, first, look),
        caption="The time to the accuracy that solve() aims at by default, the shortest at the top, on a logarithmic "
        "axis; in brackets how much of it goes by before the first step.",
        alt=f"Times to the default accuracy. {took or 'Nobody got there'}.",
        height=_AROUND + _LINE * max(len(first), 4),
    )
    many = len(panels)
    return Drawing(
        panels=(*panels, times),
        size=(11.5, max(4.4, 3.7 * many)),
        mosaic=[[k, many] for k in range(many)],
        layout={"width_ratios": (1.5, 1)},
        title=race.title,
    )


_HOW_TIMES = (
    "Each marker is a run to one tolerance, its bar the spread of the rounds; further right is more accurate, further "
    "down is faster. A hollow marker claims success, and is above the tolerance in our measure; the dashed line is one "
    "solve of a linear system with A."
)


def _parts(kinds: Mapping[str, str]) -> list[tuple[str, list[str]]]:
    """Title and competitors of each panel, solve() in each; one panel without a title where all fit into it."""
    if len(kinds) <= _SERIES + 1:
        return [("", [*kinds])]
    parts = []
    for kind, heading in (("own", "methods of this package"), ("peer", "independent solvers")):
        names = [name for name, one in kinds.items() if one == kind]
        parts += [(heading, ["solve()", *names[k : k + _SERIES]]) for k in range(0, len(names), _SERIES)]
    return [(heading, [name for name in shown if name in kinds]) for heading, shown in parts]


def _times_in_words(race: Race, shown: Iterable[str]) -> str:
    """For each competitor its most accurate run."""
    best = [_most_accurate(runs) for name in shown if (runs := _judged(race, name))]
    words = [f"{run.name} gets to {run.error or 0.0:.1e} in {in_seconds(run.median)}" for run in best]
    return f"Time against {race.measure}. {'; '.join(words) or 'No run has an error'}."


def _judged(race: Race, name: str) -> list[Entry]:
    return [run for run in race.entries if run.name == name and run.error is not None]


def _most_accurate(runs: Sequence[Entry]) -> Entry:
    return min(runs, key=lambda run: np.inf if run.error is None else run.error)


def _limits(race: Race) -> dict[str, Any]:
    """The limits of all panels, and what is drawn where the error is 0, or nothing beside the largest."""
    errors = [run.error for run in race.entries if run.error]
    times = [second for run in race.entries if run.error is not None for second in run.seconds]
    times += [race.limit] if race.limit else []
    floor = max(_EXACT * min(errors, default=1.0), UNIT_ROUNDOFF * max(errors, default=1.0))
    return {
        "floor": floor,
        "xlim": (2 * max(errors, default=1.0), floor / 2),
        "ylim": (min(times, default=1.0) / 1.6, 1.6 * max(times, default=1.0)),
    }


def _times(race: Race, shown: Mapping[str, Look], limits: dict[str, Any], heading: str, axes: Any) -> list[Any]:
    ends = []
    axes.set(xscale="log", yscale="log", ylabel="time, s", xlabel=f"{race.measure}   ({ACCURATE})")
    axes.set(xlim=limits["xlim"], ylim=limits["ylim"])
    axes.set_title(heading, fontsize=10)
    for name, (colour, marker) in shown.items():
        runs = sorted(_judged(race, name), key=lambda run: -(run.error or 0.0))
        if runs:
            errors = np.maximum([run.error or 0.0 for run in runs], limits["floor"])
            _runs(axes, runs, errors, colour, marker)
            ends.append((name, (errors[-1], runs[-1].median), colour, marker))
    if race.limit is not None:
        axes.axhline(race.limit, color=GREY, linestyle="--", linewidth=1.2, label="one linear solve")
        ends.append(("one linear solve", (limits["xlim"][1], race.limit), GREY, "$-$"))
    axes.grid(alpha=0.3)
    if any(run.loose for run in race.entries if run.name in shown):
        hollow = axes.plot(
            [], [], "o", color=GREY, markerfacecolor="none", label="claims success, above tolerance in our measure"
        )
        axes.legend(handles=hollow, loc="best", fontsize=8, frameon=False)
    name_lines(axes, ends)
    return []


def _runs(axes: Any, runs: Sequence[Entry], errors: Vector, colour: str, marker: str) -> None:
    """The runs of one competitor, hollow where their claims are loose, with the spread of their times."""
    medians = np.array([run.median for run in runs])
    loose = np.array([run.loose for run in runs])
    size, order = (7, 3) if runs[0].kind == "solve" else (5, 2)
    style = {"color": colour, "zorder": order}
    spread = [min(run.seconds) for run in runs], [max(run.seconds) for run in runs]
    axes.vlines(errors, *spread, linewidth=0.8, **style)
    axes.plot(errors, medians, linestyle=":", linewidth=0.8, label="_", **style)
    for which, face in ((~loose, colour), (loose, "none")):
        if which.any():
            marks = {"linestyle": "", "marker": marker, "markersize": size, "markerfacecolor": face}
            axes.plot(errors[which], medians[which], label=runs[0].name, **marks, **style)


def _quickest(first: Mapping[str, Entry], look: Mapping[str, Look], axes: Any) -> list[Any]:
    """One marker for each time: a bar has no length on a logarithmic axis."""
    times = [run.median for run in first.values()]
    axes.hlines(range(len(first)), min(times, default=1.0) / 3, times, color=GREY, linewidth=0.6, linestyle=":")
    for k, run in enumerate(first.values()):
        colour, marker = look[run.name]
        axes.plot([run.median], [k], color=colour, marker=marker, markersize=7, linestyle="", label=run.name)
        before = (run.build + (run.setup or 0.0)) / run.median
        axes.text(1.3 * run.median, k, f"{in_seconds(run.median)} ({before:.0%})", va="center", fontsize=8)
    axes.set(xscale="log", xlim=(min(times, default=1.0) / 3, _NUMBERS * max(times, default=1.0)))
    axes.set_yticks(range(len(first)), list(first), fontsize=8)
    axes.invert_yaxis()
    axes.margins(y=0.1)
    axes.set_xlabel(f"time to Res_D(z) ≤ {RTOL:g} Res_D(0), s\n(in brackets the share before the first step)")
    axes.grid(axis="x", alpha=0.3)
    if not first:
        axes.text(0.5, 0.5, "nobody got there", ha="center", transform=axes.transAxes)
    return []


def in_seconds(t: float) -> str:
    """`t` seconds to two digits, in the unit that people would use."""
    for unit, words in ((1.0, "s"), (1e-3, "ms")):
        if t >= unit:
            return f"{float(f'{t / unit:.1e}'):g} {words}"
    return f"{float(f'{t / 1e-6:.1e}'):g} µs"


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
            style = {"linestyle": "", "marker": sign, "label": words.format(max_iter=found.max_iter)}
            handles += axes.plot(X[here], Y[here], markersize=5, color=_INK, **style)
    paper = np.any([found.proved[name] for name in _PAPER], axis=0)
    false = found.any_printed if (found.any_printed & ~found.any_proved).any() else np.zeros_like(paper)
    for words, mask, colour, dashes, width in (
        ("said to converge, as printed (false)", false, _FALSE, "-", 3.0),
        ("proved to converge", found.any_proved, "#1a1a1a", "-", 2.0),
        ("by the paper, corrected", paper, SKY, (0, (2, 1)), 2.0),
    ):
        if mask.any():
            style = {"color": colour, "linestyle": dashes, "linewidth": width, "label": words}
            handles += axes.plot(*outline(_edges(x), _edges(y), mask), **style)
    axes.set(xscale="log" if x.log else "linear", yscale="log" if y.log else "linear", xlabel=x.label, ylabel=y.label)
    for words, place, marker, size in _marked_places(found):
        style = {"marker": marker, "color": "white", "markeredgecolor": "#1a1a1a", "linestyle": ""}
        handles += axes.plot(*[[at] for at in place], label=words, markersize=size, zorder=4, **style)
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
