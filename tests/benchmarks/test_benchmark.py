"""Comparisons: every peer solves what it is given, one judge decides, and the tables say what happened."""

import csv
import io
from dataclasses import replace

import numpy as np
import pytest
from shell import call

import icpmodel as icp
from icpmodel.benchmarks import benchmark, choice, faster_peers
from icpmodel.present.table import Table
from icpmodel.solvers import Claim, ForeignSolver, foreign_solvers
from icpmodel.study.cases import Case, built
from icpmodel.study.charts.table_charts import exponent, scaling
from icpmodel.study.competitors import Foreign, Limit, Own, limits, own_methods


class _Fake(ForeignSolver):
    """A foreign solver, asked by nobody else, that makes what a subclass says of the exact z = (½, 0) of hand-lcp."""

    name, asked_by = "fake", ()

    def set_up(self, target, tolerance, time_limit):
        return target.problem.n, tolerance

    def run(self, model):
        n, tolerance = model
        return Claim(self.z(np.array([0.5, 0.0]), tolerance) if n == 2 else np.zeros(n), "optimal", True)

    def z(self, exact, tolerance):
        return exact


class _Clock(Foreign):
    """A foreign solver by a clock of its own."""

    def __init__(self, solver, seconds):
        super().__init__(solver)
        self.seconds = seconds

    def run(self, case, tolerance, time_limit):
        return replace(super().run(case, tolerance, time_limit), seconds=self.seconds)


def rows_of(table):
    return {row[2]: dict(zip(table.heads, row, strict=True)) for row in table.rows}


def measured(fake, scenes=("hand-lcp",), sizes=(2,), seconds=1e-9, **options):
    return benchmark(scenes, sizes, entrants=[Own(), _Clock(fake, seconds)], **options)


def test_a_peer_that_lies_is_marked_as_such():
    """Its own status is recorded; no time, no ratio, and it is not faster than solve()."""

    class Liar(_Fake):
        def z(self, exact, tolerance):
            return exact + 1e-3

    table = measured(Liar())
    row = rows_of(table)["fake"]
    assert row["time, s"] is row["ratio to solve()"] is None
    assert "not reached" in row["note"]
    assert 'says "optimal" at 1e-12, Res(z)/Res(0) = ' in row["note"]
    assert row["Res(z) / Res(0)"] > 1e-5
    assert faster_peers(table) == []


def test_the_first_tolerance_that_does_counts():
    asked = []

    class Coarse(_Fake):
        def z(self, exact, tolerance):
            asked.append(tolerance)
            return exact + 0.1 * tolerance

    table = measured(Coarse())
    row = rows_of(table)["fake"]
    assert row["note"].startswith("optimal, at 1e-08; says")
    assert row["Res(z) / Res(0)"] <= 1e-8
    assert min(asked) == pytest.approx(1e-8)
    assert row["time, s"] == row["lowest"] == row["highest"] == 1e-9
    assert len(faster_peers(table)) == 1


def test_the_next_size_begins_one_tolerance_below_the_one_that_did():
    asked = []

    class Coarse(_Fake):
        def set_up(self, target, tolerance, time_limit):
            asked.append((target.problem.n, tolerance))
            return target.problem, tolerance

        def run(self, model):
            problem, tolerance = model
            return Claim(icp.solve(problem, "newton").z if tolerance < 1e-6 else 0.0 * problem.q, "optimal", True)

    measured(Coarse(), scenes=["membrane"], sizes=[16, 25])
    assert max(tolerance for n, tolerance in asked if n == 16) == pytest.approx(1e-3)
    assert [f"{tolerance:.0e}" for n, tolerance in asked if n == 25][:2] == ["1e-06", "1e-07"]


def test_a_peer_is_judged_in_the_units_of_the_problem():
    case = Case("", icp.ICP([[2e80, 0.0], [0.0, 2e80]], [-1e160, 1e160]))
    claim = Foreign(foreign_solvers()["active set, cold"]).run(case, 1e-10, 1.0)
    assert claim.z / 1e80 == pytest.approx([0.5, 0.0])
    assert case.judged(claim.z) < 1e-8


@pytest.mark.parametrize("z", [None, [np.nan, 0.0], [0.5], "text", 0.0])
def test_what_is_no_z_is_no_answer(z):
    class Odd(_Fake):
        def z(self, exact, tolerance):
            return z

    row = rows_of(measured(Odd()))["fake"]
    assert row["Res(z) / Res(0)"] is None
    assert "not reached" in row["note"]


def test_what_a_peer_raises_is_told():
    class Broken(_Fake):
        def z(self, exact, tolerance):
            raise RuntimeError("out of order")

    assert "RuntimeError: out of order" in rows_of(measured(Broken()))["fake"]["note"]


def test_a_peer_that_cannot_take_a_problem_is_left_out_with_the_reason():
    class Absent(_Fake):
        def why_not(self, target):
            return "no_such_module is not installed: pip install no_such_module"

    row = rows_of(measured(Absent()))["fake"]
    assert row["note"] == "no_such_module is not installed: pip install no_such_module"
    assert row["time, s"] is None


def test_a_problem_that_is_no_qp_is_for_own_methods_only():
    row = rows_of(measured(_Fake(), scenes=["dividend"], sizes=[31]))["fake"]
    assert row["note"] == "psi is neither constant nor affine: no QP"


def test_one_that_would_take_too_long_is_not_asked_again():
    """4 s at n = 16 and at n = 25, limit 7 s: linear growth at least gives 4 s · 49/25 = 7.8 s."""
    asked = []

    class Slow(_Fake):
        def set_up(self, target, tolerance, time_limit):
            asked.append(target.problem.n)
            return super().set_up(target, tolerance, time_limit)

    table = measured(Slow(), scenes=["membrane"], sizes=[49, 16, 25], time_limit=7.0, seconds=4.0)
    assert set(asked) == {16, 25}
    notes = [row[-1] for row in table.rows if row[2] == "fake"]
    assert "not reached" in notes[0]
    assert notes[2] == "would take about 7.8 s, the limit is 7 s"


def test_a_linear_solve_that_fails_is_no_limit():
    case = Case("", built("membrane", 16).problem)
    wrong = Limit("wrong", lambda A, b: 0.0 * b)
    assert not wrong.run(case, 1e-8, 1.0).solved
    assert not Limit("nan", lambda A, b: np.nan * b).run(case, 1e-8, 1.0).solved
    assert all(limit.run(case, 1e-8, 1.0).solved for limit in limits())
    # a condition number of 1e10: 1e-8 ||b|| is below what rounding leaves
    assert limits()[0].run(Case("", built("bearing", 100_000).problem), 1e-8, 1.0).solved
    singular = Case("", icp.ICP([[1.0, 1.0], [1.0, 1.0]], [-1.0, -1.0]))
    assert "singular" in limits()[0].run(singular, 1e-8, 1.0).words


def test_a_benchmark_has_everyone(capsys):
    """solve(), peers, own methods and linear solves, each once, the ratio of solve() to itself being 1."""
    table = benchmark(["hand-lcp"], [2])
    rows = rows_of(table)
    assert len(rows) == len(table.rows)
    assert {"solve()", "osqp", "clarabel", "piqp", "scs", "psor", "active set, cold", "lemke", "multilevel"} < set(rows)
    assert {"SuperLU, one solve", "PyAMG, one solve"} < set(rows)
    assert rows["solve()"]["ratio to solve()"] == 1.0
    for row in rows.values():
        if row["time, s"] is not None:
            assert row["lowest"] <= row["time, s"] <= row["highest"]
            assert row["kind"] == "limit" or row["Res(z) / Res(0)"] <= 1e-8
    assert capsys.readouterr().out == ""


def test_an_own_method_that_cannot_take_a_problem_says_so():
    """Every own method is in the field, and why_not or the status is the note."""
    names = [one.name for one in own_methods()]
    assert set(icp.methods.contract.names()) <= set(names)
    rows = [one.why_not(Case("", built("dividend", 31).problem)) for one in own_methods() if one.name == "lemke"]
    assert "constant or affine" in rows[0]


def test_sizes_and_scenes_are_checked():
    with pytest.raises(icp.InputError, match="there is no scene 'membran'"):
        benchmark(["membran"])
    with pytest.raises(icp.InputError, match="NAME,PARAMETER=NUMBER"):
        benchmark(["membrane,mu"])
    with pytest.raises(icp.InputError, match="repeats is 2"):
        benchmark(["membrane"], repeats=2)
    with pytest.raises(icp.InputError, match="time_limit"):
        benchmark(["membrane"], time_limit=0)
    with pytest.raises(icp.InputError, match="sizes is 0"):
        benchmark(["membrane"], [0])
    with pytest.raises(icp.InputError, match="sizes is 9; a list"):
        benchmark(["membrane"], 9)
    row = benchmark(["dividend"], [10], entrants=[Own()]).rows[0]
    assert row[:2] == ("dividend", 10)
    assert ">= 31" in row[-1]


def test_a_table_goes_through_csv_without_loss():
    table = choice(1, ["gallery-hand-lcp", "gallery-coulomb"], (2, 2, 1), own=["lemke"], peers=False)
    heads, *rows = csv.reader(io.StringIO(table.to_csv()))
    assert tuple(heads) == table.heads
    for read, row in zip(rows, table.rows, strict=True):
        assert [type(cell)(text) for text, cell in zip(read, row, strict=True)] == list(row)


def test_the_exponent_is_that_of_the_power_law():
    assert exponent([(10, 3e-3 * 10**1.5), (100, 3e-3 * 100**1.5)]) == pytest.approx(1.5)
    assert exponent([(1, 9.0), (10, 1.0), (100, 100.0), (1000, 1e4)]) == pytest.approx(2.0)  # the largest three
    assert exponent([(10, 1.0)]) is None


def test_figures_show_what_was_measured_and_label_it():
    heads = ("scene", "n", "method", "kind", "time, s")
    rows = [("membrane,mu=4", n, name, kind, n * 1e-6) for n in (100, 1000) for name, kind in
            (("solve()", "solve"), ("osqp", "peer"), ("mnmgs", "own"), ("SuperLU", "limit"))]  # fmt: skip
    rows += [("membrane,mu=4", 1000, "late", "peer", None), ("coulomb", 2, "solve()", "solve", 1.0)]
    figures = scaling(Table("", heads, tuple(rows)))
    assert list(figures) == ["membrane,mu=4"]
    left, right = figures["membrane,mu=4"].axes
    labels = [[text.get_text() for text in axes.texts if text.get_text()] for axes in (left, right)]
    assert [{label.split(":")[0] for label in half} for half in labels] == [
        {"solve()", "osqp", "SuperLU"},
        {"solve()", "mnmgs"},
    ]
    assert all("n^{1.00}" in label for half in labels for label in half)
    assert left.get_xlabel() == "number of unknowns n"
    assert figures["membrane,mu=4"].get_supylabel().endswith(", s")


def test_the_commands_write_csv_and_figures(capsys, tmp_path):
    folder = tmp_path / "new"
    code, out, err = call(
        capsys, "benchmark", "peers", "hard-degenerate", "hand-lcp", "--n", "4", "--n", "16", "-o", str(folder)
    )
    assert (code, err) == (0, "")
    assert "No peer is faster." in out or "A peer is faster than solve():" in out
    written = [f"{name}.{suffix}" for name in ("benchmark", "hard-degenerate") for suffix in ("csv", "png")]
    assert sorted(path.name for path in folder.iterdir()) == written
    command, heads = (folder / "benchmark.csv").read_text().splitlines()[:2]
    assert command.startswith("# icpmodel benchmark peers hard-degenerate hand-lcp --n 4 --n 16")
    assert heads.startswith("scene,n,method,kind,")
    assert (folder / "hard-degenerate.csv").read_text().splitlines()[0] == command
    assert all(path.stat().st_size > 500 for path in folder.iterdir())


def test_a_peer_that_is_faster_is_named():
    assert faster_peers(measured(_Fake())) == ["hand-lcp, n = 2: fake takes 0.00 of solve()'s time"]
    assert faster_peers(measured(_Fake(), seconds=1e3)) == []


def test_ctrl_c_keeps_what_was_measured():
    class Stopping(_Fake):
        def set_up(self, target, tolerance, time_limit):
            if target.problem.n == 25:
                raise KeyboardInterrupt
            return super().set_up(target, tolerance, time_limit)

    with pytest.raises(icp.Interrupted) as stopped:
        measured(Stopping(), scenes=["membrane"], sizes=[16, 25])
    rows = stopped.value.report.rows
    assert [row[1:3] for row in rows if row[1] == 25] == [(25, "solve()")]
    assert (16, "fake") in {row[1:3] for row in rows}


def test_ctrl_c_within_solve_is_the_end_of_a_measurement_and_not_of_one_run():
    def interrupted(z):
        raise KeyboardInterrupt

    case = Case("", icp.ICP([[2.0]], [-1.0], psi=interrupted))
    for one in (Own(), own_methods()[0]):
        with pytest.raises(KeyboardInterrupt):
            one.run(case, 1e-8, 1.0)


def test_a_folder_that_cannot_be_made_is_told_before_the_work(capsys, tmp_path):
    (tmp_path / "file").write_text("")
    code, out, err = call(capsys, "benchmark", "peers", "hand-lcp", "-o", str(tmp_path / "file"))
    assert (code, out) == (2, "")
    assert "cannot be made a folder" in err
