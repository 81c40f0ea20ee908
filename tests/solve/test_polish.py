"""`Solution.polish`: the answer to rounding accuracy from the certified active set."""

import numpy as np
import pytest
from conformance import WITH_Z
from known_answers import attempt

import icpmodel as icp
from icpmodel.algebra.equations import solve_on


def in_units(size):
    """Problems whose p is of that size."""
    rng = np.random.default_rng(0)
    for _ in range(20):
        A = np.array([[4.0, -1.0], [-2.0, 4.0]]) + rng.uniform(-0.3, 0.3, (2, 2))
        yield icp.ICP(size * A, size * np.array([-3.0, 2.0]), 0.1)


class TestPolish:
    @pytest.mark.parametrize("name", WITH_Z)
    def test_a_rough_answer_becomes_exact_to_rounding(self, name):
        scene = icp.scenes.scene(name, 100 if "n" in icp.scenes.parameters(name) else None)
        rough = attempt(scene.problem, rtol=1e-3)
        fine = rough.polish()
        size = max(1.0, np.abs(scene.z_exact).max())
        if not rough.active_set.undecided.any() or name == "hand-degenerate":
            assert np.abs(fine.z - scene.z_exact).max() <= 1e-13 * size
            if fine.error_bound is not None and name != "hard-scaled":  # there rounding alone is more than that
                assert fine.error_bound <= 1e-11 * size
        assert fine.residual <= rough.residual
        assert fine.solved

    def test_a_run_that_failed_is_solved_where_the_polished_answer_is(self):
        rough = attempt(icp.scenes.membrane(n=400).problem, "mnmgs", max_iter=150)
        assert rough.status is icp.Status.ITERATION_LIMIT
        assert rough.polish().status is icp.Status.SOLVED

    @pytest.mark.parametrize("size", [1e-150, 1.0, 1e10, 1e150, 1e250])
    def test_large_units_of_p_do_not_hide_the_better_answer(self, size):
        """Rounding may make |p| larger than any r, so that the residual grows while the certified error falls."""
        for problem in in_units(size):
            rough = attempt(problem, "mnmgs", max_iter=2)
            assert not rough.active_set.undecided.any()
            assert rough.error_bound > 1e-4
            assert rough.polish().error_bound < 1e-14

    def test_a_row_that_is_proved_takes_its_side_though_z_is_nearer_to_the_other(self):
        """z* = 0 touches with p* = 1; at z = 2 r = 3.8 > p = 3, and p > 2 proves p* > 0."""
        rough = attempt(icp.ICP([[1.0]], [1.0], icp.Affine([[-0.9]])), z0=[2.0], max_iter=0)
        assert rough.active_set.active.tolist() == [True]
        assert rough.polish().z == pytest.approx([0.0], abs=1e-15)

    @pytest.mark.parametrize(("accuracy", "status"), [(1e-20, "ITERATION_LIMIT"), (1e-9, "SOLVED")])
    def test_it_is_solved_only_where_the_accuracy_is_reached(self, accuracy, status):
        problem = icp.scenes.membrane(n=100).problem
        rough = attempt(problem, "mnmgs", accuracy=accuracy, max_iter=40)
        assert rough.status.name == "ITERATION_LIMIT"
        fine = rough.polish()
        assert fine.error_bound < 1e-12
        assert fine.status.name == status

    def test_an_answer_that_is_solved_stays_solved(self):
        """In units of p that make any rounding larger than `atol`, the better z is not what was asked for."""
        for problem in in_units(1e150):
            fine = problem.solve("mnmgs", rtol=0.0, atol=1.0).polish()
            assert fine.solved
            assert fine.residual <= 1.0

    def test_a_singular_active_set_is_no_candidate(self):
        with pytest.raises(icp.SingularOperator):
            solve_on(icp.ICP([[0.0]], [1.0]), np.zeros(1), np.array([False]))
        rough = attempt(icp.ICP([[0.0]], [-1.0]), "mnmgs", phi2=1.0, max_iter=3)
        fine = rough.polish()
        assert fine.z is rough.z
        assert "not polished: " in fine.why


def test_what_the_status_says_is_said_of_this_z():
    """Where obstacles crossed, no other point takes the place of the one at which they do."""
    c = np.array([0.0, 0.1, -np.inf])
    below, above = icp.Function(lambda z: z / 2 + c), icp.Function(lambda z: np.roll(z, 1) / 2 + [1.0, 0.0, 0.0])
    problem = icp.ICP(np.diag([1.0, 0.0, -1e-6]), np.zeros(3), below, upper=above)
    crossed = attempt(problem, z0=[1e10] * 3)
    assert crossed.status is icp.Status.CROSSED
    z = crossed.polish().z
    assert (problem.psi.value(z) > problem.upper.value(z)).any()
