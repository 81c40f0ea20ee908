"""Figures of the tables of the benchmarks, by name, as they are written to a folder."""

from __future__ import annotations

from typing import Any

import numpy as np

from ...numerics.arrays import Vector
from ...present.table import Table
from .figures import COLOURS, DASHES, Figure, legend_below, looks, new_figure

#: what is so many times as slow as the best own method in hindsight, or as a peer, makes `solve()` look bad
OWN, PEER = 2.0, 1.5
#: the largest factor of a profile that is drawn
_LARGEST = 1000.0
#: more profiles than these cannot be told apart
_SHOWN = 12

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

    Left `solve()`, the peers and the linear solves, right `solve()` and the own methods; only runs that reached the
    residual are shown. The label has the exponent of n, fitted through the three largest sizes.
    """
    scenes: dict[str, dict[tuple[str, str], _Points]] = {}
    for cells in table.records():
        if cells["time, s"] is not None:
            lines = scenes.setdefault(cells["scene"], {})
            lines.setdefault((cells["kind"], cells["method"]), []).append((cells["n"], cells["time, s"]))
    found: dict[str, Figure] = {}
    for scene, lines in scenes.items():
        if len({n for points in lines.values() for n, _ in points}) < 2:
            continue
        found[scene] = figure = new_figure(10, 6.2)
        left, right = figure.subplots(1, 2, sharey=True)
        _draw(left, {key: points for key, points in lines.items() if key[0] != "own"})
        _draw(right, {key: points for key, points in lines.items() if key[0] in ("solve", "own")})
        left.set(title="solve(), peers and one linear solve", ylabel="time to Res(z) ≤ 1e-8 Res(0), s")
        right.set(title="solve() and single methods")
        figure.suptitle(scene)
    return found


def _draw(axes: Any, lines: dict[tuple[str, str], _Points]) -> None:
    shown = looks([name for _, name in lines])
    for (kind, name), points in lines.items():
        colour, marker = shown[name]
        width, size = (2.5, 6) if kind == "solve" else (1.2, 5)
        style = {"color": colour, "marker": marker, "linewidth": width, "markersize": size}
        dash = "--" if kind == "limit" else "-"
        axes.plot(*zip(*points, strict=True), dash, label=_labelled(name, points), zorder=1 + width, **style)
    axes.set(xscale="log", yscale="log", xlabel="number of unknowns n")
    sizes = sorted({n for points in lines.values() for n, _ in points})
    apart = [n for k, n in enumerate(sizes) if k == 0 or n > 1.8 * sizes[k - 1]]
    axes.set_xticks(apart, [f"{n}" for n in apart])
    axes.minorticks_off()
    axes.grid(alpha=0.3)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, frameon=False, fontsize=8)


def memory_figure(table: Table) -> Figure:
    """Memory against n of a `memory`, one line for each scene, and the bytes of A; exponents as in `scaling`."""
    lines: dict[str, _Points] = {}
    sizes: dict[str, _Points] = {}
    for scene, n, _, size, peak, *_ in table.rows:
        sizes.setdefault(scene, []).append((n, size))
        if peak > 0:
            lines.setdefault(scene, []).append((n, peak))
    figure = new_figure(7, 4.6)
    axes = figure.subplots()
    for kind, found, dash in (("solve()", lines, "-"), ("A", sizes, "--")):
        for scene, (colour, marker) in looks(found).items():
            label, points = _labelled(f"{kind}, {scene}", found[scene]), zip(*found[scene], strict=True)
            axes.plot(*points, dash, marker=marker, color=colour, label=label, linewidth=1.2)
    axes.set(xscale="log", yscale="log", xlabel="number of unknowns n", ylabel="memory, MiB")
    axes.grid(alpha=0.3)
    legend_below(figure, 2)
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
    is its name up to the first hyphen, and at the upper edge a cross where `solve()` failed."""
    rows = [(row, row["family"].partition("+")[0].partition("-")[0]) for row in table.records()]
    marks = looks(sorted({kind for _, kind in rows}))
    peers = [head for head in table.heads if head.startswith("to ")]
    sizes = [row["n"] for row, _ in rows] or [1]
    figure = new_figure(10, 5.2)
    panels = figure.subplots(1, 2, sharey=True)
    for axes, columns, bound in ((panels[0], ["ratio"], OWN), (panels[1], peers, PEER)):
        for kind, (colour, marker) in marks.items():
            here = [(row["n"], row[head]) for row, one in rows if one == kind for head in columns]
            points = [point for point in here if point[1] is not None]
            x, y = zip(*points, strict=True) if points else ((), ())
            label = kind if axes is panels[0] else None
            axes.plot(x, y, marker, color=colour, markersize=5, alpha=0.75, linestyle="none", label=label)
        for at, style in ((1.0, "-"), (bound, "--")):
            axes.axhline(at, color="black", linestyle=style, linewidth=0.8)
        axes.set(xscale="log", yscale="log", xlabel="number of unknowns n", xlim=(0.8 * min(sizes), 1.25 * max(sizes)))
        axes.xaxis.set_minor_formatter("")
        axes.grid(alpha=0.3)
    failed = [row["n"] for row, _ in rows if not row["solve() by"]]
    if failed:
        edge = panels[0].get_xaxis_transform()
        panels[0].plot(
            failed, [1.0] * len(failed), "x", color="black", transform=edge, clip_on=False, label="not solved"
        )
    panels[0].set(title="to the best own method in hindsight", ylabel="time of solve() / time of the other")
    panels[1].set(title="to " + ", ".join(head.removeprefix("to ") for head in peers) if peers else "no peers")
    legend_below(figure, 5, fontsize=9)
    return figure


def profiles(table: Table) -> dict[str, Vector]:
    """Method → its factors t/t_best, increasing, on the problems that it solved; infinite on the others.

    A problem is a scene at a size which someone solved; linear solves do not take part. The share ρ(τ) of factors ≤ τ
    is the performance profile. Reference: Dolan and Moré, Math. Program. 91 (2002), doi:10.1007/s101070100263.
    """
    times: dict[str, dict[tuple[str, int], float]] = {}
    best: dict[tuple[str, int], float] = {}
    for cells in table.records():
        if cells["method"] and cells["kind"] != "limit":
            mine, problem, seconds = (
                times.setdefault(cells["method"], {}),
                (cells["scene"], cells["n"]),
                cells["time, s"],
            )
            if seconds is not None:
                mine[problem] = seconds
                best[problem] = min(seconds, best.get(problem, np.inf))
    return {
        name: np.sort([mine.get(problem, np.inf) / seconds for problem, seconds in best.items()])
        for name, mine in times.items()
    }


def profile_figure(table: Table) -> Figure:
    """The twelve best profiles of a `benchmark`, by the area below them over log τ, best first in the legend."""
    found = profiles(table)
    figure = new_figure(9, 5.4)
    axes = figure.subplots()
    areas = {name: np.log(_LARGEST / np.clip(factors, 1.0, _LARGEST)).sum() for name, factors in found.items()}
    ranked = sorted(found, key=lambda name: (name != "solve()", -areas[name]))[:_SHOWN]
    styles = [("black", "solid"), *((colour, dash) for dash in DASHES for colour in COLOURS)]
    for name, (colour, dash) in zip(ranked, styles, strict=False):
        factors = found[name]
        solved = factors[factors <= _LARGEST]
        x = np.concatenate([[1.0], solved, [_LARGEST]])
        y = np.concatenate([[0.0], np.arange(1, solved.size + 1), [solved.size]]) / max(factors.size, 1)
        width = 2.5 if name == "solve()" else 1.3
        axes.plot(x, y, drawstyle="steps-post", color=colour, linestyle=dash, linewidth=width, label=name)
    axes.set(xscale="log", xlim=(1.0, _LARGEST), ylim=(0.0, 1.02))
    axes.set(xlabel="time within this factor of the quickest", ylabel="share of the problems")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside right center", frameon=False, fontsize=8)
    return figure
