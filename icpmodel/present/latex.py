"""Tables as LaTeX with the rules of booktabs."""

from __future__ import annotations

#: characters with a meaning in LaTeX, some of them only after the end of a line, or missing from its old fonts
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


def as_latex(title: str, heads: tuple[str, ...], cells: list[list[str]], numbers: list[bool]) -> str:
    """The table as a LaTeX float; `numbers` says which columns contain numbers only."""
    rows = [[_cell(cell, number) for cell, number in zip(row, numbers, strict=True)] for row in cells]
    lines = [r"\begin{table}", r"\centering", *([rf"\caption{{{_escape(title)}}}"] if title else [])]
    lines += [rf"\begin{{tabular}}{{{''.join('r' if number else 'l' for number in numbers)}}}", r"\toprule"]
    lines += [" & ".join(map(_escape, heads)) + r" \\", r"\midrule", *(" & ".join(row) + r" \\" for row in rows)]
    return "\n".join([*lines, r"\bottomrule", r"\end{tabular}", r"\end{table}", ""])


def _escape(text: str) -> str:
    return text.translate(_ESCAPED)


def _cell(text: str, is_number: bool) -> str:
    """A cell in LaTeX: negative numbers and powers of ten as formulas, an unknown value as a dash, texts escaped."""
    if not is_number or text == "-":
        return "--" if text == "-" else _escape(text)
    digits, _, exponent = text.partition("e")
    if exponent:
        return rf"${digits} \times 10^{{{int(exponent)}}}$"
    return f"${text}$" if text.startswith("-") else text
