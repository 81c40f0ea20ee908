"""The command line: arguments in, text or JSON out. No numerics here.

Exit codes: 0 success (solved; for `crosscheck` also confirmed), 1 not solved or not confirmed, 2 wrong input,
130 interrupted before there was anything to show.
"""

from __future__ import annotations

import json
import sys
from collections.abc import Callable
from pathlib import Path
from typing import Any

import click

from .errors import IcpError, InputError
from .files import load_problem, save_problem, save_solution
from .methods import named
from .problem import ICP
from .solution import Solution

_SOURCE_HELP = """SOURCE is the name of a built-in scene (see `icpmodel scenes`), a folder or .npz file written by
`icpmodel.save_problem`, or a Matrix Market file of A together with --q."""


@click.group(context_settings={"help_option_names": ["-h", "--help"]})
@click.version_option(package_name="icpmodel")
def commands() -> None:
    """Implicit complementarity problems: find z with p = Az + q >= 0, r = z - psi(z) >= 0 and p'r = 0.

    \b
    icpmodel scenes                          what is built in
    icpmodel solve membrane --n 10000        solve a scene
    icpmodel solve problem/ -o answer.npz    solve a problem from files
    icpmodel crosscheck membrane             solve, then have osqp, cvxpy and Pyomo check the answer
    icpmodel measure sweep                   the numbers of the README, measured on this machine
    """


def _problem_options(command: Callable[..., Any]) -> Callable[..., Any]:
    """The arguments by which a problem, a method and the limits are named, shared by `solve` and `crosscheck`."""
    for decorate in reversed(
        (
            click.argument("source"),
            click.option(
                "--n", type=int, help="Wanted number of unknowns of a scene; it takes the nearest it can have."
            ),
            click.option("--set", "parameters", multiple=True, metavar="NAME=VALUE", help="A parameter of the scene."),
            click.option("--q", "q_file", type=click.Path(), help="Matrix Market file of q, where SOURCE is one of A."),
            click.option("--method", help="Name of the method, e.g. mnmsor; without it one is picked."),
            click.option(
                "--option", "options", multiple=True, metavar="NAME=VALUE", help="Option of the method: theta1=1.2"
            ),
            click.option("--rtol", type=float, default=1e-8, show_default=True, help="Stop at rtol * Res(0) ..."),
            click.option(
                "--atol", type=float, default=0.0, show_default=True, help="... or at atol, the larger of both."
            ),
            click.option("--max-iter", type=int, default=100_000, show_default=True, help="Iterations in all."),
            click.option("--time-limit", type=float, help="Seconds for the solve, and for each independent solver."),
            click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text."),
        )
    ):
        command = decorate(command)
    return command


@commands.command(epilog=_SOURCE_HELP)
@_problem_options
@click.option("-o", "--output", type=click.Path(), help="Write z, p, r and the certificate to this .npz file.")
@click.option(
    "--save-problem", "problem_path", type=click.Path(), help="Write the problem to this folder or .npz file."
)
def solve(output: str | None, problem_path: str | None, as_json: bool, **arguments: Any) -> int:
    """Solve the problem SOURCE and say how wrong the answer can be."""
    problem, scene = _problem(arguments)
    if problem_path is not None:
        save_problem(problem, problem_path)
    solution = _solve(problem, scene, arguments)
    if output is not None:
        save_solution(solution, output)
    errors = {} if scene is None else scene.errors(solution.z)
    if as_json:
        click.echo(json.dumps(solution.about() | {"distance_to_reference": errors}, indent=2))
    else:
        click.echo(str(solution))
        for name, error in errors.items():
            click.echo(f"{'reference':<9} {name}: off by {error:.3g}")
    return _exit_code(solution.solved, solution.message)


@commands.command(epilog=_SOURCE_HELP)
@_problem_options
@click.option("--solver", "solvers", multiple=True, help="Independent solver to ask; repeatable; default: all.")
@click.option("--csv", "csv_path", type=click.Path(), help="Write the report's rows to this CSV file as well.")
def crosscheck(solvers: tuple[str, ...], csv_path: str | None, as_json: bool, **arguments: Any) -> int:
    """Solve the problem SOURCE, then have independent solvers check the answer."""
    from .crosscheck import crosscheck as check

    problem, scene = _problem(arguments)
    solution = _solve(problem, scene, arguments)
    if not solution.solved:
        click.echo(json.dumps({"solution": solution.about(), "report": None}, indent=2) if as_json else str(solution))
        return _exit_code(False, solution.message)
    time_limit = arguments["time_limit"] or 60.0
    report = check(problem, solution, solvers or None, time_limit=time_limit)
    if csv_path is not None:
        report.to_csv(csv_path)
    smaller = [] if scene is None else _at_their_size(scene, report, arguments)
    others = [check(problem, None, names, time_limit=time_limit) for problem, names in smaller]
    if as_json:
        told = {"solution": solution.about(), "report": json.loads(report.to_json())}
        click.echo(json.dumps(told | {"at_their_size": [json.loads(other.to_json()) for other in others]}, indent=2))
    else:
        click.echo(f"{solution}\n\n{report}")
        for (problem, names), other in zip(smaller, others, strict=True):
            click.echo(f"\n{', '.join(names)}: the same scene at n = {problem.n}\n{other}")
    contradicted = any(row.verdict.value == "disagrees" for other in others for row in other.rows)
    return _exit_code(
        report.agrees and not contradicted,
        "the answer is not confirmed: no independent solver agrees, or one disagrees",
    )


@commands.command()
@click.argument("name", required=False)
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def scenes(name: str | None, as_json: bool) -> int:
    """List the built-in scenes, or describe the scene NAME."""
    from . import scenes as gallery

    if name is None:
        titles = gallery.titles()
        width = max(map(len, titles))
        click.echo(
            json.dumps(titles, indent=2) if as_json else "\n".join(f"{k:<{width}}  {v}" for k, v in titles.items())
        )
        return 0
    scene = gallery.scene(name)
    reference = (["z"] if scene.z_exact is not None else []) + list(scene.quantities)
    facts = {
        "name": scene.name,
        "title": scene.title,
        "models": scene.models,
        "problem": repr(scene.problem),
        "parameters": gallery.parameters(name),
        "reference": reference,
        "why_no_reference": scene.why_no_reference,
    }
    if as_json:
        click.echo(json.dumps(facts, indent=2))
        return 0
    click.echo(f"{scene.name}: {scene.title}\n{scene.models}\n{scene.problem!r}")
    click.echo("parameters: " + (", ".join(f"{k}={v}" for k, v in gallery.parameters(name).items()) or "none"))
    click.echo("reference:  " + (", ".join(reference) or f"none: {scene.why_no_reference}"))
    return 0


@commands.group()
def measure() -> None:
    """Measure what the README claims, on this machine."""


@measure.command()
@click.option("--n", type=int, default=1_000_000, show_default=True, help="Unknowns of the 5-point matrix.")
@click.option("--repeats", type=int, default=15, show_default=True, help="Pairs of timings.")
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
def sweep(n: int, repeats: int, as_csv: bool) -> int:
    """One sweep with its residual against one SciPy A @ z, timed in turn."""
    from .measure import sweep_cost

    return _show(sweep_cost(n, repeats), as_csv)


@measure.command()
@click.option("--m", "sides", type=int, multiple=True, default=(10, 20, 30), show_default=True, help="Grid sides.")
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
def counts(sides: tuple[int, ...], as_csv: bool) -> int:
    """Sweeps to Res <= 1e-5 on Bai's LCP, against the grid side m."""
    from .measure import sweep_counts

    return _show(sweep_counts(sides), as_csv)


@measure.command()
@click.argument("scene", default="dividend")
@click.option("--n", "sizes", type=int, multiple=True, default=(61, 241, 961), show_default=True, help="Unknowns.")
@click.option("--method", help="Name of the method; without it one is picked.")
@click.option("--csv", "as_csv", is_flag=True, help="Print CSV.")
def order(scene: str, sizes: tuple[int, ...], method: str | None, as_csv: bool) -> int:
    """The error of SCENE against its closed form on finer and finer grids."""
    from .measure import grid_order

    return _show(grid_order(scene, sizes, method), as_csv)


def _show(table: Any, as_csv: bool) -> int:
    click.echo(table.to_csv() if as_csv else str(table), nl=not as_csv)
    return 0


def main(arguments: list[str] | None = None) -> None:
    """The entry point: every error is one line on standard error.

    >>> main(["scenes", "--help"])
    Traceback (most recent call last):
    SystemExit: 0
    """
    try:
        code = commands.main(args=arguments, prog_name="icpmodel", standalone_mode=False)
    except click.exceptions.Exit as stop:
        code = stop.exit_code
    except click.exceptions.NoArgsIsHelpError as help_page:
        help_page.show()
        code = 2
    except click.ClickException as error:
        _complain(error.format_message())
        code = 2
    except IcpError as error:
        _complain(str(error))
        code = 2
    except (KeyboardInterrupt, click.Abort):
        _complain("interrupted")
        code = 130
    except BrokenPipeError:  # the reader, head for one, has seen enough
        sys.stderr.close()
        code = 0
    sys.exit(code)


def _problem(arguments: dict[str, Any]) -> tuple[ICP, Any]:
    """The problem that the arguments name, and its scene if it is one."""
    from . import scenes as gallery

    source, n = arguments["source"], arguments["n"]
    parameters = dict(_pair(text) for text in arguments["parameters"])
    if source in gallery.names():
        scene = gallery.scene(source, n, **parameters)
        if n is not None and scene.problem.n != n:
            click.echo(f"note: {source} has no size {n}; the nearest is {scene.problem.n}", err=True)
        return scene.problem, scene
    if n is not None or parameters:
        raise InputError(f"--n and --set belong to scenes, and {source} is none of them: {', '.join(gallery.names())}")
    if not Path(source).exists():
        raise InputError(f"{source} is neither a file or folder nor a scene; scenes: {', '.join(gallery.names())}")
    return load_problem(source, arguments["q_file"]), None


def _solve(problem: ICP, scene: Any, arguments: dict[str, Any]) -> Solution:
    options = dict(_pair(text) for text in arguments["options"])
    method = None if arguments["method"] is None else named(arguments["method"], **options)
    if options and method is None:
        raise InputError("--option belongs to a method; name one with --method")
    return problem.solve(
        method,
        z0=None if scene is None else scene.z0,
        rtol=arguments["rtol"],
        atol=arguments["atol"],
        max_iter=arguments["max_iter"],
        time_limit=arguments["time_limit"],
        progress=True,
        raise_on_failure=False,
    )


def _at_their_size(scene: Any, report: Any, arguments: dict[str, Any]) -> list[tuple[ICP, list[str]]]:
    """For the solvers that a scene is too large for: the scene at the largest size they take, and their names."""
    from . import scenes as gallery
    from .crosscheck import independent_solvers

    known = independent_solvers()
    by_size: dict[int, list[str]] = {}
    for row in report.rows:
        largest = known[row.solver].largest
        if row.verdict.value == "skipped" and largest is not None and largest < scene.problem.n:
            by_size.setdefault(largest, []).append(row.solver)
    parameters = dict(_pair(text) for text in arguments["parameters"])
    found = []
    for largest, names in by_size.items():
        n = largest
        while (smaller := gallery.scene(scene.name, n, **parameters).problem).n > largest:
            n -= 1
        found.append((smaller, names))
    return found


def _pair(text: str) -> tuple[str, Any]:
    """name=value with the value as a number or truth value where it is one."""
    name, equals, value = text.partition("=")
    if not equals or not name:
        raise InputError(f"{text!r} is not of the form NAME=VALUE")
    if value.lower() in ("true", "false"):
        return name, value.lower() == "true"
    for convert in (int, float):
        try:
            return name, convert(value)
        except ValueError:
            continue
    return name, value


def _exit_code(success: bool, complaint: str) -> int:
    if success:
        return 0
    _complain(complaint)
    return 1


def _complain(message: str) -> None:
    click.echo("icpmodel: " + " ".join(message.split()), err=True)
