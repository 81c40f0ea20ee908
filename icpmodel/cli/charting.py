"""`icpmodel race`, `icpmodel stability` and `icpmodel report`."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import click

from ..errors import InputError
from ..methods.contract import names
from ..scenes import names as scene_names
from ..solve.progress import status_line
from ..study import race as run_race
from ..study import report as make_report
from ..study import stability as map_stability
from ..study.cases import uninterrupted
from ..study.charts.figures import data_file, figure, picture_file, save
from ..study.html_report import page_file, scene_texts
from ..study.planes import PLANES
from .arguments import (
    METHOD_OPTIONS,
    SOLVERS_OPTION,
    SOURCE_OPTIONS,
    command,
    completing,
    from_signature,
    named_method,
    named_problem,
)
from .output import FORMS, TO_FIGURE, command_line, exit_code, measured, print_table, wrote
from .solving import unsolved

_STABILITY_OPTIONS = ("points", "starts", "max_iter", "rtol", "time_limit")
_RACE_OPTIONS = ("repeats", "time_limit")


@command(
    click.argument("plane", default="relaxation", shell_complete=completing(lambda: PLANES)),
    click.argument("source", required=False, shell_complete=completing(scene_names)),
    *SOURCE_OPTIONS[1:],
    click.option(
        "--method", shell_complete=completing(names), help="For the planes that vary the problem.  [default: mnmgs]"
    ),
    *from_signature(map_stability, *_STABILITY_OPTIONS),
    TO_FIGURE,
    *FORMS,
)
def stability(plane: str, output: str | None, form: str | None, **arguments: Any) -> int:
    """Map where a method converges, how fast, how it fails elsewhere, and what the theorems prove.

    PLANE says what varies. Parameters of a method vary, on SOURCE or on a built-in problem, for relaxation (theta1 x
    theta2, the default) and shift (phi x Omega). The problem varies for coupling (mu x norm of G), transport (skewness
    x mu) and units (units x norm of G).
    """
    check_picture(output)
    options = {name: arguments[name] for name in ("method", *_STABILITY_OPTIONS)}
    problem = None
    if arguments["source"] is not None or arguments["a_file"] is not None:
        problem, _ = named_problem(arguments)
    elif arguments["parameters"] or any(arguments[name] is not None for name in ("q_file", "psi", "upper")):
        raise InputError("--set, --q, --psi and --upper belong to a SOURCE or to --A; name one")
    elif arguments["n"] is not None:
        options["n"] = arguments["n"]
    run = partial(map_stability, plane, problem, **options, progress=True, command=command_line())
    return _print_and_draw(run, output, form, "the other points are not run")


@command(
    *SOURCE_OPTIONS,
    click.option(
        "--method",
        "methods",
        multiple=True,
        shell_complete=completing(names),
        help="A method to compare with solve(); repeatable; default: several.",
    ),
    SOLVERS_OPTION,
    *from_signature(run_race, *_RACE_OPTIONS),
    TO_FIGURE,
    *FORMS,
)
def race(
    methods: tuple[str, ...], solvers: tuple[str, ...], output: str | None, form: str | None, **arguments: Any
) -> int:
    """Measure time against error on SOURCE, for this package's methods and independent solvers."""
    check_picture(output)
    problem, scene = named_problem(arguments)
    options = {name: arguments[name] for name in _RACE_OPTIONS}
    options |= {"progress": True, "command": command_line()}
    run = partial(run_race, scene or problem, methods or None, solvers or None, **options)
    return _print_and_draw(run, output, form, "this is what was measured before")


def check_picture(path: str | None) -> None:
    """Raise FileError or InputError, before the work begins, where `path` cannot take the picture and its data."""
    if path is not None:
        data_file(picture_file(path))


def _print_and_draw(run: Callable[[], Any], output: str | None, form: str | None, if_interrupted: str) -> int:
    """Run, draw to `output` and print; after Ctrl-C the results so far, with the message `if_interrupted`.

    Returns the exit code.
    """

    def show(result: Any) -> None:
        # before printing, which may fail
        for path in [] if output is None else save(figure(result), output, result.table(), command_line()):
            wrote(path)
        print_table(result, result.table(), form)

    return measured(run, show, if_interrupted)


@command(
    *SOURCE_OPTIONS,
    *METHOD_OPTIONS,
    click.option("-o", "--output", type=click.Path(), required=True, help="The HTML file to write."),
    *from_signature(make_report, "time_limit"),
)
def report(output: str, time_limit: float, **arguments: Any) -> int:
    """Write one self-contained HTML page on SOURCE: analysis, solution, pictures, cross-check, race and map."""
    page_file(output)
    problem, scene = named_problem(arguments)
    method = named_method(arguments)
    about = {"title": arguments["source"] or arguments["a_file"]} if scene is None else scene_texts(scene)
    with status_line(True) as say:
        say("solving")
        start = scene and scene.z0
        solution = uninterrupted(problem.solve(method, z0=start, history=True, raise_on_failure=False))
        make_report(solution, output, **about, command=command_line(), time_limit=time_limit, progress=True)
    wrote(output)
    return exit_code(solution.solved, unsolved(solution))
