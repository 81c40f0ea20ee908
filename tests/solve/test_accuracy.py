"""solve(accuracy=...): until the certified error is small enough."""

import traceback

import numpy as np
import pytest
from known_answers import PAIR, attempt

import icpmodel as icp


class TestAccuracy:
    @pytest.mark.parametrize("name", ["bai-symmetric", "manufactured-affine", "manufactured-elementwise", "hand-lcp"])
    @pytest.mark.parametrize("accuracy", [1e-2, 1e-6, 1e-10])
    def test_the_error_is_below_what_was_asked_for(self, name, accuracy):
        scene = icp.scenes.scene(name)
        solution = scene.problem.solve(accuracy=accuracy)
        assert solution.error_bound <= accuracy
        assert np.abs(solution.z - scene.z_exact).max() <= accuracy

    def test_ctrl_c_while_the_error_is_bounded_returns_the_best_iterate(self):
        calls = []

        def psi(z):
            if calls and any(frame.name == "error_bound" for frame in traceback.extract_stack()):
                raise KeyboardInterrupt
            return 0.3 * np.sin(z)

        problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0], icp.Elementwise(psi, lipschitz=0.3))
        with pytest.raises(icp.NotSolved) as error:
            problem.solve(accuracy=1e-9, callback=calls.append)
        assert error.value.solution.status is icp.Status.INTERRUPTED
        assert error.value.solution.residual < problem.residual(np.zeros(2))

    def test_what_rounding_forbids_is_a_precision_limit(self):
        solution = attempt(icp.scenes.bai_symmetric().problem, accuracy=1e-17)
        assert solution.status is icp.Status.PRECISION_LIMIT
        assert "1e-17 was wanted" in solution.message

    @pytest.mark.parametrize("steps", range(10))
    def test_an_error_below_it_is_a_success_wherever_the_run_ends(self, steps):
        """The last word is the bound on the error of the answer."""
        problem = icp.ICP([[1.0, -0.9], [-0.9, 1.0]], [-1.0, -1.0])
        solution = attempt(problem, "mnmj", accuracy=7.0, max_iter=steps)
        assert solution.solved == (solution.error_bound <= 7.0)

    @pytest.mark.parametrize("patience", [18, 20, 22, 24])
    def test_a_psi_that_fails_late_leaves_the_best_iterate(self, patience):
        calls = []

        def tiring(z):
            calls.append(1)
            if len(calls) > patience:
                raise ValueError("tired")
            return 0.3 * z[::-1]

        psi = icp.Function(tiring, lipschitz=[[0, 0.3], [0.3, 0]])
        solution = attempt(icp.ICP(PAIR, [-1, 3], psi), accuracy=1e-12)
        assert solution.status is icp.Status.MAP_FAILED
        assert "tired" in solution.message
        assert solution.residual < 0.2

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
