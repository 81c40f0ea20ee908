"""Whatever foreign solvers do becomes the right verdict, and the report says it in every format."""

import csv
import io
import json
import os
import time

import numpy as np
import pytest
from known_answers import chain

import icpmodel as icp
from icpmodel.crosscheck.check import crosscheck
from icpmodel.crosscheck.judge import Row, Verdict
from icpmodel.crosscheck.report import Report
from icpmodel.solvers import Claim, ForeignSolver, chosen_solvers
from icpmodel.solvers.typical_units import in_typical_units

QUICK = ("osqp", "cvxpy-clarabel", "cvxpy-highs", "pyomo-highs")


def verdicts(report):
    return [row.verdict for row in report.rows]


class Fake(ForeignSolver):
    """Returns, or raises, what the test wants."""

    name, forms, used_by = "fake", ("mpec",), ()

    def __init__(self, z=None, words="optimal", solved=True):
        self.z, self.words, self.solved = z, words, solved

    def set_up(self, target, tolerance, time_limit):
        return None

    def run(self, model):
        if isinstance(self.z, BaseException):
            raise self.z
        return Claim(self.z, self.words, self.solved)


LCP = icp.ICP([[0.5, 0.0], [0.0, 0.5]], [-0.25, 0.25])
LCP_Z = np.array([0.5, 0.0])


def ask(z, solution=LCP_Z, problem=LCP, **claim):
    """The one row of a fake solver, whose answer is given in the user's units."""
    scaled = z if z is None or isinstance(z, BaseException | str) else np.asarray(z) / typical_unit(problem)
    return crosscheck(problem, solution, [Fake(scaled, **claim)]).rows[0]


def typical_unit(problem):
    return in_typical_units(problem)[1]


# --- what foreign solvers do -------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("z", "claim", "verdict"),
    [
        ([0.5, 0.0], {}, Verdict.AGREES),
        *(([0.5, off], {}, Verdict.LOOSE) for off in (1e-4, -1e-4)),
        *((wrong, {}, Verdict.LOOSE) for wrong in ([0.0, 0.0], [1e300, 0.0])),
        *((bad, {}, Verdict.FAILED) for bad in ([np.nan, 0.0], [np.inf, 0.0], [0.5], [[0.5, 0.0]], 0.5, "z", None)),
        (KeyError("no such key"), {}, Verdict.FAILED),
        # OSQP calls definite problems unbounded where its tolerances are tight
        (None, {"words": "dual infeasible", "solved": False}, Verdict.FAILED),
        ([0.5, 0.0], {"words": "time limit", "solved": False}, Verdict.FAILED),
    ],
)
def test_what_a_solver_returns_or_raises_is_judged_and_what_it_claims_is_not_believed(z, claim, verdict):
    row = ask(z, **claim)
    assert row.verdict is verdict
    # a solver is held to the criterion that it was asked for, or to ours by name
    assert verdict is not Verdict.LOOSE or "asked for 1e-10 in its own measure" in row.note
    assert row.note or verdict is not Verdict.FAILED


def test_an_interruption_passes_through():
    with pytest.raises(KeyboardInterrupt):
        ask(KeyboardInterrupt())


TWO = icp.ICP([[1.0, 2.0], [2.0, 1.0]], [-1.0, -1.0])


@pytest.mark.parametrize("z", [[1.0, 0.0], [0.0, 1.0], [1 / 3, 1 / 3]])
@pytest.mark.parametrize("foreign", [[1.0, 0.0], [0.0, 1.0], [1 / 3, 1 / 3]])
def test_another_solution_is_neither_agreement_nor_disagreement(z, foreign):
    assert ask(foreign, z, TWO).verdict is (Verdict.AGREES if z == foreign else Verdict.OTHER_SOLUTION)


def test_an_indefinite_problem_is_skipped_with_the_reason_and_not_confirmed():
    report = crosscheck(TWO, [1.0, 0.0], QUICK)
    assert set(verdicts(report)) == {Verdict.SKIPPED}
    assert all("not positive semidefinite" in row.note or "no bounds" in row.note for row in report.rows)
    assert not report.agrees
    assert report.conclusion().endswith("not confirmed.")


def test_the_certified_bound_can_make_the_agreement():
    """Of an answer 1e-10 away, with a bound of about that: near enough for 5e-11, undecided for 1e-12."""
    z = np.array([0.5 + 1e-10, 0.0])
    near, far = (crosscheck(LCP, z, [Fake(LCP_Z / typical_unit(LCP))], atol=atol).rows[0] for atol in (5e-11, 1e-12))
    assert near.verdict is Verdict.AGREES
    assert near.note.startswith("within the certified bound")
    assert far.verdict is Verdict.INCONCLUSIVE


def test_two_honest_answers_at_a_loose_tolerance_are_no_disagreement():
    """A slow mode of the 1-D Laplacian: SOLVED at 1e-8, yet off by 1e-4; the bound says so, and so must the report."""
    n = 300
    A = chain(n)
    problem = icp.ICP(A, -A @ (1.0 + np.arange(n) % 2))
    solution = problem.solve("mnmmod", theta1=float(4 * np.sin(np.pi / 2 / (n + 1))))
    report = crosscheck(problem, solution, ["osqp"])
    assert report.count(Verdict.DISAGREES) == 0
    assert crosscheck(problem, problem.solve("mnmmod", theta1=0.02, rtol=1e-13), ["osqp"]).agrees


def test_a_singular_problem_with_many_solutions_is_not_called_unique():
    """The Neumann Laplacian: z + constant solves as well."""
    n = 20
    A, q = np.diag(np.r_[1.0, np.full(n - 2, 2.0), 1.0]) - np.eye(n, k=1) - np.eye(n, k=-1), np.zeros(n)
    q[3], q[10] = 1.0, -1.0
    x = np.linalg.lstsq(A, -q)[0]
    report = crosscheck(icp.ICP(A, q), x - x.min() + 1.0, QUICK)
    assert report.count(Verdict.DISAGREES) == 0
    assert report.count(Verdict.OTHER_SOLUTION) > 0


# --- which solvers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("arguments", "options", "told"),
    [
        ((LCP_Z, ["gurobi"]), {}, r"'gurobi'; one of .*'cvxpy-clarabel', .* was expected"),
        ((LCP_Z, [3]), {}, "solvers has 3; names"),
        (([0.5], ["osqp"]), {}, "solution has shape"),
        ((["osqp"],), {}, "solvers="),
        ((LCP_Z, ["osqp"]), {"atol": -1.0}, "atol"),
        *(((LCP_Z, ["osqp"]), {"time_limit": bad}, "time_limit") for bad in (0.0, -1.0, np.nan, np.inf, True, "1")),
    ],
)
def test_unknown_and_unfit_arguments_are_named(arguments, options, told):
    with pytest.raises(icp.InputError, match=told):
        crosscheck(LCP, *arguments, **options)


@pytest.mark.parametrize("verdict", list(Verdict))
def test_one_disagreement_spoils_the_report_and_nothing_else_does(verdict):
    rows = [Row(name, "", v, None, None, None, "", "") for name, v in (("a", Verdict.AGREES), ("b", verdict))]
    assert Report(tuple(rows), "", 1, "", "", 0.0, True, None, "", 1e-6).agrees is (verdict is not Verdict.DISAGREES)
    assert Report(tuple(rows[1:]), "", 1, "", "", 0.0, True, None, "", 1e-6).agrees is (verdict is Verdict.AGREES)


def test_all_solvers_by_default_each_at_least_one_row():
    report = crosscheck(LCP, LCP_Z)
    assert [row.solver for row in report.rows] == [solver.name for solver in chosen_solvers(None, "crosscheck")]


def test_a_spent_time_limit_ends_the_attempts():
    class Slow(Fake):
        name, tight, asked = "slow", (1e-9, 1e-6), 0

        def run(self, model):
            self.asked += 1
            return Claim(None, "time limit", False)

    for limit, times in ((1e-9, 0), (60.0, 2)):
        slow = Slow()
        crosscheck(LCP, LCP_Z, [slow], time_limit=limit)
        assert slow.asked == times


def test_who_was_not_asked_for_want_of_time_has_not_failed():
    class Late(Fake):
        name = "late"

        def run(self, model):
            time.sleep(1.1)
            return Claim(None, "time limit", False)

    report = crosscheck(LCP, LCP_Z, [Late(), Fake()], time_limit=1.0)
    assert verdicts(report) == [Verdict.FAILED, Verdict.SKIPPED]
    assert "not asked" in report.rows[1].note


@pytest.mark.parametrize(("ends", "said"), [(False, "time_limit"), (True, "exit code 3")])
def test_a_solver_that_does_not_stop_or_dies_takes_nobody_with_it(ends, said):
    """Where there is little time for the size of the problem it has a process of its own."""

    class Endless(Fake):
        name = "endless"

        def run(self, model):
            if ends:
                os._exit(3)
            time.sleep(15.0)
            return Claim(np.zeros(500), "optimal", True)

    problem = icp.ICP(np.eye(500) + 1e-3, np.ones(500))
    report = crosscheck(problem, np.zeros(500), [Endless(), Fake()], time_limit=3.0)
    assert verdicts(report) == [Verdict.FAILED, Verdict.SKIPPED]
    assert all(said in row.note for row in report.rows)


# --- the report --------------------------------------------------------------------------------------------------


def test_a_report_begins_with_the_verdict():
    for solution, solvers, begins in (
        (LCP_Z, ["osqp"], "Solved; no entry off by more than "),
        ([0.6, 0.0], ["osqp"], "Not solved: "),
        (LCP_Z, [], "Solved; "),
    ):
        report = crosscheck(LCP, solution, solvers)
        assert str(report).startswith(report.conclusion())
        assert report.conclusion().startswith(begins)
        assert report.agrees is (begins.startswith("Solved; no") and bool(solvers))


def test_a_moving_obstacle_is_covered_as_a_whole_and_frozen():
    problem = icp.ICP([[2.0, 0.0], [0.0, 2.0]], [-1.0, -1.0], icp.Affine([[0.0, 0.5], [0.0, 0.0]], 0.0))
    report = crosscheck(problem, None, ["osqp"])
    assert report.coverage().startswith("Confirmed: the whole problem by osqp; with its obstacle frozen")
    assert json.loads(report.to_json())["coverage"] == report.coverage()
    assert report.coverage() in report._repr_html_().replace("\n", " ")


def test_csv_and_json_come_back(tmp_path):
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
