"""The figures of a report, by Bokeh: one can point at them, zoom and filter by solver, and sliders go through iterates
on the way to the answer, and over θ."""

from __future__ import annotations

import contextlib
from collections.abc import Sequence
from typing import Any

import numpy as np

from ...errors import IcpError
from ...methods.aor import MNMGS, MNMSOR
from ...problem.data import ProblemData
from ...scenes.registry import points_of
from ...solve.driver import solve
from ...solve.goal import RTOL
from ...solve.solution import Solution
from ..cases import unbroken
from ..competitors import Entry
from ..race import Race
from ..stability_map import StabilityMap
from . import study_charts as still
from .figures import ACCURATE, BLUE, GREEN, ORANGE, PURPLE
from .solution_charts import FEW, ON_CURVE, frame, numbers, turned_rows, turned_run

#: what is neither a series nor text, on a light page and on a dark one
_BETWEEN = "#8a9099"
#: what has this tag gets the colour of the page's text
_INK = "ink"
#: what matplotlib calls "s", Bokeh calls "square"; and signs of failures, some of which are letters in matplotlib
_MARKERS = {"s": "square", "^": "triangle", "D": "diamond", "v": "inverted_triangle", "P": "plus", "X": "x"}
_FAILURES = ("dot", "cross", "square_x", "triangle", "inverted_triangle", "dash", "circle", "x", "asterisk", "diamond")
#: what is said of an unknown
_TIPS = {"z": "@z{%.5g}", "ψ(z)": "@psi{%.5g}", "p": "@p{%.5g}"}


def _chart(x: str, y: str, height: int, **more: Any) -> Any:
    """An empty figure, as wide as the page lets it be; a finger or a wheel on it moves the page until a tool is on."""
    from bokeh.models import PrintfTickFormatter
    from bokeh.plotting import figure

    tools = {"tools": "pan,box_zoom,wheel_zoom,reset,save", "active_drag": None, "active_scroll": None}
    placed = {"height": height, "sizing_mode": "stretch_width", "toolbar_location": "above"}
    made = figure(x_axis_label=x, y_axis_label=y, **tools, **(placed | more))
    made.outline_line_color = made.border_fill_color = made.background_fill_color = None
    made.toolbar.logo = made.axis.minor_tick_line_color = None
    made.axis.axis_label_text_font_style, made.grid.grid_line_color = "normal", f"{_BETWEEN}40"
    if x in ("row", "step") and "x_axis_type" not in more:
        made.xaxis.ticker.min_interval = 1
    if not {"y_axis_type", "y_range"} & {*more}:
        made.yaxis.formatter = PrintfTickFormatter(format="%.4g")
    return made


def _source(name: str | None, columns: dict[str, Any]) -> Any:
    """What glyphs draw; a slider finds it by its `name`."""
    from bokeh.models import ColumnDataSource

    return ColumnDataSource(data=columns, name=name)


def _finished(chart: Any, drawn: Sequence[Any], tips: dict[str, str], columns: int = 2) -> Any:
    """The `chart`, which tells words → "@column" of what is `drawn`, with a legend that hides what is clicked."""
    from bokeh.models import HoverTool

    forms = {of.split("{")[0]: "printf" for of in tips.values() if "%" in of}
    chart.add_tools(HoverTool(renderers=list(drawn), tooltips=list(tips.items()), formatters=forms))
    if chart.legend:
        chart.add_layout(chart.legend[0], "below")
        chart.legend.update(click_policy="hide", ncols=columns, label_text_font_size="12px", spacing=4, padding=4)
        chart.legend.update(location="top_left", background_fill_alpha=0.0, border_line_alpha=0.0)
    return chart


def _coloured(chart: Any, name: str, palette: str, low: float, high: float, log: bool = False) -> dict[str, Any]:
    """What colours the column `name` by its values, on a `log` axis the smallest brightest, with a bar beside it."""
    from bokeh import models, palettes

    mapper, order = (models.LogColorMapper, -1) if log else (models.LinearColorMapper, 1)
    colours = mapper(palette=getattr(palettes, palette)[::order], low=low, high=high + (high == low))
    chart.add_layout(models.ColorBar(color_mapper=colours, width=12, background_fill_alpha=0.0, title=name), "right")
    return {"field": name, "transform": colours}


def answer_charts(solution: Solution, points: Any, z0: Any, time_limit: float) -> tuple[list[Any], dict[str, Any]]:
    """z, p, the residual where the run can be made again, and a slider through runs from `z0`: of the method that found
    the answer, which ends there, and of the paper's sweeps."""
    problem = solution.problem
    places = points_of(problem) if points is None else np.asarray(points)
    rows, where, cell = turned_rows(problem.n, places)
    answer = frame(problem, rows, solution.z, None, solution.residual)
    runs: list[dict[str, Any]] = [{"name": "the answer", "data": {}, "frames": []}]
    words = ("which found the answer", "sweeps as in the paper")
    for k, method in enumerate({repr(one): one for one in (solution.method, MNMGS())}.values()):
        with contextlib.suppress(IcpError):
            runs[k:] = [turned_run(problem, rows, method, z0, time_limit) | {"name": f"{method!r}, {words[k]}"}]
    first = runs[0]["frames"]
    way = runs[0]["data"].get("way")
    first[-1:] = [answer]
    spots = _source("points", answer["data"]["points"] | where)
    charts = _on_line(spots, places is None) if cell is None else _in_plane(spots, cell)
    if way is not None:
        answer["data"]["at"] = now = {name: values[-1:] for name, values in way.items()}  # the end of the way
        chart = _chart("step", "residual Res_D(z)", 380, y_axis_type="log")
        line = chart.line("step", "residual", source=_source("way", way), color=BLUE, line_width=2)
        dot = chart.scatter("step", "residual", source=_source("at", now), color=ORANGE, size=11)
        charts.append(_finished(chart, [line, dot], {"step": "@step", "residual": "@told"}))
    return charts, {"label": "Step", "start": len(first) - 1, "runs": runs}


def _on_line(spots: Any, by_row: bool) -> list[Any]:
    """z between its obstacles, and p; rows in contact have a ring."""
    x = "row" if by_row else "x"
    few = len(spots.data["x"]) <= FEW
    heights = _chart(x, "z", 380)
    forces = _chart(x, "force p", 380, x_range=heights.x_range)
    lower = ("psi", ORANGE, "obstacle ψ(z)")
    upper = ("upper", PURPLE, "obstacle above")
    drawn = {}
    for name, colour, words in (lower, upper, ("z", BLUE, "z"), ("p", GREEN, "p")):
        if name in spots.data:
            chart = forces if name == "p" else heights
            style = {"source": spots, "color": colour, "legend_label": words}
            if not (few and by_row):  # rows have nothing between them
                chart.line("x", name, line_width=2, **style)
            sign, size = ("dash", 20) if name in ("psi", "upper") else ("circle", 7)
            drawn[name] = chart.scatter("x", name, marker=sign, size=size if few else 3, **style)
    for name, colour in (("below", _BETWEEN), ("above", PURPLE)):
        if name in spots.data:
            style = {"fill_alpha": 0.0, "line_alpha": name, "line_color": colour, "line_width": 2, "size": 12}
            heights.scatter("x", "z", source=spots, **style)
    return [_finished(one, [drawn[name]], {x: "@x{%.4g}"} | _TIPS) for one, name in ((heights, "z"), (forces, "p"))]


def _in_plane(spots: Any, cell: tuple[float, float]) -> list[Any]:
    """Fields of z and p in the colours of the answer; rows in contact have a dot."""
    charts: list[Any] = []
    for name, palette in (("z", "Viridis256"), ("p", "Cividis256")):
        ranges = {"x_range": charts[0].x_range, "y_range": charts[0].y_range} if charts else {}
        chart = _chart("x", "y", 420, width=460, sizing_mode="scale_width", match_aspect=True, **ranges)
        known = [one for one in spots.data[name] if one is not None] or [0.0]
        paint = _coloured(chart, name, palette, min(known), max(known))
        drawn = chart.rect("x", "y", *cell, source=spots, fill_color=paint, line_color=paint, line_width=0.5)
        for side, colour in (("below", "white"), ("above", ORANGE)):
            if side in spots.data:
                chart.scatter("x", "y", source=spots, size=4, color=colour, fill_alpha=side, line_alpha=0.0)
        charts.append(_finished(chart, [drawn], {"x": "@x{%.3g}", "y": "@y{%.3g}"} | _TIPS))
    return charts


def race_charts(found: Race) -> list[Any]:
    """Time against error, in panels that zoom together, and bars; a name that is clicked is hidden in all of them."""
    from bokeh.models import CustomJS, Range1d

    limits = still.limits_of(found)
    named: dict[str, list[Any]] = {}
    axes = {"x_range": Range1d(*limits["xlim"]), "y_range": Range1d(*limits["ylim"])}
    axes |= {"x_axis_type": "log", "y_axis_type": "log"}
    tips = {"": "@name", found.measure: "@told", "time": "@took", "says": "@claim"}
    charts = []
    for shown in still.parts_of(found):
        chart = _chart(f"{found.measure}   ({ACCURATE})", "time, s", 460, **axes)
        for name, look in shown.items():
            named.setdefault(name, []).extend(_runs(chart, found, name, look, limits["floor"]))
        if found.limit is not None:
            style = {"line_dash": "dashed", "color": _BETWEEN, "line_width": 2, "legend_label": "one linear solve"}
            chart.line(limits["xlim"], [found.limit] * 2, **style)
        charts.append(_finished(chart, [one for one in chart.renderers if one.name == "runs"], tips))
    if first := found.quickest(RTOL):
        charts.append(_bars(first, named))
    for alike in named.values():
        follow = CustomJS(args={"alike": alike}, code="for (const one of alike) one.visible = cb_obj.visible")
        for one in alike:
            one.js_on_change("visible", follow)
    return charts


def _runs(chart: Any, found: Race, name: str, look: tuple[str, str], floor: float) -> list[Any]:
    """A competitor: its runs, hollow where they claim too much, and the way of one of them."""
    runs = [run for run in found.entries if run.name == name and run.error is not None]
    colour = look[0]
    tags = [_INK] if look[0] == "black" else []
    data = _told(runs, floor)
    seconds, path = found.traces.get(name, (data["time"], data["error"]))
    dash = "solid" if name in found.traces else "dotted"
    style = {"color": colour, "legend_label": name}
    sign = {"marker": _MARKERS.get(look[1], "circle"), "size": 11 if tags else 9, "fill_alpha": "fill"}
    drawn = [
        chart.line(numbers(np.maximum(path, floor)), numbers(seconds), line_dash=dash, line_alpha=0.6, **style),
        chart.scatter("error", "time", source=_source(None, data), name="runs", **sign, **style),
    ]
    for one in drawn:
        one.glyph.tags = tags
    return drawn


def _told(runs: Sequence[Entry], floor: float = 0.0) -> dict[str, list[Any]]:
    """What is drawn and said of the runs."""
    shares = [(run.build + (run.setup or 0.0)) / run.median for run in runs]
    return {
        "name": [run.name for run in runs],
        "error": [max(run.error or 0.0, floor) for run in runs],
        "time": [run.median for run in runs],
        "fill": [0.0 if run.wrong else 1.0 for run in runs],
        "told": [f"{run.error or 0.0:.2g} where {run.tolerance:g} was asked for" for run in runs],
        "took": [f" {still.in_seconds(run.median)} ({share:.0%})" for run, share in zip(runs, shares, strict=True)],
        "claim": [run.claim for run in runs],
    }


def _bars(first: dict[str, Entry], named: dict[str, list[Any]]) -> Any:
    """The time to the default accuracy, on a logarithmic axis, with numbers; `named` gets the bar of each name."""
    times = [run.median for run in first.values()]
    bars = []
    axis = f"time to Res_D(z) ≤ {RTOL:g} Res_D(0), s\n(in brackets the share before the first step)"
    ranges = {"x_range": (min(times) / 3, 60.0 * max(times)), "y_range": [*first][::-1]}
    chart = _chart(axis, "", 150 + 26 * max(len(first), 4), x_axis_type="log", **ranges)
    for name, run in first.items():
        (colour, words) = still.KINDS[run.kind]
        at = {"y": "name", "source": _source(None, _told([run]))}
        bar = chart.hbar(left=min(times) / 3, right="time", height=0.65, color=colour, legend_label=words, **at)
        text = chart.text(x="time", text="took", text_baseline="middle", text_font_size="12px", **at)
        text.glyph.tags = [_INK]
        bar.glyph.tags = [_INK] if colour == "black" else []
        named.setdefault(name, []).extend([bar, text])
        bars.append(bar)
    return _finished(chart, bars, {"": "@name", "time": "@took", "says": "@claim"}, 1)


def map_charts(found: StabilityMap, problem: ProblemData) -> tuple[list[Any], dict[str, Any]]:
    """The steps and ends of a map over θ₁ and θ₂, the residuals where they are equal, and a slider over these."""
    frames = []
    ways = []
    thetas = np.linspace(found.plane.x.values[0], found.plane.x.values[-1], 25)
    options: dict[str, Any] = {"max_iter": found.max_iter, "rtol": found.rtol, "raise_on_failure": False}
    for theta in thetas.tolist():
        run = unbroken(solve(problem, MNMSOR(theta1=theta), history=True, **options))
        some = np.unique(np.geomspace(1, run.history.iteration.size, ON_CURVE).astype(int)) - 1
        ways.append({"step": run.history.iteration[some].tolist(), "residual": numbers(run.history.residual[some])})
        end = f"{'solved in' if run.solved else f'{run.status.value} after'} {run.iterations} steps"
        data = {"theta-way": ways[-1], "theta": {"x": [theta], "y": [theta]}}
        frames.append({"says": f"θ₁ = θ₂ = {theta:.3g}: {end}", "data": data})
    start = int(np.abs(thetas - 1.0).argmin())
    first = ways[0]["residual"][0]
    axes = {"x_axis_type": "log", "y_axis_type": "log", "y_range": (0.1 * found.rtol * first, 1e3 * first)}
    falls = _chart("step", "residual Res_D(z)", 460, **axes)
    falls.multi_line([one["step"] for one in ways], [one["residual"] for one in ways], color=_BETWEEN, alpha=0.35)
    line = falls.line("step", "residual", source=_source("theta-way", ways[start]), color=ORANGE, line_width=3)
    _finished(falls, [line], {"step": "@step", "residual": "@residual{%.2g}"})
    slider = {"label": "θ", "start": start, "runs": [{"name": "", "data": {}, "frames": frames}]}
    return [_map(found, {"x": [thetas[start]], "y": [thetas[start]]}), falls], slider


def _map(found: StabilityMap, theta: dict[str, Any]) -> Any:
    """Steps as colours, failures as signs, lines around what is proved, or as printed said, to converge, and θ."""
    x = found.plane.x
    y = found.plane.y
    chart = _chart(x.label, y.label, 520)
    j, i = (of.ravel() for of in np.indices(found.ends.shape))
    steps = found.steps[j, i]
    ends = found.ends[j, i]
    by = [", ".join(name for name, at in found.proved.items() if at[k]) or "nothing" for k in zip(j, i, strict=True)]
    cells = {"x": x.values[i], "y": y.values[j], "end": ends, "steps": steps, "by": np.array(by)}
    width, height = (float(of.values[1] - of.values[0]) for of in (x, y))
    solved = steps[ends == "solved"]
    drawn = []
    least = int(solved.min(initial=found.max_iter))
    most = int(solved.max(initial=1))
    paint = _coloured(chart, "steps", "Viridis256", least, max(most, 10 * least), log=True)
    for sign, end in zip(("", *_FAILURES), ("solved", *still.SIGNS), strict=True):
        here = {"source": _source(None, {name: values[ends == end].tolist() for name, values in cells.items()})}
        if end == "solved":
            drawn.append(chart.rect("x", "y", width, height, line_alpha=0.0, fill_color=paint, **here))
        elif (ends == end).any():
            words = still.SIGNS[end][1].format(max_iter=found.max_iter)
            here |= {"marker": sign, "size": 18 if sign == "dot" else 9, "color": _BETWEEN, "legend_label": words}
            drawn.append(chart.scatter("x", "y", **here))
    for words, mask, colour, dash in still.proofs(found):
        xs, ys = np.transpose(still.outline(found, mask), (2, 0, 1)).tolist()
        style = {"line_width": 3, "line_dash": "solid" if dash == "solid" else "dashed", "legend_label": words}
        ink = [_INK] if dash == "solid" and colour != still.FALSE else []
        chart.multi_line(xs, ys, color=colour, **style).glyph.tags = ink
    style = {"fill_color": "white", "line_color": "#1a1a1a"}
    for words, (place, marker) in still.marked_places(found).items():
        shape, size = ("star", 17) if marker == "*" else ("circle", 11)
        chart.scatter(*[[at] for at in place], marker=shape, size=size, legend_label=words, **style)
    style = {"fill_color": ORANGE, "line_color": "white", "legend_label": "θ of the slider"}
    chart.scatter("x", "y", source=_source("theta", theta), marker="diamond", size=15, **style)
    tips = {x.name: "@x{%.3g}", y.name: "@y{%.3g}", "end": "@end", "steps": "@steps", "proved by": "@by"}
    return _finished(chart, drawn, tips, 1)
