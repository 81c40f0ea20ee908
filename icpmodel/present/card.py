"""Cards (names beside texts) and sections (titles above texts), shown as text and as HTML."""

from __future__ import annotations

import textwrap
from collections.abc import Iterator, Mapping

from ..errors import check_arguments
from .display import Displayable, brief
from .rendering import render
from .table import PAGE_WIDTH, width

#: the least number of characters for the names of a card
_NAME_COLUMNS = 9


@check_arguments
class Card(Displayable, Mapping[str, str]):
    """Names with texts, which may have several lines.

    Parameters
    ----------
    rows : dict
        Name → text, in the order in which they are shown.

    Examples
    --------
    >>> print(Card({"status": "solved", "rows": "one\\ntwo"}))
    status    solved
    rows      one
              two
    """

    def __init__(self, rows: Mapping[str, str]) -> None:
        self.rows = dict(rows)

    def __getitem__(self, name: str) -> str:
        return self.rows[name]

    def __iter__(self) -> Iterator[str]:
        return iter(self.rows)

    def __len__(self) -> int:
        return len(self.rows)

    def __str__(self) -> str:
        indent = max([_NAME_COLUMNS, *map(len, self.rows)]) + 1
        columns = page_width() - indent
        lines = []
        for name, text in self.rows.items():
            parts = [part for line in text.splitlines() for part in textwrap.wrap(line, columns)]
            lines.append((f"{name:<{indent}}" + f"\n{'':<{indent}}".join(parts)).rstrip())
        return "\n".join(lines)

    def __repr__(self) -> str:
        return f"Card({brief(self.rows)})"

    def to_html(self) -> str:
        """The card as an HTML table.

        Returns
        -------
        str
            HTML.
        """
        return render("card.html", rows=self.rows)

    _repr_html_ = to_html


class Sections:
    """Titles with texts indented below them; a line that is wider than the page is wrapped."""

    def __init__(self, sections: Mapping[str, str]) -> None:
        self.sections = dict(sections)

    def __str__(self) -> str:
        parts = ["\n".join([title, *map(_indent, text.splitlines())]) for title, text in self.sections.items()]
        return "\n\n".join(parts)

    def to_html(self) -> str:
        """The sections as headings and preformatted texts."""
        return render("sections.html", sections=self.sections)


def page_width() -> int:
    """The largest number of characters in a line of a card or of sections."""
    return min(width(), PAGE_WIDTH)


def inner_width() -> int:
    """The largest number of characters in a line of a table in a section."""
    return page_width() - 2


def _indent(line: str) -> str:
    if len(line) <= inner_width():  # a line of a table keeps its columns
        return f"  {line}"
    return textwrap.fill(line, page_width(), initial_indent="  ", subsequent_indent="    ")
