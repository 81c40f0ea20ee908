"""The answer as figures that one can point at and zoom, and a slider through iterates on the way to it."""

from __future__ import annotations

import contextlib
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.equations import pattern_at
from ...errors import IcpError
from ...methods.aor import MNMGS
from ...methods.contract import Method
from ...numerics.arrays import Vector
from ...problem.data import ProblemData
from ...scenes.grid import edges
from ...solve.driver import solve
from ...solve.progress import Sparsely
from ...solve.solution import Solution
from ..cases import unbroken
from .figures import BLUE, GREEN, ORANGE, PURPLE, outline
from .interactive import BETWEEN, ON_CURVE, Chart, Slider, chart_of, coloured, evenly, legend, numbers, pointed, source
from .solution_charts import FEW, located

#: so many unknowns are drawn at the most, on a line and in the plane
_ON_LINE, _IN_PLANE = 400, 1600
#: after iterate k of a run the next one that is shown is at so many times k: 34 of 100 000
_SHOWN = 1.4
#: what is said of a point
_TIPS = {"z": "@z{%.5g}", "ψ(z)": "@psi{%.5g}", "p": "@p{%.5g}"}


@dataclass(frozen=True, eq=False)
class Places:
    """Where unknowns are drawn: `rows` are the numbers of these, `x` and, in the plane, `y` where they are; `by_row` if
    x is the row number, `regular` if they fill a grid."""

    rows: NDArray[np.int64]
    x: Vector
    y: Vector | None
    by_row: bool
    regular: bool

    @cached_property
    def cells(self) -> tuple[Vector, Vector]:
        """The borders of the columns and rows of the grid."""
        assert self.y is not None
        return edges(np.unique(self.x)), edges(np.unique(self.y))

    def contact(self, mask: NDArray[np.bool_]) -> dict[str, list[float | None]]:
        """What shows the rows of the `mask`: strips on a line, an outline on a grid, else the points themselves."""
        if self.y is None:
            ends, change = edges(self.x), np.flatnonzero(np.diff(np.pad(mask, 1).astype(int)))
            return {"x0": numbers(ends[change[::2]]), "x1": numbers(ends[change[1::2]])}
        if not self.regular:
            return {"x": numbers(self.x[mask]), "y": numbers(self.y[mask])}
        field = np.zeros((self.cells[1].size - 1, self.cells[0].size - 1), dtype=bool)
        j, i = (np.searchsorted(ends, at) - 1 for ends, at in zip(self.cells[::-1], (self.y, self.x), strict=True))
        field[j, i] = mask
        return dict(zip(("x0", "y0", "x1", "y1"), map(numbers, outline(*self.cells, field).T), strict=True))

    @property
    def columns(self) -> dict[str, Any]:
        """The places, and the cells around them on a grid."""
        if self.y is None or not self.regular:
            return {"x": self.x} if self.y is None else {"x": self.x, "y": self.y}
        (ex, ey), at = self.cells, {"x": self.x, "y": self.y}
        i, j = np.searchsorted(ex, self.x) - 1, np.searchsorted(ey, self.y) - 1
        return at | {"left": ex[i], "right": ex[i + 1], "bottom": ey[j], "top": ey[j + 1]}


def places(solution: Solution, points: Any) -> Places:
    """Some of the unknowns, evenly: every one of them where they are few."""
    found = located(solution, points)
    rows = np.arange(solution.problem.n)
    if found is None or found.ndim == 1:
        x = rows.astype(np.float64) if found is None else found
        rows = rows[evenly(rows.size, _ON_LINE)]
        return Places(rows[np.argsort(x[rows])], np.sort(x[rows]), None, found is None, False)
    (columns, i), (levels, j) = (np.unique(of, return_inverse=True) for of in found.T)
    regular = columns.size * levels.size == rows.size and min(columns.size, levels.size) > 1
    if regular:
        share = min((_IN_PLANE / rows.size) ** 0.5, 1.0)
        kept = (evenly(of.size, max(int(share * of.size), 2)) for of in (columns, levels))
        rows = rows[np.logical_and(*(np.isin(at, of) for at, of in zip((i, j), kept, strict=True)))]
    else:
        rows = rows[evenly(rows.size, _IN_PLANE)]
    return Places(rows, found[rows, 0], found[rows, 1], False, regular)


def answer_charts(solution: Solution, points: Any, z0: Any, time_limit: float) -> tuple[list[Chart], Slider]:
    """z, p and the residual, and a slider through the runs from `z0` of the method that found the answer, which ends
    with the answer itself, and of the paper's sweeps; the residual is left out where no run can be made again."""
    problem, at = solution.problem, places(solution, points)
    answer = _frame(at, problem, solution.z, None, solution.residual)
    data = {name: dict(columns) for name, columns in answer["data"].items()}
    data["points"] |= at.columns | _obstacles(at, problem, solution.z, moving=False)
    runs: list[dict[str, Any]] = [{"data": {}, "frames": []}]
    for k, method in enumerate({repr(one): one for one in (solution.method, MNMGS())}.values()):
        with contextlib.suppress(IcpError):
            runs[k:] = [_run(at, problem, method, z0, time_limit)]
        if k < len(runs):
            runs[k]["name"] = f"{method!r}, {'sweeps as in the paper' if k else 'which found the answer'}"
    first, way = runs[0]["frames"], runs[0]["data"].get("way")
    if way is not None:  # the answer is on the way, at its end
        answer["data"]["at"] = data["at"] = {name: values[-1:] for name, values in way.items()}
    if first and first[-1]["data"]["points"] == answer["data"]["points"]:
        first.pop()
    first.append(answer)
    sources = {name: source(name, columns) for name, columns in data.items()}
    charts = (_on_line if at.y is None else _in_plane)(at, solution, sources)
    if way is not None:
        charts.append(_residuals(source("way", way), sources["at"]))
    return charts, {"label": "Step", "start": [0, len(first) - 1], "runs": runs}


def _run(at: Places, problem: ProblemData, method: Method, z0: Any, time_limit: float) -> dict[str, Any]:
    """A run of the `method`, as a slider shows it. Raises IcpError."""
    frames: list[dict[str, Any]] = []
    some = Sparsely(lambda now: frames.append(_frame(at, problem, now.z, now.iteration, now.residual)), _SHOWN)
    options: dict[str, Any] = {"z0": z0, "time_limit": time_limit, "history": True, "raise_on_failure": False}
    solution = unbroken(solve(problem, method, callback=some, **options))
    some.end()
    frames[-1]["says"] += f"; {solution.status.value}"
    assert solution.history is not None
    steps, residual = solution.history.iteration, solution.history.residual
    lowest = 0.1 * float(residual[residual > 0.0].min(initial=1.0))  # what 0 is drawn at
    rows = evenly(steps.size, ON_CURVE)
    way = {"step": steps[rows].tolist(), "residual": numbers(np.maximum(residual[rows], lowest))}
    return {"data": {"way": way}, "frames": frames}


def _frame(at: Places, problem: ProblemData, z: Vector, step: int | None, residual: float) -> dict[str, Any]:
    """What a slider says and shows of an iterate; of the answer, which has no `step`."""
    _, active, above = pattern_at(problem, z)
    masks = {"below": active} if above is None else {"below": active & ~above, "above": above}
    shown = {"z": numbers(z[at.rows]), "p": numbers(problem.p(z)[at.rows])}
    begin = "the answer" if step is None else f"step {step}"
    return {
        "says": f"{begin}: residual {residual:.2g}, {int(active.sum())} of {z.size} rows in contact",
        "data": {
            "points": shown | _obstacles(at, problem, z, moving=True),
            "at": {"step": [step or 0], "residual": numbers([residual or np.nan])},
            **{name: at.contact(mask[at.rows]) for name, mask in masks.items()},
        },
    }


def _obstacles(at: Places, problem: ProblemData, z: Vector, moving: bool) -> dict[str, Any]:
    """ψ(z) and ψ̄(z), those that move with z, or those that do not."""
    maps = {name: one for name, one in (("psi", problem.psi), ("upper", problem.upper)) if one is not None}
    return {name: numbers(one.value(z)[at.rows]) for name, one in maps.items() if one.is_constant is not moving}


def _residuals(way: Any, now: Any) -> Chart:
    chart = chart_of("step", "residual Res(z)", 360, y_axis_type="log")
    line = chart.line("step", "residual", source=way, color=BLUE, line_width=2)
    dot = chart.scatter("step", "residual", source=now, color=ORANGE, size=11)
    pointed(chart, [line, dot], {"step": "@step", "residual": "@residual{%.2g}"})
    return chart


def _on_line(at: Places, solution: Solution, sources: dict[str, Any]) -> list[Chart]:
    """z between its obstacles, and p; contact is shaded."""
    x, few, spots = "row" if at.by_row else "x", at.rows.size <= FEW, sources["points"]
    heights = chart_of(x, "z", 380)
    forces = chart_of(x, "force p", 380, x_range=heights.x_range)
    for chart in (heights, forces):
        for name, colour in (("below", BETWEEN), ("above", PURPLE)):
            if name in sources:
                words = {"legend_label": f"contact {name}" if "above" in sources else "contact"}
                chart.vstrip("x0", "x1", source=sources[name], color=colour, fill_alpha=0.25, line_alpha=0.0, **words)
    lower, upper = ("psi", ORANGE, "obstacle ψ(z)"), ("upper", PURPLE, "obstacle above")
    for name, colour, label in (lower, upper, ("z", BLUE, "z"), ("p", GREEN, "p")):
        if name in spots.data:
            chart = forces if name == "p" else heights
            style = {"source": spots, "color": colour, "legend_label": label}
            if not (few and at.by_row):  # rows have nothing between them
                chart.line("x", name, line_width=2, **style)
            sign, size = ("dash", 18) if name in ("psi", "upper") else ("circle", 7)
            drawn = chart.scatter("x", name, marker=sign, size=size if few else 3, **style)
            if name in ("z", "p"):
                pointed(chart, [drawn], {x: "@x{%.4g}"} | _TIPS)
    for chart in (heights, forces):
        legend(chart)
    return [heights, forces]


def _in_plane(at: Places, solution: Solution, sources: dict[str, Any]) -> list[Chart]:
    """Fields of z and p in the colours of the answer, with an outline around contact."""
    charts: list[Chart] = []
    for name, values, palette in (("z", solution.z, "Viridis256"), ("p", solution.p, "Cividis256")):
        ranges = {"x_range": charts[0].x_range, "y_range": charts[0].y_range} if charts else {}
        chart = chart_of("x", "y", 420, width=460, sizing_mode="scale_width", match_aspect=True, **ranges)
        paint = coloured(chart, name, palette, float(values.min()), float(values.max()))
        style = {"source": sources["points"], "fill_color": paint, "line_color": paint}
        if at.regular:
            drawn = chart.quad("left", "right", "bottom", "top", line_width=0.5, **style)
        else:
            drawn = chart.scatter("x", "y", size=7, **style)
        pointed(chart, [drawn], {"x, y": "@x{%.3g}, @y{%.3g}"} | _TIPS)
        for side, colour in (("below", "white"), ("above", ORANGE)):
            if side in sources and at.regular:
                chart.segment("x0", "y0", "x1", "y1", source=sources[side], color=colour, line_width=2.5)
            elif side in sources:
                chart.scatter("x", "y", source=sources[side], size=7, fill_alpha=0.0, line_color=colour)
        charts.append(chart)
    return charts
