"""A card: names and texts, one below the other, as text and as HTML."""

from __future__ import annotations

import textwrap
from collections.abc import Mapping

from .page import render

#: columns of a card, and of the names in it
_WIDTH, _NAMES = 100, 10


class Card:
    """Names with texts, which may have several lines, in the order of `rows`.

    >>> from icpmodel.present.card import Card
    >>> print(Card({"status": "solved", "rows": "one\\ntwo"}))
    status    solved
    rows      one
              two
    """

    def __init__(self, rows: Mapping[str, str]) -> None:
        self.rows = dict(rows)

    def __str__(self) -> str:
        lines = []
        for name, text in self.rows.items():
            parts = [part for line in text.splitlines() for part in textwrap.wrap(line, _WIDTH - _NAMES)]
            heads = [name, *[""] * len(parts)]
            lines += [f"{head:<{_NAMES - 1}} {part}" for head, part in zip(heads, parts, strict=False)]
        return "\n".join(lines)

    def to_html(self) -> str:
        """The card as an HTML table."""
        return render("card.html", rows=self.rows)
