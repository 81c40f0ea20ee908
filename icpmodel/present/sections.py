"""Texts with titles, one below the other, as text and as HTML."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

from .page import render
from .terminal import width

#: the longest lines of a page
_WIDTH = 116


class Sections:
    """Title → text, whose lines are indented below the title; a line that is wider than the page is wrapped.

    >>> from icpmodel.present.sections import Sections
    >>> print(Sections({"solution": "exists", "advice": "take it"}))
    solution
      exists
    <BLANKLINE>
    advice
      take it
    """

    def __init__(self, sections: Mapping[str, str]) -> None:
        self.sections = dict(sections)

    def __str__(self) -> str:
        parts = ["\n".join([title, *map(_indented, text.splitlines())]) for title, text in self.sections.items()]
        return "\n\n".join(parts)

    def to_html(self) -> str:
        """The sections as headings and preformatted texts."""
        return render("sections.html", sections=self.sections)


def inner_width() -> int:
    """The columns that a table in a section may have."""
    return min(width(_WIDTH), _WIDTH) - 2


def _indented(line: str) -> str:
    if len(line) <= inner_width():  # a line of a table keeps its columns
        return f"  {line}"
    return textwrap.fill(line, inner_width() + 2, initial_indent="  ", subsequent_indent="    ")
