"""What the commands print, their exit codes, and who may write to standard output."""

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
#: the forms of a printed table; the last one that is typed counts
FORMS = (
    click.option("--csv", "form", flag_value="csv", help="Print the whole table as CSV."),
    click.option("--latex", "form", flag_value="latex", help="Print the whole table as LaTeX (booktabs)."),
)
TO_FIGURE = click.option(
    "-o", "--output", type=click.Path(), help="Write the figure (.png, .pdf or .svg), and its data beside it (.csv)."
)


def show_json(data: dict[str, Any]) -> None:
    """Print data as a line of JSON; NaN and infinities, which JSON does not have, become null."""
    click.echo(json.dumps(_finite(data), allow_nan=False))


def print_as(data: dict[str, Any], text: object, as_json: bool) -> None:
    """Print `data` as JSON, or `text`, which says the same."""
    show_json(data) if as_json else click.echo(str(text))


def print_table(result: Any, table: Table, form: str | None) -> None:
    """Print `result`, or its whole `table` as CSV or LaTeX."""
    formats = {"csv": table.to_csv, "latex": table.to_latex}
    click.echo(formats[form]() if form else str(result), nl=not form)


def keep_standard_output() -> None:
    """Replace `sys.stdout`, so that what libraries write to descriptor 1 goes to standard error.

    HiGHS and others print there in the middle of a solve, which no reader of JSON or CSV expects.
    """
    with suppress(OSError):  # a substitute of sys.stdout may have no descriptor
        # a stream that the shell has closed is None
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
    """Print `message` as one line on standard error, and return the exit code `code`."""
    with suppress(OSError):  # standard error may be full
        click.echo("icpmodel: " + " ".join(message.split()), err=True)
    return code


def command_line() -> str:
    """The command line of this process, recorded in the files that it writes."""
    return str(click.get_current_context().find_root().obj)


def exit_code(success: bool, complaint: str) -> int:
    """Return 0 for success; else print the complaint and return 1."""
    return 0 if success else complain(complaint, 1)


def measured(measure: Callable[[], Any], show: Callable[[Any], None], if_interrupted: str) -> int:
    """Measure and show; after Ctrl-C show the results so far, with the message `if_interrupted`. Returns 0 or 130."""
    try:
        result = measure()
        code = 0
    except Interrupted as stopped:
        result = stopped.report
        code = complain(f"interrupted: {if_interrupted}", 130)
    show(result)
    return code


def wrote(path: Any) -> None:
    """Report on standard error that `path` was written."""
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
