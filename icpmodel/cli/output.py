"""What the commands print, with which exit code they end, and where they may write."""

from __future__ import annotations

import json
import logging
import math
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from typing import Any

import click
import numpy as np

from ..errors import Interrupted
from ..present.table import Table

STANDARD_INPUT = "standard input"
AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")
#: one of them for a table; the last one that is typed counts
FORMS = (
    click.option("--csv", "form", flag_value="csv", help="Print the whole table as CSV."),
    click.option("--latex", "form", flag_value="latex", help="Print the whole table as LaTeX (booktabs)."),
)
TO_FIGURE = click.option(
    "-o", "--output", type=click.Path(), help="Write the figure (.png, .pdf or .svg), and its data beside it (.csv)."
)


def show_json(data: dict[str, Any]) -> None:
    """Print plain data as a line of JSON; NaN and infinities, which JSON does not have, as null."""
    click.echo(json.dumps(_finite(data), allow_nan=False))


def print_as(data: dict[str, Any], text: object, as_json: bool) -> None:
    """Print the same thing as JSON or as text."""
    show_json(data) if as_json else click.echo(str(text))


def print_table(result: Any, table: Table, form: str | None) -> None:
    """Print the results, or their whole table as CSV or LaTeX."""
    formats = {"csv": table.to_csv, "latex": table.to_latex}
    click.echo(formats[form]() if form else str(result), nl=not form)


def keep_standard_output() -> None:
    """Let this process alone write to its standard output: what libraries write to descriptor 1 goes to standard error.

    HiGHS and others print there in the middle of a solve, which no reader of JSON or CSV expects.
    """
    with suppress(OSError):  # what stands for it has no descriptor
        # one that the shell has closed is None
        if sys.stdout is not None and sys.stderr is not None and sys.stdout.fileno() == 1:
            kept = open(os.dup(1), "w", encoding=sys.stdout.encoding)  # noqa: SIM115  as long as the process lives
            os.dup2(2, 1)
            sys.stdout = kept


@contextmanager
def compilation_announced() -> Iterator[None]:
    """Announce compilation on the terminal in a block, even if standard error is redirected."""
    compiler = logging.getLogger("icpmodel.compiler")
    handler = logging.StreamHandler()
    handler.setFormatter(logging.Formatter("icpmodel ... %(message)s"))
    level = compiler.level
    compiler.setLevel(logging.INFO)
    compiler.addHandler(handler)
    try:
        yield
    finally:
        compiler.removeHandler(handler)
        compiler.setLevel(level)


def complain(message: str, code: int = 2) -> int:
    """One line on standard error; the exit code that goes with it."""
    with suppress(OSError):  # standard error may be full
        click.echo("icpmodel: " + " ".join(message.split()), err=True)
    return code


def command_line() -> str:
    """The command line of this process, recorded in the files that it writes."""
    return str(click.get_current_context().find_root().obj)


def exit_code(success: bool, complaint: str) -> int:
    """0 for success, else 1 and the complaint."""
    return 0 if success else complain(complaint, 1)


def measured(measure: Callable[[], Any], show: Callable[[Any], None], if_interrupted: str) -> int:
    """Measure and show; after Ctrl-C show the results so far, with the sentence `if_interrupted`. Returns 0 or 130."""
    try:
        result = measure()
        code = 0
    except Interrupted as stopped:
        result = stopped.report
        code = complain(f"interrupted: {if_interrupted}", 130)
    show(result)
    return code


def wrote(path: Any) -> None:
    """Say on standard error what was written."""
    with suppress(OSError):
        click.echo(f"wrote {path}", err=True)


def _finite(value: Any) -> Any:
    if isinstance(value, np.ndarray):
        return _finite(value.tolist())
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
