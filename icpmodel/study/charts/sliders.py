"""The sliders of a report: over the iterates of a run, and over θ.

A slider is {"label", "start", "runs": [{"name", "data", "frames": [{"says", "data"}, ...]}, ...]}. Its data are
{gid of an artist: {column: values}}, those of a run for all of its frames; `start` is the frame that is drawn at first.
"""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ...errors import IcpError
from ...methods.aor import MNMGS, MNMSOR
from ...methods.contract import Method
from ...numerics.arrays import Vector
from ...problem.data import ProblemData
from ...solve.driver import solve
from ...solve.solution import Solution
from ..cases import unbroken
from ..stability_map import StabilityMap
from .figures import GREY, ORANGE, Panel
from .places import Places, numbers, places_of
from .solution_charts import columns, contacts, on_log_axis

#: so many cells of a plane, or points of a line, move
MOVED = 900
#: a curve has so many points
_ON_CURVE = 200
#: the values of θ
_THETAS = 25
#: the ratio of the numbers of the iterates that are shown
_RATIO = 1.4

Slider = dict[str, Any]


def run_slider(solution: Solution, points: Any, z0: Any, time_limit: float) -> Slider:
    """Runs from `z0` of the method that made the answer, and of the paper's sweeps."""
    problem = solution.problem
    places = places_of(problem, points, most=MOVED)
    answer = {
        "says": f"the answer: {_in_words(problem, solution.z, solution.residual)}",
        "data": columns(problem, places, solution.z),
    }
    runs = []
    methods = {repr(one): one for one in (solution.method, MNMGS())}
    for name, method in methods.items():
        try:
            runs.append({"name": name, **_run(problem, places, method, z0, time_limit)})
        except IcpError:
            continue
    if not runs:
        runs = [{"name": "the answer", "data": {}, "frames": []}]
    runs[0]["frames"].append(answer)
    return {"label": "Step", "start": len(runs[0]["frames"]) - 1, "runs": runs}


def _run(problem: ProblemData, places: Places, method: Method, z0: Any, time_limit: float) -> Slider:
    """The "data" and "frames" of a run, at iterates in geometric progression."""
    frames: dict[int, Slider] = {}
    following = 0

    def show(iteration: int, z: Vector, residual: float, ended: str = "") -> None:
        says = f"step {iteration}: {_in_words(problem, z, residual)}{ended}"
        at = {"at": {"x": [iteration], "y": numbers(on_log_axis(np.array([residual])))}}
        frames[iteration] = {"says": says, "data": columns(problem, places, z) | at}

    def watch(now: Any) -> None:
        nonlocal following
        if now.iteration >= following:
            following = max(now.iteration + 1, int(_RATIO * now.iteration))
            show(now.iteration, now.z, now.residual)

    options: dict[str, Any] = {"z0": z0, "time_limit": time_limit, "history": True, "raise_on_failure": False}
    solution = unbroken(solve(problem, method, callback=watch, **options))
    show(solution.iterations, solution.z, solution.residual, f"; {solution.status.value}")
    history = solution.history
    some = np.unique(np.linspace(0, history.residual.size - 1, _ON_CURVE).astype(int))
    path = {"x": history.iteration[some].tolist(), "y": numbers(on_log_axis(history.residual)[some])}
    return {"data": {"path": path}, "frames": [*frames.values()]}


def _in_words(problem: ProblemData, z: Vector, residual: float) -> str:
    held = sum(int(rows.sum()) for rows in contacts(problem, z).values())
    return f"residual {residual:.2g}, {held} of {z.size} rows in contact"


def theta_slider(found: StabilityMap, problem: ProblemData) -> tuple[Panel, float, Slider]:
    """The residuals at θ₁ = θ₂, the θ that is drawn at first, and the slider over the others."""
    thetas = np.linspace(found.plane.x.values[0], found.plane.x.values[-1], _THETAS)
    options: dict[str, Any] = {"max_iter": found.max_iter, "rtol": found.rtol, "raise_on_failure": False}
    frames: list[Slider] = []
    for theta in thetas.tolist():
        run = unbroken(solve(problem, MNMSOR(theta1=theta), history=True, **options))
        some = np.unique(np.geomspace(1, run.history.iteration.size, _ON_CURVE).astype(int)) - 1
        path = {"x": run.history.iteration[some].tolist(), "y": numbers(run.history.residual[some])}
        end = f"{'solved in' if run.solved else f'{run.status.value} after'} {run.iterations} steps"
        data = {"falls": path, "theta": {"x": [theta], "y": [theta]}}
        frames.append({"says": f"θ₁ = θ₂ = {theta:.3g}: {end}", "data": data})
    start = int(np.abs(thetas - 1.0).argmin())
    panel = Panel(
        draw=partial(_falls, [frame["data"]["falls"] for frame in frames], start, found.rtol),
        caption=f"The residual, step by step, at θ₁ = θ₂ = {thetas[start]:.3g} in orange, or where the slider is, "
        "and at other values in grey.",
        alt="Residual against steps.",
    )
    slider = {"label": "θ", "start": start, "runs": [{"name": "", "data": {}, "frames": frames}]}
    return panel, float(thetas[start]), slider


def _falls(paths: list[dict[str, Any]], start: int, rtol: float, axes: Any) -> list[Any]:
    for path in paths:
        axes.plot(path["x"], path["y"], color=GREY, alpha=0.35, linewidth=0.8, label="_")
    axes.plot(paths[start]["x"], paths[start]["y"], color=ORANGE, linewidth=2.5, gid="falls", label="residual")
    first = paths[start]["y"][0]
    axes.set(xscale="log", yscale="log", xlabel="step", ylabel="residual Res_D(z)")
    axes.set_ylim(0.1 * rtol * first, 1e3 * first)
    axes.grid(alpha=0.3)
    return []
