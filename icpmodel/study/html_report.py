"""One self-contained HTML page on a problem: the answer pictured, what is certain, who confirms it, how it moves."""

from __future__ import annotations

import html
import io
import re
import zlib
from collections.abc import Callable
from typing import TYPE_CHECKING, Any

from ..crosscheck.check import crosscheck
from ..errors import IcpError, InputError
from ..explain.page import explain
from ..icp import ICP
from ..numerics.arrays import Vector, as_number, described
from ..solve.solution import Solution
from .charts.map_chart import map_figure
from .charts.race_chart import race_figure
from .charts.solution_chart import solution_figure
from .racing import race
from .sensitivity import sensitivity
from .stability_map import stability
from .timing import machine

if TYPE_CHECKING:
    from matplotlib.figure import Figure

_STYLE = """
body { font: 16px/1.5 system-ui, sans-serif; max-width: 64rem; margin: 2rem auto; padding: 0 1rem; color: #1a1a1a; }
h1 { font-size: 1.6rem; margin-bottom: 0; } h2 { font-size: 1.2rem; margin-top: 2.2rem; border-top: 1px solid #ccc; }
h2 { padding-top: .8rem; } h4 { margin: .8rem 0 .2rem; } .note { color: #555; }
pre { font: 13px/1.4 ui-monospace, monospace; white-space: pre-wrap; background: #f6f6f4; padding: .6rem .8rem; }
table { border-collapse: collapse; font-size: 14px; display: block; overflow-x: auto; }
th, td { padding: .2rem .8rem .2rem 0; vertical-align: top; text-align: left; } svg { max-width: 100%; height: auto; }
"""


def html_report(
    solution: Solution,
    *,
    title: str,
    about: str = "",
    points: Vector | None = None,
    z_exact: Vector | None = None,
    command: str = "",
    time_limit: float = 60.0,
    say: Callable[[str], None] = lambda text: None,
) -> str:
    """A page that opens offline: the answer, its picture, the problem explained, a cross-check, sensitivity, a map.

    What cannot be done, such as a cross-check of a problem that is too large, is said in its place.
    Parameters: `solution`, solved or not; `title` and `about`, text; `points` as in `solution_figure`;
    `z_exact` the solution, shape (n,), where it is known; `command` what makes the page again; `time_limit` in seconds
    for each independent solver; `say` is told what is going on.
    Returns the HTML text, about a megabyte at the most: figures are SVG within it, large fields pixels within those.
    Raises InputError where an argument is no such thing.

    >>> page = html_report(ICP([[2, -1], [-1, 2]], [-1, 3]).solve(), title="A pair", time_limit=5)
    >>> page.startswith("<!DOCTYPE html>"), "<h2>Cross-check</h2>" in page
    (True, True)
    """
    if not isinstance(solution, Solution):
        raise InputError(f"solution is {described(solution)}; a Solution was expected")
    time_limit = as_number(time_limit, "time_limit", above=0.0)
    problem = solution.problem
    parts: list[tuple[str, Callable[[], str]]] = [
        ("Answer", lambda: solution._repr_html_()),
        ("Picture", lambda: _svg(solution_figure(solution, points))),
        ("What is certain before a solve", lambda: explain(problem)._repr_html_()),
        ("Cross-check", lambda: crosscheck(problem, solution, time_limit=time_limit)._repr_html_()),
        ("Sensitivity of the answer", lambda: _pre(sensitivity(solution))),
        ("Race", lambda: _race(problem, z_exact, time_limit)),
        ("Where relaxation works", lambda: _map(problem)),
    ]
    body = []
    for heading, make in parts:
        say(heading)
        try:
            inner = make()
        except IcpError as error:
            inner = f"<p class='note'>Not shown: {html.escape(str(error))}.</p>"
        body.append(f"<section><h2>{heading}</h2>{inner}</section>")
    made = f"{machine()}" + (f"; {command}" if command else "")
    return (
        "<!DOCTYPE html>\n<html lang='en'><head><meta charset='utf-8'>"
        "<meta name='viewport' content='width=device-width, initial-scale=1'>"
        f"<title>{html.escape(title)}</title><style>{_STYLE}</style></head><body>"
        f"<h1>{html.escape(title)}</h1><p>{html.escape(about)}</p><p class='note'>{html.escape(made)}</p>"
        f"{''.join(body)}</body></html>\n"
    )


#: a map solves the problem some hundreds of times
_MAP_UP_TO = 1000


def _map(problem: ICP) -> str:
    if problem.n > _MAP_UP_TO:
        raise InputError(f"a map solves the problem hundreds of times, which is done up to n = {_MAP_UP_TO}")
    found = stability("relaxation", problem, points=11, starts=2, max_iter=1000)
    return _svg(map_figure(found)) + _pre(found)


#: the tolerances of the race, and the seconds that each of its runs may take
_TOLERANCES, _RACE_LIMIT = tuple(10.0**-k for k in range(2, 13, 2)), 3.0


def _race(problem: ICP, z_exact: Vector | None, time_limit: float) -> str:
    limit = min(_RACE_LIMIT, time_limit)
    found = race(problem, z_exact=z_exact, tolerances=_TOLERANCES, repeats=1, time_limit=limit)
    left_out = [f"{name}: left out, {reason}" for name, reason in found.skipped]
    return _svg(race_figure(found)) + (_pre("\n".join(left_out)) if left_out else "")


def _pre(told: Any) -> str:
    return f"<pre>{html.escape(str(told))}</pre>"


def _svg(figure: Figure) -> str:
    """The figure as an SVG element, with names of its own within it, as several figures meet on a page."""
    text = io.StringIO()
    figure.savefig(text, format="svg", dpi=110)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :]
    mark = f"f{zlib.crc32(svg.encode()):x}-"
    svg = re.sub(r'(\bid="|url\(#|href="#)', lambda found: found.group(1) + mark, svg)
    return f"<figure>{svg}</figure>"
