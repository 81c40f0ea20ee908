"""The figures of a solution, of a scene and of the path of a run."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ...algebra.equations import pattern_at
from ...errors import InputError
from ...methods.contract import Method
from ...numerics.arrays import Vector
from ...problem.data import ProblemData
from ...scenes import Scene
from ...scenes.registry import points_of, title
from ...solve.driver import solve
from ...solve.solution import History, Solution
from ..cases import unbroken
from .figures import BLUE, GREEN, GREY, ORANGE, PURPLE, Drawing, Panel, drawing

#: more points than this are thinned out before they are drawn: a figure has fewer pixels
_DRAWN = 200_000
#: dots on points of no grid cover half of a panel, which is about 3 inches square, in squared points
_PANEL = (3 * 72) ** 2
#: so many points or rows are shown one by one
FEW = 60
#: in figures that can be turned so many points of a curve, and so many unknowns on a line and in the plane
ON_CURVE = 200
_ON_LINE = 400
_IN_PLANE = 900
#: the iterates that are shown, in geometric progression, of 100 000 (the limit of solve) less than forty
_SHOWN = {0, *(int(1.4**k) for k in range(35))}
#: what is 0 on a logarithmic axis is drawn at, as a share of the smallest value above 0
_ZERO = 0.1
#: contact with the obstacle below and with the one above, where there are two; how they are shaded and outlined
_BELOW = "contact below"
_ABOVE = "contact above"
_SHADES = {"contact set": GREY, _BELOW: GREY, _ABOVE: PURPLE}
_SHADE = 0.25
_OUTLINES = {"contact set": "white", _BELOW: "white", _ABOVE: ORANGE}


@drawing.register
def _(solution: Solution, points: Any = None) -> Drawing:
    """z, ψ(z) and p where the unknowns are: on a line as curves, on a plane as two fields, else against the row number.

    The contact set, the rows where z is at its obstacle rather than in balance, is shaded on a line and outlined in the
    plane; where there is an obstacle above, ψ̄(z) is drawn as well, and contact with it in another colour.
    """
    n = solution.problem.n
    points = points_of(solution.problem) if points is None else np.asarray(points)
    if points is not None and points.shape not in ((n,), (n, 2)):
        raise InputError(f"points has shape {points.shape}; ({n},) or ({n}, 2) was expected")
    _, active, above = pattern_at(solution.problem, solution.z)
    contacts = {"contact set": active} if above is None else {_BELOW: active & ~above, _ABOVE: above}
    return (_line if points is None or points.ndim == 1 else _plane)(solution, points, contacts)


@drawing.register
def _(scene: Scene, points: Any = None) -> Drawing:
    return drawing(scene.solution(), points)


@drawing.register
def _(history: History, points: Any = None) -> Drawing:
    """Res_D(z) of every tested iterate."""

    above_0 = history.residual[history.residual > 0.0]
    shown = np.maximum(history.residual, _ZERO * above_0.min() if above_0.size else 1.0)

    def residuals(axes: Any) -> list[Any]:
        style = {"marker": "o", "markersize": 4} if shown.size <= FEW else {}
        axes.plot(history.iteration, shown, color=BLUE, linewidth=1.5, **style)
        axes.plot(history.iteration[-1:], shown[-1:], "o", color=BLUE, markersize=5)
        lowest = ", 0 at the lower end" if above_0.size < shown.size else ""
        axes.set(yscale="log", xlabel="iteration", ylabel=f"residual Res_D(z){lowest}")
        where = {"textcoords": "offset points", "ha": "right", "va": "top", "fontsize": 9}
        axes.annotate(ended, (history.iteration[-1], shown[-1]), (0, -7), **where)
        axes.locator_params(axis="x", integer=True)
        axes.margins(x=0.03, y=0.12)
        axes.spines[["top", "right"]].set_visible(False)
        axes.grid(alpha=0.3)
        return []

    last = int(history.iteration[-1])
    ended = f"{history.residual[-1]:.2g} after {last} step{'' if last == 1 else 's'}"
    caption = (
        "How far z is from a solution, step by step, on a logarithmic axis: a straight line is a fixed factor a step."
    )
    alt = f"The residual goes from {history.residual[0]:.2g} to {ended}."
    return Drawing(panels=(Panel(draw=residuals, caption=caption, alt=alt),), size=(6.0, 3.8))


def _line(solution: Solution, points: Vector | None, contacts: dict[str, Any]) -> Drawing:
    problem = solution.problem
    n = solution.problem.n
    x = np.arange(n, dtype=np.float64) if points is None else points
    keep = np.unique(np.linspace(0, n - 1, min(n, _DRAWN)).astype(int))
    middles = (x[:-1] + x[1:]) / 2
    apart = x[1] - x[0] if n > 1 else 1.0
    ends = np.concatenate([[x[0] - apart / 2], middles, [x[-1] + apart / 2]])
    single = points is None and n <= FEW  # rows have nothing between them

    def style(width: float, sign: str = "o") -> dict[str, Any]:
        if single:
            return {"linestyle": "", "marker": sign, "markersize": 6 if sign == "o" else max(400 / max(n, 8), 8)}
        drawn = {"drawstyle": "steps-mid"} if points is None else {}
        return {"linewidth": width, "marker": "o" if n <= FEW else "", "markersize": 3} | drawn

    def heights(axes: Any) -> list[Any]:
        for psi, colour, label in ((problem.psi, ORANGE, "obstacle ψ(z)"), (problem.upper, PURPLE, "obstacle above")):
            if psi is not None:
                value = psi.value(solution.z)
                value = np.where(np.isfinite(value), value, np.nan)
                axes.plot(x[keep], value[keep], color=colour, label=label, **style(2.5, "_"))
        axes.plot(x[keep], solution.z[keep], color=BLUE, label="z", **style(1.5))
        _dressed(axes, "z", ends, contacts, points is None)
        for name, rows in contacts.items():
            if rows.any():
                axes.fill_between([], [], facecolor=_SHADES[name], alpha=_SHADE, linewidth=0, label=name)
        for handle in axes.legend(loc="best", frameon=False, fontsize=9).legend_handles:
            if single and hasattr(handle, "set_markersize"):
                handle.set_markersize(7)
        return []

    def forces(axes: Any) -> list[Any]:
        if single:
            axes.vlines(x, 0.0, solution.p, color=GREEN, linewidth=1.5)
        axes.plot(x[keep], solution.p[keep], color=GREEN, **style(1.5))
        _dressed(axes, "force p", ends, contacts, points is None)
        return []

    caption = "The answer z and its obstacle. They touch where it is shaded, or has a ring."
    return Drawing(
        panels=(
            Panel(draw=heights, caption=caption, alt=_told("z", solution.z, contacts)),
            Panel(draw=forces, caption=_PUSHES, alt=_told("The force p", solution.p, contacts)),
        ),
        size=(7.2, 4.8),
        mosaic=[[0], [1]],
        layout={"sharex": True, "height_ratios": (2, 1)},
        title=title(problem),
    )


def _dressed(axes: Any, label: str, ends: Vector, contacts: dict[str, Any], by_row: bool) -> None:
    """Contact shaded between the `ends` of its rows, and the axes named."""
    across = {"transform": axes.get_xaxis_transform(), "fill": True, "linewidth": 0, "zorder": 0, "alpha": _SHADE}
    for name, rows in contacts.items():  # a single row is shaded, too
        shade = axes.stairs(rows.astype(float), ends, color=_SHADES[name], **across)
        shade.sticky_edges.y.clear()  # or the axis would begin at 0
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.set(ylabel=label, xlabel="row" if by_row else "x")
    if by_row:
        axes.locator_params(axis="x", integer=True)


_PUSHES = "The force p = Az + q with which the obstacle pushes back: 0 where z is free."


def _told(name: str, values: Vector, contacts: dict[str, Any]) -> str:
    held = " and ".join(f"{int(rows.sum())} of {rows.size} rows in the {words}" for words, rows in contacts.items())
    return f"{name} between {values.min():.3g} and {values.max():.3g}, {held}."


def _plane(solution: Solution, points: Any, contacts: dict[str, Any]) -> Drawing:
    x = points[:, 0]
    y = points[:, 1]
    columns = np.unique(x)
    rows = np.unique(y)
    regular = columns.size * rows.size == x.size

    def field(values: Any) -> Any:
        found = np.empty((rows.size, columns.size))
        found[np.searchsorted(rows, y), np.searchsorted(columns, x)] = values
        return found

    def half(values: Vector, heading: str, colours: str, outlined: dict[str, Any], axes: Any) -> list[Any]:
        if regular:
            shown = axes.pcolormesh(columns, rows, field(values), cmap=colours, shading="nearest", rasterized=True)
        else:
            size = max(_PANEL / (2 * x.size), 1.0)
            shown = axes.scatter(x, y, c=values, cmap=colours, s=size, rasterized=True)
        axes.figure.colorbar(shown, ax=axes, pad=0.01)
        axes.set_title(heading, fontsize=10)
        axes.set(aspect="equal", xlabel="x", ylabel="y")
        for name, contact in outlined.items():
            if regular and contact.any() and not contact.all() and min(columns.size, rows.size) > 1:
                axes.contour(columns, rows, field(contact), [0.5], colors=_OUTLINES[name], linewidths=1.5)
        return []

    heading = f"z, {_outlined(contacts)}" if regular else "z"
    heights = partial(half, solution.z, heading, "viridis", contacts)
    caption = "The answer z; where it touches its obstacle it has an outline, or dots." if regular else "The answer z."
    return Drawing(
        panels=(
            Panel(draw=heights, caption=caption, alt=_told("z", solution.z, contacts)),
            Panel(
                draw=partial(half, solution.p, "force p", "cividis", {}),
                caption=_PUSHES,
                alt=_told("The force p", solution.p, contacts),
            ),
        ),
        size=(9.6, 4.2),
        mosaic=[[0, 1]],
        layout={"sharex": True, "sharey": True},
        title=title(solution.problem),
    )


def _outlined(contacts: dict[str, Any]) -> str:
    """What has which outline."""
    if len(contacts) == 1:
        return "contact set outlined"
    colours = {_BELOW: "below (white)", _ABOVE: "above (orange)"}
    return "contact " + " and ".join(colours[name] for name, rows in contacts.items() if rows.any())


def numbers(values: Any) -> list[float | None]:
    """To five digits, for JSON: None where there is none."""
    return [float(f"{one:.5g}") if np.isfinite(one) else None for one in np.asarray(values, dtype=np.float64).tolist()]


def turned_rows(n: int, places: Vector | None) -> tuple[Any, dict[str, Any], tuple[float, float] | None]:
    """The rows that are drawn, evenly, the columns that say where, and in the plane the width and height of a cell."""
    if places is None or places.ndim == 1:
        rows = np.unique(np.linspace(0, n - 1, min(n, _ON_LINE)).astype(int))
        return rows, {"x": rows if places is None else places[rows]}, None
    ranks = [np.unique(of, return_inverse=True)[1] for of in places.T]
    step = int(np.ceil((n / _IN_PLANE) ** 0.5))
    many = [int(rank.max()) + 1 for rank in ranks]
    rows = np.flatnonzero((ranks[0] % step == 0) & (ranks[1] % step == 0))
    if many[0] * many[1] != n:  # no grid
        many = [int(n**0.5) + 1] * 2
    width, height = step * np.ptp(places, axis=0) / np.maximum(np.array(many) - 1, 1)
    return rows, dict(zip("xy", places[rows].T, strict=True)), (float(width) or 1.0, float(height) or 1.0)


def turned_run(problem: ProblemData, rows: Any, method: Method, z0: Any, time_limit: float) -> dict[str, Any]:
    """The "data" and "frames" of a run of the `method`. Raises IcpError."""
    frames = {}

    def look(now: Any) -> None:
        if now.iteration in _SHOWN:
            frames[now.iteration] = frame(problem, rows, now.z, now.iteration, now.residual)

    options: dict[str, Any] = {"z0": z0, "time_limit": time_limit, "history": True, "raise_on_failure": False}
    found = unbroken(solve(problem, method, callback=look, **options))
    frames[found.iterations] = last = frame(problem, rows, found.z, found.iterations, found.residual)
    last["says"] += f"; {found.status.value}"
    some = np.unique(np.linspace(0, found.history.residual.size - 1, ON_CURVE).astype(int))
    steps = found.history.iteration[some].tolist()
    residual = found.history.residual[some]
    shown = np.maximum(residual, _ZERO * residual[residual > 0.0].min(initial=1.0))
    way = {"step": steps, "residual": numbers(shown), "told": [f"{one:.2g}" for one in residual]}
    return {"data": {"way": way}, "frames": [*frames.values()]}


def frame(problem: ProblemData, rows: Any, z: Vector, step: int | None, residual: float) -> dict[str, Any]:
    """What a slider says and shows of an iterate, or of the answer, which has no `step`."""
    _, active, above = pattern_at(problem, z)
    fields = {"z": z, "p": problem.p(z), "psi": problem.psi.value(z)}
    masks = {"below": active} if above is None else {"below": active & ~above, "above": above}
    fields |= {} if problem.upper is None else {"upper": problem.upper.value(z)}
    columns = {name: numbers(values[rows]) for name, values in fields.items()}
    columns |= {name: mask[rows].astype(int).tolist() for name, mask in masks.items()}
    at = {"step": [step or 0], "residual": numbers([residual or np.nan]), "told": [f"{residual:.2g}"]}
    begin = "the answer" if step is None else f"step {step}"
    says = f"{begin}: residual {residual:.2g}, {int(active.sum())} of {z.size} rows in contact"
    return {"says": says, "data": {"points": columns, "at": at}}
