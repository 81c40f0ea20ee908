"""The tridiagonal method: right for every M-matrix, at any size and in any units, and honest about all others."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel import scenes
from icpmodel.algebra.kernels.tridiagonal import refine
from icpmodel.methods.shortcuts import Lemke, Tridiagonal


def run(problem, **options):
    return problem.solve(Tridiagonal(), raise_on_failure=False, **options)


def tridiagonal(lower, diagonal, upper):
    return sp.diags_array([lower[1:], diagonal, upper[:-1]], offsets=[-1, 0, 1]).tocsr()


def m_matrix(rng, n, dominance):
    """Couplings of all sizes, some of them 0, and a diagonal that gives Av = `dominance` at least for some v > 0."""
    lower, upper = (-rng.exponential(size=n) * (rng.random(n) < 0.95) for _ in range(2))
    lower[0] = upper[-1] = 0.0
    v = np.exp(rng.normal(size=n))
    pulls = lower * np.concatenate([[0.0], v[:-1]]) + upper * np.concatenate([v[1:], [0.0]])
    return tridiagonal(lower, (dominance - pulls) / v, upper)


def scaled_residual(problem, z):
    """The largest natural residual in units of z, beside what rounding explains."""
    p, r = problem.p(z) / problem.A.diagonal(), problem.r(z)
    rounding_p, rounding_r = problem.rounding(z)
    return float((np.abs(np.minimum(p, r)) - rounding_p / problem.A.diagonal() - rounding_r).max())


@pytest.mark.parametrize("n", [2, 100_000])
def test_large_tridiagonal_problems_are_solved_in_one_step_to_rounding(n):
    rng = np.random.default_rng(n)
    for dominance in (1e-4, 1.0):
        problem = icp.ICP(m_matrix(rng, n, dominance), rng.normal(size=n), rng.normal(size=n))
        solution = run(problem)
        assert solution.solved
        assert solution.iterations == 1
        assert scaled_residual(problem, solution.z) <= 0.0


@pytest.mark.parametrize("n", [300, 20_000])
@pytest.mark.parametrize("flat", [True, False])
def test_a_string_between_two_obstacles_is_solved_in_few_steps_however_long(n, flat):
    x = np.linspace(0.0, 1.0, n)
    A = tridiagonal(-np.ones(n), np.full(n, 2.0), -np.ones(n))
    q = 0.01 * np.sin(17.0 * x)
    top = icp.ICP(A, q).solve().z.max() * (np.full(n, 0.3) if flat else 0.3 + 0.1 * np.sin(40.0 * x))
    solution = run(icp.ICP(A, q, 0.0, top))
    assert solution.solved
    assert solution.iterations <= 2
    assert np.abs(np.clip(solution.z - A @ solution.z - q, 0.0, top) - solution.z).max() <= 1e-12 * top.max()
    assert icp.solve_many(A, [q], 0.0, upper=[top]).Z[0] == pytest.approx(solution.z, abs=1e-9 * top.max())


@pytest.mark.parametrize("seed", range(5))
def test_m_matrices_between_obstacles_of_all_kinds_are_solved(seed):
    rng = np.random.default_rng(seed)
    for n in (1, 2, 3, 10, 100):
        A = m_matrix(rng, n, 1e-3)
        low = np.where(rng.random(n) < 0.3, -np.inf, rng.integers(-2, 1, n).astype(float))
        high = np.where(rng.random(n) < 0.3, np.inf, np.maximum(low, -1.0) + rng.integers(0, 3, n))
        problem = icp.ICP(A, rng.normal(size=n), low, high)
        assert run(problem).z == pytest.approx(problem.solve("newton").z, rel=1e-6, abs=1e-6)


def test_where_float64_cannot_hold_a_better_answer_the_run_ends_with_the_reason_after_few_steps():
    """With h = 2π/100001 even z* itself, rounded, leaves a residual of more than 1e-8 Res_D(0)."""
    problem = scenes.bearing(n=100_000).problem
    solution = problem.solve(raise_on_failure=False)
    assert solution.status is icp.Status.PRECISION_LIMIT
    assert solution.iterations <= 4
    assert scaled_residual(problem, solution.z) <= 0.0


def test_whatever_the_matrix_no_false_answer_and_solve_finds_the_right_one_for_p_matrices():
    """Positive definite, but no H-matrices: Newton's steps may go round, and the next method goes on."""
    rng = np.random.default_rng(3)
    gave_up = 0
    for _ in range(60):
        n = int(rng.integers(2, 60))
        skew = 3 * rng.normal(size=n)
        problem = icp.ICP(tridiagonal(-np.concatenate([[0.0], skew[:-1]]), np.full(n, 0.05), skew), rng.normal(size=n))
        solution = run(problem)
        assert solution.solved is bool(problem.residual(solution.z) <= solution.tolerance)
        if not solution.solved:
            gave_up += 1
            assert solution.status is icp.Status.STAGNATED
        assert problem.solve().z == pytest.approx(problem.solve(Lemke()).z, rel=1e-6, abs=1e-6)
    assert gave_up > 0


def test_without_a_p_matrix_infeasibility_is_proved():
    """A pivot that is not positive: [[1, -2], [-2, 1]] has the determinant -3; the singular one has no solution."""
    for A, q, status in (
        ([[1.0, -2.0], [-2.0, 1.0]], [-1.0, -1.0], icp.Status.INFEASIBLE),
        ([[1.0, -1.0], [-1.0, 1.0]], [-1.0, 0.5], icp.Status.INFEASIBLE),
    ):
        solution = run(icp.ICP(A, q))
        assert solution.status is status
        assert np.isfinite(solution.z).all()


def test_why_not_says_what_is_missing():
    full = icp.ICP(np.ones((3, 3)) + np.eye(3), np.ones(3))
    far = icp.ICP([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], np.ones(3))
    moving = icp.ICP(np.eye(3), np.ones(3), np.sin)
    for problem, words in (
        (full, "A is not tridiagonal: it has 9 entries"),
        (far, "A is not tridiagonal: its entries reach 0 rows below the diagonal and 2 above"),
        (moving, "psi_i has to depend on z_i alone, with a slope below 1, which is not known of Function"),
        (icp.ICP(-np.eye(3), np.ones(3)), "A[0, 0] = -1"),
    ):
        assert words in Tridiagonal().why_not(problem)
        assert icp.select_method(problem).method.name != "tridiagonal"


def test_a_step_of_refinement_takes_an_error_away():
    rng = np.random.default_rng(0)
    lower, diagonal, upper = -np.ones(6), np.full(6, 2.5), -np.ones(6)
    A = tridiagonal(lower, diagonal, upper)
    exact = rng.normal(size=6)
    found = refine(lower, diagonal, upper, -A @ exact, np.ones(6, bool), exact + 0.1)
    np.testing.assert_allclose(found, exact, atol=1e-14)
