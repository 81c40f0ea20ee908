"""The report of a cross-check: a table for people, CSV and JSON for programs."""

from __future__ import annotations

import json
import textwrap
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..numerics.rounding import rounded_up
from ..present.card import Card
from ..present.display import Displayable
from ..present.rendering import render
from ..present.table import Table, Tabular, width
from ..present.whole_files import as_path, write_ours
from ..solve.solution import Status
from .judge import Row, Verdict

#: the columns that are printed
_PRINTED_COLUMNS = ("solver", "formulation", "verdict", "residual", "difference", "seconds", "note")
#: the first line of a report in CSV
HEADS = (",".join(Row.__annotations__) + "\n").encode()


@dataclass(frozen=True, repr=False)
class Report(Displayable, Tabular):
    """The answers of the independent solvers beside the answer under test; print it, or let a notebook show it.

    Attributes
    ----------
    rows : tuple of Row
        One line for each solver and each form of the problem.
    problem, answer : str
        Both in words.
    n : int
        The number of unknowns.
    status : str
        The status of the run that gave the answer; empty for a vector.
    residual : float or None
        Res_D(z) of the answer under test.
    holds : bool
        Whether the answer under test is a solution.
    error_bound : float or None
        A bound on |z − z*|, or on its `bounded` part; None if there is none, for the `reason`.
    tolerance : float or None
        Largest difference of two answers that agree.
    bounded : str
        The part of z that the bound covers: "z" for all entries, or a part such as the x of a program.

    Examples
    --------
    >>> report = icp.crosscheck(ICP([[2.0]], [-1.0]), [0.5], ["osqp"])
    >>> report.agrees, report.rows[0].verdict.value
    (True, 'agrees')
    >>> report.conclusion()
    'Solved; no entry off by more than ...; 1 of 1 independent solvers agree.'
    >>> report.coverage()
    'Confirmed: the whole problem by osqp.'
    """

    rows: tuple[Row, ...]
    problem: str
    n: int
    answer: str
    status: str
    residual: float | None
    holds: bool
    error_bound: float | None
    reason: str
    tolerance: float | None
    bounded: str = "z"

    @property
    def agrees(self) -> bool:
        """Whether the answer is a solution, at least one solver agrees, and none disagrees."""
        return self.holds and self.count(Verdict.AGREES) > 0 and self.count(Verdict.DISAGREES) == 0

    def count(self, verdict: Verdict) -> int:
        """Count the rows with one verdict.

        Parameters
        ----------
        verdict : Verdict
            The verdict.

        Returns
        -------
        int
            Their number.
        """
        return sum(row.verdict is verdict for row in self.rows)

    def conclusion(self) -> str:
        """The verdict in one sentence: whether the problem is solved, the error bound, and which solvers agree.

        Returns
        -------
        str
            The sentence.
        """
        ended = "" if self.status in ("", Status.SOLVED.value) else f" ({self.status})"
        if not self.holds:
            answer = f"Not solved{ended}: the residual of the answer is above tolerance"
        elif self.error_bound is None:
            answer = f"Solved{ended}; no error bound is known"
        else:
            part = "" if self.bounded == "z" else f" of {self.bounded}"
            answer = f"Solved{ended}; no entry{part} off by more than {rounded_up(self.error_bound)}"
        names = {verdict: {row.solver for row in self.rows if row.verdict is verdict} for verdict in Verdict}
        agreeing = names.pop(Verdict.AGREES) - names[Verdict.DISAGREES]
        skipped = names.pop(Verdict.SKIPPED)
        solvers = {row.solver for row in self.attempts}
        counts = [f"{len(agreeing)} of {len(solvers)} independent solvers agree"]
        counts += [f"{len(more)} {verdict.value}" for verdict, some in names.items() if (more := some - agreeing)]
        if not solvers:
            counts = ["no independent solver could be asked" if skipped else "no independent solver was asked"]
        unconfirmed = ": not confirmed" if self.holds and not self.agrees else ""
        return f"{answer}; {', '.join(counts)}{unconfirmed}."

    @property
    def attempts(self) -> tuple[Row, ...]:
        """The rows of solvers that were given the problem."""
        return tuple(row for row in self.rows if row.verdict is not Verdict.SKIPPED)

    def coverage(self) -> str:
        """The solvers that agree and what each has checked, in one sentence, empty if none agrees.

        Returns
        -------
        str
            The sentence.
        """
        agreeing = [row for row in self.rows if row.verdict is Verdict.AGREES]
        names = dict.fromkeys(row.solver for row in agreeing if not row.local)
        parts = [f"the whole problem by {', '.join(names)}"] if names else []
        if names := dict.fromkeys(row.solver for row in agreeing if row.local):
            words = {"frozen": "its obstacle frozen", "tangent": "p replaced by its tangent"}
            what = [text for word, text in words.items() if any(word in row.formulation for row in agreeing)]
            excluded = "which does not exclude other solutions"
            parts.append(f"with {' or '.join(what)} at the answer, {excluded}, by {', '.join(names)}")
        return f"Confirmed: {'; '.join(parts)}." if parts else ""

    def findings(self) -> str:
        """The verdict, the solvers that ran, why others did not, and what the checks cover, as text.

        Returns
        -------
        str
            The text.
        """
        columns = width()
        verdict, coverage = (
            textwrap.fill(one, columns, break_on_hyphens=False) for one in (self.conclusion(), self.coverage())
        )
        tables = [table.to_text(columns) for table in self._tables()]
        return "\n\n".join(filter(None, (verdict, *tables, coverage)))

    def card(self) -> Card:
        """Problem, answer, residual and error bound.

        Returns
        -------
        Card
            The card.
        """
        bound = "no certified error bound"
        if self.error_bound is not None:
            bound = f"|{self.bounded} - {self.bounded}*| <= {rounded_up(self.error_bound)}"
        residual, tolerance = ("-" if number is None else f"{number:.3g}" for number in (self.residual, self.tolerance))
        answer = f"{self.answer}; residual {residual}, {bound}"
        compared = f"|z_foreign - z| <= {tolerance} in every entry"
        return Card({"problem": self.problem, "answer": answer, "compared": compared})

    def table(self) -> Table:
        """The rows with numbers at full precision.

        Returns
        -------
        Table
            The table.
        """
        return _table(self.rows, tuple(Row.__annotations__))

    def _tables(self) -> list[Table]:
        """The solvers that ran, and those that did not, where there are any."""
        skipped = tuple((row.solver, row.note) for row in self.rows if row.verdict is Verdict.SKIPPED)
        tables = [_table(self.attempts, _PRINTED_COLUMNS), Table("", ("not run", "why"), skipped)]
        return [table for table in tables if table.rows]

    def __str__(self) -> str:
        return f"{self.findings()}\n\n{self.card()}"

    def _repr_html_(self) -> str:
        verdict, coverage = (one and render("sentence.html", text=one) for one in (self.conclusion(), self.coverage()))
        return verdict + "".join(table.to_html() for table in self._tables()) + coverage + self.card().to_html()

    def to_csv(self, path: str | Path | None = None) -> str:
        """The rows as CSV with a header, numbers at full precision.

        Parameters
        ----------
        path : str or path, optional
            File to write as well.

        Returns
        -------
        str
            The text.
        """
        return _written(self.table().to_csv(), path, HEADS)

    def to_json(self, path: str | Path | None = None) -> str:
        """Everything as strict JSON; an unknown number is null.

        Parameters
        ----------
        path : str or path, optional
            File to write as well.

        Returns
        -------
        str
            The text.
        """
        data = asdict(self) | {"rows": [_plain(row) for row in self.rows]}
        data |= {"agrees": self.agrees, "conclusion": self.conclusion(), "coverage": self.coverage()}
        return _written(json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False), path, b'{\n  "rows"')


def _table(rows: tuple[Row, ...], heads: tuple[str, ...]) -> Table:
    return Table("", heads, tuple(tuple(_plain(row)[head] for head in heads) for row in rows))


def _plain(row: Row) -> dict[str, Any]:
    return {**asdict(row), "verdict": row.verdict.value}


def _written(text: str, path: str | Path | None, begins: bytes) -> str:
    if path is not None:
        write_ours(as_path(path), text.encode(), begins=begins)
    return text
