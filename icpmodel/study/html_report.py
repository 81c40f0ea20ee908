"""One self-contained HTML page on a problem: the answer pictured, what is certain, who confirms it, how it moves."""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Callable
from typing import Any

from ..crosscheck.check import crosscheck
from ..errors import IcpError, InputError
from ..explain.explanation import explain
from ..numerics.arrays import Vector, as_number
from ..present.rendering import render
from ..problem.data import ProblemData, ProblemLike
from ..scenes import Scene
from ..solve.driver import solve
from ..solve.solution import Solution
from .cases import scene_of
from .charts.figures import Figure, figure
from .race import race
from .sensitivity import sensitivity
from .stability_map import stability
from .timing import machine

#: a map solves the problem some hundreds of times
_MAP_UP_TO = 1000
#: the tolerances of the race, and the seconds that each of its runs may take
_TOLERANCES, _RACE_LIMIT = tuple(10.0**-k for k in range(2, 13, 2)), 3.0


def report(
    problem: ProblemLike,
    *,
    title: str = "",
    about: str = "",
    points: Vector | None = None,
    z_exact: Vector | None = None,
    command: str = "",
    time_limit: float = 60.0,
    say: Callable[[str], None] = lambda text: None,
) -> str:
    """A page that opens offline: the answer, its picture, the problem explained, a cross-check, sensitivity, a map.

    What cannot be done, such as a cross-check of a problem that is too large, is said in its place.
    Parameters: `problem`, which is solved first, or a `Solution`, solved or not; `title` and `about`, text; `points` as
    in `icpmodel.study.figure`; `z_exact` the solution, shape (n,), where it is known; where `problem` is a scene or
    names one, these are by default what it says of itself; `command` what makes the page again; `time_limit` in
    seconds for each independent solver; `say` is told what is going on. Returns the HTML text, about a megabyte at the
    most, with the figures in it as SVG. Raises InputError.

    >>> page = icp.report(ICP([[2, -1], [-1, 2]], [-1, 3]), title="A pair", time_limit=5)
    >>> page.startswith("<!DOCTYPE html>"), "<h2>Cross-check</h2>" in page
    (True, True)
    """
    time_limit = as_number(time_limit, "time_limit", above=0.0)
    if (scene := scene_of(problem)) is not None:
        known = said_of(scene)
        title, about = title or known["title"], about or known["about"]
        z_exact = known["z_exact"] if z_exact is None else z_exact
    if isinstance(problem, Solution):
        solution = problem
    else:
        say("solving")
        solution = solve(problem, raise_on_failure=False) if scene is None else scene.solution()
    problem = solution.problem
    title = title or repr(problem)
    # what makes each section: its HTML "page", its "picture" as SVG, its plain "text", or several of these
    makers: dict[str, Callable[[], dict[str, str]]] = {
        "Answer": lambda: {"page": solution._repr_html_()},
        "Picture": lambda: {"picture": _svg(figure(solution, points))},
        "What is certain before a solve": lambda: {"page": explain(problem)._repr_html_()},
        "Cross-check": lambda: {"page": crosscheck(problem, solution, time_limit=time_limit)._repr_html_()},
        "Sensitivity of the answer": lambda: {"text": str(sensitivity(solution))},
        "Race": lambda: _race(problem, z_exact, time_limit),
        "Where relaxation works": lambda: _map(problem),
    }
    sections = []
    for heading, make in makers.items():
        say(heading)
        try:
            sections.append({"heading": heading} | make())
        except IcpError as error:
            sections.append({"heading": heading, "missing": str(error)})
    return render("report.html", title=title, about=about, machine=machine(), command=command, sections=sections)


def said_of(scene: Scene) -> dict[str, Any]:
    """What a page on the `scene` takes from it: its title, what it models, and its reference."""
    return {"title": f"{scene.name}: {scene.title}", "about": scene.models, "z_exact": scene.z_exact}


def _map(problem: ProblemData) -> dict[str, str]:
    if problem.n > _MAP_UP_TO:
        raise InputError(f"a map solves the problem hundreds of times, which is done up to n = {_MAP_UP_TO}")
    found = stability("relaxation", problem, points=11, starts=2, max_iter=1000)
    return {"picture": _svg(found.figure()), "text": str(found)}


def _race(problem: ProblemData, z_exact: Vector | None, time_limit: float) -> dict[str, str]:
    limit = min(_RACE_LIMIT, time_limit)
    found = race(problem, z_exact=z_exact, tolerances=_TOLERANCES, repeats=1, time_limit=limit)
    return {"picture": _svg(found.figure()), "text": "\n".join(found.left_out())}


def _svg(figure: Figure) -> str:
    """The figure as an SVG element, with names of its own within it, as several figures meet on a page."""
    text = io.StringIO()
    figure.savefig(text, format="svg", dpi=110)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    mark = f"f{zlib.crc32(svg.encode()):x}-"
    return re.sub(r'(\bid="|url\(#|href="#)', lambda found: found.group(1) + mark, svg)
