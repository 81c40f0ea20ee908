"""Races and maps as figures that one can point at, zoom and filter by solver, and a slider over θ."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from ...methods.aor import MNMSOR
from ...numerics.arrays import Vector
from ...problem.data import ProblemData
from ...solve.driver import solve
from ...solve.goal import RTOL
from ..cases import unbroken
from ..competitors import Entry
from ..race import Race
from ..stability_map import StabilityMap
from .figures import ACCURATE, ORANGE, outline
from .interactive import BETWEEN, INK, ON_CURVE, Chart, Slider, chart_of, coloured, legend, numbers, pointed, source
from .study_charts import (
    FALSE,
    KINDS,
    SIGNS,
    first_to_goal,
    in_seconds,
    limits_of,
    marked_places,
    parts_of,
    proofs,
)

#: what matplotlib calls "s", Bokeh calls "square"
_MARKERS = dict(
    zip("s^DvPXo", ["square", "triangle", "diamond", "inverted_triangle", "plus", "x", "circle"], strict=True)
)
#: signs of failures, some of which are letters in matplotlib
_FAILURES = ["dot", "cross", "square_x", "triangle", "inverted_triangle", "dash", "circle", "x", "asterisk", "diamond"]


def race_charts(found: Race) -> list[Chart]:
    """Time against error, in as many panels as it takes, zoomed together; then bars. A name that is clicked is hidden
    in all of them."""
    from bokeh.models import CustomJS, Range1d

    limits = limits_of(found)
    named: dict[str, list[Any]] = {}
    ranges = {"x_range": Range1d(*limits["xlim"]), "y_range": Range1d(*limits["ylim"])}
    tips = {"": "@name", found.measure: "@told", "time": "@took", "asked for": "@asked", "says": "@claim"}
    charts = []
    for shown in parts_of(found):
        axis = f"{found.measure}   ({ACCURATE})"
        chart = chart_of(axis, "time, s", 460, x_axis_type="log", y_axis_type="log", **ranges)
        for name, look in shown.items():
            named.setdefault(name, []).extend(_runs(chart, found, name, look, limits["floor"]))
        if found.limit is not None:
            style = {"line_dash": "dashed", "color": BETWEEN, "line_width": 2, "legend_label": "one linear solve"}
            chart.line(limits["xlim"], [found.limit] * 2, **style)
        pointed(chart, [one for one in chart.renderers if one.name == "runs"], tips)
        legend(chart, 2)
        charts.append(chart)
    charts.append(_bars(found, named))
    for alike in named.values():
        follow = CustomJS(args={"alike": alike}, code="for (const one of alike) one.visible = cb_obj.visible")
        for one in alike:
            one.js_on_change("visible", follow)
    return charts


def _runs(chart: Chart, found: Race, name: str, look: tuple[str, str], floor: float) -> list[Any]:
    """A competitor: its runs, hollow where they claim too much, their spread, and the way of one run."""
    runs = sorted((run for run in found.entries if run.name == name and run.error is not None), key=_error)
    colour, tags = look[0], [INK] if look[0] == "black" else []
    columns = _told(runs, floor) | {"fill": [0.0 if run.wrong else 1.0 for run in runs]}
    seconds, path = found.traces.get(name, (columns["time"], columns["error"]))
    dash = "solid" if name in found.traces else "dotted"
    style, data = {"color": colour, "legend_label": name}, source(None, columns)
    sign = {"marker": _MARKERS.get(look[1], "circle"), "size": 11 if tags else 9, "fill_alpha": "fill"}
    drawn = [
        chart.line(numbers(np.maximum(path, floor)), numbers(seconds), line_dash=dash, line_alpha=0.6, **style),
        chart.segment("error", "low", "error", "high", source=data, **style),
        chart.scatter("error", "time", source=data, name="runs", **sign, **style),
    ]
    for one in drawn:
        one.glyph.tags = tags
    return drawn


def _error(run: Entry) -> float:
    return run.error or 0.0


def _told(runs: Sequence[Entry], floor: float = 0.0) -> dict[str, list[Any]]:
    """What is drawn and said of the runs."""
    return {
        "name": [run.name for run in runs],
        "error": numbers([max(_error(run), floor) for run in runs]),
        "time": numbers([run.median for run in runs]),
        "low": numbers([min(run.seconds) for run in runs]),
        "high": numbers([max(run.seconds) for run in runs]),
        "told": [f"{_error(run):.2g}" for run in runs],
        "took": [in_seconds(run.median) for run in runs],
        "asked": [f"{run.tolerance:g}" for run in runs],
        "claim": [run.claim for run in runs],
        "before": [f"{(run.build + (run.setup or 0.0)) / run.median:.0%}" for run in runs],
    }


def _bars(found: Race, named: dict[str, list[Any]]) -> Chart:
    """The time to the default accuracy, on a logarithmic axis, with numbers; `named` gets the bar of each name."""
    first = first_to_goal(found.entries)
    times = [run.median for run in first.values()] or [1.0]
    left = min(times) / 3
    chart = chart_of(
        f"time to Res(z) ≤ {RTOL:g} Res(0), s (share before the first step)", "", 130 + 26 * max(len(first), 4), x_axis_type="log",
        x_range=(left, 60.0 * max(times)), y_range=[*first][::-1],
    )  # fmt: skip
    bars = []
    for name, run in first.items():
        colour, words = KINDS[run.kind]
        columns = _told([run])
        columns["number"] = [
            f" {took} ({before})" for took, before in zip(columns["took"], columns["before"], strict=True)
        ]
        style = {"y": "name", "source": source(None, columns)}
        bars.append(chart.hbar(left=left, right="time", height=0.65, color=colour, legend_label=words, **style))
        text = chart.text(x="time", text="number", text_baseline="middle", text_font_size="12px", **style)
        text.glyph.tags, bars[-1].glyph.tags = [INK], [INK] if colour == "black" else []
        named.setdefault(name, []).extend([bars[-1], text])
    pointed(chart, bars, {"": "@name", "time": "@took", "before the first step": "@before", "says": "@claim"})
    legend(chart, 1)
    return chart


def map_charts(found: StabilityMap, thetas: Vector, problem: ProblemData) -> tuple[list[Chart], Slider]:
    """The steps and ends of a map; the residuals at θ₁ = θ₂ = each of the `thetas`; and a slider over these."""
    chart, start = _map(found), int(np.abs(thetas - 1.0).argmin())
    frames: list[dict[str, Any]] = []
    options: dict[str, Any] = {"max_iter": found.max_iter, "rtol": found.rtol, "atol": 0.0}
    for theta in thetas.tolist():
        run = unbroken(solve(problem, MNMSOR(theta1=theta), history=True, raise_on_failure=False, **options))
        assert run.history is not None
        rows = np.unique(np.geomspace(1, run.history.iteration.size, ON_CURVE).astype(int)) - 1
        way = {"step": run.history.iteration[rows].tolist(), "residual": numbers(run.history.residual[rows])}
        how = f"{'solved in' if run.solved else f'{run.status.value} after'} {run.iterations} steps"
        data = {"theta-way": way, "theta": {"x": [theta], "y": [theta]}}
        frames.append({"says": f"θ₁ = θ₂ = {theta:.3g}: {how}", "data": data})
    here = {"source": source("theta", frames[start]["data"]["theta"]), "legend_label": "θ of the slider"}
    chart.scatter("x", "y", marker="diamond", size=15, color=ORANGE, line_color="white", **here)
    legend(chart, 1)
    charts = [chart, _falls([frame["data"]["theta-way"] for frame in frames], start, found.rtol)]
    return charts, {"label": "θ", "start": [0, start], "runs": [{"name": "", "data": {}, "frames": frames}]}


def _falls(ways: Sequence[dict[str, Any]], start: int, rtol: float) -> Chart:
    """All ways faint, and that of the slider."""
    first = ways[0]["residual"][0]
    chart = chart_of(
        "step", "residual Res(z)", 460, x_axis_type="log", y_axis_type="log", y_range=(0.1 * rtol * first, 1e3 * first)
    )
    chart.multi_line([one["step"] for one in ways], [one["residual"] for one in ways], color=BETWEEN, alpha=0.35)
    line = chart.line("step", "residual", source=source("theta-way", ways[start]), color=ORANGE, line_width=3)
    pointed(chart, [line], {"step": "@step", "residual": "@residual{%.2g}"})
    return chart


def _map(found: StabilityMap) -> Chart:
    """Steps as colours, failures as signs, and lines around what is proved, or as printed said, to converge."""
    x, y = found.plane.x, found.plane.y
    chart = chart_of(x.label, y.label, 520)
    j, i = (of.ravel() for of in np.indices(found.ends.shape))
    steps, ends = found.steps[j, i], found.ends[j, i]
    by = [", ".join(name for name, at in found.proved.items() if at[k]) or "nothing" for k in zip(j, i, strict=True)]
    cells = {"x": x.values[i], "y": y.values[j], "end": ends, "steps": steps, "by": np.array(by)}
    cells |= {"left": x.edges[i], "right": x.edges[i + 1], "bottom": y.edges[j], "top": y.edges[j + 1]}
    solved, drawn = steps[ends == "solved"], []
    least, most = int(solved.min(initial=found.max_iter)), int(solved.max(initial=1))
    paint = coloured(chart, "steps", "Viridis256", max(most, 10 * least), least, log=True)
    for sign, end in zip(("", *_FAILURES), ("solved", *SIGNS), strict=True):
        here = {"source": source(None, {name: values[ends == end].tolist() for name, values in cells.items()})}
        if end == "solved":
            drawn.append(chart.quad("left", "right", "bottom", "top", line_alpha=0.0, fill_color=paint, **here))
        elif (ends == end).any():
            words = SIGNS[end][1].format(max_iter=found.max_iter)
            drawn.append(
                chart.scatter(
                    "x", "y", marker=sign, size=18 if sign == "dot" else 9, color=BETWEEN, legend_label=words, **here
                )
            )
    tips = {x.name: "@x{%.3g}", y.name: "@y{%.3g}", "end": "@end", "steps": "@steps", "proved by": "@by"}
    pointed(chart, drawn, tips)
    lines = [(words, mask, colour, dash == "solid") for words, mask, colour, dash in proofs(found)]
    if (found.any_printed & ~found.any_proved).any():
        lines.append(("said to converge, as printed (false)", found.any_printed, FALSE, False))
    for words, mask, colour, solid in lines:
        x0, y0, x1, y1 = outline(x.edges, y.edges, mask).T.tolist()
        style = {"line_width": 3, "line_dash": "solid" if solid else "dashed", "legend_label": words}
        chart.segment(x0, y0, x1, y1, color=colour, **style).glyph.tags = [INK] if solid else []
    for words, ((at, level), marker) in marked_places(found).items():
        shape, size = ("star", 17) if marker == "*" else ("circle", 11)
        style = {"fill_color": "white", "line_color": "#1a1a1a", "legend_label": words}
        chart.scatter([at], [level], marker=shape, size=size, **style)
    return chart
