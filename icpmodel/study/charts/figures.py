"""One way to write a figure: as PNG and SVG, with its data as CSV beside it and the command that makes it again."""

from __future__ import annotations

import os
from pathlib import Path
from typing import TYPE_CHECKING, Any

from ...errors import FileError, InputError
from ...numerics.arrays import described
from ...present.table import Table

if TYPE_CHECKING:
    from matplotlib.figure import Figure


def save(figure: Figure, path: Any, table: Table, command: str) -> list[Path]:
    """Write `figure` to `path` with the suffixes .png and .svg, and `table` with .csv, whose first line has `command`.

    Parameters: `path` a file name, whose suffix, if any of these three, is left out; `command` the line to type.
    Returns the three paths. Raises InputError where `path` is no file name, FileError
    where the folder does not exist or cannot be written to.
    """
    if not isinstance(path, str | os.PathLike) or not Path(path).name:
        raise InputError(f"path is {described(path)}; a file name was expected")
    path = Path(path)
    stem = path.with_suffix("") if path.suffix in (".png", ".svg", ".csv") else path
    if not stem.parent.is_dir():
        raise FileError(f"{path}: the folder {stem.parent} does not exist")
    paths = [stem.with_name(stem.name + suffix) for suffix in (".png", ".svg", ".csv")]
    try:
        for file in paths[:2]:
            figure.savefig(file, dpi=100, metadata={"Title": command})
        paths[2].write_text(f"# {command}\n{table.to_csv()}", encoding="utf-8")
    except OSError as error:
        raise FileError(f"{error.filename or stem} cannot be written: {error.strerror}") from error
    return paths
