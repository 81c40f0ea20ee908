"""Answers between two obstacles: confirmed where they are right, and not where a row is at the wrong one."""

import numpy as np
import pytest
from known_answers import PAIR

import icpmodel as icp
from icpmodel.crosscheck import Verdict

ALL = ["osqp", "cvxpy-clarabel", "cvxpy-highs", "pyomo-highs"]


@pytest.mark.parametrize(("skew", "coupling"), [(0.0, 0.0), (0.5, 0.0), (0.3, 0.8)])
def test_every_solver_confirms_the_manufactured_answer(skew, coupling):
    pytest.importorskip("pyomo")
    scene = icp.scenes.box_manufactured(n=25, skew=skew, coupling=coupling, seed=1)
    report = icp.crosscheck(scene.problem, scene.z_exact, ALL)
    assert {row.verdict for row in report.rows} == {Verdict.AGREES}, str(report)
    forms = {row.formulation for row in report.rows}
    both = {"gap QP", "MPEC"} | ({"frozen gap QP", "frozen MPEC"} if coupling else set())
    assert forms == both | ({"energy QP"} if skew == coupling == 0.0 else set())
    assert report.agrees


@pytest.mark.parametrize("row", range(3))
@pytest.mark.parametrize("at", [-0.25, 0.0, 0.5, 1.0, 1.25])
def test_an_answer_with_one_row_elsewhere_is_a_disagreement(row, at):
    scene = icp.scenes.hand_box()
    z = scene.z_exact.copy()
    if z[row] == at:
        return
    z[row] = at
    report = icp.crosscheck(scene.problem, z, ["osqp", "cvxpy-clarabel"])
    assert {one.verdict for one in report.rows} == {Verdict.DISAGREES}
    assert not report.holds


def test_the_report_on_obstacles_that_cross_confirms_nothing():
    problem = icp.scenes.hard_crossing().problem
    solution = problem.solve("psor", raise_on_failure=False)
    report = icp.crosscheck(problem, solution, ["osqp", "cvxpy-clarabel"])
    assert not report.agrees
    assert not report.holds
    assert report.count(Verdict.AGREES) == report.count(Verdict.DISAGREES) == 0


def test_a_nonlinear_obstacle_above_is_frozen_with_the_one_below():
    problem = icp.ICP(PAIR, [3.0, -4.0], -1.0, upper=lambda z: 1.0 + 0.1 * np.sin(z[::-1]))
    solution = problem.solve()
    report = icp.crosscheck(problem, solution, ["osqp", "cvxpy-highs"])
    assert {row.formulation for row in report.rows} <= {"frozen energy QP", "frozen gap QP"}
    assert report.agrees, str(report)
    assert solution.z[1] == pytest.approx(problem.upper.value(solution.z)[1])
