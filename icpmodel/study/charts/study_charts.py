"""The figures of a solution, of a race and of a stability map."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from ...algebra.equations import pattern_at
from ...errors import InputError
from ...numerics.arrays import Vector, described
from ...solve.driver import RTOL
from ...solve.solution import Solution
from ..competitors import Entry
from ..planes import Axis, Plane
from .figures import BLUE, GREEN, ORANGE, PURPLE, SKY, YELLOW, Figure, legend_below, looks, new_figure

#: more points than this are thinned out before they are drawn: a figure has fewer pixels
_DRAWN = 200_000
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
#: contact with the obstacle below and with the one above, where there are two; how they are shaded and outlined
_BELOW, _ABOVE = "contact below", "contact above"
_SHADES = {"contact set": "0.85", _BELOW: "0.85", _ABOVE: "#EBD3E1"}
_OUTLINES = {"contact set": "white", _BELOW: "white", _ABOVE: ORANGE}


def solution_figure(solution: Solution, points: Vector | None = None) -> Figure:
    """z, ψ(z) and p where the unknowns are: on a line as curves, on a plane as two fields, else against the row number.

    The contact set, the rows where z is at its obstacle rather than in balance, is shaded on a line and outlined in the
    plane; where there is an obstacle above, ψ̄(z) is drawn as well, and contact with it in another colour.
    Parameters: `solution`; `points` the coordinates of the unknowns, shape (n,), (n, 2) or None, as `Scene.points` has
    them. Returns a matplotlib figure. Raises InputError for points of another shape.

    >>> square = icp.scenes.membrane(n=100)
    >>> [axes.get_title() for axes in icp.study.solution_figure(square.problem.solve(), square.points).axes[:2]]
    ['z, contact set outlined', 'p']
    """
    if not isinstance(solution, Solution):
        raise InputError(f"solution is {described(solution)}; a Solution was expected")
    n = solution.problem.n
    if points is not None and np.shape(points) not in ((n,), (n, 2)):
        raise InputError(f"points has shape {np.shape(points)}; ({n},) or ({n}, 2) was expected")
    _, active, above = pattern_at(solution.problem, solution.z)
    contacts = {"contact set": active} if above is None else {_BELOW: active & ~above, _ABOVE: above}
    flat = points is None or np.ndim(points) == 1
    return _line(solution, points, contacts) if flat else _plane(solution, points, contacts)


def _line(solution: Solution, points: Vector | None, contacts: dict[str, Any]) -> Figure:
    figure, n = new_figure(8.2, 5.0), solution.problem.n
    x = np.arange(n, dtype=np.float64) if points is None else points
    style = {"drawstyle": "steps-mid"} if points is None else {}
    if n <= 60:
        style["marker"] = "o"
    keep = np.unique(np.linspace(0, n - 1, min(n, _DRAWN)).astype(int))
    above, below = figure.subplots(2, 1, sharex=True, height_ratios=(2, 1))
    psi = solution.problem.psi.value(solution.z)
    psi = np.where(np.isfinite(psi), psi, np.nan)
    above.plot(x[keep], psi[keep], color=ORANGE, label="obstacle ψ(z)", linewidth=2.5, markersize=5, **style)
    if solution.problem.upper is not None:
        top = solution.problem.upper.value(solution.z)
        top = np.where(np.isfinite(top), top, np.nan)
        above.plot(x[keep], top[keep], color=PURPLE, label="obstacle above", linewidth=2.5, markersize=5, **style)
    above.plot(x[keep], solution.z[keep], color=BLUE, label="z", linewidth=1.5, markersize=3, **style)
    below.plot(x[keep], solution.p[keep], color=GREEN, markersize=3, **style)
    middles = (x[:-1] + x[1:]) / 2
    ends = np.concatenate([x[:1], middles, x[-1:]]) if n > 1 else x[0] + np.array([-0.5, 0.5])
    for k, axes in enumerate((above, below)):
        across = {"transform": axes.get_xaxis_transform(), "fill": True, "linewidth": 0, "zorder": 0}
        for name, rows in contacts.items():  # a single row is shaded, too
            shade = axes.stairs(rows.astype(float), ends, color=_SHADES[name], **across)
            shade.sticky_edges.y.clear()  # or the axis would begin at 0
        axes.grid(alpha=0.3)
        axes.set_ylabel(("z", "force p")[k])
    for name, rows in contacts.items():
        if rows.any():
            above.fill_between([], [], facecolor=_SHADES[name], edgecolor="0.5", linewidth=0.5, label=name)
    above.legend(loc="best", frameon=False)
    below.set_xlabel("row" if points is None else "x")
    if points is None:
        below.locator_params(axis="x", integer=True)
    return figure


def _plane(solution: Solution, points: Any, contacts: dict[str, Any]) -> Figure:
    figure = new_figure(9.6, 4.2)
    left, right = figure.subplots(1, 2, sharex=True, sharey=True)
    x, y = points[:, 0], points[:, 1]
    columns, rows = np.unique(x), np.unique(y)
    regular = columns.size * rows.size == x.size

    def field(values: Any) -> Any:
        found = np.empty((rows.size, columns.size))
        found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
        return found

    halves = (left, solution.z, f"z, {_outlined(contacts)}", "viridis"), (right, solution.p, "p", "cividis")
    for axes, values, title, colours in halves:
        if regular:
            shown = axes.pcolormesh(columns, rows, field(values), cmap=colours, shading="nearest", rasterized=True)
        else:
            shown = axes.scatter(x, y, c=values, cmap=colours, s=4, rasterized=True)
        figure.colorbar(shown, ax=axes, pad=0.01)
        axes.set(title=title, aspect="equal", xlabel="x")
    left.set_ylabel("y")
    for name, contact in contacts.items():
        if regular and contact.any() and not contact.all() and min(columns.size, rows.size) > 1:
            left.contour(columns, rows, field(contact), [0.5], colors=_OUTLINES[name], linewidths=1.5)
    return figure


def _outlined(contacts: dict[str, Any]) -> str:
    """What has which outline."""
    if len(contacts) == 1:
        return "contact set outlined"
    colours = {_BELOW: "below (white)", _ABOVE: "above (orange)"}
    return "contact " + " and ".join(colours[name] for name, rows in contacts.items() if rows.any())


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


def map_figure(
    plane: Plane, ends: Any, steps: Any, proved: dict[str, Any], printed: Any, max_iter: int, rtol: float
) -> Figure:
    """Steps as colours, failures as signs on white, and a line around the points where each theorem proves convergence.

    A red line encloses what the paper, as printed, says to converge, where that is more than is proved; `printed` is
    the mask of all its theorems together.
    """
    from matplotlib.colors import LogNorm
    from matplotlib.lines import Line2D

    figure = new_figure(8.2, 5.4)
    axes = figure.subplots()
    x, y = plane.x, plane.y
    solved = ends == "solved"
    counts = np.ma.masked_where(~solved, np.maximum(steps, 1))
    least = int(counts.min()) if solved.any() else max_iter
    norm = LogNorm(least, max(int(counts.max()) if solved.any() else 1, 10 * least))  # at least a factor of ten apart
    mesh = axes.pcolormesh(_edges(x), _edges(y), counts, cmap="viridis_r", norm=norm)
    figure.colorbar(mesh, ax=axes, label=f"steps to Res(z) ≤ {rtol:g} Res(0)", pad=0.01)
    handles = []
    X, Y = np.meshgrid(x.values, y.values)
    for end, (sign, words) in _SIGNS.items():
        here = ends == end
        if here.any():
            style: dict[str, Any] = {"linestyle": "", "marker": sign, "color": "0.25"}
            axes.plot(X[here], Y[here], markersize=5, **style)
            handles.append(Line2D([], [], markersize=7, label=words.format(max_iter=max_iter), **style))
    alike: dict[bytes, list[str]] = {}  # theorems that prove the same points have one line
    for name, mask in proved.items():
        alike.setdefault(mask.tobytes(), []).append(name)
    for names in alike.values():
        mask, (colour, dashes) = proved[names[0]], _LINES[names[-1]]
        if mask.any():
            _outline(axes, x, y, mask, colors=[colour], linestyles=[dashes], linewidths=2.0)
            label = f"proved: {', '.join(names)}"
            handles.append(Line2D([], [], color=colour, linestyle=dashes, linewidth=2.0, label=label))
    if (printed & ~np.any([*proved.values()], axis=0)).any():
        _outline(axes, x, y, printed, colors=[_FALSE], linewidths=3.0, zorder=1.5)
        handles.append(Line2D([], [], color=_FALSE, linewidth=3.0, label="said to converge, as printed (false)"))
    axes.set(xscale="log" if x.log else "linear", yscale="log" if y.log else "linear", xlabel=x.label, ylabel=y.label)
    axes.set_title(plane.title, fontsize=10)
    legend_below(figure, 3, handles=handles)
    return figure


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
