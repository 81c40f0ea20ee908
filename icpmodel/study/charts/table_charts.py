"""Figures of the tables of the benchmarks, by name, as they are written to a folder."""

from __future__ import annotations

from itertools import zip_longest
from typing import Any

import numpy as np

from ...numerics.arrays import Vector
from ...present.table import Table
from .figures import COLOURS, Figure, looks, name_lines, new_figure

#: what is so many times as slow as the best own method in hindsight, or as a peer, makes `solve()` look bad
OWN, PEER = 2.0, 1.5
#: the largest factor of a profile that is drawn
_LARGEST = 1000.0
#: (n, seconds or MiB) by increasing n
_Points = list[tuple[int, float]]


def benchmark_figures(table: Table) -> dict[str, tuple[Figure, Table]]:
    """File name → (figure, its data): the profiles of a `benchmark`, and time against n of each scene."""
    found = {"benchmark": (profile_figure(table), table)}
    for scene, figure in scaling(table).items():
        rows = tuple(row for row in table.rows if row[0] == scene)
        found[scene.replace(",", "-").replace("=", "")] = figure, Table(scene, table.heads, rows)
    return found


def scaling(table: Table) -> dict[str, Figure]:
    """Scene → time against n of a `benchmark`, for each scene of which two sizes or more were measured.

    Left `solve()`, the peers and the linear solves, right `solve()` and the own methods, in rows of panels of at most
    seven lines; only runs that reached the residual are shown. The label has the exponent of n, fitted through the
    three largest sizes.
    """
    scenes: dict[str, dict[tuple[str, str], _Points]] = {}
    for cells in table.records():
        if cells["time, s"] is not None:
            lines = scenes.setdefault(cells["scene"], {})
            lines.setdefault((cells["kind"], cells["method"]), []).append((cells["n"], cells["time, s"]))
    return {
        scene: _scaling_figure(scene, lines)
        for scene, lines in scenes.items()
        if len({n for points in lines.values() for n, _ in points}) > 1
    }


def _scaling_figure(scene: str, lines: dict[tuple[str, str], _Points]) -> Figure:
    """Columns: peers and linear solves, own methods; as many rows as it takes for seven lines a panel."""
    kinds = {name: kind for kind, name in lines}
    own = {name for name, kind in kinds.items() if kind == "own"}
    columns = [looks(name for name in kinds if (name in own) is mine or name == "solve()") for mine in (False, True)]
    rows = max(map(len, columns))
    figure = new_figure(11.5, max(4.4, 3.8 * rows))
    panels = figure.subplots(rows, 2, sharex=True, sharey=True, squeeze=False)
    ends = []
    for k, parts in enumerate(columns):
        for axes, shown in zip_longest(panels[:, k], parts):
            if shown is None:
                axes.set_axis_off()
                continue
            named = [_draw(axes, name, kinds[name], lines[kinds[name], name], shown[name]) for name in shown]
            ends.append((axes, named))
            axes.set(xscale="log", yscale="log")
            axes.grid(alpha=0.3)
            axes.tick_params(labelleft=True)
            if axes is panels[len(parts) - 1, k]:
                axes.set_xlabel("number of unknowns n")
                axes.tick_params(labelbottom=True)
    sizes = sorted({n for points in lines.values() for n, _ in points})
    apart = [n for k, n in enumerate(sizes) if k == 0 or n > 1.8 * sizes[k - 1]]
    panels[0, 0].set_xticks(apart, [f"{n}" for n in apart])
    panels[0, 0].minorticks_off()
    for axes, named in ends:  # all limits are known
        name_lines(axes, named)
    panels[0, 0].set_title("solve(), peers and one linear solve", fontsize=10)
    panels[0, 1].set_title("solve() and single methods", fontsize=10)
    figure.supylabel("time to Res(z) ≤ 1e-8 Res(0), s", fontsize=10)
    figure.suptitle(scene)
    return figure


def _draw(axes: Any, name: str, kind: str, points: _Points, look: tuple[str, str]) -> tuple[str, Any, str, str]:
    """One line, and what `name_lines` has to know of it."""
    colour, marker = look
    width, size = (2.5, 6) if kind == "solve" else (1.2, 5)
    style = {"color": colour, "marker": marker, "linewidth": width, "markersize": size}
    label = _labelled(name, points)
    axes.plot(*zip(*points, strict=True), "--" if kind == "limit" else "-", label=label, zorder=1 + width, **style)
    return label, points[-1], colour, marker


def memory_figure(table: Table) -> Figure:
    """Memory against n of a `memory`, a line for each scene, and beside it that of A; exponents as in `scaling`."""
    lines: dict[str, _Points] = {}
    sizes: dict[str, _Points] = {}
    for scene, n, _, size, peak, *_ in table.rows:
        sizes.setdefault(scene, []).append((n, size))
        if peak > 0:
            lines.setdefault(scene, []).append((n, peak))
    parts = looks(sizes)
    figure = new_figure(11.5, max(4.4, 3.8 * len(parts)))
    panels = figure.subplots(len(parts), 2, sharex=True, sharey=True, squeeze=False)
    named: list[tuple[Any, list[tuple[str, Any, str, str]]]] = []
    for row, part in zip(panels, parts, strict=True):
        for axes, found in zip(row, (lines, sizes), strict=True):
            shown = [(scene, look) for scene, look in part.items() if scene in found]
            named.append((axes, [_draw(axes, scene, "", found[scene], look) for scene, look in shown]))
            axes.set(xscale="log", yscale="log", xlabel="number of unknowns n", ylabel="memory, MiB")
            axes.grid(alpha=0.3)
            axes.label_outer()
    for axes, ends in named:  # all limits are known
        name_lines(axes, ends)
    panels[0, 0].set_title("solve()", fontsize=10)
    panels[0, 1].set_title("A", fontsize=10)
    return figure


def _labelled(name: str, points: _Points) -> str:
    """The name, with the exponent of n where there is one."""
    power = exponent(points)
    return name if power is None else f"{name}: $n^{{{power:.2f}}}$"


def exponent(points: _Points) -> float | None:
    """The exponent k of the power law t = C nᵏ through the three largest n; None with fewer than two points."""
    if len(points) < 2:
        return None
    n, t = np.log(np.array(points[-3:], dtype=float)).T
    return round(float(np.polyfit(n, t, 1)[0]), 12)


def choice_figure(table: Table) -> Figure:
    """The ratios of a `choice` over n, to the best own method and to each peer: a mark for each kind of family, which
    is its name up to the first hyphen, six in a row of panels, and at the upper edge a cross where `solve()` failed."""
    rows = [(row, row["family"].partition("+")[0].partition("-")[0]) for row in table.records()]
    parts = looks(sorted({kind for _, kind in rows}))
    peers = [head for head in table.heads if head.startswith("to ")]
    figure = new_figure(10, max(5.2, 0.6 + 3.8 * len(parts)))
    panels = figure.subplots(len(parts), 2, sharex=True, sharey=True, squeeze=False)
    for pair, marks in zip(panels, parts, strict=True):
        for axes, columns, bound in ((pair[0], ["ratio"], OWN), (pair[1], peers, PEER)):
            _ratios(axes, {kind: [row for row, one in rows if one == kind] for kind in marks}, marks, columns, bound)
        failed = [row["n"] for row, one in rows if one in marks and not row["solve() by"]]
        if failed:
            cross = {"color": "black", "transform": pair[0].get_xaxis_transform(), "clip_on": False}
            pair[0].plot(failed, [1.0] * len(failed), "x", label="not solved", **cross)
        pair[0].set_ylabel("time of solve() / time of the other")
        pair[0].legend(loc="best", fontsize=8, framealpha=0.8)
    sizes = [row["n"] for row, _ in rows] or [1]
    panels[0, 0].set_xlim(0.8 * min(sizes), 1.25 * max(sizes))
    for axes in panels[-1]:
        axes.set_xlabel("number of unknowns n")
    panels[0, 0].set_title("to the best own method in hindsight", fontsize=10)
    others = ", ".join(head.removeprefix("to ") for head in peers)
    panels[0, 1].set_title(f"to {others}" if peers else "no peers", fontsize=10)
    return figure


def _ratios(
    axes: Any, rows: dict[str, Any], marks: dict[str, tuple[str, str]], columns: list[str], bound: float
) -> None:
    """The points of each kind, at 1 a line, and a dashed one at the `bound`."""
    for kind, (colour, marker) in marks.items():
        here = [(row["n"], row[head]) for row in rows[kind] for head in columns]
        points = [point for point in here if point[1] is not None]
        x, y = zip(*points, strict=True) if points else ((), ())
        axes.plot(x, y, marker, color=colour, markersize=5, alpha=0.75, linestyle="none", label=kind)
    for at, style in ((1.0, "-"), (bound, "--")):
        axes.axhline(at, color="black", linestyle=style, linewidth=0.8)
    axes.set(xscale="log", yscale="log")
    axes.xaxis.set_minor_formatter("")
    axes.grid(alpha=0.3)


def profiles(table: Table) -> dict[str, Vector]:
    """Method → its factors t/t_best, increasing, on the problems that it solved; infinite on the others.

    A problem is a scene at a size which someone solved; linear solves do not take part. The share ρ(τ) of factors ≤ τ
    is the performance profile. Reference: Dolan and Moré, Math. Program. 91 (2002), doi:10.1007/s101070100263.
    """
    times: dict[str, dict[tuple[str, int], float]] = {}
    best: dict[tuple[str, int], float] = {}
    for cells in table.records():
        if cells["method"] and cells["kind"] != "limit":
            mine, seconds = times.setdefault(cells["method"], {}), cells["time, s"]
            if seconds is not None:
                problem = cells["scene"], cells["n"]
                mine[problem] = seconds
                best[problem] = min(seconds, best.get(problem, np.inf))
    return {
        name: np.sort([mine.get(problem, np.inf) / seconds for problem, seconds in best.items()])
        for name, mine in times.items()
    }


def profile_figure(table: Table) -> Figure:
    """The profile of `solve()` and the six best others of a `benchmark`, by the area below them over log τ."""
    found = profiles(table)
    figure = new_figure(9, 5.4)
    axes = figure.subplots()
    areas = {name: np.log(_LARGEST / np.clip(factors, 1.0, _LARGEST)).sum() for name, factors in found.items()}
    ranked = sorted(found, key=lambda name: (name != "solve()", -areas[name]))
    ends = []
    for name, (colour, marker) in looks(ranked[: 1 + len(COLOURS)])[0].items():
        factors = found[name]
        solved = factors[factors <= _LARGEST]
        x = np.concatenate([[1.0], solved, [_LARGEST]])
        y = np.concatenate([[0.0], np.arange(1, solved.size + 1), [solved.size]]) / max(factors.size, 1)
        style = {"linewidth": 2.5 if name == "solve()" else 1.3, "color": colour, "drawstyle": "steps-post"}
        axes.plot(x, y, label=name, marker=marker, markersize=4, markevery=max(x.size // 8, 1), **style)
        ends.append((name, (_LARGEST, y[-1]), colour, marker))
    axes.set(xscale="log", xlim=(1.0, _LARGEST), ylim=(0.0, 1.02))
    axes.set(xlabel="time within this factor of the quickest", ylabel="share of the problems")
    axes.grid(alpha=0.3)
    name_lines(axes, ends)
    return figure
