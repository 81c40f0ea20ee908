"""Figures of the tables, in colours that colour-blind readers can tell apart, and with markers for all others.

Reference: Okabe and Ito, Color Universal Design (2008), for the colours.
"""

from __future__ import annotations

from itertools import cycle
from typing import TYPE_CHECKING, Any

import numpy as np

from ...present.table import Table
from ..competitors import WORST

if TYPE_CHECKING:
    from matplotlib.figure import Figure

COLOURS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
#: one more than the colours, so that no pair comes twice in 42
MARKERS = ("o", "s", "^", "D", "v", "P", "X")


def scaling(table: Table) -> dict[str, Figure]:
    """Time against n of a `benchmark`, one figure for each scene of which two sizes or more were measured.

    Left `solve()`, the peers and the linear solves, right `solve()` and the own methods; only runs that reached the
    residual are shown. The label has the exponent of n, fitted through the three largest sizes.
    Returns scene → figure.
    """
    from matplotlib.figure import Figure

    found: dict[str, Figure] = {}
    for scene, lines in _lines(table).items():
        if len({n for points in lines.values() for n, _ in points}) < 2:
            continue
        figure = Figure(figsize=(10, 6.2), layout="constrained")
        left, right = figure.subplots(1, 2, sharey=True)
        _draw(left, {key: points for key, points in lines.items() if key[0] != "own"})
        _draw(right, {key: points for key, points in lines.items() if key[0] in ("solve", "own")})
        left.set_title("solve(), peers and one linear solve")
        right.set_title("solve() and single methods")
        left.set_ylabel("time to Res(z) ≤ 1e-8 Res(0), s")
        figure.suptitle(scene)
        found[scene] = figure
    return found


def memory_figure(table: Table) -> Figure:
    """Memory against n of a `memory`, one line for each scene, and the bytes of A; exponents as in `scaling`."""
    from matplotlib.figure import Figure

    lines: dict[str, list[tuple[int, float]]] = {}
    sizes: dict[str, list[tuple[int, float]]] = {}
    for scene, n, _, size, peak, *_ in table.rows:
        sizes.setdefault(scene, []).append((n, size))
        if peak > 0:
            lines.setdefault(scene, []).append((n, peak))
    figure = Figure(figsize=(7, 4.6), layout="constrained")
    axes = figure.subplots()
    for kind, found, dash in (("solve()", lines, "-"), ("A", sizes, "--")):
        for (scene, points), colour, marker in zip(found.items(), cycle(COLOURS), cycle(MARKERS), strict=False):
            power = exponent(points)
            label = f"{kind}, {scene}" + ("" if power is None else f": $n^{{{power:.2f}}}$")
            axes.plot(*zip(*points, strict=True), dash, marker=marker, color=colour, label=label, linewidth=1.2)
    axes.set_xscale("log")
    axes.set_yscale("log")
    axes.set_xlabel("number of unknowns n")
    axes.set_ylabel("memory, MiB")
    axes.grid(alpha=0.3)
    figure.legend(loc="outside lower center", ncols=2, frameon=False, fontsize=8)
    return figure


def choice(table: Table) -> Figure:
    """The ratios of a `dispatch`: one line for each scene, one marker for each size, and the bound of 1.5."""
    from matplotlib.figure import Figure

    rows = [dict(zip(table.heads, row, strict=True)) for row in table.rows]
    rows = [row for row in rows if row["ratio"] is not None]
    scenes = list(dict.fromkeys(row["scene"] for row in rows))[::-1]
    sizes = sorted({10 ** round(float(np.log10(row["n"]))) for row in rows})
    figure = Figure(figsize=(8, 1.6 + 0.28 * len(scenes)), layout="constrained")
    axes = figure.subplots()
    for size, colour, marker in zip(sizes, cycle(COLOURS), cycle(MARKERS), strict=False):
        here = [row for row in rows if 10 ** round(float(np.log10(row["n"]))) == size]
        x, y = [row["ratio"] for row in here], [scenes.index(row["scene"]) for row in here]
        label = f"n ≈ {size}" if size > 1 else "n < 4"
        axes.plot(x, y, marker, color=colour, label=label, alpha=0.85)
    axes.axvline(WORST, color="black", linestyle="--", linewidth=1)
    axes.set_xscale("log")
    ticks = [0.1, 0.2, 0.5, 0.7, 1.0, 1.5, 2.0, 3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0]
    axes.set_xticks(ticks, [f"{tick:g}" for tick in ticks], minor=False)
    axes.minorticks_off()
    ratios = [row["ratio"] for row in rows] or [1.0]
    axes.set_xlim(0.9 * min(0.5, *ratios), 1.1 * max(2.0, *ratios))
    axes.set_yticks(range(len(scenes)), scenes)
    axes.grid(axis="x", alpha=0.3)
    axes.set_xlabel("time of solve() / time of the quickest single method")
    figure.legend(loc="outside lower center", ncols=6, frameon=False)
    return figure


def exponent(points: list[tuple[int, float]]) -> float | None:
    """The exponent k of the power law t = C nᵏ through the three largest n; None with fewer than two points.

    Parameters: `points` pairs (n, t) by increasing n.
    """
    if len(points) < 2:
        return None
    n, t = np.log(np.array(points[-3:], dtype=float)).T
    return round(float(np.polyfit(n, t, 1)[0]), 12)


def _lines(table: Table) -> dict[str, dict[tuple[str, str], list[tuple[int, float]]]]:
    """scene → (kind, method) → [(n, seconds)]."""
    lines: dict[str, dict[tuple[str, str], list[tuple[int, float]]]] = {}
    for row in table.rows:
        cells = dict(zip(table.heads, row, strict=True))
        if cells["time, s"] is not None:
            methods = lines.setdefault(cells["scene"], {})
            methods.setdefault((cells["kind"], cells["method"]), []).append((cells["n"], cells["time, s"]))
    return lines


def _draw(axes: Any, lines: dict[tuple[str, str], list[tuple[int, float]]]) -> None:
    styles = zip(cycle(COLOURS), cycle(MARKERS), strict=False)
    for (kind, name), points in lines.items():
        n, seconds = zip(*points, strict=True)
        power = exponent(points)
        label = name if power is None else f"{name}: $n^{{{power:.2f}}}$"
        if kind == "solve":
            axes.plot(n, seconds, "-o", color="black", linewidth=2.5, label=label, zorder=3)
        else:
            colour, marker = next(styles)
            line = "--" if kind == "limit" else "-"
            axes.plot(n, seconds, line, marker=marker, color=colour, linewidth=1.2, markersize=5, label=label)
    axes.set_xscale("log")
    axes.set_yscale("log")
    sizes = sorted({n for points in lines.values() for n, _ in points})
    apart = [n for k, n in enumerate(sizes) if k == 0 or n > 1.8 * sizes[k - 1]]
    axes.set_xticks(apart, [f"{n}" for n in apart])
    axes.minorticks_off()
    axes.set_xlabel("number of unknowns n")
    axes.grid(alpha=0.3)
    axes.legend(loc="upper center", bbox_to_anchor=(0.5, -0.13), ncols=2, frameon=False, fontsize=8)
