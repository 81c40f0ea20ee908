"""A table, shown as text, HTML, CSV or LaTeX, and the width of texts on a terminal or in a notebook."""

from __future__ import annotations

import csv
import io
import os
import shutil
import sys
import textwrap
from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import Any

from ..errors import NotApplicable, check_arguments
from ..numerics.plugins import in_notebook
from .display import Displayable
from .latex import as_latex
from .rendering import render

#: characters in a line of a page and of a notebook cell, whose width cannot be asked for: the value that rich takes
PAGE_WIDTH = 115
#: in a file or a pipe a line may have any length
_UNBOUNDED = 10_000
#: texts are wrapped to no fewer characters
_MIN_TEXT_WIDTH = 12
#: the spaces between two columns
_COLUMN_GAP = 2


@check_arguments
@dataclass(frozen=True, repr=False)
class Table(Displayable):
    """A table of numbers and texts.

    Parameters
    ----------
    title : str
        The title.
    heads : tuple of str
        The heads of the columns, with units.
    rows : tuple of tuple
        Numbers and texts; None for what is not known.

    Examples
    --------
    >>> rows = (("newton", 900, 0.0123456), ("psor", 16, None))
    >>> print(Table("Costs", ("method", "n", "time, s"), rows))
    Costs
    method    n  time, s
    newton  900  0.01235
    psor     16        -
    """

    title: str
    heads: tuple[str, ...]
    rows: tuple[tuple[Any, ...], ...]

    def __str__(self) -> str:
        """The table, wrapped to the width of a terminal or notebook cell; elsewhere nothing is wrapped."""
        return self.to_text(width(_UNBOUNDED))

    def to_text(self, columns: int) -> str:
        """The table as text, numbers aligned right, texts aligned left.

        If the table is too wide, its texts are wrapped. If that is not enough, the remaining
        columns follow below, beside a copy of the first one.

        Parameters
        ----------
        columns : int
            The largest number of characters in a line.

        Returns
        -------
        str
            The text.
        """
        from rich.console import Console
        from rich.table import Table as Grid
        from rich.text import Text

        cells = self._cells()
        out = io.StringIO()
        console = Console(file=out, width=columns, color_system=None, force_jupyter=False)
        if self.title:
            console.print(Text(self.title))
        numbers = self._numbers()
        least = [_least(head, [row[k] for row in cells], numbers[k]) for k, head in enumerate(self.heads)]
        for number, block in enumerate(_blocks(least, columns)):
            if number:
                console.print()
            grid = Grid(box=None, pad_edge=False, header_style="")
            for k in block:
                justify: Any = "right" if numbers[k] else "left"
                grid.add_column(Text(self.heads[k]), justify=justify, overflow="fold", min_width=least[k])
            for row in cells:
                grid.add_row(*(Text(row[k]) for k in block))
            console.print(grid, crop=False)
        return "\n".join(line.rstrip() for line in out.getvalue().splitlines())

    def records(self) -> list[dict[str, Any]]:
        """The rows as head → cell.

        Returns
        -------
        list of dict
            One dict a row.
        """
        return [dict(zip(self.heads, row, strict=True)) for row in self.rows]

    def to_dataframe(self) -> Any:
        """The rows as a pandas DataFrame, numbers at full precision.

        Returns
        -------
        pandas.DataFrame
            The table.

        Raises
        ------
        NotApplicable
            Where pandas is not installed.

        Examples
        --------
        >>> Table("", ("method", "n"), (("newton", 900),)).to_dataframe()
           method    n
        0  newton  900
        """
        try:
            from pandas import DataFrame
        except ImportError:
            message = "a data frame needs pandas, which is not installed: pip install pandas; to_csv() works without it"
            raise NotApplicable(message) from None
        return DataFrame(list(self.rows), columns=list(self.heads))

    def to_html(self) -> str:
        """The table as HTML, with the title as its caption.

        Returns
        -------
        str
            HTML.
        """
        return render("table.html", title=self.title, heads=self.heads, rows=self._cells(), numbers=self._numbers())

    _repr_html_ = to_html

    def to_csv(self) -> str:
        """The heads and rows as CSV text, numbers at full precision.

        Returns
        -------
        str
            CSV.
        """
        out = io.StringIO()
        csv.writer(out, lineterminator="\n").writerows([self.heads, *self.rows])
        return out.getvalue()

    def to_latex(self) -> str:
        """The table as LaTeX: a float of the kind `table`, with the rules of the package booktabs.

        Returns
        -------
        str
            LaTeX.

        Examples
        --------
        >>> table = Table("Steps", ("method", "RES"), (("newton", 1.5e-9), ("psor", None)))
        >>> print(table.to_latex(), end="")
        \\begin{table}
        \\centering
        \\caption{Steps}
        \\begin{tabular}{lr}
        \\toprule
        method & RES \\\\
        \\midrule
        newton & $1.5 \\times 10^{-9}$ \\\\
        psor & -- \\\\
        \\bottomrule
        \\end{tabular}
        \\end{table}
        """
        return as_latex(self.title, self.heads, self._cells(), self._numbers())

    def _numbers(self) -> list[bool]:
        """Which columns contain no texts."""
        return [not any(isinstance(row[k], str) for row in self.rows) for k in range(len(self.heads))]

    def _cells(self) -> list[list[str]]:
        return [[_text(cell) for cell in row] for row in self.rows]


class Tabular(ABC):
    """A base class of objects that are, or have, a table."""

    __slots__ = ()

    @abstractmethod
    def table(self) -> Table: ...

    def to_dataframe(self) -> Any:
        """Its table as a pandas DataFrame, numbers at full precision.

        Raises
        ------
        NotApplicable
            Where pandas is not installed.
        """
        return self.table().to_dataframe()


def _least(head: str, cells: list[str], is_number: bool) -> int:
    """The least width of a column: numbers and words of the head are not broken, and texts not wrapped too narrowly."""
    longest = max(map(len, cells), default=0)
    word = max(map(len, head.split()), default=0)
    return max(longest if is_number else min(longest, _MIN_TEXT_WIDTH), word)


def _blocks(least: list[int], columns: int) -> list[list[int]]:
    """The columns of each block, from the least widths of all columns; every block begins with the first column."""
    blocks: list[list[int]] = [[]]
    for k in range(len(least)):
        block = [*blocks[-1], k]
        if len(block) > 2 and sum(least[j] + _COLUMN_GAP for j in block) - _COLUMN_GAP > columns:
            blocks.append([0, k])
        else:
            blocks[-1] = block
    return blocks


def _text(cell: Any) -> str:
    if cell is None:
        return "-"
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def folded(text: str) -> str:
    """`text` wrapped to the width of standard output, all lines but the first indented."""
    return textwrap.fill(text, width(_UNBOUNDED), subsequent_indent="  ", break_on_hyphens=False)


def width(otherwise: int = PAGE_WIDTH) -> int:
    """The characters in a line of standard output, if it is a terminal (at least 40) or a notebook cell.

    Otherwise, such as for a file or a pipe, it is `otherwise`. JUPYTER_COLUMNS may set the width of a notebook cell.
    """
    if in_notebook():
        columns = os.environ.get("JUPYTER_COLUMNS", "")
        return int(columns) if columns.isdigit() else PAGE_WIDTH
    if sys.stdout is None or not sys.stdout.isatty():
        return otherwise
    return max(shutil.get_terminal_size().columns, 40)
