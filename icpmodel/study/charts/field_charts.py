"""Vectors over the unknowns of a problem: curves on a line, fields in the plane, slices in space."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import Any, NamedTuple

import numpy as np

from ...errors import InputError, check_arguments
from ...numerics.arrays import Mask, Vector
from ...present.display import Plottable
from ...problem.data import ProblemData
from ...scenes.registry import title
from .figures import GREY, ORANGE, PURPLE, Drawing, Panel, drawing
from .places import MAX_MARKED_POINTS, Places, Slice, places_of

#: a curve with more points is rasterised
MAX_VECTOR_POINTS = 5000
#: the largest number of fields of a sequence that are drawn, evenly spaced
_MAX_FIELDS = 6
#: contact with an obstacle → its colour on a line and in the plane
CONTACT_STYLES = {"contact set": (GREY, "white"), "contact below": (GREY, "white"), "contact above": (PURPLE, ORANGE)}


@check_arguments
@dataclass(frozen=True, eq=False, repr=False)
class Fields(Plottable):
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
    >>> values = {
    ...     f"q + {c}": scene.problem.with_q(scene.problem.q + c).solve().z
    ...     for c in (0.0, 0.1)
    ... }
    >>> [
    ...     axes.get_title()
    ...     for axes in icp.study.figure(icp.study.Fields(scene.problem, values)).axes[:2]
    ... ]
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
        chosen = evenly_spaced(values)
        limits = min(one.min() for one in chosen.values()), max(one.max() for one in chosen.values())
        label = places.unknown if len(values) > 1 else next(iter(values))
        chosen_fields = [Field(one, name, label, name, limits=limits) for name, one in chosen.items()]
        return in_planes(places, chosen_fields, title(problem))
    panel = Panel(
        draw=partial(_curves, places, values),
        caption="Vectors over the unknowns, the first one darkest.",
        alt="; ".join(f"{name}: {in_words(one)}" for name, one in values.items()),
    )
    return Drawing(panels=(panel,), size=(7.2, 4.0), title=title(problem))


def evenly_spaced(values: Mapping[str, Vector]) -> dict[str, Vector]:
    """At most `_MAX_FIELDS` of the vectors, evenly spaced, by name."""
    names = [*values]
    chosen = np.unique(np.linspace(0, len(names) - 1, _MAX_FIELDS).round().astype(int))
    return {names[k]: values[names[k]] for k in chosen}


def _curves(places: Places, values: Mapping[str, Vector], axes: Any) -> list[Any]:
    from matplotlib import colormaps

    for k, (name, one) in enumerate(values.items()):
        colour = colormaps["viridis"](0.85 * k / max(len(values) - 1, 1))
        axes.plot(places.x, one[places.rows], label=name, **line_style(places, colour, 1.5))
    axes.set(xlabel=places.label, ylabel=places.unknown if len(values) > 1 else next(iter(values)))
    if len(values) > 1:
        axes.legend(frameon=False, fontsize=9)
    return style_axes(axes, whole=places.by_row)


def line_style(places: Places, colour: Any, width: float, marker: str = "o") -> dict[str, Any]:
    """The options of `Axes.plot` for a curve; by row number, few values are markers and many are steps, not lines."""
    count = places.x.size
    if places.by_row and count <= MAX_MARKED_POINTS:
        size = 6 if marker == "o" else max(400 / max(count, 8), 8)
        return {"color": colour, "linestyle": "", "marker": marker, "markersize": size}
    style = {"color": colour, "linewidth": width, "marker": "o" if count <= MAX_MARKED_POINTS else "", "markersize": 3}
    return style | {"drawstyle": "steps-mid" if places.by_row else "default", "rasterized": count > MAX_VECTOR_POINTS}


def style_axes(axes: Any, whole: bool) -> list[Any]:
    """Draw a grid without a frame. If `whole`, x ticks are whole numbers, with half a unit of room on either side.

    Returns an empty list: no handles for a legend.
    """
    axes.grid(alpha=0.3)
    axes.spines[["top", "right"]].set_visible(False)
    if whole:
        axes.locator_params(axis="x", integer=True, min_n_ticks=1)
        low, high = axes.get_xlim()
        axes.set_xlim(min(low, axes.dataLim.x0 - 0.5), max(high, axes.dataLim.x1 + 0.5))
    return []


class Field(NamedTuple):
    """A vector drawn as colours: title (`words`), label of the scale, caption, colour map, limits, rows to outline."""

    values: Vector
    words: str
    label: str
    caption: str
    colours: str = "viridis"
    limits: tuple[float, float] | None = None
    masks: Mapping[str, Mask] = {}


def in_planes(places: Places, fields: Sequence[Field], heading: str) -> Drawing:
    """The drawing of every field in every plane; a field has the same colour scale in all planes."""
    panels = []
    for field in fields:
        values = np.concatenate([field.values[plane.rows] for plane in places.planes])
        limits = field.limits or (values.min(), values.max())
        for plane in places.planes:
            draw = partial(_field, plane, field._replace(limits=limits))
            panels.append(Panel(draw=draw, caption=field.caption, alt=f"{field.words}: {in_words(field.values)}."))
    columns = len(places.planes) if len(places.planes) > 1 else min(len(panels), 3)
    rows: list[list[Any]] = [
        [k if k < len(panels) else "." for k in range(low, low + columns)] for low in range(0, len(panels), columns)
    ]
    share = len(places.planes) == 1 and len(panels) > 1
    layout = {"sharex": True, "sharey": True} if share else {}
    size = (4.8 * columns if columns < 3 else 12.0, 3.6 * len(rows) if columns == 3 else 4.2)
    return Drawing(panels=panels, size=size, mosaic=rows, layout=layout, title=heading)


def _field(plane: Slice, field: Field, axes: Any) -> list[Any]:
    values = field.values[plane.rows]
    if plane.is_grid:
        cells = values.reshape(plane.cells)
        artist = axes.pcolormesh(*plane.axes, cells, cmap=field.colours, shading="nearest", rasterized=True)
    else:
        size = 72 * min(axes.bbox.width, axes.bbox.height) / axes.figure.dpi
        style = {"cmap": field.colours, "s": max(size**2 / (2 * values.size), 1.0), "rasterized": True}
        artist = axes.scatter(plane.x, plane.y, c=values, **style)
    axes.figure.colorbar(artist, ax=axes, fraction=0.046, pad=0.02, label=field.label)
    artist.set_clim(field.limits)
    axes.set_title(", ".join(filter(None, (field.words, plane.at))), fontsize=10)
    axes.set(aspect="equal", xlabel=plane.labels[0], ylabel=plane.labels[1])
    for contact, mask in field.masks.items():
        style = {"linewidth": 1.5} if plane.is_grid else {"linestyle": "", "marker": ".", "markersize": 3}
        axes.plot(*plane.marked(mask), color=CONTACT_STYLES[contact][1], **style)
    return []


def in_words(values: Vector) -> str:
    """The range of the `values`, for the text of a picture."""
    return f"between {values.min():.3g} and {values.max():.3g}"
