"""`icpmodel solve`, `icpmodel crosscheck`, `icpmodel explain` and `icpmodel scenes`."""

from __future__ import annotations

import json
from contextlib import suppress
from pathlib import Path
from typing import Any

import click

from ..crosscheck.report import HEADS, Report
from ..errors import InputError, Interrupted
from ..icp import ICP
from ..modelling.files import save_problem
from ..modelling.solution_files import check_place, read_start, save_solution
from ..numerics.arrays import as_number
from ..present.card import Card
from ..present.table import Table
from ..present.whole_files import as_path, place_of
from ..scenes import Scene, titles
from ..scenes import names as scene_names
from ..scenes import parameters as parameters_of
from ..scenes import scene as scene_called
from ..solve.driver import solve as run
from ..solve.progress import status_line
from ..solve.solution import Solution, Status
from ..solvers.foreign import chosen_solvers
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
from .output import AS_JSON, exit_code, print_as, show_json, wrote

#: the limits of a solve
_LIMITS = ("rtol", "atol", "accuracy", "max_iter", "time_limit", "memory_limit")
#: the options of the commands that solve
_SOLVE_OPTIONS = (
    *SOURCE_OPTIONS,
    *METHOD_OPTIONS,
    click.option(
        "--z0", "z0_file", type=click.Path(), help="Start from the z of this file: an answer by -o, or a vector."
    ),
    *from_signature(run, *_LIMITS),
    click.option("--bound/--no-bound", default=True, help="Compute the error bound, which may cost a solve."),
    AS_JSON,
)


@command(*_SOLVE_OPTIONS)
@click.option(
    "-o", "--output", type=click.Path(), help="Write the answer to this file: .npz (all of it) or .csv (z, p, r)."
)
@click.option("--polish", is_flag=True, help="Solve once more on the active set, to rounding accuracy.")
@click.option("--save-problem", "problem_file", type=click.Path(), help="Write the problem to this .npz file.")
def solve(output: str | None, polish: bool, problem_file: str | None, as_json: bool, **arguments: Any) -> int:
    """Solve the problem SOURCE and bound the error of the answer."""
    if output is not None:
        check_place(output)
        if problem_file is not None and Path(output).resolve() == Path(problem_file).resolve():
            raise InputError(f"--output and --save-problem are both {output}; two files were expected")
    problem, scene = named_problem(arguments)
    if problem_file is not None:
        save_problem(problem, problem_file)
        wrote(problem_file)
    solution = _solve(problem, scene, arguments)
    if polish and solution.status is not Status.INTERRUPTED:
        with suppress(KeyboardInterrupt), status_line(True) as say:
            say("polishing; Ctrl-C leaves it out")
            polished = solution.polish()
            _ = polished.certificate
            solution = polished
    if output is not None:  # before printing, which may fail
        save_solution(solution, output)
        wrote(output)
    errors = {} if scene is None else scene.errors(solution.z)
    if as_json:
        numbers = {"z": solution.z, "p": solution.p, "r": solution.r}
        show_json(solution.about() | {"distance_to_reference": errors} | numbers)
    else:
        click.echo(str(solution))
        if errors:
            click.echo(Card({"reference": "\n".join(f"{name}: off by {error:.3g}" for name, error in errors.items())}))
    return exit_code(solution.solved, unsolved(solution))


def unsolved(solution: Solution) -> str:
    """The complaint on standard error; the printed solution has the full message."""
    return f"not solved: {solution.status.value}"


def _solve(problem: ICP, scene: Scene | None, arguments: dict[str, Any]) -> Solution:
    """Solve and compute the certificate; Ctrl-C during the latter, or --no-bound, leaves the error bound out."""
    if arguments["accuracy"] is not None and not arguments["bound"]:
        raise InputError("--accuracy asks for a certified error, and --no-bound leaves it out; drop one of them")
    method = named_method(arguments)
    z0_file = arguments["z0_file"]
    z0 = read_start(as_path(z0_file), problem.n) if z0_file is not None else scene and scene.z0
    limits = {name: arguments[name] for name in _LIMITS}
    solution = problem.solve(method, z0=z0, progress=True, raise_on_failure=False, **limits)
    if not arguments["bound"] or solution.status is Status.INTERRUPTED:  # after Ctrl-C no bound is computed
        return solution.without_bound()
    try:
        with status_line(True) as say:
            say("computing the error bound; Ctrl-C leaves it out")
            _ = solution.certificate
    except KeyboardInterrupt:
        return solution.without_bound()
    return solution


@command(*_SOLVE_OPTIONS)
@SOLVERS_OPTION
@click.option("--solver-time-limit", type=float, default=60.0, show_default=True, help="Seconds for all solvers.")
@click.option("--csv", "csv_path", type=click.Path(), help="Write the report's rows to this CSV file as well.")
def crosscheck(
    solvers: tuple[str, ...], solver_time_limit: float, csv_path: str | None, as_json: bool, **arguments: Any
) -> int:
    """Solve the problem SOURCE, then have independent solvers check the answer."""
    if csv_path is not None:
        place_of(csv_path, (".csv",), begins=HEADS)
    chosen_solvers(solvers)
    as_number(solver_time_limit, "--solver-time-limit", above=0)
    problem, scene = named_problem(arguments)
    solution = _solve(problem, scene, arguments)
    report: Report | None = None
    if solution.solved:
        try:
            report = problem.crosscheck(solution, solvers or None, time_limit=solver_time_limit, progress=True)
        except Interrupted as stopped:
            report = stopped.report
    if report is not None and csv_path is not None:
        report.to_csv(csv_path)
    if as_json:
        show_json({"solution": solution.about(), "report": report and json.loads(report.to_json())})
    elif report is not None:
        click.echo(f"{report.findings()}\n\n{solution}")
    else:
        click.echo(f"Not solved: {solution.status.value}; no independent solver was asked.\n\n{solution}")
    complaint = "not confirmed: no independent solver agrees, or one disagrees"
    return exit_code(report is not None and report.agrees, complaint if solution.solved else unsolved(solution))


@command(*SOURCE_OPTIONS, *METHOD_OPTIONS, *from_signature(ICP.explain, "accuracy", "thorough"))
@AS_JSON
def explain(accuracy: float, thorough: bool, as_json: bool, **arguments: Any) -> int:
    """Print what is proved of the problem SOURCE before a solve: classes, uniqueness, theorems, predicted rates."""
    problem, _ = named_problem(arguments)
    with status_line(True) as say:
        say("checking the theorems")
        page = problem.explain(named_method(arguments), accuracy=accuracy, thorough=thorough)
    print_as(page.about(), page, as_json)
    return 0


@click.command()
@click.argument("name", required=False, shell_complete=completing(scene_names))
@AS_JSON
def scenes(name: str | None, as_json: bool) -> int:
    """List the built-in scenes, or describe the scene NAME."""
    if name is None:
        print_as(titles(), Table("", ("scene", "what it is"), tuple(titles().items())), as_json)
        return 0
    scene = scene_called(name)
    parameters = parameters_of(name)
    reference = (["z"] if scene.z_exact is not None else []) + list(scene.quantities)
    about = {"name": scene.name, "title": scene.title, "models": scene.models, "problem": repr(scene.problem)}
    why = {"why_no_reference": scene.why_no_reference, "why_no_solution": scene.why_no_solution}
    typed = " ".join(f"--n {value}" if key == "n" else f"--set {key}={value}" for key, value in parameters.items())
    known = ", ".join(reference) or f"none: {scene.why_no_solution or scene.why_no_reference}"
    title = "solution" if scene.why_no_solution else "reference"
    card = Card(about | {"parameters": typed or "none", title: known})
    print_as(about | {"parameters": parameters, "reference": reference} | why, card, as_json)
    return 0
