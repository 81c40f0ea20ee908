"""Whatever foreign solvers do becomes the right verdict, and the report says it in every format."""

from __future__ import annotations

import csv
import io
import json
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.crosscheck.check import crosscheck
from icpmodel.crosscheck.judge import Row, Verdict
from icpmodel.crosscheck.report import Report
from icpmodel.solvers import Claim, ForeignSolver, Target
from icpmodel.solvers.formulations import in_handy_units

QUICK = ("osqp", "cvxpy-clarabel", "cvxpy-osqp", "cvxpy-highs", "pyomo-highs")


def verdicts(report: Report) -> list[Verdict]:
    return [row.verdict for row in report.rows]


class Fake(ForeignSolver):
    """Returns, or raises, what the test wants."""

    name, forms, asked_by = "fake", ("mpec",), ()

    def __init__(self, z: Any = None, words: str = "optimal", solved: bool = True) -> None:
        self.z, self.words, self.solved = z, words, solved

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        return None

    def run(self, model: Any) -> Claim:
        if isinstance(self.z, BaseException):
            raise self.z
        return Claim(self.z, self.words, self.solved)


LCP = icp.ICP([[0.5, 0.0], [0.0, 0.5]], [-0.25, 0.25])
LCP_Z = np.array([0.5, 0.0])


def ask(z: Any, solution: Any = LCP_Z, problem: icp.ICP = LCP, **claim: Any) -> Row:
    """The one row of a fake solver, whose answer is given in the user's units."""
    scaled = z if z is None or isinstance(z, BaseException | str) else np.asarray(z) / handy_unit(problem)
    return crosscheck(problem, solution, [Fake(scaled, **claim)]).rows[0]


def handy_unit(problem: icp.ICP) -> float:
    return in_handy_units(problem)[1]


# --- what foreign solvers do -------------------------------------------------------------------------------------


def test_agrees() -> None:
    row = ask(LCP_Z)
    assert (row.verdict, row.residual, row.difference, row.claim) == (Verdict.AGREES, 0.0, 0.0, "optimal")


@pytest.mark.parametrize("z", [[0.5, 1e-4], [0.5, -1e-4], [-0.5, 0.0], [0.0, 0.0], [1e300, 0.0]])
def test_a_claim_of_success_with_a_wrong_z_is_loose(z: list[float]) -> None:
    assert ask(z).verdict is Verdict.LOOSE


@pytest.mark.parametrize("z", [[np.nan, 0.0], [np.inf, 0.0], [0.5], [[0.5, 0.0]], 0.5, "z", None])
def test_an_unusable_z_is_failed(z: Any) -> None:
    row = ask(z)
    assert row.verdict is Verdict.FAILED
    assert row.note


def test_an_exception_is_failed_with_its_text() -> None:
    row = ask(KeyError("no such key"))
    assert row.verdict is Verdict.FAILED
    assert row.note == "it ended with: KeyError: 'no such key', and the answer under test is a solution"


def test_a_ray_that_nobody_has_checked_is_no_finding() -> None:
    """OSQP calls definite problems unbounded where its tolerances are tight."""
    for z in (None, [np.nan, np.nan]):
        row = ask(z, words="dual infeasible", solved=False)
        assert row.verdict is Verdict.FAILED
        assert row.note == "it ended with: dual infeasible, and the answer under test is a solution"


def test_an_interruption_passes_through() -> None:
    with pytest.raises(KeyboardInterrupt):
        ask(KeyboardInterrupt())


TWO = icp.ICP([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0])


@pytest.mark.parametrize("z", [[1.0, 0.0], [0.0, 1.0], [1 / 3, 1 / 3]])
@pytest.mark.parametrize("foreign", [[1.0, 0.0], [0.0, 1.0], [1 / 3, 1 / 3]])
def test_another_solution_is_neither_agreement_nor_disagreement(z: list[float], foreign: list[float]) -> None:
    assert ask(foreign, z, TWO).verdict is (Verdict.AGREES if z == foreign else Verdict.OTHER_SOLUTION)


def test_an_indefinite_problem_is_skipped_with_the_reason_and_not_confirmed() -> None:
    report = crosscheck(TWO, [1.0, 0.0], QUICK)
    assert set(verdicts(report)) == {Verdict.SKIPPED}
    assert all("not positive semidefinite" in row.note or "no bounds" in row.note for row in report.rows)
    assert not report.agrees
    assert report.conclusion().endswith("not confirmed.")


def test_two_honest_answers_at_a_loose_tolerance_are_no_disagreement() -> None:
    """A slow mode of the 1-D Laplacian: SOLVED at 1e-8, yet off by 1e-4; the bound says so, and so must the report."""
    n = 300
    A = sp.diags_array([-np.ones(n - 1), np.full(n, 2.0), -np.ones(n - 1)], offsets=[-1, 0, 1])
    problem = icp.ICP(A, -A @ (1.0 + np.arange(n) % 2))
    solution = problem.solve("mnmmod", theta1=float(4 * np.sin(np.pi / 2 / (n + 1))))
    report = crosscheck(problem, solution, ["osqp"])
    assert report.count(Verdict.DISAGREES) == 0
    assert crosscheck(problem, problem.solve("mnmmod", theta1=0.02, rtol=1e-13), ["osqp"]).agrees


def test_a_singular_problem_with_many_solutions_is_not_called_unique() -> None:
    """The Neumann Laplacian: z + constant solves as well."""
    n = 20
    middle = np.r_[1.0, np.full(n - 2, 2.0), 1.0]
    A = sp.diags_array([-np.ones(n - 1), middle, -np.ones(n - 1)], offsets=[-1, 0, 1]).tocsr()
    q = np.zeros(n)
    q[3], q[10] = 1.0, -1.0
    x = np.linalg.lstsq(A.toarray(), -q, rcond=None)[0]
    report = crosscheck(icp.ICP(A, q), x - x.min() + 1.0, QUICK)
    assert report.count(Verdict.DISAGREES) == 0
    assert report.count(Verdict.OTHER_SOLUTION) > 0


# --- which solvers -----------------------------------------------------------------------------------------------


def test_unknown_and_unfit_arguments_are_named() -> None:
    with pytest.raises(icp.InputError, match=r"'gurobi'; one of .*'cvxpy-clarabel', .* was expected"):
        crosscheck(LCP, LCP_Z, ["gurobi"])
    with pytest.raises(icp.InputError, match="solvers has a int"):
        crosscheck(LCP, LCP_Z, [3])  # type: ignore[list-item]
    with pytest.raises(icp.InputError, match="solution has shape"):
        crosscheck(LCP, [0.5], ["osqp"])
    for bad in (0.0, -1.0, np.nan, np.inf, True, "1"):
        with pytest.raises(icp.InputError, match="time_limit"):
            crosscheck(LCP, LCP_Z, ["osqp"], time_limit=bad)  # type: ignore[arg-type]
    with pytest.raises(icp.InputError, match="atol"):
        crosscheck(LCP, LCP_Z, ["osqp"], atol=-1.0)


@pytest.mark.parametrize("verdict", list(Verdict))
def test_one_disagreement_spoils_the_report_and_nothing_else_does(verdict: Verdict) -> None:
    rows = [Row(name, "", v, None, None, None, "", "") for name, v in (("a", Verdict.AGREES), ("b", verdict))]
    assert Report(tuple(rows), "", 1, "", "", 0.0, True, None, "", 1e-6).agrees is (verdict is not Verdict.DISAGREES)
    assert Report(tuple(rows[1:]), "", 1, "", "", 0.0, True, None, "", 1e-6).agrees is (verdict is Verdict.AGREES)


def test_a_spent_time_limit_ends_the_attempts() -> None:
    class Slow(Fake):
        name, tight, asked = "slow", (1e-9, 1e-6), 0

        def run(self, model: Any) -> Claim:
            self.asked += 1
            return Claim(None, "time limit", False)

    for limit, times in ((1e-9, 1), (60.0, 2)):
        slow = Slow()
        crosscheck(LCP, LCP_Z, [slow], time_limit=limit)
        assert slow.asked == times


def test_foreign_chatter_does_not_reach_the_output(capsys: pytest.CaptureFixture[str]) -> None:
    assert crosscheck(icp.ICP([[2.0]], [-1.0]), [0.5], ["osqp", "cvxpy-osqp"]).agrees
    assert capsys.readouterr().out == ""


# --- the report --------------------------------------------------------------------------------------------------


def test_a_report_begins_with_the_verdict_then_come_those_asked_then_why_others_were_not() -> None:
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0])
    agreed = crosscheck(problem, None, ["osqp"])
    text = str(agreed)
    assert text.startswith(agreed.conclusion())
    assert text.startswith("Solved; no entry off by more than ")
    assert "1 of 1 independent solvers agree." in text.splitlines()[0]
    wrong = crosscheck(problem, [0.6, 0.0], ["osqp"]).conclusion()
    assert wrong.startswith("Not solved: ")
    assert "0 of 1 independent solvers agree, 1 disagrees" in wrong
    nobody = crosscheck(problem, [0.5, 0.0], []).conclusion()
    assert nobody.startswith("Solved; ")
    assert nobody.endswith("not confirmed.")
    skipped = Report((Row("x", "", Verdict.SKIPPED, note="too large"),), "", 1, "", "", 0.0, True, 0.0, "", 1e-6)
    assert "verdict" not in str(skipped)  # no empty table
    assert str(skipped).index(skipped.conclusion()) < str(skipped).index("not asked") < str(skipped).index("too large")


def test_csv_and_json_come_back(tmp_path: Any) -> None:
    report = crosscheck(LCP, LCP_Z)
    rows = list(csv.DictReader(io.StringIO(report.to_csv(tmp_path / "report.csv"))))
    assert (tmp_path / "report.csv").read_text(encoding="utf-8") == report.to_csv()
    data = json.loads(report.to_json(tmp_path / "report.json"), parse_constant=pytest.fail)
    assert data == json.loads((tmp_path / "report.json").read_text(encoding="utf-8"))
    assert data["agrees"] is True
    for row, from_csv, from_json in zip(report.rows, rows, data["rows"], strict=True):
        assert from_csv["verdict"] == from_json["verdict"] == row.verdict.value
        assert from_json["difference"] == row.difference
        assert (float(from_csv["difference"]) if from_csv["difference"] else None) == row.difference
        assert from_csv["note"] == from_json["note"] == row.note
