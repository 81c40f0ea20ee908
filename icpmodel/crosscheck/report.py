"""What comes out of a cross-check: a table for people, CSV and JSON for programs."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, NamedTuple

from ..numerics.rounding import at_most
from ..present.card import Card
from ..present.rendering import render
from ..present.shown import Shown
from ..present.table import Table, Tabular, width
from ..present.whole_files import as_path, write_ours
from ..solve.solution import Solution, Status, certify
from .judge import Checked, Row, Verdict, finite

#: columns of a report that goes to no terminal
_WIDTH = 118
#: what the verdict counts beside agreement
_OTHERWISE = [verdict for verdict in Verdict if verdict not in (Verdict.AGREES, Verdict.SKIPPED)]


#: with this a report in CSV begins
HEADS = ",".join(Row.__annotations__).encode()


class Certain(NamedTuple):
    """What is certain of an answer: Res_D(z), |z − z*| ≤ `error_bound`, or None and the `reason`."""

    residual: float
    error_bound: float | None
    reason: str

    @classmethod
    def of(cls, checked: Checked, solution: Any) -> Certain:
        """That of the `solution`, or of the vector that was `checked`."""
        known = solution.certificate if isinstance(solution, Solution) and solution.problem is checked.problem else None
        found = known or certify(checked.problem, checked.z)
        return cls(found.residual, found.error_bound, found.bound.reason)


@dataclass(frozen=True, repr=False)
class Report(Shown, Tabular):
    """What the independent solvers say of an answer; print it, or let a notebook show it.

    `rows`; `problem` and `answer` as texts; `n` unknowns; `status` of the run that gave the answer, empty for a vector.
    `residual` = Res_D(z) of the answer under test; `holds`: whether it is a solution; `error_bound` with |z − z*| ≤ it,
    or None and the `reason`; `tolerance` of the differences.

    >>> report = icp.crosscheck(ICP([[2.0]], [-1.0]), [0.5], ["osqp"])
    >>> report.agrees, report.rows[0].verdict.value
    (True, 'agrees')
    >>> report.conclusion()
    'Solved; no entry off by more than ...; 1 of 1 independent solvers agree.'
    >>> report.coverage()
    'Solved alike: the whole problem by osqp.'
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

    @classmethod
    def of(cls, checked: Checked, rows: Iterable[Row], solution: Any, certain: Certain) -> Report:
        """The report on `checked` with its `rows`; `solution` a `Solution` or a vector, of which this is `certain`."""
        problem = checked.problem
        answer = "given as a vector"
        status = ""
        if isinstance(solution, Solution):
            status = solution.status.value
            answer = f"{status}, {solution.method!r}"
        residual = finite(certain.residual)
        bound = certain.error_bound
        reason = certain.reason
        tolerance = finite(checked.tolerance)
        holds = checked.holds
        return cls(tuple(rows), repr(problem), problem.n, answer, status, residual, holds, bound, reason, tolerance)

    @property
    def agrees(self) -> bool:
        """Whether the answer is a solution, at least one solver agrees, and none disagrees."""
        return self.holds and self.count(Verdict.AGREES) > 0 and self.count(Verdict.DISAGREES) == 0

    def count(self, verdict: Verdict) -> int:
        """How many rows have this `verdict`."""
        return sum(row.verdict is verdict for row in self.rows)

    def conclusion(self) -> str:
        """The verdict in one sentence: whether the problem is solved, how wrong the answer can be, and who agrees."""
        ended = "" if self.status in ("", Status.SOLVED.value) else f" ({self.status})"
        if not self.holds:
            answer = f"Not solved{ended}: the residual of the answer is above tolerance"
        elif self.error_bound is None:
            answer = f"Solved{ended}; no error bound is known"
        else:
            answer = f"Solved{ended}; no entry off by more than {at_most(self.error_bound)}"
        by_verdict = {verdict: {row.solver for row in self.rows if row.verdict is verdict} for verdict in Verdict}
        agreeing = by_verdict[Verdict.AGREES] - by_verdict[Verdict.DISAGREES]
        asked = {row.solver for row in self.asked}
        others = [f"{len(more)} {v.value}" for v in _OTHERWISE if (more := by_verdict[v] - agreeing)]
        said = ", ".join([f"{len(agreeing)} of {len(asked)} independent solvers agree", *others])
        if not asked:
            said = "no independent solver could be asked" if self.rows else "no independent solver was asked"
        return f"{answer}; {said}{': not confirmed' if self.holds and not self.agrees else ''}."

    @property
    def asked(self) -> tuple[Row, ...]:
        """The rows of solvers that were given the problem."""
        return tuple(row for row in self.rows if row.verdict is not Verdict.SKIPPED)

    def coverage(self, *smaller: Report) -> str:
        """Which check that agrees covers what, in a sentence, empty without any; `smaller` of the scene at fewer n."""
        whole, frozen = ([row for row in self.rows if row.frozen is kind] for kind in (False, True))
        covered = {
            "the whole problem": whole,
            "with its obstacle frozen at the answer, which leaves open whether there are others,": frozen,
        } | {f"the same scene at n = {one.n}, which says nothing of this answer,": one.rows for one in smaller}
        told = []
        for what, rows in covered.items():
            if names := dict.fromkeys(row.solver for row in rows if row.verdict is Verdict.AGREES):
                told.append(f"{what} by {', '.join(names)}")
        return f"Solved alike: {'; '.join(told)}." if told else ""

    def findings(self) -> str:
        """The verdict, the solvers that were asked, why others were not, and what the checks cover, as text."""
        columns = width(_WIDTH)
        sentences = [
            textwrap.fill(one, columns, break_on_hyphens=False) for one in (self.conclusion(), self.coverage())
        ]
        tables = [table.to_text(columns) for table in self._tables()]
        return "\n\n".join(filter(None, (sentences[0], *tables, sentences[1])))

    def card(self) -> Card:
        """Problem, answer, residual and error bound."""
        bound = "no certified error bound" if self.error_bound is None else f"|z - z*| <= {at_most(self.error_bound)}"
        residual, tolerance = ("-" if number is None else f"{number:.3g}" for number in (self.residual, self.tolerance))
        answer = f"{self.answer}; residual {residual}, {bound}"
        compared = f"|z_foreign - z| <= {tolerance} in every entry"
        return Card({"problem": self.problem, "answer": answer, "compared": compared})

    def table(self) -> Table:
        """The rows, numbers rounded to two digits."""
        return _rounded(self.rows)

    def _tables(self) -> list[Table]:
        """The solvers that were asked, and those that were not, where there are any."""
        skipped = tuple((row.solver, row.note) for row in self.rows if row.verdict is Verdict.SKIPPED)
        tables = [_rounded(self.asked), Table("", ("not asked", "why"), skipped)]
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
        return _written(self._in_full().to_csv(), path, HEADS)

    def to_dataframe(self) -> Any:
        """The rows as a pandas DataFrame, numbers at full precision.

        Raises
        ------
        NotApplicable
            Where pandas is not installed.
        """
        return self._in_full().to_dataframe()

    def _in_full(self) -> Table:
        rows = tuple(tuple(_plain(row).values()) for row in self.rows)
        return Table("", tuple(Row.__annotations__), rows)

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


def _rounded(rows: tuple[Row, ...]) -> Table:
    heads = ("solver", "formulation", "verdict", "residual", "difference", "seconds", "note")
    plain = [_plain(row) | {"formulation": row.formulation or "-"} for row in rows]
    two = [{key: float(f"{x:.1e}") if isinstance(x, float) else x for key, x in row.items()} for row in plain]
    return Table("", heads, tuple(tuple(row[head] for head in heads) for row in two))


def _plain(row: Row) -> dict[str, Any]:
    return {**asdict(row), "verdict": row.verdict.value}


def _written(text: str, path: str | Path | None, begins: bytes) -> str:
    if path is not None:
        write_ours(as_path(path), text.encode(), begins=begins)
    return text
