"""What comes out of a cross-check: a table for people, CSV and JSON for programs."""

from __future__ import annotations

import csv
import html
import io
import json
import textwrap
from collections.abc import Iterable
from dataclasses import asdict, dataclass, fields
from pathlib import Path

from ..numerics.rounding import at_most
from ..solve.solution import Solution, certify
from .judge import Checked, Row, Verdict, finite


@dataclass(frozen=True)
class Report:
    """What the independent solvers say of an answer; print it, or let a notebook show it.

    `rows`; `problem` and `answer` as texts; `residual` = Res(z) of the answer under test and `holds`, whether it is a
    solution; `error_bound` with |z − z*| ≤ it, or None and the `reason`; `tolerance` of the differences.

    >>> from icpmodel.crosscheck.check import crosscheck
    >>> from icpmodel import ICP
    >>> report = crosscheck(ICP([[2.0]], [-1.0]), [0.5], ["osqp"])
    >>> report.agrees, report.rows[0].verdict.value
    (True, 'agrees')
    """

    rows: tuple[Row, ...]
    problem: str
    answer: str
    residual: float | None
    holds: bool
    error_bound: float | None
    reason: str
    tolerance: float | None

    @classmethod
    def of(cls, checked: Checked, rows: Iterable[Row], solution: Solution | None) -> Report:
        """The report on `checked` with its `rows`; `solution` where the answer was one.

        >>> from icpmodel import ICP
        >>> Report.of(Checked.of(ICP([[2.0]], [-1.0]), [0.5]), [], None).agrees
            False
        """
        same = solution is not None and solution.problem is checked.problem
        certificate = solution.certificate if solution is not None and same else certify(checked.problem, checked.z)
        answer = "given as a vector" if solution is None else f"{solution.status.value}, {solution.method!r}"
        return cls(
            tuple(rows),
            repr(checked.problem),
            answer,
            finite(certificate.residual),
            checked.holds,
            certificate.error_bound,
            certificate.bound.reason,
            finite(checked.tolerance),
        )

    @property
    def agrees(self) -> bool:
        """Whether the answer is a solution, at least one solver agrees, and none disagrees.

        >>> Report((), "", "", 0.0, True, None, "", 1e-6).agrees
        False
        """
        return self.holds and self.count(Verdict.AGREES) > 0 and self.count(Verdict.DISAGREES) == 0

    def count(self, verdict: Verdict) -> int:
        """How many rows have this `verdict`.

        >>> Report((), "", "", 0.0, True, None, "", 1e-6).count(Verdict.AGREES)
        0
        """
        return sum(row.verdict is verdict for row in self.rows)

    def conclusion(self) -> str:
        """The report in a sentence or two.

        >>> Report((), "", "", 0.0, True, None, "", 1e-6).conclusion()
        'No independent check was made. The answer is not confirmed.'
        """
        others = [f"{self.count(v)} {v.value}" for v in Verdict if v is not Verdict.AGREES and self.count(v)]
        made = len(self.rows) - self.count(Verdict.SKIPPED)
        parts = [f"{self.count(Verdict.AGREES)} of {made} independent checks agree" if made else "", *others]
        first = "; ".join(part for part in parts if part) or "No independent check was made"
        if not made and self.rows:
            first = f"No independent check could be made: {first}"
        wrong = "" if self.holds else " Its own residual is above tolerance."
        return f"{first}. The answer is {'' if self.agrees else 'not '}confirmed.{wrong}"

    def headline(self) -> str:
        """Problem, answer, residual and error bound, in three lines.

        >>> print(Report((), "ICP(n=1)", "given as a vector", 0.0, True, 1e-16, "", 1e-6).headline())
        problem  ICP(n=1)
        answer   given as a vector; residual 0, |z - z*| <= 1e-16
        compared |z_foreign - z| <= 1e-06 in every entry
        """
        bound = (
            f"|z - z*| <= {at_most(self.error_bound)}" if self.error_bound is not None else "no certified error bound"
        )
        return (
            f"problem  {self.problem}\n"
            f"answer   {self.answer}; residual {_number(self.residual, '.3g')}, {bound}\n"
            f"compared |z_foreign - z| <= {_number(self.tolerance, '.3g')} in every entry"
        )

    def __str__(self) -> str:
        cells = [_COLUMNS, *map(_cells, self.rows)]
        widths = [max(len(line[k]) for line in cells) for k in range(len(_COLUMNS) - 1)]
        indent = sum(widths) + 2 * len(widths)
        lines = []
        for line in cells:
            padded = [
                text.rjust(width) if 3 <= k <= 5 else text.ljust(width)
                for k, (text, width) in enumerate(zip(line, widths, strict=False))
            ]
            notes = textwrap.wrap(line[-1], max(118 - indent, 30)) or [""]
            lines.append("  ".join([*padded, notes[0]]).rstrip())
            lines += [" " * indent + note for note in notes[1:]]
        return "\n".join([self.headline(), "", *lines, "", self.conclusion()])

    def _repr_html_(self) -> str:
        def line(cells: Iterable[str], tag: str) -> str:
            return "<tr>" + "".join(f"<{tag} style='text-align:left'>{html.escape(c)}</{tag}>" for c in cells) + "</tr>"

        body = "".join(line(_cells(row), "td") for row in self.rows)
        head = html.escape(self.headline())
        return f"<pre>{head}</pre><table>{line(_COLUMNS, 'th')}{body}</table><p>{html.escape(self.conclusion())}</p>"

    def to_csv(self, path: str | Path | None = None) -> str:
        """The rows as CSV with a header, numbers in full; written to `path` where one is given. Returns the text.

        >>> Report((Row.skipped("osqp", "why"),), "", "", 0.0, True, None, "", 1e-6).to_csv().splitlines()[1]
        'osqp,,skipped,,,,,why'
        """
        text = io.StringIO()
        writer = csv.DictWriter(text, [field.name for field in fields(Row)], lineterminator="\n")
        writer.writeheader()
        writer.writerows({**asdict(row), "verdict": row.verdict.value} for row in self.rows)
        return _written(text.getvalue(), path)

    def to_json(self, path: str | Path | None = None) -> str:
        """Everything as strict JSON, unknown numbers as null; written to `path` where one is given. Returns the text.

        >>> json.loads(Report((), "", "", None, False, None, "", 1e-6).to_json())["agrees"]
        False
        """
        data = {**asdict(self), "agrees": self.agrees, "conclusion": self.conclusion()}
        for row in data["rows"]:
            row["verdict"] = row["verdict"].value
        return _written(json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False), path)


_COLUMNS = ("solver", "formulation", "verdict", "residual", "difference", "seconds", "note")


def _cells(row: Row) -> tuple[str, ...]:
    numbers = (_number(row.residual, ".1e"), _number(row.difference, ".1e"), _number(row.seconds, ".2f"))
    return (row.solver, row.formulation or "-", row.verdict.value, *numbers, row.note)


def _number(value: float | None, form: str) -> str:
    return "-" if value is None else format(value, form)


def _written(text: str, path: str | Path | None) -> str:
    if path is not None:
        Path(path).write_text(text, encoding="utf-8")
    return text
