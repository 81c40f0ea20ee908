"""What comes out of a cross-check: a table for people, CSV and JSON for programs."""

from __future__ import annotations

import json
import textwrap
from collections.abc import Iterable
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from ..numerics.rounding import at_most
from ..present.card import Card
from ..present.rendering import render
from ..present.shown import Shown
from ..present.table import Table, Tabular, width
from ..solve.solution import Solution, certify
from .judge import Checked, Row, Verdict, finite

#: columns of a report that goes to no terminal
_WIDTH = 118


@dataclass(frozen=True, repr=False)
class Report(Shown, Tabular):
    """What the independent solvers say of an answer; print it, or let a notebook show it.

    `rows`; `problem` and `answer` as texts; `n` unknowns; `residual` = Res(z) of the answer under test and `holds`,
    whether it is a solution; `error_bound` with |z − z*| ≤ it, or None and the `reason`; `tolerance` of the
    differences.

    >>> report = icp.crosscheck(ICP([[2.0]], [-1.0]), [0.5], ["osqp"])
    >>> report.agrees, report.rows[0].verdict.value
    (True, 'agrees')
    >>> report.conclusion(), report.coverage()
    ('1 of 1 independent checks agree. The answer is confirmed.', 'Solved alike: the whole problem by osqp.')
    """

    rows: tuple[Row, ...]
    problem: str
    n: int
    answer: str
    residual: float | None
    holds: bool
    error_bound: float | None
    reason: str
    tolerance: float | None

    @classmethod
    def of(cls, checked: Checked, rows: Iterable[Row], solution: Any) -> Report:
        """The report on `checked` with its `rows`; `solution` a `Solution` or a vector."""
        problem, answer, known = checked.problem, "given as a vector", None
        if isinstance(solution, Solution):
            answer = f"{solution.status.value}, {solution.method!r}"
            known = solution.certificate if solution.problem is problem else None
        of = known or certify(problem, checked.z)
        residual, tolerance = finite(of.residual), finite(checked.tolerance)
        bound, reason = of.error_bound, of.bound.reason
        return cls(tuple(rows), repr(problem), problem.n, answer, residual, checked.holds, bound, reason, tolerance)

    @property
    def agrees(self) -> bool:
        """Whether the answer is a solution, at least one solver agrees, and none disagrees."""
        return self.holds and self.count(Verdict.AGREES) > 0 and self.count(Verdict.DISAGREES) == 0

    def count(self, verdict: Verdict) -> int:
        """How many rows have this `verdict`."""
        return sum(row.verdict is verdict for row in self.rows)

    def conclusion(self) -> str:
        """The report in a sentence or two."""
        others = [f"{self.count(v)} {v.value}" for v in Verdict if v is not Verdict.AGREES and self.count(v)]
        first = "No independent check was made"
        if made := len(self.rows) - self.count(Verdict.SKIPPED):
            first = "; ".join([f"{self.count(Verdict.AGREES)} of {made} independent checks agree", *others])
        elif self.rows:
            first = f"No independent check could be made: {others[0]}"
        wrong = "" if self.holds else " Its own residual is above tolerance."
        return f"{first}. The answer is {'' if self.agrees else 'not '}confirmed.{wrong}"

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

    def closing(self) -> str:
        """Conclusion and coverage, as lines."""
        lines = filter(None, (self.conclusion(), self.coverage()))
        return "\n".join(textwrap.fill(one, width(_WIDTH), break_on_hyphens=False) for one in lines)

    def card(self) -> Card:
        """Problem, answer, residual and error bound."""
        bound = "no certified error bound" if self.error_bound is None else f"|z - z*| <= {at_most(self.error_bound)}"
        residual, tolerance = ("-" if number is None else f"{number:.3g}" for number in (self.residual, self.tolerance))
        answer = f"{self.answer}; residual {residual}, {bound}"
        compared = f"|z_foreign - z| <= {tolerance} in every entry"
        return Card({"problem": self.problem, "answer": answer, "compared": compared})

    def table(self) -> Table:
        """The rows, numbers rounded to two digits."""
        heads = ("solver", "formulation", "verdict", "residual", "difference", "seconds", "note")
        rows = [_plain(row) | {"formulation": row.formulation or "-"} for row in self.rows]
        two = [{key: float(f"{x:.1e}") if isinstance(x, float) else x for key, x in row.items()} for row in rows]
        return Table("", heads, tuple(tuple(row[head] for head in heads) for row in two))

    def __str__(self) -> str:
        return f"{self.card()}\n\n{self.table().to_text(width(_WIDTH))}\n\n{self.closing()}"

    def _repr_html_(self) -> str:
        return self.card().to_html() + self.table().to_html() + render("sentence.html", text=self.closing())

    def to_csv(self, path: str | Path | None = None) -> str:
        """The rows as CSV with a header, numbers in full; written to `path` where one is given. Returns the text."""
        return _written(self._in_full().to_csv(), path)

    def to_dataframe(self) -> Any:
        """The rows as a pandas DataFrame, numbers in full. Raises NotApplicable where pandas is not installed."""
        return self._in_full().to_dataframe()

    def _in_full(self) -> Table:
        rows = tuple(tuple(_plain(row).values()) for row in self.rows)
        return Table("", tuple(Row.__annotations__), rows)

    def to_json(self, path: str | Path | None = None) -> str:
        """Everything as strict JSON, unknown numbers null; written to `path` where one is given. Returns the text."""
        data = asdict(self) | {"rows": [_plain(row) for row in self.rows]}
        data |= {"agrees": self.agrees, "conclusion": self.conclusion(), "coverage": self.coverage()}
        return _written(json.dumps(data, indent=2, allow_nan=False, ensure_ascii=False), path)


def _plain(row: Row) -> dict[str, Any]:
    return {**asdict(row), "verdict": row.verdict.value}


def _written(text: str, path: str | Path | None) -> str:
    if path is not None:
        Path(path).write_text(text, encoding="utf-8")
    return text
