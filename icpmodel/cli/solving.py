"""`icpmodel solve` and `icpmodel crosscheck`."""

from __future__ import annotations

import json
from typing import TYPE_CHECKING, Any

import click

from ..errors import InputError, Interrupted
from ..icp import ICP
from ..modelling.files import load_solution, save_problem, save_solution
from ..solve.progress import status_line
from ..solve.solution import Solution
from .output import exit_code, must_be_writable, show_json
from .source import METHOD_OPTIONS, SOURCE_HELP, SOURCE_OPTIONS, named_method, named_problem, options, pairs

if TYPE_CHECKING:
    from ..crosscheck.report import Report
    from ..scenes import Scene

_OPTIONS = (
    *SOURCE_OPTIONS,
    *METHOD_OPTIONS,
    click.option("--z0", "z0_file", type=click.Path(), help="Start from the z of this .npz file, written by -o."),
    click.option("--rtol", type=float, help="Stop at the residual rtol * Res(0), default 1e-8 ..."),
    click.option("--atol", type=float, help="... or at atol, the larger of both, default 0 ..."),
    click.option("--accuracy", type=float, help="... or, instead, at this certified error of every entry of z."),
    click.option("--max-iter", type=int, default=100_000, show_default=True, help="Iterations in all."),
    click.option("--time-limit", type=float, help="Seconds, looked at between iterations."),
    click.option("--bound/--no-bound", default=True, help="Compute the error bound, which may cost a solve."),
    click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text."),
)


@click.command(epilog=SOURCE_HELP)
@options(*_OPTIONS)
@click.option("-o", "--output", type=click.Path(), help="Write z, p, r and the certificate to this .npz file.")
@click.option("--polish", is_flag=True, help="Solve once more on the active set, to rounding accuracy.")
@click.option("--save-problem", "folder", type=click.Path(), help="Write the problem to this folder or .npz file.")
def solve(output: str | None, polish: bool, folder: str | None, as_json: bool, **arguments: Any) -> int:
    """Solve the problem SOURCE and say how wrong the answer can be."""
    must_be_writable(output, ".npz")
    problem, scene = named_problem(arguments)
    if folder is not None:
        save_problem(problem, folder)
        click.echo(f"wrote {folder}", err=True)
    solution = _solved(problem, scene, arguments)
    if polish:
        solution = solution.polish()
    errors = {} if scene is None else scene.errors(solution.z)
    if as_json:
        show_json(solution.about() | {"distance_to_reference": errors})
    else:
        click.echo(str(solution))
        for name, error in errors.items():
            click.echo(f"{'reference':<9} {name}: off by {error:.3g}")
    if output is not None:
        save_solution(solution, output)
        click.echo(f"wrote {output}", err=True)
    return exit_code(solution.solved, _unsolved(solution))


@click.command(epilog=SOURCE_HELP)
@options(*_OPTIONS)
@click.option("--solver", "solvers", multiple=True, help="Independent solver to ask; repeatable; default: all.")
@click.option("--solver-time-limit", type=float, default=60.0, show_default=True, help="Seconds for each of them.")
@click.option("--csv", "csv_path", type=click.Path(), help="Write the report's rows to this CSV file as well.")
def crosscheck(
    solvers: tuple[str, ...], solver_time_limit: float, csv_path: str | None, as_json: bool, **arguments: Any
) -> int:
    """Solve the problem SOURCE, then have independent solvers check the answer."""
    from ..solvers.contract import chosen_solvers

    must_be_writable(csv_path)
    chosen_solvers(solvers)
    problem, scene = named_problem(arguments)
    solution = _solved(problem, scene, arguments)
    told: dict[str, Any] = {"solution": solution.about(), "report": None, "at_their_size": []}
    if not as_json:  # at once, so that nothing is lost if the solvers below take too long
        click.echo(str(solution))
    agrees, complaint = False, _unsolved(solution)
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


def _unsolved(solution: Solution) -> str:
    """The complaint beside a card, which has the message in full."""
    return f"not solved: {solution.status.value}"


def _report(problem: ICP, solution: Any, solvers: tuple[str, ...], time_limit: float) -> tuple[Report, bool]:
    """The report, and whether Ctrl-C cut it short."""
    from ..crosscheck.check import crosscheck as check

    try:
        return check(problem, solution, solvers or None, time_limit=time_limit, progress=True), False
    except Interrupted as stopped:
        return stopped.report, True


def _solved(problem: ICP, scene: Scene | None, arguments: dict[str, Any]) -> Solution:
    """The solution with its certificate; Ctrl-C while the error bound is computed leaves the bound out."""
    if arguments["accuracy"] is not None and not arguments["bound"]:
        raise InputError("--accuracy asks for a certified error, and --no-bound leaves it out; drop one of them")
    method = named_method(arguments)
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
    from ..solvers.contract import foreign_solvers

    known = foreign_solvers()
    by_size: dict[int, list[str]] = {}
    for row in report.rows:
        largest = known[row.solver].largest
        if row.verdict.value == "skipped" and largest is not None and largest < scene.problem.n:
            by_size.setdefault(largest, []).append(row.solver)
    found = []
    for largest, asked in by_size.items():
        n = largest
        while (smaller := gallery.scene(scene.name, n, **pairs(arguments["parameters"])).problem).n > largest:
            n -= 1
        found.append((smaller, tuple(asked)))
    return found
