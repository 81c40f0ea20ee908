"""Races: one measure of error for all, claims that are wrong are marked, what was measured is never lost."""

import time

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.solvers import Claim, ForeignSolver
from icpmodel.study.competitors import tuned_omega

BAI = icp.scenes.bai_symmetric(n=100)
TOLERANCES = (1e-2, 1e-6, 1e-10)


@pytest.fixture(scope="module")
def bai():
    return icp.race(BAI.problem, ["mnmgs"], ["osqp"], z_exact=BAI.z_exact, tolerances=TOLERANCES, repeats=2)


def test_every_competitor_runs_at_every_tolerance_that_it_has_not_yet_reached_in_every_round(bai):
    for name in ("solve()", "mnmgs", "osqp"):
        residuals = {one.tolerance: one.residual for one in bai.entries if one.name == name}
        reached = 1.0
        for tolerance in TOLERANCES:
            assert (tolerance in residuals) is (tolerance < reached), name
            reached = residuals.get(tolerance, reached)
    for one in bai.entries:
        assert len(one.seconds) == 2
        assert 0 < one.build < min(one.seconds)
        assert one.build + (one.setup or 0.0) < max(one.seconds)
    assert bai.limit > 0


def test_the_error_is_that_of_the_z_that_solve_returns(bai):
    for entry in (one for one in bai.entries if one.name == "mnmgs"):
        tolerance = entry.tolerance
        z = BAI.problem.solve("mnmgs", rtol=tolerance).z
        assert entry.error == np.abs(z - BAI.z_exact).max()
        assert entry.residual == BAI.problem.residual(z) / BAI.problem.residual(np.zeros(100))
        assert entry.residual <= tolerance
    assert bai.measure == "max |z - z*|"


def test_without_a_known_answer_the_measure_is_a_bound_that_holds():
    found = icp.race(BAI.problem, ["mnmgs"], [], tolerances=TOLERANCES, repeats=1)
    assert found.measure == "certified bound on max |z - z*|"
    for entry in found.entries:
        if entry.name == "mnmgs":
            z = BAI.problem.solve("mnmgs", rtol=entry.tolerance).z
            true = np.abs(z - BAI.z_exact).max()
            assert true <= entry.error <= true + 1e-10


def test_between_two_obstacles_all_competitors_reach_the_same_answer():
    box = icp.scenes.box_manufactured(n=25)
    found = icp.race(box.problem, ["newton"], z_exact=box.z_exact, tolerances=[1e-8], repeats=1)
    assert {"solve()", "newton", "osqp", "clarabel", "piqp", "scs"} <= {one.name for one in found.entries}
    for one in found.entries:
        assert one.error <= 1e-5, one
    mms = icp.race(box.problem, ["mms"], [], z_exact=box.z_exact, tolerances=[1e-2], repeats=1)
    assert dict(mms.skipped)["mms"].startswith("MMS has one |x| for each row")


class Liar(ForeignSolver):
    """A foreign solver, asked by nobody else, that says solved of z = 0."""

    name, used_by = "liar", ()

    def set_up(self, target, tolerance, time_limit):
        return target.problem.n

    def run(self, model):
        return Claim(np.zeros(model), "solved", True)


def test_a_claim_that_our_measure_does_not_bear_out_is_marked_and_not_called_wrong():
    found = icp.race(BAI.problem, ["mnmgs"], [Liar()], tolerances=TOLERANCES, repeats=1)
    assert {(one.name, one.loose) for one in found.entries} == {("solve()", False), ("mnmgs", False), ("liar", True)}
    (first, *_) = (one for one in found.entries if one.loose)
    assert "asked for 0.01 in its own measure, 1.0e+00 in ours" in str(found)
    assert first.note in found.table().to_csv()
    assert icp.study.figure(found).axes[0].get_legend() is not None


def test_one_that_exceeds_its_time_is_not_asked_for_more():
    slow = icp.scenes.membrane(n=2500)
    found = icp.race(slow.problem, ["mnmj"], [], tolerances=TOLERANCES, repeats=1, time_limit=1e-4)
    asked = [one.tolerance for one in found.entries if one.name == "mnmj"]
    assert asked == [1e-2]


def test_a_set_up_that_cannot_be_interrupted_is_within_the_limit_or_left_out():
    class Sleeper(Liar):
        name = "sleeper"

        def set_up(self, target, tolerance, time_limit):
            time.sleep(60.0)

    found = icp.race(icp.scenes.membrane(n=2500), [], [Sleeper()], tolerances=[1e-2], repeats=1, time_limit=0.2)
    assert "time_limit = 0.2 s" in dict(found.skipped)["sleeper"]
    assert {one.name for one in found.entries} == {"solve()"}


def test_an_answer_is_judged_in_the_units_of_the_problem():
    problem = icp.ICP([[2e80, 0.0], [0.0, 2e80]], [-1e160, 1e160])
    found = icp.race(problem, [], ["osqp"], tolerances=[1e-8], repeats=1)
    assert {one.name: one.residual < 1e-8 for one in found.entries} == {"solve()": True, "osqp": True}


def test_a_linear_solve_that_fails_is_no_limit():
    singular = icp.ICP([[1.0, -1.0], [-1.0, 1.0]], [-1.0, 2.0])
    assert icp.race(singular, [], [], tolerances=[0.1], repeats=1).limit is None


def test_where_z_0_is_a_solution_nothing_is_measured():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [1.0, 1.0])
    with pytest.raises(icp.InputError, match=r"Res_D\(0\) of the problem is 0; there is nothing to measure"):
        icp.race(problem, ["psor"], [], repeats=1)


@pytest.mark.parametrize("z", [None, [np.nan, 0.0], [0.5], "text", np.array([0.5 + 7j, 1j])])
def test_what_is_no_z_is_no_answer(z):
    class Odd(ForeignSolver):
        name, used_by = "odd", ()

        def set_up(self, target, tolerance, time_limit):
            return None

        def run(self, model):
            return Claim(z, "optimal", True)

    found = icp.race(icp.scenes.hand_lcp(), [], [Odd()], tolerances=[0.1], repeats=1)
    assert [(one.residual, one.error) for one in found.entries if one.name == "odd"] == [(None, None)]


def test_what_cannot_take_part_is_left_out_with_the_reason():
    found = icp.race(icp.scenes.dividend(n=31).problem, ["lemke", "newton"], ["osqp"], tolerances=[1e-4], repeats=1)
    assert dict(found.skipped).keys() == {"lemke", "osqp"}
    assert "lemke: left out, pivoting needs" in str(found)


def test_ctrl_c_keeps_what_was_measured():
    class Stopping(Liar):
        def set_up(self, target, tolerance, time_limit):
            if tolerance < 1e-2:
                raise KeyboardInterrupt
            return super().set_up(target, tolerance, time_limit)

    with pytest.raises(icp.Interrupted) as stopped:
        icp.race(BAI.problem, ["mnmgs"], [Stopping()], tolerances=[1e-2, 1e-3], repeats=1)
    assert [one.name for one in stopped.value.report.entries][:3] == ["solve()", "mnmgs", "liar"]
    assert icp.study.figure(stopped.value.report).axes


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        ({"methods": ["nonsense"]}, "method is 'nonsense'"),
        ({"solvers": ["nonsense"]}, "solvers has 'nonsense'; one of .*'osqp'"),
        ({"methods": "mnmgs"}, "methods is 'mnmgs'; a list was expected"),
        ({"tolerances": []}, "tolerances is empty"),
        ({"tolerances": [2.0]}, "tolerances is 2"),
        ({"repeats": 0}, "repeats is 0"),
        ({"time_limit": 0}, "time_limit is 0"),
        ({"z_exact": [1.0]}, "z_exact has shape"),
    ],
)
def test_wrong_arguments_are_named(arguments, words):
    with pytest.raises(icp.InputError, match=words):
        icp.race(BAI.problem, **arguments)


def test_the_time_of_a_later_round_that_fails_is_not_counted():
    class Flaky(Liar):
        runs = 0

        def run(self, model):
            self.runs += 1
            if self.runs > 2:
                raise RuntimeError("licence lost")
            return Claim(np.array([0.5, 0.0]), "solved", True)

    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0])
    found = icp.race(problem, [], [Flaky()], z_exact=[0.5, 0.0], tolerances=[1e-2], repeats=3)
    (entry,) = (one for one in found.entries if one.name == "liar")
    assert len(entry.seconds) < 3
    assert "licence lost" in entry.claim


def test_rows_without_couplings_need_no_relaxation():
    assert tuned_omega(icp.ICP(sp.eye_array(5000), -np.ones(5000))) == 1.0
