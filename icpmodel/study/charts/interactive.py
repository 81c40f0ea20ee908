"""Figures that one can point at, zoom and filter, by Bokeh: what all of them have in common."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from numpy.typing import NDArray

#: what is neither a series nor text, on a light page and on a dark one
BETWEEN = "#8a9099"
#: what has this tag gets the colour of the page's text
INK = "ink"
#: axes with nothing between whole numbers
COUNTED = ("row", "step")
#: so many points of a curve are drawn
ON_CURVE = 200

#: a Bokeh figure: Bokeh is loaded when the first one is made
Chart = Any
#: what a slider goes through: its "label"; "start", the run and the frame that the figures show at first; "runs", each
#: with a "name", the "data" that belong to all of it, and "frames", each with what it "says" and its "data", which are
#: name of a source → column → values
Slider = dict[str, Any]


def chart_of(x: str, y: str, height: int, **more: Any) -> Chart:
    """An empty figure, as wide as the page lets it be; a finger or a wheel on it moves the page until a tool is on."""
    from bokeh.plotting import figure

    tools = {"tools": "pan,box_zoom,wheel_zoom,reset,save", "active_drag": None, "active_scroll": None}
    placed = {"height": height, "sizing_mode": "stretch_width", "toolbar_location": "above"}
    made = figure(x_axis_label=x, y_axis_label=y, **tools, **(placed | more))
    made.toolbar.logo = None
    made.grid.grid_line_alpha = 0.35
    made.axis.minor_tick_line_color = None
    if x in COUNTED and "x_axis_type" not in more:
        made.xaxis.ticker.min_interval = 1
    return made


def source(name: str | None, columns: dict[str, Any]) -> Any:
    """What glyphs draw; a slider finds it by its `name`."""
    from bokeh.models import ColumnDataSource

    return ColumnDataSource(data=columns, name=name)


def pointed(chart: Chart, renderers: Sequence[Any], tips: dict[str, str]) -> None:
    """What is said of the `renderers` where one points at them: words → "@column"."""
    from bokeh.models import HoverTool

    numbers = {of.split("{")[0]: "printf" for of in tips.values() if "%" in of}
    chart.add_tools(HoverTool(renderers=list(renderers), tooltips=list(tips.items()), formatters=numbers))


def coloured(chart: Chart, name: str, palette: str, low: float, high: float, log: bool = False) -> dict[str, Any]:
    """What colours the column `name` by its values, with a bar beside the figure."""
    from bokeh.models import ColorBar, LinearColorMapper, LogColorMapper

    high = high if high != low else low + 1.0
    colours = (LogColorMapper if log else LinearColorMapper)(palette=palette, low=low, high=high)
    chart.add_layout(ColorBar(color_mapper=colours, width=12, background_fill_alpha=0.0, title=name), "right")
    return {"field": name, "transform": colours}


def legend(chart: Chart, columns: int = 3) -> None:
    """Below the figure, where a click on a name hides what has it."""
    if chart.legend:
        chart.add_layout(chart.legend[0], "below")
        chart.legend.update(click_policy="hide", ncols=columns, label_text_font_size="12px", spacing=4, padding=4)
        chart.legend.update(location="top_left", background_fill_alpha=0.0, border_line_alpha=0.0)


def numbers(values: Any) -> list[float | None]:
    """To five digits, for JSON: None where there is none."""
    return [float(f"{one:.5g}") if np.isfinite(one) else None for one in np.asarray(values, dtype=np.float64).tolist()]


def evenly(n: int, most: int) -> NDArray[np.int64]:
    """Of n things the numbers of some, the first and the last among them."""
    return np.unique(np.linspace(0, n - 1, min(n, most)).astype(np.int64))
