"""The figures of solutions, of vectors over their unknowns, and of the path of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...algebra.equations import pattern_at
from ...derivatives.derivative import Derivative
from ...errors import InputError
from ...numerics.arrays import Mask, Vector
from ...present.shown import Plotted
from ...problem.data import ProblemData
from ...scenes import Scene
from ...scenes.registry import title
from ...solve.solution import History, Solution
from ...solve.solutions import Solutions
from ..sensitivity import Sensitivity
from .figures import BLUE, GREEN, GREY, ORANGE, PURPLE, Drawing, Panel, drawing
from .places import Places, Slice, places_of

#: so many points or rows are shown one by one
FEW = 60
#: a curve of more points is written as pixels
_VECTOR = 5000
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
    problem = fields.problem
    places = places_of(problem, points, shape)
    values = {name: problem.vector(one, name, finite=True) for name, one in fields.values.items()}
    if not values:
        raise InputError("values is empty; at least one vector was expected")
    if places.planes:
        chosen = _evenly(values)
        limits = min(one.min() for one in chosen.values()), max(one.max() for one in chosen.values())
        label = places.unknown if len(values) > 1 else next(iter(values))
        drawn = [_Field(one, name, label, name, limits=limits) for name, one in chosen.items()]
        return _in_planes(places, drawn, title(problem))
    panel = Panel(
        draw=partial(_curves, places, values),
        caption="Vectors over the unknowns, the first one darkest.",
        alt="; ".join(f"{name}: {_range(one)}" for name, one in values.items()),
    )
    return Drawing(panels=(panel,), size=(7.2, 4.0), title=title(problem))


def _evenly(values: Mapping[str, Vector]) -> dict[str, Vector]:
    """At most `_FIELDS` of the vectors."""
    names = [*values]
    return {names[k]: values[names[k]] for k in np.unique(np.linspace(0, len(names) - 1, _FIELDS).round().astype(int))}


def _curves(places: Places, values: Mapping[str, Vector], axes: Any) -> list[Any]:
    from matplotlib import colormaps

    for k, (name, one) in enumerate(values.items()):
        colour = colormaps["viridis"](0.85 * k / max(len(values) - 1, 1))
        axes.plot(places.x, one[places.rows], label=name, **_line_style(places, colour, 1.5))
    axes.set(xlabel=places.label, ylabel=places.unknown if len(values) > 1 else next(iter(values)))
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
def _(solutions: Solutions, points: Any = None, shape: Any = None) -> Drawing:
    values = _evenly({f"row {k}": z for k, z in enumerate(solutions.Z)})
    return drawing(Fields(solutions[0].problem, values), points=points, shape=shape)


@drawing.register
def _(derivative: Derivative, points: Any = None, shape: Any = None) -> Drawing:
    """The change of z as the load grows, which is −q: dz for dq = −1 in every row."""
    problem = derivative.problem
    moved = derivative.forward(dq=-np.ones(problem.n))
    return drawing(Fields(problem, {"dz/dt for q − t": moved}), points=points, shape=shape)


@drawing.register
def _(sensitivity: Sensitivity, points: Any = None, shape: Any = None) -> Drawing:
    if sensitivity.moved is None:
        raise InputError("the sensitivity has no picture: a changed problem was not solved")
    name = f"largest |dz| of {sensitivity.trials} changes / ({sensitivity.change:g} max |z|)"
    return drawing(Fields(sensitivity.problem, {name: sensitivity.moved}), points=points, shape=shape)


@drawing.register
def _(scene: Scene, points: Any = None, shape: Any = None) -> Drawing:
    return drawing(scene.solution(), points=points, shape=shape)


@drawing.register
def _(solution: Solution, points: Any = None, shape: Any = None) -> Drawing:
    """z, its obstacles and p over the unknowns: curves on a line, fields in the plane, slices in space.

    The contact set, the rows where z is at its obstacle rather than in balance, has rings on a line and an outline in
    the plane.
    """
    problem = solution.problem
    places = places_of(problem, points, shape)
    masks = _contacts(problem, solution.z)
    if places.planes:
        words = places.unknown + _outlined(masks)
        z = _Field(solution.z, words, places.unknown, "The answer z; the contact set has an outline.", masks=masks)
        p = _Field(solution.p, "force p", "force p", _FORCE, "cividis")
        return _in_planes(places, [z, p], title(problem))
    held = " and ".join(f"{int(rows.sum())} of {rows.size} rows in the {name}" for name, rows in masks.items())
    heights = Panel(
        draw=partial(_heights, places, solution, masks),
        caption="The answer z and its obstacle. They touch where there are rings.",
        alt=f"z {_range(solution.z)}, {held}.",
    )
    forces = Panel(draw=partial(_forces, places, solution.p), caption=_FORCE, alt=f"The force p {_range(solution.p)}.")
    layout = {"sharex": True, "height_ratios": (2, 1)}
    return Drawing(panels=(heights, forces), size=(7.2, 4.8), mosaic=[[0], [1]], layout=layout, title=title(problem))


def _contacts(problem: ProblemData, z: Vector) -> dict[str, Mask]:
    """Name of the obstacle's contact → its rows."""
    _, active, above = pattern_at(problem, z)
    if above is None:
        return {"contact set": active}
    return {"contact below": active & ~above, "contact above": above}


def _line_style(places: Places, colour: Any, width: float, marker: str = "o") -> dict[str, Any]:
    """Rows have nothing between them: few of them are markers, many are steps."""
    many = places.x.size
    if places.by_row and many <= FEW:
        size = 6 if marker == "o" else max(400 / max(many, 8), 8)
        return {"color": colour, "linestyle": "", "marker": marker, "markersize": size}
    style = {"color": colour, "linewidth": width, "marker": "o" if many <= FEW else "", "markersize": 3}
    return style | {"drawstyle": "steps-mid" if places.by_row else "default", "rasterized": many > _VECTOR}


def _heights(places: Places, solution: Solution, masks: Mapping[str, Mask], axes: Any) -> list[Any]:
    problem = solution.problem
    z = solution.z[places.rows]
    for psi, colour, words in ((problem.psi, ORANGE, "obstacle ψ(z)"), (problem.upper, PURPLE, "obstacle above")):
        if psi is not None:
            obstacle = psi.value(solution.z)[places.rows]
            axes.plot(places.x, obstacle, label=words, **_line_style(places, colour, 2.5, "_"))
    axes.plot(places.x, z, label="z", **_line_style(places, BLUE, 1.5))
    for name, mask in masks.items():
        here = mask[places.rows]
        if here.any():
            ring = {"linestyle": "", "marker": "o", "markersize": 9, "alpha": 0.3, "zorder": 0}
            axes.plot(places.x[here], z[here], label=name, color=CONTACTS[name][0], rasterized=z.size > _VECTOR, **ring)
    for handle in axes.legend(loc="best", frameon=False, fontsize=9).legend_handles:
        if handle.get_linestyle() == "None":
            handle.set_markersize(7)
    axes.set(xlabel=places.label, ylabel=places.unknown)
    return _clean(axes, places)


def _forces(places: Places, p: Vector, axes: Any) -> list[Any]:
    if places.by_row and places.x.size <= FEW:
        axes.vlines(places.x, 0.0, p[places.rows], color=GREEN, linewidth=1.5)
    axes.plot(places.x, p[places.rows], label="p", **_line_style(places, GREEN, 1.5))
    axes.set(xlabel=places.label, ylabel="force p")
    return _clean(axes, places)


def _clean(axes: Any, places: Places) -> list[Any]:
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    if places.by_row:
        axes.locator_params(axis="x", integer=True)
    return []


class _Field(NamedTuple):
    """A vector as colours: its title, the label of its colours, their limits, and the rows that have an outline."""

    values: Vector
    words: str
    label: str
    caption: str
    colours: str = "viridis"
    limits: tuple[float, float] | None = None
    masks: Mapping[str, Mask] = {}


def _in_planes(places: Places, fields: Sequence[_Field], heading: str) -> Drawing:
    """Every field in every plane, on one scale in all of them."""
    panels = []
    for field in fields:
        shown = np.concatenate([field.values[plane.rows] for plane in places.planes])
        limits = field.limits or (shown.min(), shown.max())
        for plane in places.planes:
            draw = partial(_field, plane, field._replace(limits=limits))
            panels.append(Panel(draw=draw, caption=field.caption, alt=f"{field.words}: {_range(field.values)}."))
    wide = len(places.planes) if len(places.planes) > 1 else min(len(panels), 3)
    rows = [[k if k < len(panels) else "." for k in range(low, low + wide)] for low in range(0, len(panels), wide)]
    share = len(places.planes) == 1 and len(panels) > 1
    layout = {"sharex": True, "sharey": True} if share else {}
    size = (4.8 * wide if wide < 3 else 12.0, 3.6 * len(rows) if wide == 3 else 4.2)
    return Drawing(panels=panels, size=size, mosaic=rows, layout=layout, title=heading)


def _field(plane: Slice, field: _Field, axes: Any) -> list[Any]:
    values = field.values[plane.rows]
    if plane.is_grid:
        cells = values.reshape(plane.cells)
        shown = axes.pcolormesh(*plane.axes, cells, cmap=field.colours, shading="nearest", rasterized=True)
    else:
        size = 72 * min(axes.bbox.width, axes.bbox.height) / axes.figure.dpi
        style = {"cmap": field.colours, "s": max(size**2 / (2 * values.size), 1.0), "rasterized": True}
        shown = axes.scatter(plane.x, plane.y, c=values, **style)
    axes.figure.colorbar(shown, ax=axes, fraction=0.046, pad=0.02, label=field.label)
    shown.set_clim(field.limits)
    axes.set_title(", ".join(filter(None, (field.words, plane.at))), fontsize=10)
    axes.set(aspect="equal", xlabel=plane.labels[0], ylabel=plane.labels[1])
    for contact, mask in field.masks.items():
        style = {"linewidth": 1.5} if plane.is_grid else {"linestyle": "", "marker": ".", "markersize": 3}
        axes.plot(*plane.marked(mask), color=CONTACTS[contact][1], **style)
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


def _residuals(history: History, ended: str, axes: Any) -> list[Any]:
    above_0 = history.residual[history.residual > 0.0]
    shown = np.maximum(history.residual, _ZERO * above_0.min() if above_0.size else 1.0)  # 0 is drawn somewhere
    style = {"marker": "o", "markersize": 4} if shown.size <= FEW else {}
    axes.plot(history.iteration, shown, color=BLUE, linewidth=1.5, label="residual", **style)
    axes.plot(history.iteration[-1:], shown[-1:], "o", color=BLUE, markersize=5, label="_")
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
