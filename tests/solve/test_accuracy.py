"""solve(accuracy=...): until the certified error is small enough."""

import numpy as np
import pytest

import icpmodel as icp
from icpmodel.solve.goal import AccuracyGoal


class TestAccuracy:
    @pytest.mark.parametrize("name", ["bai-symmetric", "manufactured-affine", "manufactured-elementwise", "hand-lcp"])
    @pytest.mark.parametrize("accuracy", [1e-2, 1e-6, 1e-10])
    def test_the_error_is_below_what_was_asked_for(self, name, accuracy):
        scene = icp.scenes.scene(name)
        solution = scene.problem.solve(accuracy=accuracy)
        assert solution.error_bound <= accuracy
        assert np.abs(solution.z - scene.z_exact).max() <= accuracy

    def test_it_stops_earlier_for_less(self):
        problem = icp.scenes.membrane(n=20**2, mu=0).problem
        steps = [problem.solve("mnmgs", accuracy=a).iterations for a in (1e-2, 1e-5, 1e-8)]
        assert steps == sorted(set(steps))

    def test_what_rounding_forbids_is_a_precision_limit(self):
        solution = icp.scenes.bai_symmetric().problem.solve(accuracy=1e-17, raise_on_failure=False)
        assert solution.status is icp.Status.PRECISION_LIMIT
        assert "1e-17 was wanted" in solution.message

    @pytest.mark.parametrize("steps", range(10))
    def test_an_error_below_it_is_a_success_wherever_the_run_ends(self, steps):
        """The loop does not look at every z, but the last word is a look."""
        problem = icp.ICP([[1.0, -0.9], [-0.9, 1.0]], [-1.0, -1.0])
        solution = problem.solve("mnmj", accuracy=7.0, max_iter=steps, raise_on_failure=False)
        assert solution.solved == (solution.error_bound <= 7.0)

    def test_it_looks_once_at_a_point_that_does_not_move(self):
        """Every look, and every step, asks for ψ a few times."""
        calls = []
        psi = icp.Function(lambda z: calls.append(1) or 0.0 * z, lipschitz=0.0)
        problem = icp.ICP([[2, -1], [-1, 2]], [-1, 3], psi)
        found = problem.solve("mnmgs", accuracy=1e-17, raise_on_failure=False)
        assert found.status is icp.Status.PRECISION_LIMIT
        assert len(calls) <= 5 * found.iterations + 60
        exact = problem.solve().polish()
        calls.clear()
        assert problem.solve(accuracy=1e-3, z0=exact).iterations == 0
        assert len(calls) <= 10

    def test_it_stops_soon_after_the_bound_allows_it(self):
        """Not every z is looked at, but few more steps are made than are needed."""
        problem = icp.scenes.membrane(n=100).problem
        for accuracy in 10.0 ** -np.arange(1, 11):
            path = enumerate(icp.MNMGS().iterates(problem, np.zeros(problem.n)))
            first = next(k for k, (z, _) in path if icp.error_bound(problem, z).value <= accuracy)
            assert first <= problem.solve("mnmgs", accuracy=accuracy).iterations <= 1.3 * first + 5

    @pytest.mark.parametrize("patience", [25, 30, 35, 40, 45])
    def test_a_psi_that_fails_late_leaves_the_best_iterate(self, patience):
        calls = []

        def tiring(z):
            calls.append(1)
            if len(calls) > patience:
                raise ValueError("tired")
            return 0.3 * z[::-1]

        psi = icp.Function(tiring, lipschitz=[[0, 0.3], [0.3, 0]])
        solution = icp.ICP([[2, -1], [-1, 2]], [-1, 3], psi).solve(accuracy=1e-12, raise_on_failure=False)
        assert solution.status is icp.Status.MAP_FAILED
        assert "tired" in solution.message
        assert solution.residual < 0.1

    def test_the_bound_of_one_point_is_not_that_of_another_where_psi_fails(self):
        def psi(z):
            if z[0] > 5:
                raise ValueError("too far")
            return 0.3 * z

        problem = icp.ICP([[2.0]], [-2.0], icp.Function(psi, lipschitz=0.3))
        goal = AccuracyGoal(problem, 1e-3, np.array([1.0]))
        assert goal.judge(np.array([1.0]), 0.0)
        assert not goal.judge(np.array([10.0]), 0.0)

    def test_without_a_certificate_it_is_refused_with_the_reason(self):
        with pytest.raises(icp.NotApplicable, match=r"nothing bounds the error .* Lipschitz .* give rtol"):
            icp.ICP([[1.0]], [-1.0], np.sin).solve(accuracy=1e-3)

    @pytest.mark.parametrize("options", [{"rtol": 1e-3}, {"atol": 0.0}])
    def test_it_does_not_go_with_a_residual_tolerance(self, options):
        with pytest.raises(icp.InputError, match="give accuracy alone"):
            icp.ICP([[1.0]], [-1.0]).solve(accuracy=1e-3, **options)

    @pytest.mark.parametrize("accuracy", [0.0, -1.0, np.nan, np.inf, "x"])
    def test_it_is_a_positive_number(self, accuracy):
        with pytest.raises(icp.InputError, match="accuracy is"):
            icp.ICP([[1.0]], [-1.0]).solve(accuracy=accuracy)
