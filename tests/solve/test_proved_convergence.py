"""A theorem that a named method converges outweighs a residual that stays flat."""

import re

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.solve.proved_convergence import proved_convergence


def test_monotone_iterates_are_followed_while_their_residual_is_flat():
    """From 10⁴·1 every step takes 1 off each z_i, as a jump costs 1: √3 is the residual for ten thousand steps."""
    A = np.array([[600.0, -200.0, -300.0], [-20.0, 70.0, -40.0], [-30.0, -10.0, 50.0]])
    jumps = sp.csr_array((np.full(3, -1.0), ([0, 1, 2], [1, 2, 0])), shape=(3, 3))
    problem, start = icp.ICP(A, [24.0, 1.6, -10.0], icp.Intervention(jumps)), np.full(3, 1e4)
    assert icp.theory.check("monotone", problem, icp.MNMJ()).holds
    found = problem.solve("mnmj", z0=start)
    assert found.iterations > 10_000
    assert found.z == pytest.approx(problem.solve().z, abs=1e-7)
    # no theorem says so of a step that is not isotone
    assert not icp.theory.check("monotone", problem, icp.MNMJ(phi2=3.0 * A.diagonal())).holds


def test_a_proved_factor_is_followed_and_the_limit_says_by_which_step():
    A = np.array([[3.5e-5, -3e-4], [-1e-5, 1.5e-4]])
    problem = icp.ICP(A, [0.83170471, -0.69761138], upper=[np.inf, 4.0])
    early = problem.solve("mnmod", max_iter=2_500, raise_on_failure=False)  # its residual is flat for 1000 steps
    assert early.status is icp.Status.ITERATION_LIMIT
    assert int(re.search(r"by step (\d+)", early.message)[1]) > 2_500
    for shift in (2e-4, 2e-3):
        near = icp.ICP(A + shift * np.eye(2), problem.q, upper=problem.upper)
        early = near.solve("mnmod", max_iter=2_500, raise_on_failure=False)
        said = proved_convergence(near, icp.MNMOD(), early.z, early.z, early.tolerance, 1000)
        steps = int(re.search(r"by step (\d+)", said)[1]) - 1000
        assert near.solve("mnmod", z0=early, max_iter=steps).solved


@pytest.mark.parametrize("method", ["psor", "mnmj"])
@pytest.mark.parametrize(
    "problem",
    [
        icp.ICP([[1, -1], [-1, 1]], [-1, -1]),
        icp.ICP([[1, -1], [-1, 1]], [1, 1], -np.inf),
        icp.ICP(np.eye(2), [1, 1], icp.Affine([[0, 1], [1, 0]], [1, 1])),
    ],
)
def test_monotone_iterates_without_a_bound_are_not_said_to_converge(method, problem):
    """There is no solution: z grows or falls by the same step for ever."""
    solution = problem.solve(method, raise_on_failure=False)
    assert solution.status is icp.Status.INFEASIBLE
    assert "by theorem" not in solution.message
