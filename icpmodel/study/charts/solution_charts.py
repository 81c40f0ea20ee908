"""The figures of solutions, of vectors over their unknowns, and of the history of a run."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from functools import partial
from typing import Any

import numpy as np

from ...algebra.equations import Pattern
from ...derivatives.derivative import Derivative
from ...errors import InputError
from ...numerics.arrays import Mask, Vector
from ...present.display import counted
from ...problem.data import ProblemData
from ...scenes import Scene
from ...scenes.registry import title
from ...solve.solution import History, Solution
from ...solve.solutions import Solutions
from ..sensitivity import Sensitivity
from .field_charts import (
    CONTACT_STYLES,
    MAX_VECTOR_POINTS,
    Field,
    Fields,
    evenly_spaced,
    in_planes,
    in_words,
    line_style,
    style_axes,
)
from .figures import BLUE, GREEN, GREY, ORANGE, PURPLE, ZERO_SHARE, Drawing, Panel, drawing
from .places import MAX_MARKED_POINTS, Places, places_of

_FORCE = "The force p with which the obstacle pushes back: 0 where z is free."


@drawing.register(list)
@drawing.register(tuple)
def _(solutions: Any, **where: Any) -> Drawing:
    if not solutions or not all(isinstance(one, Solution) for one in solutions):
        raise InputError("a list that is drawn holds solutions only, and at least one; use Fields for other vectors")
    values = {f"solve {k + 1}": one.z for k, one in enumerate(solutions)}
    return drawing(Fields(solutions[0].problem, values), **where)


@drawing.register
def _(solutions: Solutions, **where: Any) -> Drawing:
    values = evenly_spaced({f"row {k}": z for k, z in enumerate(solutions.Z)})
    return drawing(Fields(solutions[0].problem, values), **where)


@drawing.register
def _(derivative: Derivative, **where: Any) -> Drawing:
    """The derivative of z as the load −q grows: dz for dq = −1 in every row."""
    problem = derivative.problem
    moved = derivative.forward(dq=-np.ones(problem.n))
    return drawing(Fields(problem, {"dz/dt for q − t": moved}), **where)


@drawing.register
def _(sensitivity: Sensitivity, **where: Any) -> Drawing:
    if sensitivity.rows is None:
        raise InputError("the sensitivity has no picture: the equations of the active set are singular")
    name = "condition number of each entry" + ("" if sensitivity.exact else ", from below")
    return drawing(Fields(sensitivity.problem, {name: sensitivity.rows}), **where)


@drawing.register
def _(scene: Scene, **where: Any) -> Drawing:
    return drawing(scene.solution(), **where)


@drawing.register
def _(solution: Solution, points: Any = None, shape: Any = None) -> Drawing:
    """z and p over the unknowns: curves on a line, with the obstacles; fields in the plane; slices in space.

    The contact set, the rows where z is at its obstacle, is marked by rings on a line and by an outline in the plane.
    """
    problem = solution.problem
    places = places_of(problem, points, shape)
    masks = _contacts(problem, solution.z)
    force = _without_rounding(solution)
    if places.planes:
        words = places.unknown + _outline(masks)
        z = Field(solution.z, words, places.unknown, "The answer z; the contact set has an outline.", masks=masks)
        p = Field(force, "force p", "force p", _FORCE, "cividis")
        return in_planes(places, [z, p], title(problem))
    contacts = " and ".join(f"{int(rows.sum())} of {rows.size} rows in the {name}" for name, rows in masks.items())
    heights = Panel(
        draw=partial(_heights, places, solution, masks),
        caption="The answer z and its obstacle. They touch where there are rings.",
        alt=f"z {in_words(solution.z)}, {contacts}.",
    )
    forces = Panel(draw=partial(_forces, places, force), caption=_FORCE, alt=f"The force p {in_words(force)}.")
    layout = {"sharex": True, "height_ratios": (2, 1)}
    return Drawing(panels=(heights, forces), size=(7.2, 4.8), mosaic=[[0], [1]], layout=layout, title=title(problem))


def _contacts(problem: ProblemData, z: Vector) -> dict[str, Mask]:
    """Name of each contact set, one for each obstacle → the mask of its rows."""
    _, active, above = Pattern.at(problem, z)
    if above is None:
        return {"contact set": active}
    return {"contact below": active & ~above, "contact above": above}


def _without_rounding(solution: Solution) -> Vector:
    """p, with 0 where |p_i| is at most its rounding error."""
    in_p, _ = solution.problem.rounding(solution.z)
    return np.where(np.abs(solution.p) <= in_p, 0.0, solution.p)


def _heights(places: Places, solution: Solution, masks: Mapping[str, Mask], axes: Any) -> list[Any]:
    problem = solution.problem
    z = solution.z[places.rows]
    for psi, colour, words in ((problem.psi, ORANGE, "obstacle ψ(z)"), (problem.upper, PURPLE, "upper obstacle")):
        obstacle = None if psi is None else psi.value(solution.z)[places.rows]
        if obstacle is not None and np.isfinite(obstacle).any():
            axes.plot(places.x, obstacle, label=words, **line_style(places, colour, 2.5, "_"))
    axes.plot(places.x, z, label="z", **line_style(places, BLUE, 1.5))
    for name, mask in masks.items():
        contact = mask[places.rows]
        if contact.any():
            ring = {"linestyle": "", "marker": "o", "markersize": 13, "alpha": 0.35, "zorder": 0}
            ring |= {"label": name, "color": CONTACT_STYLES[name][0], "rasterized": z.size > MAX_VECTOR_POINTS}
            axes.plot(places.x[contact], z[contact], **ring)
    for handle in axes.legend(loc="best", frameon=False, fontsize=9).legend_handles:
        if handle.get_linestyle() == "None":
            handle.set_markersize(7)
    axes.set(xlabel=places.label, ylabel=places.unknown)
    return style_axes(axes, whole=places.by_row)


def _forces(places: Places, p: Vector, axes: Any) -> list[Any]:
    if places.by_row and places.x.size <= MAX_MARKED_POINTS:
        axes.vlines(places.x, 0.0, p[places.rows], color=GREEN, linewidth=1.5)
    axes.plot(places.x, p[places.rows], label="p", **line_style(places, GREEN, 1.5))
    axes.set(xlabel=places.label, ylabel="force p")
    return style_axes(axes, whole=places.by_row)


def _outline(masks: Mapping[str, Mask]) -> str:
    """The part of a title that explains the outlines, if there are any."""
    if "contact set" in masks:
        return ", contact set outlined"
    colours = {"contact below": "below (white)", "contact above": "above (orange)"}
    outlines = [colours[name] for name, rows in masks.items() if rows.any()]
    return f", contact {' and '.join(outlines)}" if outlines else ""


@drawing.register
def _(history: History) -> Drawing:
    """Res_D(z) of every tested iterate, the tolerance, and the iterates from which another method ran."""
    last = int(history.iteration[-1])
    ended = f"{history.residual[-1]:.2g} after {counted(last, 'step')}"
    caption = "How far z is from a solution, step by step; the dashed line is the tolerance. On the logarithmic axis a "
    caption += "straight line is a fixed factor a step; a dotted line is a change of the method."
    alt = f"The residual goes from {history.residual[0]:.2g} to {ended}."
    panel = Panel(draw=partial(_residuals, history, ended), caption=caption, alt=alt)
    return Drawing(panels=(panel,), size=(6.0, 3.8))


def _residuals(history: History, ended: str, axes: Any) -> list[Any]:
    positive = history.residual[history.residual > 0.0]
    drawn = [*positive, history.tolerance] if history.tolerance > 0.0 else [*positive]
    zero = ZERO_SHARE * min(drawn, default=1.0 / ZERO_SHARE)
    residuals = np.maximum(history.residual, zero)
    style = {"marker": "o", "markersize": 4} if residuals.size <= MAX_MARKED_POINTS else {}
    axes.plot(history.iteration, residuals, color=BLUE, linewidth=1.5, label="residual", **style)
    axes.plot(history.iteration[-1:], residuals[-1:], "o", color=BLUE, markersize=5, label="_")
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
    axes.margins(x=0.03, y=0.12)
    return style_axes(axes, whole=True)


def _changes(history: History) -> Iterable[tuple[int, str]]:
    """(iteration, name) of each change of method, the first method included; empty if there was only one."""
    names = history.method
    changed = [k for k in range(len(names)) if k == 0 or names[k] != names[k - 1]]
    return [(int(history.iteration[k]), names[k]) for k in changed] if len(changed) > 1 else []
