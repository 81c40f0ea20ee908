"""`icpmodel race`, `icpmodel stability` and `icpmodel report`."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError, Interrupted
from ..solve.progress import status_line
from .output import complain, exit_code, must_be_writable, typed
from .source import METHOD_OPTIONS, SOURCE_HELP, SOURCE_OPTIONS, named_method, named_problem, options

if TYPE_CHECKING:
    from ..study import Race, StabilityMap


@click.command(epilog=SOURCE_HELP)
@click.argument("plane", default="relaxation")
@options(click.argument("source", required=False), *SOURCE_OPTIONS[1:])
@click.option("--method", help="For the planes that vary the problem.  [default: mnmgs]")
@click.option("--points", type=int, default=25, show_default=True, help="Points per axis.")
@click.option("--starts", type=int, default=3, show_default=True, help="Starts per point; the worst run counts.")
@click.option("--max-iter", type=int, default=2000, show_default=True, help="Steps of a run.")
@click.option("--rtol", type=float, default=1e-8, show_default=True, help="Relative tolerance of a run.")
@click.option("-o", "--output", type=click.Path(), help="Write the figure (PNG and SVG) and its data (CSV).")
@click.option("--csv", "as_csv", is_flag=True, help="Print all points as CSV.")
def stability(plane: str, output: str | None, as_csv: bool, **arguments: Any) -> int:
    """Map where a method converges, how fast, how it fails elsewhere, and where the theorems prove what.

    PLANE is one of relaxation (theta1 x theta2, the default) and shift (phi x Omega), which vary a method on SOURCE or
    on a built-in problem, and coupling (mu x norm of G), transport (skewness x mu), condition (condition number x
    units) and units (units x norm of G), which vary the problem.
    """
    from ..study import stability as mapped

    must_be_writable(output)
    problem = None
    if arguments["source"] is not None:
        problem, _ = named_problem(arguments)
    elif arguments["parameters"] or arguments["q_file"] is not None:
        raise InputError("--set and --q belong to a SOURCE; name one")
    asked = {name: arguments[name] for name in ("method", "points", "starts", "max_iter", "rtol")}
    size = {} if arguments["n"] is None or problem is not None else {"n": arguments["n"]}
    return _shown(
        lambda: mapped(plane, problem, **asked, **size, progress=True, command=typed()),
        output,
        as_csv,
        "the other points are not run",
    )


@click.command(epilog=SOURCE_HELP)
@options(*SOURCE_OPTIONS)
@click.option("--method", "methods", multiple=True, help="An own method beside solve(); repeatable; default: several.")
@click.option("--solver", "solvers", multiple=True, help="An independent solver; repeatable; default: all that apply.")
@click.option("--repeats", type=int, default=3, show_default=True, help="Rounds of timings.")
@click.option("--time-limit", type=float, default=10.0, show_default=True, help="Seconds for one run.")
@click.option("-o", "--output", type=click.Path(), help="Write the chart (PNG and SVG) and its data (CSV).")
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
def race(methods: tuple[str, ...], solvers: tuple[str, ...], output: str | None, as_csv: bool, **arguments: Any) -> int:
    """Time against error on SOURCE: own methods and independent solvers at every tolerance, in turn."""
    from ..study import race as run

    must_be_writable(output)
    problem, scene = named_problem(arguments)
    exact = None if scene is None else scene.z_exact
    limits = {name: arguments[name] for name in ("repeats", "time_limit")}
    return _shown(
        lambda: run(problem, methods or None, solvers or None, z_exact=exact, progress=True, command=typed(), **limits),
        output,
        as_csv,
        "this is what was measured before",
    )


def _shown(measure: Callable[[], Race | StabilityMap], output: str | None, as_csv: bool, partly: str) -> int:
    """Measure, print and draw; after Ctrl-C what there is, with the sentence `partly`, and the exit code 130."""
    stopped = False
    try:
        found = measure()
    except Interrupted as interrupted:
        found, stopped = interrupted.report, True
    click.echo(found.table().to_csv() if as_csv else str(found), nl=not as_csv)
    if output is not None:
        for path in found.plot(output):
            click.echo(f"wrote {path}", err=True)
    if stopped:
        complain(f"interrupted: {partly}")
        return 130
    return 0


@click.command(epilog=SOURCE_HELP)
@options(*SOURCE_OPTIONS, *METHOD_OPTIONS)
@click.option("-o", "--output", type=click.Path(), required=True, help="The HTML file to write.")
@click.option("--time-limit", type=float, default=60.0, show_default=True, help="Seconds per independent solver.")
def report(output: str, time_limit: float, **arguments: Any) -> int:
    """Write one self-contained HTML page on SOURCE: explained, solved, pictured, cross-checked, charted."""
    from ..study import html_report

    must_be_writable(output, ".html")
    problem, scene = named_problem(arguments)
    method = named_method(arguments)
    with status_line(True) as say:
        say("solving")
        solution = problem.solve(method, z0=None if scene is None else scene.z0, raise_on_failure=False)
        page = html_report(
            solution,
            title=arguments["source"] if scene is None else f"{scene.name}: {scene.title}",
            about="" if scene is None else scene.models,
            points=None if scene is None else scene.points,
            z_exact=None if scene is None else scene.z_exact,
            command=typed(),
            time_limit=time_limit,
            say=say,
        )
    Path(output).write_text(page, encoding="utf-8")
    click.echo(f"wrote {output}", err=True)
    return exit_code(solution.solved, f"not solved: {solution.status.value}")
