"""`icpmodel explain`."""

from __future__ import annotations

from typing import Any

import click

from ..solve.progress import status_line
from .output import show_json
from .source import METHOD_OPTIONS, SOURCE_HELP, SOURCE_OPTIONS, named_method, named_problem, options


@click.command(epilog=SOURCE_HELP)
@options(*SOURCE_OPTIONS, *METHOD_OPTIONS)
@click.option("--accuracy", type=float, default=1e-6, show_default=True, help="To which the numbers of steps refer.")
@click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
def explain(accuracy: float, as_json: bool, **arguments: Any) -> int:
    """Say what is certain of the problem SOURCE before it is solved: classes, uniqueness, theorems, predicted rates."""
    problem, _ = named_problem(arguments)
    with status_line(True) as say:
        say("checking the theorems")
        page = problem.explain(named_method(arguments), accuracy=accuracy)
    if as_json:
        show_json(page.about())
    else:
        click.echo(str(page))
    return 0
