"""The judge's constants and units: what counts as a solution, and how near is near."""

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.crosscheck.judge import Checked, Verdict, _sum_of_bounds, solves
from icpmodel.solvers.contract import Answer
from icpmodel.solvers.formulations import Target, in_handy_units


def test_units_that_blind_the_residual_do_not_hold() -> None:
    problem = icp.ICP(1e-12 * np.eye(2), [1e-12, -1e-12], [1.0, -5.0])  # z* = (1, 1)
    blind = np.array([1.0, 0.0])
    assert solves(problem, blind, 1e-8)
    assert not Checked.of(problem, blind).holds


def test_the_loose_tolerance_of_another_problem_does_not_count() -> None:
    loose = icp.ICP([[2.0]], [-2.0]).solve("mnmj", phi2=9.0, rtol=1e-4)
    assert not Checked.of(icp.ICP([[2.0]], [-2.0]), loose).holds
    assert Checked.of(loose.problem, loose).holds


def test_a_tolerance_above_the_loosest_is_not_taken_over() -> None:
    problem = icp.ICP([[2.0]], [-2.0])
    loose = problem.solve("mnmj", phi2=9.0, rtol=9e-3)
    assert loose.residual > 2e-4
    assert not Checked.of(problem, loose).holds


def test_ten_times_the_rounding_is_no_solution() -> None:
    problem, z = icp.ICP([[3.0]], [-1.0]), np.array([1 / 3])
    floor = float(np.linalg.norm(np.maximum(*problem.rounding(z))))
    assert solves(problem, z, 0.0)
    assert not solves(problem, z + 10 * floor, 0.0)


@pytest.mark.parametrize("error", [1e-3, 0.9999e-4])
def test_a_wide_bound_proves_no_agreement(error: float) -> None:
    checked = Checked.of(icp.ICP(np.diag([1, 1e-6]), [-1, -1e-6]), [1.0, 1.0 + error])
    exact = Answer(np.ones(2) / checked.unit, "optimal", True)
    assert checked.judge("exact", "energy", checked.targets[0], exact, 0.0).verdict is Verdict.INCONCLUSIVE


def test_a_unit_far_larger_than_z_does_not_make_a_wrong_answer_agree() -> None:
    report = icp.ICP([[1e-9]], [1.0], psi=1.0).crosscheck([1.5])  # z* = 1
    assert report.count(Verdict.AGREES) == 0
    assert not report.agrees


def test_the_bounds_of_both_answers_add_up() -> None:
    both = _sum_of_bounds(Target(icp.ICP([[1.0]], [-1.0])), np.array([1 + 5e-9]), np.array([1 - 5e-9]))
    assert both >= 1e-8


def test_handy_units_keep_the_lipschitz_matrix() -> None:
    handy, unit = in_handy_units(icp.ICP([[4e6]], [-3e9], psi=icp.Elementwise(np.sin, lipschitz=0.5)))
    assert unit != 1.0
    assert handy.psi.lipschitz is not None
    assert handy.psi.lipschitz.toarray() == [[0.5]]


def test_an_infeasible_first_try_is_repeated_more_loosely(monkeypatch: pytest.MonkeyPatch) -> None:
    from pyomo.contrib.appsi.base import TerminationCondition
    from pyomo.contrib.appsi.solvers import Highs

    from icpmodel.solvers.pyomo import PyomoHighs

    real, tried = Highs.solve, []

    def infeasible_at_first(self, model):  # type: ignore[no-untyped-def]
        result = real(self, model)
        tried.append(dict(self.highs_options))
        if len(tried) == 1:
            result.termination_condition = TerminationCondition.infeasible
        return result

    monkeypatch.setattr(Highs, "solve", infeasible_at_first)
    assert PyomoHighs().solve(Target(icp.ICP([[2.0]], [-1.0])), time_limit=10).claims_solved
    assert len(tried) == 2
