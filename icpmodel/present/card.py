"""A card: names and texts, one below the other, as text and as HTML."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

from .page import render
from .terminal import width

#: the longest lines of a card, and the columns of its names
_WIDTH, _NAMES = 100, 9


class Card:
    """Names with texts, which may have several lines, in the order of `rows`.

    >>> print(Card({"status": "solved", "rows": "one\\ntwo"}))
    status    solved
    rows      one
              two
    """

    def __init__(self, rows: Mapping[str, str]) -> None:
        self.rows = dict(rows)

    def __str__(self) -> str:
        names = max(_NAMES, *map(len, self.rows))
        lines = []
        for name, text in self.rows.items():
            wide = min(width(_WIDTH), _WIDTH) - names - 1
            parts = [part for line in text.splitlines() for part in textwrap.wrap(line, wide)]
            heads = [name, *[""] * len(parts)]
            lines += [f"{head:<{names}} {part}" for head, part in zip(heads, parts or [""], strict=False)]
        return "\n".join(line.rstrip() for line in lines)

    def to_html(self) -> str:
        """The card as an HTML table."""
        return render("card.html", rows=self.rows)
