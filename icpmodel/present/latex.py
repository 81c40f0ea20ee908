"""Tables as LaTeX with the rules of booktabs."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from itertools import groupby
from typing import Any

#: what LaTeX takes for something else, after the end of a line too, or has no letter for in its old fonts
_ESCAPED = str.maketrans(
    {
        **{letter: f"\\{letter}" for letter in "&%$#_{}"},
        **{letter: f"{{{letter}}}" for letter in "[]*"},
        "\\": r"\textbackslash{}",
        "~": r"\textasciitilde{}",
        "^": r"\textasciicircum{}",
        "<": r"\textless{}",
        ">": r"\textgreater{}",
        "|": r"\textbar{}",
    }
)

_Row = tuple[Any, ...]


def as_latex(title: str, heads: tuple[str, ...], rows: Sequence[_Row], cells: list[list[str]]) -> str:
    """The table as `cells`, which are texts where `rows` have some: one float, or, where all texts of the first column
    stand for several rows each, one for each of these, with that text in the caption."""
    is_text = [any(isinstance(row[k], str) for row in rows) for k in range(len(heads))]
    shown = [[_cell(cell, is_text[k]) for k, cell in enumerate(row)] for row in cells]
    groups = [list(group) for _, group in groupby(shown, key=lambda row: row[0])]
    if not (len(heads) > 1 and is_text[0] and groups and min(map(len, groups)) > 1):
        return _float(_escaped(title), shown, heads, is_text)
    captions = [f"{_escaped(title)}: {group[0][0]}" for group in groups]
    rest = [[row[1:] for row in group] for group in groups]
    return "\n".join(_float(*part, heads[1:], is_text[1:]) for part in zip(captions, rest, strict=True))


def _float(caption: str, rows: list[list[str]], heads: tuple[str, ...], is_text: list[bool]) -> str:
    lines = [r"\begin{table}", r"\centering", *([rf"\caption{{{caption}}}"] if caption else [])]
    lines += [rf"\begin{{tabular}}{{{''.join('l' if text else 'r' for text in is_text)}}}", r"\toprule"]
    lines += [" & ".join(map(_escaped, heads)) + r" \\", r"\midrule", *_body(rows, is_text)]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}", ""])


def _body(rows: list[list[str]], is_text: list[bool]) -> Iterator[str]:
    """The lines, a first text that stands for several of them once, with some space before the next one."""
    groups = [list(group) for _, group in groupby(rows, key=lambda row: row[0] if is_text[0] else None)]
    apart = is_text[0] and any(len(group) > 1 for group in groups)
    for k, group in enumerate(groups):
        if k and apart:
            yield r"\addlinespace"
        for place, row in enumerate(group):
            yield " & ".join(["", *row[1:]] if place and apart else row).lstrip() + r" \\"


def _escaped(text: str) -> str:
    return text.translate(_ESCAPED)


def _cell(text: str, is_text: bool) -> str:
    """A number of any size and sign as formula, what is not known as a dash."""
    if is_text or text == "-":
        return "--" if text == "-" else _escaped(text)
    digits, _, exponent = text.partition("e")
    if exponent:
        return rf"${digits} \times 10^{{{int(exponent)}}}$"
    return f"${text}$" if text.startswith("-") else text
