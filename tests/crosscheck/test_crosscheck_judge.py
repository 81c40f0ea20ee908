"""The judge's constants and units: what counts as a solution, and how near is near."""

import numpy as np

import icpmodel as icp
from icpmodel.crosscheck.judge import AnswerUnderTest, Verdict, solves
from icpmodel.solvers.foreign import Claim


def test_units_that_blind_the_residual_do_not_hold():
    """Law 5: beside an obstacle of size 1 the paper's Res sees nothing of a p of size 1e-12."""
    problem = icp.ICP(1e-12 * np.eye(2), [1e-12, -1e-12], [1.0, -5.0])  # z* = (1, 1)
    blind = np.array([1.0, 0.0])
    assert problem.paper_residual(blind) <= 1e-12
    assert not AnswerUnderTest(problem, blind).holds


def test_the_loose_tolerance_of_another_problem_does_not_count():
    loose = icp.ICP([[2.0]], [-2.0]).solve("mnmj", phi2=9.0, rtol=1e-4)
    assert not AnswerUnderTest(icp.ICP([[2.0]], [-2.0]), loose).holds
    assert AnswerUnderTest(loose.problem, loose).holds


def test_ten_times_the_rounding_is_no_solution():
    problem, z = icp.ICP([[3.0]], [-1.0]), np.array([1 / 3])
    floor = problem.rounding_of_residual(z)
    assert solves(problem, z, 0.0)
    assert not solves(problem, z + 10 * floor, 0.0)


def test_a_wide_bound_proves_no_agreement():
    A, z = np.eye(2) - (1 - 1e-6) * (1 - np.eye(2)), np.array([1.0, 2.0])
    checked = AnswerUnderTest(icp.ICP(A, -A @ z, -10.0), z + 1e-3)
    exact = Claim(z / checked.unit, "optimal", True, 0.0, 0.0)
    assert checked.judge("exact", "energy", checked.targets[0], exact).verdict is Verdict.INCONCLUSIVE


def test_a_unit_far_larger_than_z_does_not_make_a_wrong_answer_agree():
    report = icp.ICP([[1e-9]], [1.0], psi=1.0).crosscheck([1.5])  # z* = 1
    assert report.count(Verdict.AGREES) == 0
    assert not report.agrees
