"""One self-contained HTML page on a problem: in short, then pictured, explained, cross-checked, timed and mapped."""

from __future__ import annotations

import io
import re
import zlib
from collections.abc import Callable
from html import escape
from typing import Any

from ..crosscheck.check import crosscheck
from ..derivatives.derivative import Derivative
from ..errors import IcpError, InputError
from ..explain.explanation import explain
from ..numerics.arrays import Vector, as_number
from ..numerics.rounding import at_most
from ..present.card import Card
from ..present.rendering import render
from ..problem.data import ProblemData, ProblemLike
from ..scenes import Scene
from ..scenes.registry import title as called
from ..solve.driver import solve
from ..solve.progress import status_line
from ..solve.solution import Solution
from .charts.figures import Figure, drawing
from .charts.interactive_charts import answer_charts, map_charts, race_charts
from .planes import relaxation
from .race import race
from .sensitivity import sensitivity
from .stability_map import stability
from .timing import machine

#: by this element a page is known to be ours
GENERATOR = b'<meta name="generator" content="icpmodel">'
#: a map solves the problem some hundreds of times
_MAP_UP_TO = 1000
#: maps that are tried in turn, until on a few points each a share of them converges: the largest θ, a smaller one makes
#: shorter steps, how many of these a run may take, and the points per axis and starts that this leaves time for
_MAPS = ((2.5, 1000, 11, 2), (2.5, 10_000, 7, 1), (0.25, 10_000, 7, 1))
_TRIED = 4
_SHARE = 0.25
#: the tolerances of the race, and the seconds that each of its runs may take
_TOLERANCES = tuple(10.0**-k for k in range(2, 13, 2))
_RACE_LIMIT = 3.0

#: what a section shows, each entry left out where there is none: "short", the answer to its question; "lead", a
#: sentence or two; "pictures", each with "still", an SVG, its "caption" and "alt"; as many "charts" by Bokeh that take
#: the places of the first ones; the "slider" of these; "folded", (what it is, HTML) each
_Section = dict[str, Any]


def report(
    problem: ProblemLike,
    *,
    title: str = "",
    about: str = "",
    points: Vector | None = None,
    z_exact: Vector | None = None,
    command: str = "",
    time_limit: float = 60.0,
    progress: bool = False,
) -> str:
    """A page that opens offline: in short whether the problem is solved, how sure that is, who agrees, who is quickest
    and whether the answer has a derivative; then the answer, what is certain, the cross-check, the race and a map.

    What cannot be done, such as a cross-check of a problem that is too large, is said in its place. The page is dark
    where the reader's screen is, and can be read on a phone.
    The figures can be pointed at, zoomed and filtered by solver, and sliders go through iterates on the way to the
    answer and over θ; without scripts, and in print, they stand still.
    Parameters: `problem`, which is solved first, or a `Solution`, solved or not; `title` and `about`, text; `points` as
    in `icpmodel.study.figure`; `z_exact` the solution, shape (n,), where it is known; where `problem` is a scene,
    these are by default what it says of itself; `command` what makes the page again; `time_limit` in
    seconds for the cross-check; `progress` shows a line on what is going on. Returns the HTML text, less
    than 5 MB, of which Bokeh is 1.3, that loads nothing. Raises InputError.

    >>> page = icp.report(ICP([[2, -1], [-1, 2]], [-1, 3]), title="A pair", time_limit=5)
    >>> page.startswith("<!DOCTYPE html>"), "Who agrees?" in page
    (True, True)
    """
    time_limit = as_number(time_limit, "time_limit", above=0.0)
    scene = problem if isinstance(problem, Scene) else None
    if scene is not None:
        known = said_of(scene)
        title = title or known["title"]
        about = about or known["about"]
        z_exact = known["z_exact"] if z_exact is None else z_exact
    start = None if scene is None else scene.z0
    with status_line(progress, f"seven sections; the cross-check takes {time_limit:g} s at most") as say:
        if isinstance(problem, Solution):
            solution = problem
        else:
            say("solving")
            solution = solve(scene.problem if scene else problem, z0=start, history=True, raise_on_failure=False)
        problem = solution.problem
        sections: list[_Section] = []
        for heading, question, make in _contents(solution, start, points, z_exact, time_limit):
            say(heading)
            section: _Section = {"heading": heading, "question": question, "id": re.sub(r"\W+", "-", heading.lower())}
            try:
                section |= make()
            except IcpError as error:
                section |= {"missing": str(error), "short": f"Not known: {error}."}
            sections.append(section)
    return render(
        "report.html",
        title=title or called(problem),
        about=about,
        data=_data(problem),
        bounded=problem.upper is not None,
        machine=machine(),
        command=command,
        sections=sections,
        **_bokeh(sections),
    )


def said_of(scene: Scene) -> dict[str, Any]:
    """What a page on the `scene` takes from it: its title, what it models, and its reference."""
    return {"title": called(scene.problem), "about": f"{scene.title}. {scene.models}", "z_exact": scene.z_exact}


def _contents(
    solution: Solution, start: Vector | None, points: Vector | None, z_exact: Vector | None, time_limit: float
) -> list[tuple[str, str, Callable[[], _Section]]]:
    """Heading, the question that it answers in short, and what makes the section."""
    problem = solution.problem
    return [
        ("The answer", "Is it solved?", lambda: _answer(solution, start, points, time_limit)),
        ("How sure that is", "How sure is that?", lambda: _certain(solution)),
        ("Second opinions", "Who agrees?", lambda: _checked(solution, time_limit)),
        ("Time against accuracy", "Who is quickest?", lambda: _race(problem, z_exact, time_limit)),
        ("When the data change", "Has it a derivative?", lambda: _moved(solution)),
        ("Before the solve", "", lambda: _explained(problem)),
        ("Where relaxation works", "", lambda: _map(problem)),
    ]


def _data(problem: ProblemData) -> str:
    """The size of A, and of what kind ψ is."""
    psi = problem.psi
    kind = "is a function of z that is not affine"
    if psi.linear is not None:
        kind = "does not depend on z" if psi.is_constant else "depends on z: it is Gz + c"
    return f"A is {problem.n} × {problem.n}, with {problem.A.nnz} entries that are not 0; ψ {kind}."


def _answer(solution: Solution, start: Vector | None, points: Vector | None, time_limit: float) -> _Section:
    took = f"{solution.iterations} step{'' if solution.iterations == 1 else 's'}, {solution.seconds:.2g}\u00a0s"
    short = (
        f"Yes, by {solution.method.name}: {took}. The residual, which is 0 at a solution, is {solution.residual:.2g}."
    )
    if not solution.solved:
        short = f"No: {solution.message}. What is shown is the best that was found in {took}."
    pictures = _pictures(solution, points)
    if solution.history_or_none is not None and solution.history.residual.size > 1:
        pictures += _pictures(solution.history)
    charts, slider = answer_charts(solution, points, start, min(_RACE_LIMIT, time_limit))
    return {
        "short": short,
        "lead": "The slider goes through a run, from the start to the answer; in sweeps one sees the contact close in.",
        "pictures": pictures,
        "charts": charts[: len(pictures)],
        "slider": slider,
        "folded": [("The solve in detail", Card(solution.summary()).to_html())],
    }


def _certain(solution: Solution) -> _Section:
    certificate = solution.certificate
    bound = certificate.bound
    short = f"It is not proved: {bound.reason}."
    if bound.value is not None:
        size = at_most(bound.value)
        short = f"It is proved that no entry of z is off by more than {size}, and that there is no other solution."
    elif bound.unique:
        short = (
            f"It is proved that there is one solution and no other; how far z is from it is not known: {bound.reason}."
        )
    lead = "What is said here was computed again from A, q, ψ and z, whatever solver found z."
    return {"short": short, "lead": lead, "folded": [("The certificate", render("folded.html", text=str(certificate)))]}


def _checked(solution: Solution, time_limit: float) -> _Section:
    found = crosscheck(solution.problem, solution, time_limit=time_limit)
    lead = "Other solvers got the same problem, from scratch and without being told the answer, and one judge compares."
    return {"short": found.conclusion(), "lead": lead, "folded": [("Every check", found._repr_html_())]}


def _moved(solution: Solution) -> _Section:
    derivative = Derivative(solution)
    sure = "Yes, and this is proved" if derivative.certain else "Not for certain"
    short = f"{sure}: {derivative.reason}."
    lead = "How much z moves when A, q and ψ change by a small share of themselves, entry by entry."
    folded = [("The derivative", render("folded.html", text=str(derivative)))]
    try:
        folded.insert(0, ("The condition number", render("folded.html", text=str(sensitivity(solution)))))
    except IcpError as error:
        lead = f"How much z moves with the data is not told: {error}."
    return {"short": short, "lead": lead, "folded": folded}


def _explained(problem: ProblemData) -> _Section:
    page = explain(problem)
    first, *_ = next(iter(page.sections().values())).splitlines()
    return {
        "lead": f"To do: {first}.",
        "folded": [("What is known of A and ψ, and what is proved", page._repr_html_())],
    }


def _race(problem: ProblemData, z_exact: Vector | None, time_limit: float) -> _Section:
    limit = min(_RACE_LIMIT, time_limit)
    found = race(problem, z_exact=z_exact, tolerances=_TOLERANCES, repeats=1, time_limit=limit)
    folded = [("Every run", found.table().to_html())]
    if left := found.left_out():
        folded.append(("Who did not take part", render("folded.html", text="\n".join(left))))
    lead = "Each run was made once; times on other machines, and of problems of another size, differ."
    return {
        "short": found.in_words("To {goal:g} of the residual at z = 0"),
        "lead": lead,
        "pictures": _pictures(found),
        "charts": race_charts(found),
        "folded": folded,
    }


def _map(problem: ProblemData) -> _Section:
    if problem.n > _MAP_UP_TO:
        raise InputError(f"a map solves the problem hundreds of times, which is done up to n = {_MAP_UP_TO}")
    largest, max_iter, points, starts = _worth_mapping(problem)
    found = stability(relaxation(points, problem, largest), starts=starts, max_iter=max_iter)
    worst = f" from {starts} starts, of which the worst counts" if starts > 1 else ""
    lead = f"What relaxation does to the paper's method: at each point {found.plane.title} is solved{worst}."
    charts, slider = map_charts(found, problem)
    falls = {"alt": "Residual against steps.", "caption": "The residual at θ₁ = θ₂ as the slider has it, others grey."}
    pictures = [*_pictures(found), falls]
    folded = [("Counted", found._repr_html_())]
    return {"lead": lead, "pictures": pictures, "charts": charts, "slider": slider, "folded": folded}


def _worth_mapping(problem: ProblemData) -> tuple[float, int, int, int]:
    """The first of the maps of which enough converges, or else the one of which most does. Raises InputError."""
    share = {}
    ends = set()
    for one in _MAPS:
        largest, max_iter, *_ = one
        found = stability(relaxation(_TRIED, problem, largest), starts=1, max_iter=max_iter)
        share[one] = float((found.ends == "solved").mean())
        ends |= {*found.ends.ravel().tolist()}
        if share[one] >= _SHARE:
            return one
    best = max(share, key=lambda one: share[one])
    if not share[best]:
        tried = f"for θ₁ and θ₂ up to {_MAPS[0][0]:g} and up to {max_iter} steps"
        raise InputError(f"no point converged, {tried}; how they ended: {', '.join(sorted(ends))}")
    return best


def _pictures(what: Any, points: Vector | None = None) -> list[dict[str, str]]:
    made = drawing(what, points)
    pairs = zip(made.apart(), made.panels, strict=True)
    return [{"still": _svg(one, panel.alt), "alt": panel.alt, "caption": panel.caption} for one, panel in pairs]


def _bokeh(sections: list[_Section]) -> dict[str, str]:
    """The library itself, and the script that puts the charts into the elements which take their places here."""
    from bokeh.embed import components
    from bokeh.resources import Resources

    charts = [chart for section in sections for chart in section.get("charts", ())]
    script, elements = components(charts) if charts else ("", ())
    placed = iter(elements)
    for section in sections:
        section["charts"] = [next(placed) for _ in section.get("charts", ())]
    library = Resources(mode="inline", components=["bokeh"]).render_js() if charts else ""
    return {"library": library, "script": script}


def _svg(figure: Figure, alt: str) -> str:
    """The figure as an SVG element that says what it shows, with names of its own within it, as several figures meet on
    a page; what is black has the colour of the text, and white paper is the page."""
    figure.patch.set_visible(False)
    for axes in figure.axes:
        axes.patch.set_visible(axes.get_facecolor() != (1.0, 1.0, 1.0, 1.0))
    text = io.StringIO()
    figure.savefig(text, format="svg", dpi=110)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :].replace("#000000", "currentColor")
    mark = f"f{zlib.crc32(svg.encode()):x}-"
    svg = re.sub(r'(\bid="|url\(#|href="#)', lambda found: found.group(1) + mark, svg)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(alt)}" fill="currentColor"', 1)
