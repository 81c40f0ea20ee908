"""What all figures have in common: colours, markers, axes, and one way to write them, with their data beside them."""

from __future__ import annotations

import os
from abc import ABC, abstractmethod
from collections.abc import Hashable, Iterable
from itertools import cycle
from pathlib import Path
from typing import Any, TypeVar

from ...errors import FileError, InputError
from ...numerics.arrays import described
from ...present.table import Table

Name = TypeVar("Name", bound=Hashable)

#: a matplotlib figure: matplotlib is loaded when the first one is drawn
Figure = Any

#: which colour-blind readers can tell apart: Okabe and Ito, Color Universal Design (2008)
BLUE, ORANGE, GREEN, PURPLE, YELLOW, SKY = "#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"
COLOURS = (BLUE, ORANGE, GREEN, PURPLE, YELLOW, SKY)
#: one more than the colours, so that no pair comes twice in 42
MARKERS = ("o", "s", "^", "D", "v", "P", "X")
DASHES = ("solid", "dashed", "dotted", "dashdot")


def new_figure(width: float, height: float) -> Figure:
    """An empty figure, in inches, that belongs to no window."""
    from matplotlib.figure import Figure as Empty

    return Empty(figsize=(width, height), layout="constrained")


def looks(names: Iterable[Name]) -> dict[Name, tuple[str, str]]:
    """name → (colour, marker); "solve()" is always a black circle."""
    pairs = zip(cycle(COLOURS), cycle(MARKERS), strict=False)
    return {name: ("black", "o") if name == "solve()" else next(pairs) for name in names}


def legend_below(figure: Figure, columns: int, **more: Any) -> None:
    """One legend for all axes, below them."""
    figure.legend(loc="outside lower center", ncols=columns, frameon=False, **({"fontsize": 8} | more))


def save(figure: Figure, path: Any, table: Table, command: str) -> list[Path]:
    """Write `figure` as .png and .svg, and `table` as .csv, whose first line has `command`; see `Charted.plot`."""
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


class Charted(ABC):
    """What a study found: a table, a figure, and the `command` that makes both again."""

    command: str

    @abstractmethod
    def table(self) -> Table: ...

    @abstractmethod
    def figure(self) -> Figure: ...

    def plot(self, path: Any) -> list[Path]:
        """Write the picture, PNG and SVG, and the numbers, CSV with the command in its first line.

        Parameters: `path` a file name, whose suffix, if any of these three, is left out. Returns the three paths.
        Raises InputError where `path` is no file name, FileError where it cannot be written.
        """
        return save(self.figure(), path, self.table(), self.command)
