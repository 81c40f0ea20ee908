"""One self-contained HTML page on a problem: a summary, then answer, proofs, cross-check, race, sensitivity and map."""

from __future__ import annotations

import io
import os
import re
import zlib
from collections.abc import Callable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

from ..crosscheck.check import crosscheck
from ..derivatives.derivative import Derivative
from ..errors import IcpError, InputError, check_arguments
from ..explain.explanation import explain
from ..methods.aor import MNMGS
from ..numerics.arrays import Vector, as_number
from ..numerics.rounding import rounded_up
from ..present.card import Card
from ..present.display import counted
from ..present.rendering import render
from ..present.whole_files import place_of, write_ours
from ..problem.data import ProblemData, ProblemLike, as_problem
from ..problem.map import Map
from ..problem.two_sided import sides_of
from ..scenes import Scene
from ..scenes.registry import title as scene_title
from ..solve.driver import solve
from ..solve.progress import Progress, status_line
from ..solve.solution import Solution
from .cases import uninterrupted
from .charts.field_charts import Fields
from .charts.figures import Panel, drawing, panel_figure
from .charts.places import places_of
from .planes import relaxation_plane
from .race import DEFAULT_TOLERANCES, race
from .sensitivity import sensitivity
from .stability_map import stability
from .timing import machine

#: the element that marks a page as one of this package
GENERATOR = b'<meta name="generator" content="icpmodel">'
#: the largest n with a map, which solves the problem at `_MAP_POINTS`² points
_MAP_UP_TO = 1000
#: the points per axis of the map
_MAP_POINTS = 9
#: the seconds that each run of the race may take
_RACE_LIMIT = 3.0
#: the ratio of the step numbers of successive iterates that are drawn
_PICTURE_RATIO = 3


class Page(str):
    """The HTML text of a page, with a short `repr`."""

    __slots__ = ()

    def __repr__(self) -> str:
        return f"<page, {len(self) / 1e6:.1f} MB of HTML>"


@dataclass
class Section:
    """One section of the page.

    Parameters
    ----------
    short : str
        The answer to the `question`, in a sentence.
    introduction : str
        A sentence or two.
    panels : sequence of Panel
        The pictures.
    folded : list of (str, str)
        (title, HTML) of each part that can be unfolded.
    missing : str
        Why the section is empty.
    heading, question : str
        Filled in by `report`.
    """

    short: str = ""
    introduction: str = ""
    panels: Sequence[Panel] = ()
    folded: list[tuple[str, str]] = field(default_factory=list)
    missing: str = ""
    heading: str = ""
    question: str = ""

    @property
    def anchor(self) -> str:
        """The name of the section in links."""
        return re.sub(r"\W+", "-", self.heading.lower())

    @property
    def pictures(self) -> list[tuple[Panel, str]]:
        """Each panel with its SVG."""
        return [(panel, _svg(panel)) for panel in self.panels]


@check_arguments
def report(
    problem: ProblemLike,
    path: str | os.PathLike[str] | None = None,
    *,
    title: str = "",
    about: str = "",
    points: Vector | None = None,
    z_exact: Vector | None = None,
    command: str = "",
    time_limit: float = 60.0,
    progress: bool = False,
) -> Page:
    """Make one HTML page that opens offline: answer, certificate, cross-check, race, sensitivity and map.

    It begins with a summary: whether the problem is solved, how certain that is, which solvers agree,
    which is fastest, and whether the answer has a derivative. A section that cannot be made, such as a
    map of a problem that is too large, says why. The page follows the reader's dark mode.

    Pointing at a marker shows its numbers; clicking on a figure widens it to the page.

    Parameters
    ----------
    problem : ICP, Scene, Solution, or what else can be solved
        The subject of the page. Unless it is a solution, it is solved first.
    path : str or path, optional
        The file to write, whose name ends in .html.
    title, about : str, optional
        Heading and introduction; by default those of the scene.
    points : array_like of shape (n,), (n, 2) or (n, 3), optional
        Coordinates of the unknowns; by default those of the scene or grid that A is from.
    z_exact : array_like of shape (n,), optional
        The solution where it is known; by default that of the scene.
    command : str, optional
        The command that makes the page again, shown on the page.
    time_limit : float, default 60.0
        Seconds for the cross-check, and at most 3 of them for each run of the race.
    progress : bool, default False
        Whether to show a status line.

    Returns
    -------
    str
        The HTML text, about 1 MB. It needs no other file.

    Raises
    ------
    InputError
        For wrong arguments.
    FileError
        Where the file cannot be written.

    Examples
    --------
    >>> page = icp.report(ICP([[2, -1], [-1, 2]], [-1, 3]), title="A pair", time_limit=5)
    >>> page.startswith("<!DOCTYPE html>"), "Which solvers agree?" in page
    (True, True)
    """
    time_limit = as_number(time_limit, "time_limit", above=0.0)
    file = None if path is None else page_file(path)
    scene = problem if isinstance(problem, Scene) else None
    if scene is not None:
        known = scene_texts(scene)
        about = about or known["about"]
        z_exact = known["z_exact"] if z_exact is None else z_exact
    data = as_problem(problem, nonlinear=True)
    if z_exact is not None:
        data.vector(z_exact, "z_exact", finite=True)
    if points is not None:
        places_of(data, points, None)
    start = None if scene is None else scene.z0
    sections: list[Section] = []
    limit = min(_RACE_LIMIT, time_limit)
    opening = f"seven sections; the cross-check takes {time_limit:g} s at most, each run of the race {limit:g} s"
    with status_line(progress, opening) as say:
        if isinstance(problem, Solution):
            solution = problem
        else:
            say("solving")
            solution = uninterrupted(solve(data, z0=start, history=True, raise_on_failure=False))
        problem = solution.problem
        for heading, question, make in _contents(solution, start, points, z_exact, time_limit):
            say(f"section {len(sections) + 1}: {heading}")
            try:
                section = make()
            except IcpError as error:
                section = Section(missing=str(error), short=f"Not known: {error}.")
            section.heading = heading
            section.question = question
            sections.append(section)
    page = render(
        "report.html",
        title=title or scene_title(problem),
        about=about,
        problem=problem,
        data=_data(problem),
        machine=machine(),
        command=command,
        sections=sections,
    )
    if file is not None:
        write_ours(file, page.encode("utf-8", "backslashreplace"), holds=GENERATOR)
    return Page(page)


def scene_texts(scene: Scene) -> dict[str, Any]:
    """The introduction and the exact solution, if known, for a page on `scene`."""
    return {"about": f"{scene.title}. {scene.models}", "z_exact": scene.z_exact}


def page_file(path: Any) -> Path:
    """Check that a page can be written to `path`, and return it. Raises InputError and FileError."""
    return place_of(path, (".html",), holds=GENERATOR)


def _contents(
    solution: Solution, start: Vector | None, points: Vector | None, z_exact: Vector | None, time_limit: float
) -> list[tuple[str, str, Callable[[], Section]]]:
    """(heading, question of the summary or "", function that makes the section) of each section, in order."""
    problem = solution.problem
    return [
        ("The answer", "Is it solved?", lambda: _answer(solution, start, points, time_limit)),
        ("Certainty", "How certain is it?", lambda: _certificate(solution)),
        ("Second opinions", "Which solvers agree?", lambda: _crosscheck(solution, time_limit)),
        ("Time against accuracy", "Which is the fastest?", lambda: _race(problem, z_exact, time_limit)),
        ("When the data change", "Does it have a derivative?", lambda: _sensitivity(solution)),
        ("Before the solve", "", lambda: _explanation(problem)),
        ("Where relaxation works", "", lambda: _map(problem)),
    ]


def _data(problem: ProblemData) -> str:
    """The size of A and the kind of each obstacle, in words."""
    sides = "; ".join(f"{name} {_kind(one)}" for name, one in zip(("ψ", "ψ̄"), sides_of(problem.psi), strict=False))
    return f"A is {problem.n} × {problem.n}, with {problem.A.nnz} entries that are not 0; {sides}."


def _kind(obstacle: Map) -> str:
    if obstacle.linear is None:
        return "is a function of z that is not affine"
    return "does not depend on z" if obstacle.is_constant else "depends on z: it is Gz + c"


def _answer(solution: Solution, start: Vector | None, points: Vector | None, time_limit: float) -> Section:
    took = f"{counted(solution.iterations, 'step')}, {solution.seconds:.2g}\u00a0s"
    short = (
        f"Yes, by {solution.method.name}: {took}. The residual, which is 0 at a solution, is {solution.residual:.2g}."
    )
    if not solution.solved:
        short = f"No: {solution.message}. What is shown is the best that was found in {took}."
    panels = [*drawing(solution, points=points).panels]
    if solution.history_or_none is not None and solution.history.residual.size > 1:
        panels += drawing(solution.history).panels
    with suppress(IcpError):
        panels += drawing(_sweep_iterates(solution, start, min(_RACE_LIMIT, time_limit)), points=points).panels
    return Section(
        short=short,
        introduction="Last, a run of the paper's sweeps: z as the contact closes in.",
        panels=panels,
        folded=[("The solve in detail", Card(solution.summary()).to_html())],
    )


def _sweep_iterates(solution: Solution, start: Vector | None, time_limit: float) -> Fields:
    """Iterates of a run of the paper's sweeps, their step numbers in geometric progression. Raises IcpError."""
    iterates: dict[str, Vector] = {}
    following = 0

    def watch(now: Progress) -> None:
        nonlocal following
        if now.iteration >= following:
            following = max(now.iteration + 1, _PICTURE_RATIO * now.iteration)
            iterates[f"z after {counted(now.iteration, 'step')}"] = now.z

    problem = solution.problem
    options: dict[str, Any] = {"z0": start, "time_limit": time_limit, "raise_on_failure": False}
    uninterrupted(solve(problem, MNMGS(), callback=watch, **options))
    return Fields(problem, iterates)


def _certificate(solution: Solution) -> Section:
    bound = solution.certificate.bound
    short = f"It is not proved: {bound.reason}."
    if bound.value is not None:
        size = rounded_up(bound.value)
        short = f"It is proved that no entry of z is off by more than {size}, and that there is no other solution."
    elif bound.unique:
        short = (
            f"It is proved that there is one solution and no other; how far z is from it is not known: {bound.reason}."
        )
    introduction = "What is said here was computed again from A, q, ψ and z, whatever solver made z."
    folded = [("The certificate", solution.certificate._repr_html_())]
    return Section(short, introduction, folded=folded)


def _crosscheck(solution: Solution, time_limit: float) -> Section:
    checks = crosscheck(solution.problem, solution, time_limit=time_limit)
    introduction = "Other solvers got the same problem, without the answer, and one criterion judges all of them."
    return Section(checks.conclusion(), introduction, folded=[("Every check", checks._repr_html_())])


def _sensitivity(solution: Solution) -> Section:
    derivative = Derivative(solution)
    sure = "Yes, and this is proved" if derivative.certain else "Not for certain"
    section = Section(f"{sure}: {derivative.reason}.")
    section.folded = [("The derivative", derivative._repr_html_())]
    try:
        section.folded.insert(0, ("The condition number", sensitivity(solution)._repr_html_()))
        section.introduction = "How much z moves when A, q and ψ change by a small share of themselves, entry by entry."
    except IcpError as error:
        section.introduction = f"How much z moves with the data is not known: {error}."
    return section


def _explanation(problem: ProblemData) -> Section:
    page = explain(problem)
    first, *_ = next(iter(page.sections().values())).splitlines()
    return Section(
        introduction=f"To do: {first}.", folded=[("What is known of A and ψ, and what is proved", page._repr_html_())]
    )


def _race(problem: ProblemData, z_exact: Vector | None, time_limit: float) -> Section:
    limit = min(_RACE_LIMIT, time_limit)
    outcome = race(problem, z_exact=z_exact, tolerances=DEFAULT_TOLERANCES[::2], repeats=1, time_limit=limit)
    folded = [("Every run", outcome.table().to_html())]
    if left := outcome.left_out():
        folded.append(("Solvers that did not take part", render("folded.html", text="\n".join(left))))
    return Section(
        short=outcome.in_words("To {goal:g} of the residual at z = 0"),
        introduction="Each run was made once; times on other machines, and of problems of another size, differ.",
        panels=drawing(outcome).panels,
        folded=folded,
    )


def _map(problem: ProblemData) -> Section:
    if problem.n > _MAP_UP_TO:
        raise InputError(f"a map solves the problem {_MAP_POINTS**2} times, which is done up to n = {_MAP_UP_TO}")
    result = stability(relaxation_plane(_MAP_POINTS, problem), starts=1)
    return Section(
        introduction=f"What relaxation does to the paper's method: at each point {result.plane.title} is solved.",
        panels=drawing(result).panels,
        folded=[("Counted", result._repr_html_())],
    )


def _svg(panel: Panel) -> str:
    """The panel as an SVG element with its alternative text.

    Its ids have a prefix of their own, as several figures share a page. Black becomes the colour of the text, and white
    backgrounds are transparent. Tooltips show the numbers of a marker and the value of a cell.
    """
    figure = panel_figure(panel)
    figure.patch.set_visible(False)
    for axes in figure.axes:
        axes.patch.set_visible(axes.get_facecolor() != (1.0, 1.0, 1.0, 1.0))
    tips = [tip for axes in figure.axes for tip in _tips(axes)]
    for k, (artist, _, _) in enumerate(tips):
        artist.set_gid(f"m{k}")
    text = io.StringIO()
    figure.savefig(text, format="svg", dpi=110)
    svg = text.getvalue()
    svg = svg[svg.index("<svg") :].replace("#000000", "currentColor")
    for k, (_, element, words) in enumerate(tips):
        add_titles = partial(_with_titles, element, iter(words))
        svg = re.sub(rf'<g id="m{k}">.*?(?=<g id=)', add_titles, svg, count=1, flags=re.DOTALL)
    prefix = f"f{zlib.crc32(svg.encode()):x}-"
    svg = re.sub(r'(\bid="|url\(#|href="#)', lambda match: match.group(1) + prefix, svg)
    return svg.replace("<svg", f'<svg role="img" aria-label="{escape(panel.alt)}" fill="currentColor"', 1)


def _tips(axes: Any) -> Iterator[tuple[Any, str, list[str]]]:
    """Yield (artist, SVG tag of its markers or cells, their tooltips)."""
    for line in axes.lines:
        label = line.get_label()
        if line.get_marker() != "None" and not label.startswith("_"):
            yield line, "use", [f"{label}: {x:.3g}, {y:.3g}" for x, y in line.get_xydata()]
    for cells in axes.collections:
        if cells.colorbar and not cells.get_rasterized():
            label = cells.colorbar.ax.get_ylabel()
            yield cells, "path", [f"{label}: {value}" for value in cells.get_array().ravel().tolist()]


def _with_titles(element: str, words: Iterator[str], group: re.Match[str]) -> str:
    """The text of a matched group, in which each `element` has the next of `words` as its tooltip."""

    def with_title(one: re.Match[str]) -> str:
        return f"{one.group(1)}><title>{escape(next(words, ''))}</title></{element}>"

    return re.sub(rf"(<{element} [^>]*)/>", with_title, group.group())
