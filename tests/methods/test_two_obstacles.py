"""ψ ≤ z ≤ ψ̄: every method against the enumeration of all choices of rows, and what the second obstacle leaves alone."""

import re

import numpy as np
import pytest
from known_answers import chain

from icpmodel import ICP, Affine, Elementwise
from icpmodel.solve.solution import Status


def test_obstacles_that_cross_where_the_run_has_come_to_are_a_status_with_the_row():
    steep = Affine([[0.0, 0.0], [2.0, 0.0]], [0.0, 0.0])  # psi_1 = 2 z_0, and z_0 is to be 1
    problem = ICP(np.eye(2), [-1.0, 0.0], steep, upper=[5.0, 1.0])
    solution = problem.solve("proximal", raise_on_failure=False)
    assert solution.status is Status.CROSSED
    assert re.search(r"psi_1 = [\d.]+ is above upper_1 = 1 at this z", solution.message)
    assert not solution.certificate.unique


def test_fixed_obstacles_that_cross_are_found_before_any_method_is_tried():
    """ψ_i = z_i/2 + 1 is an obstacle at 2, whatever z is."""
    half = Elementwise(lambda z: 0.5 * z + 1.0, lambda z: np.full(z.shape, 0.5), lipschitz=0.5)
    solution = ICP(np.eye(3), np.zeros(3), half, upper=[3.0, 1.9, 3.0]).solve(raise_on_failure=False)
    assert solution.status is Status.CROSSED
    assert solution.iterations == 0
    assert "psi_1 = 2 is above upper_1 = 1.9" in solution.message
    assert "psi_1 and upper_1 are fixed, and cross" in solution.why


@pytest.mark.parametrize("method", ["psor", "mnmgs", "mnmj"])
def test_one_obstacle_may_move_while_the_other_does_not(method):
    A, swap = chain(3, 4.0).toarray(), np.eye(3)[::-1]
    for psi, upper in ((Affine(0.25 * swap, 1.0), 2.0), (-2.0, Affine(0.25 * swap, -1.0))):
        problem = ICP(A, [3.0, -30.0, 2.0], psi, upper=upper)
        assert problem.solve(method, rtol=1e-12).z == pytest.approx(problem.solve("enumerate").z, abs=1e-9)
