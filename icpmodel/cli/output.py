"""What the commands print, and where they may write."""

from __future__ import annotations

import json
import math
from pathlib import Path
from typing import Any

import click

from ..errors import FileError, InputError

AS_JSON = click.option("--json", "as_json", is_flag=True, help="Print JSON instead of text.")


def show_json(told: dict[str, Any]) -> None:
    """Print plain data as JSON; NaN and infinities, which JSON does not have, as null."""
    click.echo(json.dumps(_finite(told), indent=2, allow_nan=False))


def complain(message: str, code: int = 2) -> int:
    """One line on standard error; the exit code that goes with it."""
    click.echo("icpmodel: " + " ".join(message.split()), err=True)
    return code


def typed() -> str:
    """The command line that is at work, to be noted beside what it makes."""
    return str(click.get_current_context().find_root().obj)


def exit_code(success: bool, complaint: str) -> int:
    """0 for success, else 1 and the complaint."""
    return 0 if success else complain(complaint, 1)


def must_be_writable(path: str | None, suffix: str = "") -> None:
    """Raise FileError or InputError now for a path that could not be written later, when the work is done.

    Parameters: `path`, or None for none; the `suffix` that it must have.
    """
    if path is None:
        return
    if Path(path).is_dir():
        raise FileError(f"{path}: is a folder; a file name was expected")
    if not Path(path).parent.is_dir():
        raise FileError(f"{path}: the folder {Path(path).parent} does not exist")
    if not path.lower().endswith(suffix):
        raise InputError(f"--output is {path!r}; a name that ends in {suffix} was expected")


def _finite(value: Any) -> Any:
    if isinstance(value, dict):
        return {key: _finite(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(item) for item in value]
    return None if isinstance(value, float) and not math.isfinite(value) else value
