"""A panel that Matplotlib draws, as a Bokeh chart: one can point at it, zoom, hide what has a name, and move a slider.

The panel is drawn into axes that nobody sees. Each artist in them becomes a glyph with the same data, colours and name.
An artist with a gid becomes a source of that name, whose columns a slider exchanges.
"""

from __future__ import annotations

from collections.abc import Sequence
from importlib.util import find_spec
from typing import Any

import numpy as np

from .figures import ALONE, Panel, new_figure

#: marker of matplotlib → that of Bokeh; any other one is a circle
_MARKERS = {
    "s": "square",
    "^": "triangle",
    "D": "diamond",
    "v": "inverted_triangle",
    "P": "plus",
    "X": "x",
    "x": "x",
    "*": "star",
    ".": "dot",
    "_": "dash",
    "1": "inverted_triangle",
    "2": "triangle",
    "$+$": "cross",
    "$?$": "square_x",
    "$\\circ$": "circle_dot",
    "$\\ast$": "asterisk",
    "$/$": "diamond_cross",
}
#: what is neither a series nor text, on a light page and on a dark one
_BETWEEN = "#8a9099"
#: what has this tag gets the colour of the page's text
_INK = "ink"
_DASHES = {"-": "solid", "--": "dashed", ":": "dotted", "-.": "dashdot"}
#: pixels per inch of a chart
_SCALE = 110


def is_installed() -> bool:
    """Whether Bokeh is, which comes with the extra "report"."""
    return find_spec("bokeh") is not None


def chart(panel: Panel) -> Any:
    """The panel as a Bokeh figure.

    Parameters
    ----------
    panel : Panel
        The panel. Its lines, error bars, fields and scattered points are translated; texts are not.

    Returns
    -------
    bokeh.plotting.figure
        The chart.
    """
    from bokeh.models import HoverTool
    from bokeh.plotting import figure
    from matplotlib.collections import LineCollection, PathCollection, QuadMesh
    from matplotlib.lines import Line2D

    axes = new_figure(*ALONE).subplots()
    panel.draw(axes)
    x, y = axes.get_xlabel(), axes.get_ylabel()
    made = figure(
        x_axis_label=x,
        y_axis_label=y,
        x_axis_type=axes.get_xscale(),
        y_axis_type=axes.get_yscale(),
        x_range=axes.get_xlim(),
        y_range=axes.get_ylim(),
        height=int(_SCALE * panel.height),
        sizing_mode="stretch_width",
        match_aspect=axes.get_aspect() != "auto",
        toolbar_location="above",
        tools="pan,box_zoom,wheel_zoom,reset,save",
        active_drag=None,
        active_scroll=None,
    )
    _dress(made, axes)
    pointed = []
    tips = [("", "$name")]
    for artist in sorted(axes.get_children(), key=lambda one: one.get_zorder()):
        if isinstance(artist, Line2D) and artist.get_transform().contains_branch(axes.transData):
            pointed += _line(made, artist)
        elif isinstance(artist, QuadMesh | PathCollection) and artist.get_array() is not None:
            pointed.append(_field(made, artist))
            tips.append((pointed[-1].name, "@value"))
        elif isinstance(artist, LineCollection):
            segments = [np.transpose(one).tolist() for one in artist.get_segments()]
            colour = _colour(artist.get_color()[0])
            made.multi_line([xs for xs, _ in segments], [ys for _, ys in segments], color=colour)
    tips += [(x.split("(")[0].strip() or "x", "@x"), (y.split("(")[0].strip() or "y", "@y")]
    made.add_tools(HoverTool(renderers=pointed, tooltips=tips))
    if made.legend:
        made.add_layout(made.legend[0], "below")
        made.legend.update(click_policy="hide", ncols=2, label_text_font_size="12px", spacing=4, padding=4)
        made.legend.update(location="top_left", background_fill_alpha=0.0, border_line_alpha=0.0)
    return made


def linked(panels: Sequence[Panel]) -> list[Any]:
    """The charts of panels in which one name is one thing: what is hidden in one chart is hidden in all of them."""
    from bokeh.models import CustomJS

    charts = [chart(panel) for panel in panels]
    named: dict[str, list[Any]] = {}
    for made in charts:
        for glyph in made.renderers:
            named.setdefault(glyph.name, []).append(glyph)
    for name, alike in named.items():
        follow = CustomJS(args={"alike": alike}, code="for (const one of alike) one.visible = cb_obj.visible")
        for glyph in alike if name else ():
            glyph.js_on_change("visible", follow)
    return charts


def _dress(made: Any, axes: Any) -> None:
    made.outline_line_color = made.border_fill_color = made.background_fill_color = None
    made.toolbar.logo = made.axis.minor_tick_line_color = None
    made.axis.axis_label_text_font_style = "normal"
    made.grid.grid_line_color = f"{_BETWEEN}40"
    if axes.get_title():
        made.title = axes.get_title()
    names = [label.get_text() for label in axes.get_yticklabels()]
    if axes.get_yscale() == "linear" and any(name.strip("−0123456789. ") for name in names):  # the lines have names
        made.yaxis.ticker = axes.get_yticks().tolist()
        made.yaxis.major_label_overrides = dict(enumerate(names))


def _colour(colour: Any) -> str:
    from matplotlib.colors import to_hex

    return to_hex(colour)


def _named(artist: Any) -> dict[str, Any]:
    """The name of a glyph, and its entry in the legend."""
    label = str(artist.get_label())
    return {} if label.startswith("_") else {"name": label, "legend_label": label}


def _line(made: Any, line: Any) -> list[Any]:
    """A curve and its markers, which share a source."""
    from bokeh.models import ColumnDataSource

    x, y = (np.asarray(values, dtype=np.float64) for values in line.get_data())
    if line.get_transform() != line.axes.transData:  # across all of the axes, such as a tolerance
        (left, right), (low, high) = line.axes.get_xlim(), line.axes.get_ylim()
        x = np.array([left, right]) if len(set(y)) == 1 else x
        y = np.array([low, high]) if len(set(y)) != 1 else y
    source = ColumnDataSource(data={"x": x, "y": y}, name=line.get_gid())
    colour = _colour(line.get_color())
    ink = [_INK] if colour == "#000000" else []
    alpha = line.get_alpha() or 1.0
    style = {"source": source, "color": colour, **_named(line)}
    drawn = []
    if line.get_linestyle() != "None":
        dash = _DASHES.get(line.get_linestyle(), "dashed")
        drawn.append(made.line("x", "y", line_width=line.get_linewidth() + 0.5, line_dash=dash, alpha=alpha, **style))
    if (marker := line.get_marker()) not in ("None", "", None):
        filled = 0.0 if str(line.get_markerfacecolor()) == "none" else alpha
        size = 1.6 * line.get_markersize()
        edge = {} if line.get_markeredgecolor() == line.get_color() else {"line_color": line.get_markeredgecolor()}
        shape = {"marker": _MARKERS.get(marker, "circle"), "size": size, "fill_alpha": filled, "line_alpha": alpha}
        drawn.append(made.scatter("x", "y", **shape, **(style | edge)))
    for glyph in drawn:
        glyph.glyph.tags = ink
    return drawn


def _field(made: Any, field: Any) -> Any:
    """Cells or points in colours, with a colour bar."""
    from bokeh.models import ColorBar, ColumnDataSource, LinearColorMapper, LogColorMapper
    from matplotlib.collections import PathCollection
    from matplotlib.colors import LogNorm

    values = np.ma.filled(np.ma.ravel(field.get_array()).astype(np.float64), np.nan)
    palette = [_colour(field.cmap(k / 255)) for k in range(256)]
    mapper = LogColorMapper if isinstance(field.norm, LogNorm) else LinearColorMapper
    low, high = field.get_clim()
    colours = mapper(palette=palette, low=low, high=high + (high == low), nan_color="rgba(0, 0, 0, 0)")
    label = field.colorbar.ax.get_ylabel()
    made.add_layout(ColorBar(color_mapper=colours, width=12, background_fill_alpha=0.0, title=label), "right")
    paint = {"field": "value", "transform": colours}
    if isinstance(field, PathCollection):
        x, y = np.transpose(np.asarray(field.get_offsets()))
        source = ColumnDataSource(data={"x": x, "y": y, "value": values}, name=field.get_gid())
        return made.scatter("x", "y", source=source, size=9, color=paint, name=label)
    corners = field.get_coordinates()
    low_x, high_x = (np.ravel(part) for part in (corners[:-1, :-1, 0], corners[1:, 1:, 0]))
    low_y, high_y = (np.ravel(part) for part in (corners[:-1, :-1, 1], corners[1:, 1:, 1]))
    data = {"left": low_x, "right": high_x, "bottom": low_y, "top": high_y, "value": values}
    data |= {"x": (low_x + high_x) / 2, "y": (low_y + high_y) / 2}
    source = ColumnDataSource(data=data, name=field.get_gid())
    sides = {side: side for side in ("left", "right", "bottom", "top")}
    return made.quad(**sides, source=source, fill_color=paint, line_color=paint, line_width=0.5, name=label)
