"""The figures of solutions, of vectors over their unknowns, and of the path of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Any

import numpy as np

from ...algebra.equations import pattern_at
from ...errors import InputError
from ...numerics.arrays import Mask, Vector
from ...present.shown import Plotted
from ...problem.data import ProblemData
from ...scenes import Scene
from ...scenes.registry import title
from ...solve.solution import History, Solution
from ..sensitivity import Sensitivity
from .figures import BLUE, GREEN, GREY, ORANGE, PURPLE, Drawing, Panel, drawing
from .places import PIXELS, Columns, Places, Slice, numbers, places_of

#: so many points or rows are shown one by one
FEW = 60
#: what is 0 on a logarithmic axis is drawn at, as a share of the smallest value above 0
_ZERO = 0.1
#: of a sequence of fields so many are drawn, evenly spaced
_FIELDS = 6
#: contact with an obstacle → its colour on a line and in the plane
CONTACTS = {"contact set": (GREY, "white"), "contact below": (GREY, "white"), "contact above": (PURPLE, ORANGE)}
_FORCE = "The force p = Az + q with which the obstacle pushes back: 0 where z is free."


@dataclass(frozen=True, eq=False, repr=False)
class Fields(Plotted):
    """Vectors over the unknowns of a problem, to be drawn: curves in one panel, or one field each.

    Parameters
    ----------
    problem : ICP
        The problem that has the unknowns.
    values : dict of str to array of shape (n,)
        Name → vector. In a plane at most six are drawn, evenly spaced.

    Examples
    --------
    >>> scene = icp.scenes.membrane(n=100)
    >>> values = {f"q + {c}": scene.problem.with_q(scene.problem.q + c).solve().z for c in (0.0, 0.1)}
    >>> [axes.get_title() for axes in icp.study.figure(icp.study.Fields(scene.problem, values)).axes[:2]]
    ['q + 0.0', 'q + 0.1']
    """

    problem: ProblemData
    values: Mapping[str, Vector]


@drawing.register
def _(fields: Fields, points: Any = None, shape: Any = None) -> Drawing:
    places = places_of(fields.problem, points, shape)
    values = {name: fields.problem.vector(one, name, finite=True) for name, one in fields.values.items()}
    if not values:
        raise InputError("values is empty; at least one vector was expected")
    ranges = "; ".join(f"{name}: {_range(one)}" for name, one in values.items())
    if places.planes:
        names = [*values]
        chosen = [names[k] for k in np.unique(np.linspace(0, len(names) - 1, _FIELDS).round().astype(int))]
        scale = min(values[name].min() for name in chosen), max(values[name].max() for name in chosen)
        data = {name: (values[name], name, "viridis", scale) for name in chosen}
        alt = {name: f"{name}: {_range(values[name])}." for name in chosen}
        return _in_planes(places, data, {}, alt, title(fields.problem))
    draw = partial(_curves, places, values)
    panel = Panel(draw=draw, caption="Vectors over the unknowns, the first one darkest.", alt=ranges)
    return Drawing(panels=(panel,), size=(7.2, 4.0), title=title(fields.problem))


def _curves(places: Places, values: Mapping[str, Vector], axes: Any) -> list[Any]:
    from matplotlib import colormaps

    for k, (name, one) in enumerate(values.items()):
        colour = colormaps["viridis"](0.85 * k / max(len(values) - 1, 1))
        axes.plot(places.x, one[places.rows], label=name, **_line_style(places, colour, 1.5))
    axes.set(xlabel=places.label, ylabel=places.unknown if len(values) > 1 else next(iter(values), ""))
    if len(values) > 1:
        axes.legend(frameon=False, fontsize=9)
    return _clean(axes, places)


@drawing.register(list)
@drawing.register(tuple)
def _(solutions: Any, points: Any = None, shape: Any = None) -> Drawing:
    if not solutions or not all(isinstance(one, Solution) for one in solutions):
        raise InputError("a list that is drawn holds solutions only, and at least one; use Fields for other vectors")
    values = {f"solve {k + 1}": one.z for k, one in enumerate(solutions)}
    return drawing(Fields(solutions[0].problem, values), points=points, shape=shape)


@drawing.register
def _(sensitivity: Sensitivity, points: Any = None, shape: Any = None) -> Drawing:
    if sensitivity.moved is None:
        raise InputError("the sensitivity has no picture: a changed problem was not solved")
    name = f"largest |dz| of {sensitivity.trials} changes / ({sensitivity.change:g} max |z|)"
    return drawing(Fields(sensitivity.problem, {name: sensitivity.moved}), points=points, shape=shape)


@drawing.register
def _(scene: Scene, points: Any = None, shape: Any = None) -> Drawing:
    return drawing(scene.solution(), points=points, shape=shape)


@drawing.register(Solution)
def solution_drawing(solution: Solution, points: Any = None, shape: Any = None, most: int = PIXELS) -> Drawing:
    """z, its obstacles and p over the unknowns: curves on a line, fields in the plane, slices in space.

    The contact set, the rows where z is at its obstacle rather than in balance, has rings on a line and an outline in
    the plane.
    """
    problem = solution.problem
    places = places_of(problem, points, shape, most)
    masks = contacts(problem, solution.z)
    held = " and ".join(f"{int(rows.sum())} of {rows.size} rows in the {name}" for name, rows in masks.items())
    alt = {"z": f"z {_range(solution.z)}, {held}.", "p": f"The force p {_range(solution.p)}, {held}."}
    if places.planes:
        fields = {
            "z": (solution.z, places.unknown + _outlined(masks), "viridis", None),
            "p": (solution.p, "force p", "cividis", None),
        }
        return _in_planes(places, fields, masks, alt, title(problem))
    data = columns(problem, places, solution.z, digits=17)
    return Drawing(
        panels=(
            Panel(
                draw=partial(_heights, places, data),
                caption="The answer z and its obstacle. They touch where there are rings.",
                alt=alt["z"],
            ),
            Panel(draw=partial(_forces, places, data), caption=_FORCE, alt=alt["p"]),
        ),
        size=(7.2, 4.8),
        mosaic=[[0], [1]],
        layout={"sharex": True, "height_ratios": (2, 1)},
        title=title(problem),
    )


def contacts(problem: ProblemData, z: Vector) -> dict[str, Mask]:
    """Name of the obstacle's contact → its rows."""
    _, active, above = pattern_at(problem, z)
    if above is None:
        return {"contact set": active}
    return {"contact below": active & ~above, "contact above": above}


def columns(problem: ProblemData, places: Places, z: Vector, digits: int = 5) -> dict[str, Columns]:
    """Name of an artist → the columns that it draws of an iterate z, which a slider exchanges."""
    p = problem.p(z)
    masks = contacts(problem, z)
    drawn: dict[str, Columns] = {}
    for k, plane in enumerate(places.planes):
        drawn |= {f"{name}{k}": {"value": numbers(of[plane.rows])} for name, of in (("z", z), ("p", p))}
        drawn |= {f"{name}{k}": plane.marked(mask) for name, mask in masks.items()}
    if places.planes:
        return drawn
    curves = {"psi": problem.psi.value(z), "z": z, "p": p}
    curves |= {} if problem.upper is None else {"upper": problem.upper.value(z)}
    curves |= {name: np.where(mask, z, np.nan) for name, mask in masks.items()}
    return {name: {"y": numbers(of[places.rows], digits)} for name, of in curves.items()}


def _line_style(places: Places, colour: Any, width: float, marker: str = "o") -> dict[str, Any]:
    """Rows have nothing between them: few of them are markers, many are steps."""
    many = places.x.size
    if places.by_row and many <= FEW:
        size = 6 if marker == "o" else max(400 / max(many, 8), 8)
        return {"color": colour, "linestyle": "", "marker": marker, "markersize": size}
    steps = {"drawstyle": "steps-mid"} if places.by_row else {}
    return {"color": colour, "linewidth": width, "marker": "o" if many <= FEW else "", "markersize": 3} | steps


def _heights(places: Places, data: dict[str, Columns], axes: Any) -> list[Any]:
    for name, colour, words in (("psi", ORANGE, "obstacle ψ(z)"), ("upper", PURPLE, "obstacle above")):
        if name in data:
            style = _line_style(places, colour, 2.5, "_")
            axes.plot(places.x, data[name]["y"], gid=name, label=words, **style)
    axes.plot(places.x, data["z"]["y"], gid="z", label="z", **_line_style(places, BLUE, 1.5))
    for name, (colour, _) in CONTACTS.items():
        if name in data:
            ring = {"linestyle": "", "marker": "o", "markersize": 9, "alpha": 0.3, "zorder": 0}
            seen = "_" if data[name]["y"] == [None] * places.x.size else name
            axes.plot(places.x, data[name]["y"], gid=name, label=seen, color=colour, **ring)
    for handle in axes.legend(loc="best", frameon=False, fontsize=9).legend_handles:
        if handle.get_linestyle() == "None":
            handle.set_markersize(7)
    axes.set(xlabel=places.label, ylabel=places.unknown)
    return _clean(axes, places)


def _forces(places: Places, data: dict[str, Columns], axes: Any) -> list[Any]:
    if places.by_row and places.x.size <= FEW:
        axes.vlines(places.x, 0.0, data["p"]["y"], color=GREEN, linewidth=1.5)
    axes.plot(places.x, data["p"]["y"], gid="p", label="p", **_line_style(places, GREEN, 1.5))
    axes.set(xlabel=places.label, ylabel="force p")
    return _clean(axes, places)


def _clean(axes: Any, places: Places) -> list[Any]:
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    if places.by_row:
        axes.locator_params(axis="x", integer=True)
    return []


def _in_planes(
    places: Places,
    fields: Mapping[str, tuple[Vector, str, str, tuple[float, float] | None]],
    masks: Mapping[str, Mask],
    alt: Mapping[str, str],
    heading: str,
) -> Drawing:
    """Every field (values, title, colours, their limits) in every plane; the contact of z has an outline."""
    panels = []
    for name, (values, words, colours, scale) in fields.items():
        for k, plane in enumerate(places.planes):
            marks = {contact: (f"{contact}{k}", plane.marked(mask)) for contact, mask in masks.items() if name == "z"}
            shown = f"{words}, {plane.at}" if plane.at else words
            draw = partial(_field, plane, f"{name}{k}", values[plane.rows], shown, colours, scale, marks)
            caption = _FORCE if name == "p" else "The answer z; the contact set has an outline." if masks else words
            panels.append(Panel(draw=draw, caption=caption, alt=alt[name]))
    wide = len(places.planes) if len(places.planes) > 1 else min(len(panels), 3)
    mosaic = [[min(k + i, len(panels)) for i in range(wide)] for k in range(0, len(panels), wide)]
    rows: list[list[Any]] = [[k if k < len(panels) else "." for k in row] for row in mosaic]
    size = (max(4.8 * wide, 4.8) if wide < 3 else 12.0, 4.2 * len(rows))
    share = len(places.planes) == 1 and len(panels) > 1
    layout = {"sharex": True, "sharey": True} if share else {}
    return Drawing(panels=panels, size=size, mosaic=rows, layout=layout, title=heading)


def _field(
    plane: Slice,
    name: str,
    values: Vector,
    heading: str,
    colours: str,
    scale: tuple[float, float] | None,
    marks: Mapping[str, tuple[str, Columns]],
    axes: Any,
) -> list[Any]:
    label = heading.split(",")[0]
    if plane.is_grid:
        cells = values.reshape(plane.cells)
        shown = axes.pcolormesh(*plane.axes, cells, cmap=colours, shading="nearest", rasterized=True, gid=name)
    else:
        size = 72 * min(axes.bbox.width, axes.bbox.height) / axes.figure.dpi
        style = {"cmap": colours, "s": max(size**2 / (2 * values.size), 1.0), "rasterized": True}
        shown = axes.scatter(plane.x, plane.y, c=values, gid=name, **style)
    axes.figure.colorbar(shown, ax=axes, fraction=0.046, pad=0.02, label=label)
    if scale is not None:
        shown.set_clim(*scale)
    axes.set_title(heading, fontsize=10)
    axes.set(aspect="equal", xlabel=plane.labels[0], ylabel=plane.labels[1])
    for contact, (gid, border) in marks.items():
        style = {"linewidth": 1.5} if plane.is_grid else {"linestyle": "", "marker": ".", "markersize": 3}
        axes.plot(border["x"], border["y"], gid=gid, color=CONTACTS[contact][1], **style)
    return []


def _outlined(masks: Mapping[str, Mask]) -> str:
    """What has which outline."""
    if "contact set" in masks:
        return ", contact set outlined"
    colours = {"contact below": "below (white)", "contact above": "above (orange)"}
    seen = [colours[name] for name, rows in masks.items() if rows.any()]
    return f", contact {' and '.join(seen)}" if seen else ""


def _range(values: Vector) -> str:
    return f"between {values.min():.3g} and {values.max():.3g}"


@drawing.register
def _(history: History) -> Drawing:
    """Res_D(z) of every tested iterate, the tolerance, and the iterates at which another method took over."""
    last = int(history.iteration[-1])
    ended = f"{history.residual[-1]:.2g} after {last} step{'' if last == 1 else 's'}"
    caption = "How far z is from a solution, step by step; the dashed line is the tolerance. On the logarithmic axis a "
    caption += "straight line is a fixed factor a step; a dotted line is a change of the method."
    alt = f"The residual goes from {history.residual[0]:.2g} to {ended}."
    panel = Panel(draw=partial(_residuals, history, ended), caption=caption, alt=alt)
    return Drawing(panels=(panel,), size=(6.0, 3.8))


def on_log_axis(residual: Vector) -> Vector:
    """The residuals, 0 raised to where it can be drawn."""
    above_0 = residual[residual > 0.0]
    return np.maximum(residual, _ZERO * above_0.min() if above_0.size else 1.0)


def _residuals(history: History, ended: str, axes: Any) -> list[Any]:
    shown = on_log_axis(history.residual)
    style = {"marker": "o", "markersize": 4} if shown.size <= FEW else {}
    axes.plot(history.iteration, shown, color=BLUE, linewidth=1.5, gid="path", label="residual", **style)
    axes.plot(history.iteration[-1:], shown[-1:], "o", color=BLUE, markersize=5, gid="at", label="_")
    if history.tolerance > 0.0:
        axes.axhline(history.tolerance, color=GREY, linestyle="--", linewidth=1.2, label="tolerance")
        axes.annotate("tolerance", (0.0, history.tolerance), (2, 3), textcoords="offset points", fontsize=8, color=GREY)
    for iteration, name in _changes(history):
        axes.axvline(iteration, color=GREY, linestyle=":", linewidth=1.0, label="_")
        where = {"rotation": 90, "va": "top", "ha": "right", "fontsize": 8, "color": GREY}
        axes.text(iteration, 0.98, name, transform=axes.get_xaxis_transform(), **where)
    lowest = ", 0 at the lower end" if (history.residual == 0.0).any() else ""
    axes.set(yscale="log", xlabel="iteration", ylabel=f"residual Res_D(z){lowest}")
    axes.set_title(ended, loc="right", fontsize=9)
    axes.locator_params(axis="x", integer=True)
    axes.margins(x=0.03, y=0.12)
    axes.spines[["top", "right"]].set_visible(False)
    axes.grid(alpha=0.3)
    return []


def _changes(history: History) -> Iterable[tuple[int, str]]:
    """The iterates from which another method ran, with its name; the first one where there are several."""
    names = history.method
    changed = [k for k in range(len(names)) if k == 0 or names[k] != names[k - 1]]
    return [(int(history.iteration[k]), names[k]) for k in changed] if len(changed) > 1 else []
