"""Josephy's steps: the affine problems are those of ψ's derivative, and the last one has the answer."""

import numpy as np
import pytest
from known_answers import definite, sine

import icpmodel as icp
from icpmodel.methods.shortcuts import Josephy, Lemke


def run(problem, **options):
    return problem.solve(Josephy(), raise_on_failure=False, **options)


def neighbours(n, slope):
    """ψ_i(z) = slope·sin z_{i+1}, cyclic: its Jacobian is full of zeros, but for one entry off the diagonal."""

    def jacobian(z):
        J = np.zeros((n, n))
        J[np.arange(n), (np.arange(n) + 1) % n] = slope * np.cos(np.roll(z, -1))
        return J

    return icp.Function(lambda z: slope * np.sin(np.roll(z, -1)), jacobian)


def test_a_step_is_the_affine_problem_at_z():
    rng = np.random.default_rng(0)
    A, q, z = definite(rng, 6), rng.normal(size=6), rng.normal(size=6)
    psi = neighbours(6, 0.4)
    path = Josephy().iterates(icp.ICP(A, q, psi), z)
    next(path)
    J = psi.jacobian(z).toarray()
    linear = icp.ICP(A, q, icp.Affine(J, psi.value(z) - J @ z))
    assert next(path)[0] == pytest.approx(linear.solve(Lemke()).z, rel=1e-12)


def test_it_converges_quadratically():
    rng = np.random.default_rng(1)
    for _ in range(10):
        psi = sine(0.9, rng.normal(size=8))
        problem = icp.ICP(definite(rng, 8), rng.normal(size=8), psi)
        exact = problem.solve("newton", rtol=1e-14, raise_on_failure=False).z
        path = Josephy().iterates(problem, exact + 1e-3 * rng.normal(size=8))
        near, step = (np.abs(next(path)[0] - exact).max() for _ in range(2))
        assert step <= 10 * near**2 + 1e-14


def test_it_stands_still_where_steps_lead_nowhere_and_solve_goes_on():
    """z ≥ 1 + z² for no z: there is no solution. And a first step where I − ψ′ is singular."""
    none = icp.ICP([[1.0]], [-1.0], icp.Elementwise(lambda z: z**2 + 1.0, lambda z: 2.0 * z))
    flat = icp.ICP([[2.0]], [-4.0], icp.Elementwise(lambda z: z - 1.0, lambda z: np.ones(z.shape)))
    for problem in (none, flat):
        solution = run(problem)
        assert solution.status is icp.Status.STAGNATED
        assert solution.iterations < 20
    assert flat.solve().z == pytest.approx([2.0])


@pytest.mark.parametrize("seed", range(3))
def test_steps_that_would_wander_are_shortened(seed):
    """Newton's method for z − .9 sin z = c alone goes to and fro; here 40 rows do so at once."""
    rng = np.random.default_rng(seed)
    psi = sine(0.9, rng.normal(size=40))
    solution = run(icp.ICP(definite(rng, 40, 3.0), rng.normal(size=40), psi), history=True)
    assert solution.solved
    assert (np.diff(solution.history.residual) < 0).all()
