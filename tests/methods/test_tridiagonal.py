"""The tridiagonal method: right for every M-matrix, at any size and in any units, and honest about all others."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel import scenes
from icpmodel.methods.shortcuts import Lemke, Tridiagonal
from icpmodel.solve.choice import choose


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


def signed(rng, n, margin):
    """Couplings of either sign, rows dominated by the diagonal: H+."""
    lower, upper = rng.normal(size=(2, n))
    lower[0] = upper[-1] = 0.0
    return tridiagonal(lower, np.abs(lower) + np.abs(upper) + margin, upper)


def obstacle(rng, n, trial):
    """Normal entries; in every third trial a third of the rows is without one."""
    c = rng.normal(size=n)
    if trial % 3 == 0:
        c[rng.random(n) < 0.3] = -np.inf
    return c


def scaled_residual(problem, z):
    """The largest natural residual in units of z, beside what rounding explains."""
    p, r = problem.p(z) / problem.A.diagonal(), problem.r(z)
    for_p, for_r = problem.rounding(z)
    return float((np.abs(np.minimum(p, r)) - for_p / problem.A.diagonal() - for_r).max())


def test_the_answer_is_lemke_s_for_m_matrices_with_obstacles_and_rows_without_one():
    rng = np.random.default_rng(0)
    for trial in range(300):
        n = int(rng.integers(1, 30))
        c = obstacle(rng, n, trial)
        problem = icp.ICP(m_matrix(rng, n, 0.1), rng.normal(size=n) * np.exp(2 * rng.normal(size=n)), c)
        solution = run(problem)
        assert solution.solved
        assert solution.iterations == 1
        assert solution.z == pytest.approx(problem.solve(Lemke()).z, rel=1e-7, abs=1e-9)


def test_one_pass_finds_the_active_set_of_an_m_matrix():
    """Newton's steps, which follow, have nothing left to correct where the problem is not degenerate."""
    from icpmodel.numerics.kernels.thomas import SETTLED, bands, newton, release

    rng = np.random.default_rng(1)
    for _ in range(300):
        n = int(rng.integers(1, 60))
        A, q, c = m_matrix(rng, n, 1e-3), rng.normal(size=n), rng.normal(size=n)
        matrix = bands(A.indptr, A.indices, A.data)
        free = release(*matrix, q, c)
        z, ended = newton(*matrix, q, c, None, c, free.copy(), 1)
        assert ended == SETTLED
        assert np.array_equal(free, A @ z + q < A.diagonal() * (z - c))


def test_one_load_that_opens_row_after_row_upwards_and_runs_that_meet():
    """Only the last row is loaded and the slack of those above it small; then loads at both ends that meet."""
    n = 200
    A = tridiagonal(-np.ones(n), np.full(n, 2.0), -np.ones(n))
    for q in (np.full(n, 1e-4), np.full(n, 1e-6)):
        for loads in ([n - 1], [0], [0, n - 1], [50, 60, 150]):
            q[:] = abs(q[1])
            q[loads] = -1.0
            problem = icp.ICP(A, q)
            solution = run(problem)
            assert solution.iterations == 1
            assert solution.z == pytest.approx(problem.solve(Lemke()).z, rel=1e-9, abs=1e-9)


@pytest.mark.parametrize("n", [1, 2, 3, 1000, 100_000])
def test_large_ones_are_solved_in_one_step_to_rounding(n):
    rng = np.random.default_rng(n)
    for dominance in (1e-4, 1.0):
        problem = icp.ICP(m_matrix(rng, n, dominance), rng.normal(size=n), rng.normal(size=n))
        solution = run(problem)
        assert solution.solved
        assert solution.iterations == 1
        assert scaled_residual(problem, solution.z) <= 0.0


@pytest.mark.parametrize("n", [40, 300, 10_000])
def test_the_bearing_is_solved_in_one_step(n):
    scene = scenes.bearing(n=n)
    solution = run(scene.problem)
    assert solution.solved
    assert solution.iterations == 1
    assert scene.errors(solution.z)["p_max"] <= 0.1 * scene.h**2


def test_where_float64_cannot_hold_a_better_answer_the_run_ends_with_the_reason_after_few_steps():
    """With h = 2π/100001 even z* itself, rounded, leaves a residual of more than 1e-8 Res(0)."""
    problem = scenes.bearing(n=100_000).problem
    solution = problem.solve(raise_on_failure=False)
    assert solution.status is icp.Status.PRECISION_LIMIT
    assert solution.iterations <= 4
    assert scaled_residual(problem, solution.z) <= 0.0


def test_couplings_of_either_sign_are_solved_where_the_diagonal_dominates():
    rng = np.random.default_rng(2)
    for trial in range(200):
        n = int(rng.integers(1, 40))
        c = obstacle(rng, n, trial)
        problem = icp.ICP(signed(rng, n, 0.1), rng.normal(size=n), c)
        solution = run(problem)
        assert solution.solved
        assert solution.z == pytest.approx(problem.solve(Lemke()).z, rel=1e-7, abs=1e-9)
    assert run(icp.ICP(signed(rng, 20_000, 1e-3), rng.normal(size=20_000))).solved


def test_whatever_the_matrix_no_false_answer_and_solve_finds_the_right_one_for_p_matrices():
    """Positive definite, but no H-matrices: Newton's steps may go round, and the next method goes on."""
    rng = np.random.default_rng(3)
    gave_up = 0
    for _ in range(300):
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


def test_matrices_that_are_no_p_matrices_are_given_up_honestly():
    """A pivot that is not positive: [[1, -2], [-2, 1]] has the determinant -3; the singular one has no solution."""
    for A, q in (([[1.0, -2.0], [-2.0, 1.0]], [-1.0, -1.0]), ([[1.0, -1.0], [-1.0, 1.0]], [-1.0, 0.5])):
        solution = run(icp.ICP(A, q))
        assert solution.status is icp.Status.STAGNATED
        assert np.isfinite(solution.z).all()


def test_rows_without_obstacle_alone_are_a_linear_system():
    rng = np.random.default_rng(4)
    A, q = m_matrix(rng, 50, 0.1), rng.normal(size=50)
    assert run(icp.ICP(A, q, -np.inf)).z == pytest.approx(np.linalg.solve(A.toarray(), -q), rel=1e-9)


def test_obstacles_that_move_with_their_own_unknown_are_fixed_first():
    rng = np.random.default_rng(5)
    A, q = m_matrix(rng, 40, 0.1), rng.normal(size=40)
    for psi in (
        icp.Affine(sp.diags_array(rng.uniform(-0.9, 0.9, 40)), rng.normal(size=40)),
        icp.Elementwise(lambda z: 0.8 * np.sin(z), lambda z: 0.8 * np.cos(z), lipschitz=0.8, c=rng.normal(size=40)),
        icp.Elementwise(lambda z: 0.8 * np.sin(z), lipschitz=0.8),
    ):
        problem = icp.ICP(A, q, psi)
        solution = run(problem)
        assert solution.solved
        assert solution.iterations == 1
        assert solution.z == pytest.approx(problem.solve("mnmgs", rtol=1e-12).z, abs=1e-8)


@pytest.mark.parametrize("size", [1e-100, 1e100])
def test_units_of_rows_and_columns_change_nothing(size):
    rng = np.random.default_rng(6)
    for n in (1, 5, 40):
        A, q, c = m_matrix(rng, n, 0.1).toarray(), rng.normal(size=n), rng.normal(size=n)
        z = run(icp.ICP(A, q, c)).z
        for R, C in (
            (np.full(n, size), np.ones(n)),
            (np.ones(n), np.full(n, size)),
            (size ** rng.uniform(0, 1, n), np.ones(n)),
            (np.ones(n), size ** rng.uniform(0, 1, n)),
        ):
            path = Tridiagonal().iterates(icp.ICP(R[:, None] * A * C, R * q, c / C), np.zeros(n))
            assert [next(path), next(path)[0]][1] * C == pytest.approx(z, rel=1e-7, abs=1e-9 * np.abs(z).max())


def test_why_not_says_what_is_missing():
    full = icp.ICP(np.ones((3, 3)) + np.eye(3), np.ones(3))
    far = icp.ICP([[1.0, 0.0, 1.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]], np.ones(3))
    moving = icp.ICP(np.eye(3), np.ones(3), np.sin)
    for problem, words in (
        (full, "A is not tridiagonal: it has 9 entries"),
        (far, "A is not tridiagonal: its entries reach 0 rows below the diagonal and 2 above"),
        (moving, "it needs a psi_i that moves with z_i alone, by less than it, which is not known of Function"),
        (icp.ICP(-np.eye(3), np.ones(3)), "A[0, 0] = -1"),
    ):
        assert words in Tridiagonal().why_not(problem)
        assert "tridiagonal" not in [one.method.name for stage in choose(problem, 1e-8) for one, _ in stage.made()]


def test_large_bearings_are_left_to_it_by_solve():
    for n in (200, 2_000, 20_000):
        solution = scenes.bearing(n=n).problem.solve()
        assert repr(solution.method) == "Tridiagonal()"
        assert "a shortcut" in solution.why


def test_a_dense_array_is_taken_like_a_sparse_one():
    sparse = scenes.bearing(n=30).problem
    dense = icp.ICP(sparse.A.toarray(), sparse.q)
    assert dense.nnz == sparse.nnz == 88
    assert np.array_equal(run(dense).z, run(sparse).z)
