"""What use and misuse of the derivative found: what is tied, what is sent, and what cannot be written to."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp


def test_a_row_at_its_obstacle_up_to_rounding_is_tied_though_steps_that_add_up_to_nothing_lead_there():
    """Where nothing is proved the reach of rounding errors is that of several steps, as those of one may cancel."""
    A = np.array([[3.0, 0.0, 0.0, 1.0], [0.0, 2.0, 0.0, 0.0], [-2.0, 0.0, 4.0, 0.0], [2.0, 0.0, 0.0, 4.0]])
    never_best = sp.csr_array(([-9.0, -9.0], ([0, 1], [1, 0])), shape=(4, 4))
    problem = icp.ICP(A, [3.0, -2.0, -14.0, 2.0], icp.Intervention(never_best), upper=[np.inf, np.inf, np.inf, 0.0])
    for last in (0.0, -1e-16, -1e-17, 1e-17):
        derivative = problem.solve(z0=[-1.0, 1.0, 3.0, last]).derivative()
        assert "no error bound" in derivative.reason
        right, left = derivative.one_sided(dupper=[0.0, 0.0, 0.0, -1.0])
        np.testing.assert_allclose(right, [1 / 3, 0.0, 1 / 6, -1.0], atol=1e-9)
        np.testing.assert_allclose(left, 0.0, atol=1e-9)


@pytest.mark.parametrize("speed", [1.0, -1.0])
def test_a_direction_in_which_obstacles_cross_on_either_side_is_refused(speed):
    derivative = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0], [0.0, 0.0], [0.0, 5.0]).solve().derivative()
    with pytest.raises(icp.InputError, match=r"dpsi\[0\] is above dupper\[0\]"):
        derivative.one_sided(dpsi=[speed, 0.0])


@pytest.mark.parametrize("size", [5e-324, 1e-310, 1e-300, 1e300])
def test_a_direction_may_have_any_size(size):
    right, left = icp.ICP([[2.0]], [-4.0], psi=2.0).solve().derivative().one_sided(dq=[size])
    np.testing.assert_allclose([*right, *left], [0.0, -size / 2], rtol=1e-9, atol=1e-307)


def test_a_solution_of_another_problem_is_refused():
    problem = icp.ICP([[2.0]], [-2.0])
    other = icp.ICP([[4.0]], [-8.0]).solve()
    with pytest.raises(icp.InputError, match=r"another problem object: call solution\.derivative\(\)"):
        problem.derivative(other)
    assert problem.derivative(problem.solve()).forward(dq=[1.0]) == -0.5


def test_p_and_r_of_a_solution_cannot_be_written_to():
    solution = icp.ICP([[2.0]], [-2.0]).solve()
    for values in (solution.p, solution.r):
        with pytest.raises(ValueError, match="read-only"):
            values[0] = 1.0
