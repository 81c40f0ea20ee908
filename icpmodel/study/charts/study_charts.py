"""The figures of a race and of a stability map."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from functools import partial
from typing import Any

import numpy as np

from ...numerics.rounding import UNIT_ROUNDOFF
from ...solve.goal import RTOL
from ..competitors import Entry
from ..planes import Axis
from ..race import Race
from ..stability_map import StabilityMap
from .figures import ACCURATE, BLUE, GREY, ORANGE, SKY, YELLOW, Drawing, Panel, drawing, looks, name_lines

#: what an answer that is exact to the last digit is drawn at, as a share of the smallest error above 0
_EXACT = 0.1
#: kind of a competitor → colour of its bar and what that means
KINDS = {
    "solve": ("black", "what solve() does by itself"),
    "own": (BLUE, "a method of this package"),
    "peer": (ORANGE, "an independent solver"),
}
#: what a panel on its own needs for a bar, in inches, and for the axes around them
_BAR = 0.24
_AROUND = 1.0
#: room for the numbers at the bars, as a factor
_NUMBERS = 30.0
#: how a run ended → the sign for it and its words; solved points have colours
SIGNS = {
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
_INK = "0.25"
_PLATE = "0.97"
#: what proves convergence → the theorems, the colour and dashes of its line: they often bound the same region
_PROVED: dict[str, tuple[tuple[str, ...], str, Any]] = {
    "paper, corrected": (("4.1", "4.2", "4.3", "4.4"), SKY, (0, (2, 1))),
    "sharper bound": (("sharper",), "#1a1a1a", "solid"),
    "row by row": (("rowwise", "h-plus"), BLUE, (0, (6, 2))),
    "positive definite": (("definite",), YELLOW, (0, (5, 1, 1, 1))),
}
FALSE = "#C00000"


@drawing.register
def _(found: Race, points: Any = None) -> Drawing:
    """Time against error, more accurate to the right, for seven competitors at most in a panel; then the times to
    Res_D ≤ 1e-8·Res_D(0) as bars."""
    parts = parts_of(found)
    limits = limits_of(found)
    panels = [
        Panel(
            draw=partial(_times, found, shown, limits, len(parts) > 1),
            caption=_HOW_TIMES if k == 0 else "The same for others, with solve() once more.",
            alt=_times_told(found, shown),
        )
        for k, shown in enumerate(parts)
    ]
    first = found.quickest(RTOL)
    took = [f"{name} {in_seconds(run.median)}" for name, run in first.items()]
    bars = Panel(
        draw=partial(_bars, first),
        caption="The time to the accuracy that solve() aims at by default, the shortest at the top, on a logarithmic "
        "axis; in brackets how much of it goes by before the first step.",
        alt=f"Bars of times. {', '.join(took) or 'Nobody got there'}.",
        height=_AROUND + _BAR * max(len(first), 4),
    )
    many = len(panels)
    return Drawing(
        panels=(*panels, bars),
        size=(11.5, max(4.4, 3.7 * many)),
        mosaic=[[k, many] for k in range(many)],
        layout={"width_ratios": (1.5, 1)},
        title=found.title,
    )


_HOW_TIMES = (
    "Each marker is a run to one tolerance, its bar the spread of the rounds, the thin line the way of one run; "
    "further right is more accurate, further down is faster. A hollow marker says “solved” and is not; the dashed "
    "line is one solve of a linear system with A."
)


def parts_of(found: Race) -> list[dict[str, tuple[str, str]]]:
    """Panel by panel competitor → (colour, marker), solve() in each."""
    kinds = {run.name: run.kind for run in found.entries}
    parts = looks(kinds)
    if len(parts) > 1:
        groups = [[name for name, one in kinds.items() if one in ("solve", kind)] for kind in ("own", "peer")]
        parts = [one for group in groups for one in looks(group) if {*one} - {"solve()"}]
    return parts


def _times_told(found: Race, shown: Iterable[str]) -> str:
    """For each competitor its most accurate run."""
    told = []
    for name in shown:
        if runs := [run for run in found.entries if run.name == name and run.error is not None]:
            best = _most_accurate(runs)
            told.append(f"{name} gets to {best.error or 0.0:.1e} in {in_seconds(best.median)}")
    return f"Time against {found.measure}. {'; '.join(told) or 'No run has an error'}."


def _most_accurate(runs: Sequence[Entry]) -> Entry:
    return min(runs, key=lambda run: np.inf if run.error is None else run.error)


def limits_of(found: Race) -> dict[str, Any]:
    """The limits of all panels, errors the other way round, and what is drawn where the error is 0, or nothing beside
    the largest: a way may begin, or a run that diverges may go, far beyond."""
    errors = [run.error for run in found.entries if run.error]
    times = [second for run in found.entries if run.error is not None for second in run.seconds]
    times += [t for seconds, _ in found.traces.values() for t in seconds.tolist() if t > 0]
    times += [found.limit] if found.limit else []
    floor = max(_EXACT * min(errors, default=1.0), UNIT_ROUNDOFF * max(errors, default=1.0))
    return {
        "floor": floor,
        "xlim": (2 * max(errors, default=1.0), floor / 2),
        "ylim": (min(times, default=1.0) / 1.6, 1.6 * max(times, default=1.0)),
    }


def _times(
    found: Race, shown: dict[str, tuple[str, str]], limits: dict[str, Any], several: bool, axes: Any
) -> list[Any]:
    entries = found.entries
    floor = limits["floor"]
    ends = []
    axes.set(xscale="log", yscale="log", ylabel="time, s", xlabel=f"{found.measure}   ({ACCURATE})")
    axes.set(xlim=limits["xlim"], ylim=limits["ylim"])
    for name, (colour, marker) in shown.items():
        mine = [run for run in entries if run.name == name and run.error is not None]
        _points(axes, mine, colour, marker, floor)
        if name in found.traces:
            seconds, path = found.traces[name]
            axes.plot(np.maximum(path, floor), seconds, color=colour, linewidth=0.7, alpha=0.6, zorder=1)
        if mine:
            best = _most_accurate(mine)
            ends.append((name, (max(best.error or 0.0, floor), best.median), colour, marker))
    if found.limit is not None:
        axes.axhline(found.limit, color=GREY, linestyle="--", linewidth=1.2)
        ends.append(("one linear solve", (limits["xlim"][1], found.limit), GREY, "$-$"))
    axes.grid(alpha=0.3)
    if several:
        kinds = {run.kind for run in entries if run.name in shown}
        axes.set_title("methods of this package" if "own" in kinds else "independent solvers", fontsize=10)
    if any(run.wrong for run in entries if run.name in shown):
        hollow = axes.plot([], [], "o", color=GREY, markerfacecolor="none", label='says "solved", is not')
        axes.legend(handles=hollow, loc="best", fontsize=8, frameon=False)
    name_lines(axes, ends)
    return []


def _points(axes: Any, mine: list[Entry], colour: str, marker: str, floor: float) -> None:
    """The runs of one competitor."""
    places = [(max(run.error or 0.0, floor), run.median) for run in mine]
    for k, (run, (error, median)) in enumerate(zip(mine, places, strict=True)):
        size, order = (7, 3) if run.kind == "solve" else (5, 2)
        spread = [[median - min(run.seconds)], [max(run.seconds) - median]]
        style = {"color": colour, "marker": marker, "markersize": size, "linestyle": "", "linewidth": 0.8}
        style |= {"markerfacecolor": "none" if run.wrong else colour, "zorder": order}
        axes.errorbar([error], [median], yerr=spread, label=run.name if k == 0 else None, **style)
    if mine and mine[0].kind == "peer":  # they have no path of their own
        axes.plot(*zip(*sorted(places), strict=True), color=colour, linewidth=0.7, linestyle=":", zorder=1)


def _bars(first: dict[str, Entry], axes: Any) -> list[Any]:
    """On a logarithmic axis parts of a bar have no length, so what goes by before the first step is a number."""
    times = [run.median for run in first.values()]
    left = min(times, default=1.0) / 3
    for k, run in enumerate(first.values()):
        axes.barh(k, run.median - left, left=left, color=KINDS[run.kind][0], alpha=0.85, height=0.6)
        before = (run.build + (run.setup or 0.0)) / run.median
        axes.text(1.1 * run.median, k, f"{in_seconds(run.median)} ({before:.0%})", va="center", fontsize=8)
    axes.set(xscale="log", xlim=(left, _NUMBERS * max(times, default=1.0)))
    axes.set_yticks(range(len(first)), list(first), fontsize=8)
    axes.invert_yaxis()
    axes.set_xlabel(f"time to Res_D(z) ≤ {RTOL:g} Res_D(0), s\n(in brackets the share before the first step)")
    axes.grid(axis="x", alpha=0.3)
    kinds = {run.kind for run in first.values()}
    for kind, (colour, words) in KINDS.items():
        if kind in kinds:
            axes.barh([0], [0], color=colour, alpha=0.85, label=words)
    if not first:
        axes.text(0.5, 0.5, "nobody got there", ha="center", transform=axes.transAxes)
    else:
        axes.legend(loc="upper right", fontsize=8, frameon=False)  # where bars are short
    return []


def in_seconds(t: float) -> str:
    """`t` seconds to two digits, in the unit that people would use."""
    for unit, words in ((1.0, "s"), (1e-3, "ms")):
        if t >= unit:
            return f"{float(f'{t / unit:.1e}'):g} {words}"
    return f"{float(f'{t / 1e-6:.1e}'):g} µs"


@drawing.register
def _(found: StabilityMap, points: Any = None) -> Drawing:
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
    """Steps as colours, failures as signs on a plate, and a line around the points where convergence is proved.

    A red line encloses what the paper, as printed, says to converge, where that is more than is proved.
    """
    from matplotlib.collections import LineCollection
    from matplotlib.colors import LogNorm
    from matplotlib.lines import Line2D

    x = found.plane.x
    y = found.plane.y
    ends = found.ends
    solved = ends == "solved"
    counts = np.ma.masked_where(~solved, np.maximum(found.steps, 1))
    least = int(counts.min()) if solved.any() else found.max_iter
    norm = LogNorm(least, max(int(counts.max()) if solved.any() else 1, 10 * least))  # at least a factor of ten apart
    axes.set_facecolor(_PLATE)
    mesh = axes.pcolormesh(_edges(x), _edges(y), counts, cmap="viridis_r", norm=norm)
    axes.figure.colorbar(mesh, ax=axes, label=f"steps to Res_D(z) ≤ {found.rtol:g} Res_D(0)", pad=0.01)
    handles = []
    X, Y = np.meshgrid(x.values, y.values)
    for end, (sign, words) in SIGNS.items():
        here = ends == end
        if here.any():
            style: dict[str, Any] = {"linestyle": "", "marker": sign}
            axes.plot(X[here], Y[here], markersize=5, color=_INK, **style)
            words = words.format(max_iter=found.max_iter)
            handles.append(Line2D([], [], markersize=7, color=GREY, label=words, **style))
    for words, mask, colour, dashes in proofs(found):
        width, shown = (3.0, colour) if colour == FALSE else (2.0, "black" if dashes == "solid" else colour)
        style = {"colors": [colour], "linestyles": [dashes], "linewidths": width, "zorder": 4.5 - width}
        axes.add_collection(LineCollection(outline(found, mask), **style))
        handles.append(Line2D([], [], color=shown, linestyle=dashes, linewidth=width, label=words))
    axes.set(xscale="log" if x.log else "linear", yscale="log" if y.log else "linear", xlabel=x.label, ylabel=y.label)
    return handles + _marked(found, axes)


def proofs(found: StabilityMap) -> list[tuple[str, Any, str, Any]]:
    """(words, points, colour, dashes) of what proves convergence, each region once, and of what was printed."""
    alike: dict[bytes, list[str]] = {}
    masks = {words: np.any([found.proved[name] for name in names], axis=0) for words, (names, *_) in _PROVED.items()}
    for words, mask in masks.items():
        if mask.any():
            alike.setdefault(mask.tobytes(), []).append(words)
    told = []
    for same in alike.values():
        how = "" if len(alike) == 1 else f" ({', '.join(same)})"
        told.append((f"proved to converge{how}", masks[same[-1]], *_PROVED[same[-1]][1:]))
    if (found.any_printed & ~found.any_proved).any():
        told.append(("said to converge, as printed (false)", found.any_printed, FALSE, "solid"))
    return told


def marked_places(found: StabilityMap) -> dict[str, tuple[tuple[float, float], str]]:
    """Words → (point, marker): on the plane of a method where it is by default, and where it needs the fewest steps."""
    places = {}
    if found.plane.default is not None:
        places["default"] = found.plane.default, "o"
        if (found.ends == "solved").any():
            j, i = np.unravel_index(np.where(found.ends == "solved", found.steps, np.inf).argmin(), found.ends.shape)
            best = float(found.plane.x.values[i]), float(found.plane.y.values[j])
            places[f"fewest steps: {found.steps[j, i]}"] = best, "*"
    return places


def _marked(found: StabilityMap, axes: Any) -> list[Any]:
    marked: list[Any] = []
    for words, (place, marker) in marked_places(found).items():
        size = 12 if marker == "*" else 8
        style = {"marker": marker, "color": "white", "markeredgecolor": "#1a1a1a", "linestyle": ""}
        marked += axes.plot(*[[at] for at in place], label=words, markersize=size, zorder=4, **style)
    return marked


def _edges(axis: Axis) -> Any:
    """The borders of the cells around the values."""
    t = np.log(axis.values) if axis.log else axis.values
    middle = 0.5 * (t[1:] + t[:-1])
    found = np.concatenate([[2.0 * t[0] - middle[0]], middle, [2.0 * t[-1] - middle[-1]]])
    return np.exp(found) if axis.log else found


def outline(found: StabilityMap, mask: Any) -> list[tuple[tuple[float, float], tuple[float, float]]]:
    """The borders of the cells where `mask` holds, in pieces from a point to a point."""
    ex = _edges(found.plane.x)
    ey = _edges(found.plane.y)
    wide = np.pad(mask, 1)
    upright = wide[1:-1, 1:] != wide[1:-1, :-1]
    level = wide[1:, 1:-1] != wide[:-1, 1:-1]
    pieces = [((ex[i], ey[j]), (ex[i], ey[j + 1])) for j, i in np.argwhere(upright)]
    return pieces + [((ex[i], ey[j]), (ex[i + 1], ey[j])) for j, i in np.argwhere(level)]
