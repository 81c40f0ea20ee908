"""The equations that an active set leaves, and the steps of Newton's method on them."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.algebra.equations import step_of


def derivatives(rng, n):
    """Derivatives of ψ of every kind: jumps in chains and in circles, slopes of one's own, and full ones."""
    jumps = np.zeros((n, n))
    jumps[np.arange(1, n), rng.integers(0, np.arange(1, n))] = 1.0
    circle = np.roll(np.eye(n), 1, axis=1)
    own = np.diag(rng.uniform(-2.0, 0.9, n))
    unit = np.eye(n) + 0.5 * circle  # I − ψ′ has no diagonal
    return {
        "none": 0 * own,
        "unit slope": unit,
        "jumps": jumps,
        "circle": 0.9 * circle,
        "own": own,
        "own and jumps": own + 0.3 * jumps,
        "full": rng.normal(size=(n, n)) / n,
    }


@pytest.mark.parametrize("kind", derivatives(np.random.default_rng(0), 3))
@pytest.mark.parametrize("n", [1, 2, 9, 80])
def test_a_step_solves_its_equations_whatever_psi_and_the_active_set_are(kind, n):
    """(I − ψ′)d = −r in the active rows and Ad = −p in the others, though the active unknowns are eliminated."""
    rng = np.random.default_rng(n)
    for share in (0.0, 0.3, 0.9, 1.0):
        J = derivatives(rng, n)[kind]
        problem = icp.ICP(n * np.eye(n) + rng.normal(size=(n, n)), np.zeros(n))
        active = rng.random(n) < share
        p, r = rng.normal(size=(2, n))
        d = step_of(problem, active, sp.csr_array(J))(p, r, 1e-12)
        assert np.where(active, d - J @ d, problem.A @ d) == pytest.approx(-np.where(active, r, p), abs=1e-9)


def test_jumps_in_a_circle_have_no_step():
    problem = icp.ICP(np.eye(3), np.zeros(3))
    step = step_of(problem, np.ones(3, dtype=bool), sp.csr_array(np.roll(np.eye(3), 1, axis=1)))
    assert step(np.ones(3), np.array([1.0, 2.0, 3.0]), 1e-8) is None
