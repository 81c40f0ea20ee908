"""`icpmodel solve` and `icpmodel crosscheck`."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError, Interrupted
from ..files import load_problem, load_solution, save_problem, save_solution
from ..methods import named, names
from ..problem import ICP
from ..progress import status_line
from ..solution import Solution
from .output import exit_code, must_be_writable, show_json

if TYPE_CHECKING:
    from ..crosscheck import Report
    from ..scenes import Scene

_SOURCE_HELP = """SOURCE is the name of a built-in scene (see `icpmodel scenes`), a folder or .npz file written by
--save-problem, or a Matrix Market file of A together with --q."""

_PAIR: dict[str, Any] = {"multiple": True, "metavar": "NAME=VALUE"}
_OPTIONS = (
    click.argument("source"),
    click.option("--n", type=int, help="Wanted number of unknowns of a scene; it takes the nearest it can have."),
    click.option("--set", "parameters", **_PAIR, help="A parameter of the scene; repeatable."),
    click.option("--q", "q_file", type=click.Path(), help="Matrix Market file of q, where SOURCE is one of A."),
    click.option("--method", help=f"One of {', '.join(names())}; without it one is picked."),
    click.option("--option", "options", **_PAIR, help="An option of the method, such as theta1=1.2; repeatable."),
    click.option("--z0", "z0_file", type=click.Path(), help="Start from the z of this .npz file, written by -o."),
    click.option("--rtol", type=float, help="Stop at the residual rtol * Res(0), default 1e-8 ..."),
    click.option("--atol", type=float, help="... or at atol, the larger of both, default 0 ..."),
    click.option("--accuracy", type=float, help="... or, instead, at this certified error of every entry of z."),
    click.option("--max-iter", type=int, default=100_000, show_default=True, help="Iterations in all."),
    click.option("--time-limit", type=float, help="Seconds, looked at between iterations."),
    click.option("--bound/--no-bound", default=True, help="Compute the error bound, which may cost a solve."),
    click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text."),
)


def _problem_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The arguments by which a problem, a method and the limits are named."""
    for decorate in reversed(_OPTIONS):
        command = decorate(command)
    return command


@click.command(epilog=_SOURCE_HELP)
@_problem_options
@click.option("-o", "--output", type=click.Path(), help="Write z, p, r and the certificate to this .npz file.")
@click.option("--save-problem", "folder", type=click.Path(), help="Write the problem to this folder or .npz file.")
def solve(output: str | None, folder: str | None, as_json: bool, **arguments: Any) -> int:
    """Solve the problem SOURCE and say how wrong the answer can be."""
    must_be_writable(output)
    if output is not None and not output.lower().endswith(".npz"):
        raise InputError(f"--output is {output!r}; a name that ends in .npz was expected")
    problem, scene = _problem(arguments)
    if folder is not None:
        save_problem(problem, folder)
    solution = _solved(problem, scene, arguments)
    errors = {} if scene is None else scene.errors(solution.z)
    if as_json:
        show_json(solution.about() | {"distance_to_reference": errors})
    else:
        click.echo(str(solution))
        for name, error in errors.items():
            click.echo(f"{'reference':<9} {name}: off by {error:.3g}")
    if output is not None:
        save_solution(solution, output)
    return exit_code(solution.solved, f"not solved: {solution.message}")


@click.command(epilog=_SOURCE_HELP)
@_problem_options
@click.option("--solver", "solvers", multiple=True, help="Independent solver to ask; repeatable; default: all.")
@click.option("--solver-time-limit", type=float, default=60.0, show_default=True, help="Seconds for each of them.")
@click.option("--csv", "csv_path", type=click.Path(), help="Write the report's rows to this CSV file as well.")
def crosscheck(
    solvers: tuple[str, ...], solver_time_limit: float, csv_path: str | None, as_json: bool, **arguments: Any
) -> int:
    """Solve the problem SOURCE, then have independent solvers check the answer."""
    from ..crosscheck import chosen_solvers

    must_be_writable(csv_path)
    chosen_solvers(solvers)
    problem, scene = _problem(arguments)
    solution = _solved(problem, scene, arguments)
    told: dict[str, Any] = {"solution": solution.about(), "report": None, "at_their_size": []}
    if not as_json:  # at once, so that nothing is lost if the solvers below take too long
        click.echo(str(solution))
    agrees, complaint = False, f"not solved: {solution.message}"
    if solution.solved:
        report, interrupted = _report(problem, solution, solvers, solver_time_limit)
        agrees, complaint = report.agrees, "not confirmed: no independent solver agrees, or one disagrees"
        told["report"] = json.loads(report.to_json())
        if not as_json:
            click.echo(f"\n{report}")
        if csv_path is not None:
            report.to_csv(csv_path)
        for smaller, asked in [] if scene is None or interrupted else _at_their_size(scene, report, arguments):
            report, _ = _report(smaller, None, asked, solver_time_limit)
            agrees &= not any(row.verdict.value == "disagrees" for row in report.rows)
            told["at_their_size"].append(json.loads(report.to_json()))
            if not as_json:
                click.echo(f"\n{', '.join(asked)}: the same scene at n = {smaller.n}\n{report}")
    if as_json:
        show_json(told)
    return exit_code(agrees, complaint)


def _report(problem: ICP, solution: Any, solvers: tuple[str, ...], time_limit: float) -> tuple[Report, bool]:
    """The report, and whether Ctrl-C cut it short."""
    from ..crosscheck import crosscheck as check

    try:
        return check(problem, solution, solvers or None, time_limit=time_limit, progress=True), False
    except Interrupted as stopped:
        return stopped.report, True


def _problem(arguments: dict[str, Any]) -> tuple[ICP, Scene | None]:
    """The problem that the arguments name, and its scene if it is one."""
    from .. import scenes as gallery

    source, n, q_file = arguments["source"], arguments["n"], arguments["q_file"]
    parameters = _pairs(arguments["parameters"])
    if source in gallery.names():
        if q_file is not None:
            raise InputError(f"--q belongs to a Matrix Market file of A; {source} is a scene, which has its own q")
        if "n" in parameters:
            raise InputError("the size of a scene is set by --n, not by --set n=...")
        scene = gallery.scene(source, n, **parameters)
        if n is not None and scene.problem.n != n:
            click.echo(f"note: {source} has no size {n}; the nearest is {scene.problem.n}", err=True)
        return scene.problem, scene
    listed = ", ".join(gallery.names())
    if not source or not Path(source).exists():
        raise InputError(f"{source or 'SOURCE'} is neither a file or folder nor a scene; scenes: {listed}")
    if n is not None or parameters:
        raise InputError(f"--n and --set belong to scenes, and {source} is none of them: {listed}")
    return load_problem(source, q_file), None


def _solved(problem: ICP, scene: Scene | None, arguments: dict[str, Any]) -> Solution:
    """The solution with its certificate; Ctrl-C while the error bound is computed leaves the bound out."""
    options = _pairs(arguments["options"])
    method = None if arguments["method"] is None else named(arguments["method"], **options)
    if options and method is None:
        raise InputError("--option belongs to a method; name one with --method")
    z0 = None if scene is None else scene.z0
    if arguments["z0_file"] is not None:
        z0 = load_solution(arguments["z0_file"])["z"]
    limits = {name: arguments[name] for name in ("rtol", "atol", "accuracy", "max_iter", "time_limit")}
    solution = problem.solve(method, z0=z0, progress=True, raise_on_failure=False, **limits)
    if not arguments["bound"]:
        return solution.without_bound()
    try:
        with status_line(True) as say:
            say("computing the error bound; Ctrl-C leaves it out")
            _ = solution.certificate
    except KeyboardInterrupt:
        return solution.without_bound()
    return solution


def _at_their_size(scene: Scene, report: Report, arguments: dict[str, Any]) -> list[tuple[ICP, tuple[str, ...]]]:
    """For the solvers that a scene is too large for: the scene at the largest size they take, and their names."""
    from .. import scenes as gallery
    from ..crosscheck import independent_solvers

    known = independent_solvers()
    by_size: dict[int, list[str]] = {}
    for row in report.rows:
        largest = known[row.solver].largest
        if row.verdict.value == "skipped" and largest is not None and largest < scene.problem.n:
            by_size.setdefault(largest, []).append(row.solver)
    found = []
    for largest, asked in by_size.items():
        n = largest
        while (smaller := gallery.scene(scene.name, n, **_pairs(arguments["parameters"])).problem).n > largest:
            n -= 1
        found.append((smaller, tuple(asked)))
    return found


def _pairs(texts: tuple[str, ...]) -> dict[str, Any]:
    """name=value with the value as a number or truth value where it is one."""
    found: dict[str, Any] = {}
    for text in texts:
        name, equals, value = text.partition("=")
        if not equals or not name:
            raise InputError(f"{text!r} is not of the form NAME=VALUE")
        found[name] = value
        if value.lower() in ("true", "false"):
            found[name] = value.lower() == "true"
        for convert in (float, int):  # int last: it wins where both can read it
            try:
                found[name] = convert(value)
            except ValueError:
                continue
    return found
