"""The proximal method: monotone problems that are semidefinite or degenerate, and an end where there is no solution."""

import itertools

import hypothesis.strategies as st
import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from known_answers import GENERATORS

import icpmodel as icp


def run(problem, **options):
    return problem.solve("proximal", raise_on_failure=False, **options)


def complementary(rng, n, degenerate=0.3):
    """z*, p* ≥ 0 with z*ᵀp* = 0 where a share of the pairs is (0, 0)."""
    z, p = rng.uniform(0.5, 1.5, (2, n))
    kind = rng.random(n)
    z[kind < 0.5], p[kind >= 0.5] = 0.0, 0.0
    both = rng.random(n) < degenerate
    z[both] = p[both] = 0.0
    return z, p


@given(GENERATORS, st.integers(1, 12), st.floats(0.0, 1.0), st.floats(0.0, 3.0), st.integers(-6, 6))
@settings(max_examples=30)
def test_every_monotone_problem_with_a_solution_is_solved_in_any_units(rng, n, rank, skew, decades):
    E, K = rng.normal(size=(n, max(round(rank * n), 1))), skew * rng.normal(size=(n, n))
    A, (z, p), units = E @ E.T + K - K.T, complementary(rng, n), 10.0 ** (decades * rng.uniform(-1, 1, n))
    problem = icp.ICP(units[:, None] * A * units, units * (p - A @ z))
    # that rounding allows no more is true, too
    assert run(problem).status in (icp.Status.SOLVED, icp.Status.PRECISION_LIMIT)


def test_the_answer_is_nearer_than_the_start_to_every_solution():
    """The resolvent is nonexpansive, and the solutions are its fixed points; here they are a triangle."""
    A, q = np.ones((3, 3)), -np.ones(3)
    z = run(icp.ICP(A, q), z0=[2.0, 0.0, 0.0]).z
    for solution in np.eye(3):
        assert np.linalg.norm(z - solution) <= np.linalg.norm(np.array([2.0, 0.0, 0.0]) - solution)


def moving(rng, above):
    """A solvable problem with a monotone A and affine obstacles that move with all unknowns."""
    n = int(rng.integers(5, 60))
    B, S = rng.normal(size=(n, int(rng.integers(1, n + 1)))), rng.normal(size=(n, n))
    A = B @ B.T + rng.choice([0.0, 0.3]) * (S - S.T)
    G = rng.uniform(-1.0, 1.0, (n, n))
    G *= 0.8 / np.abs(G).sum(axis=1, keepdims=True)
    (r, p), z = complementary(rng, n), rng.normal(size=n)
    q, psi, upper = p - A @ z, icp.Affine(G, z - r - G @ z), None
    if above:  # in every third row z is on it, and p below 0
        high = np.arange(n) % 3 == 0
        q, psi = q - np.where(high, p + rng.random(n), 0.0), icp.Affine(G, z - np.where(high, 1.0, r) - G @ z)
        upper = icp.Affine(G, z + np.where(high, 0.0, 1.0) - G @ z)
    return icp.ICP(A, q, psi, upper=upper)


@pytest.mark.parametrize("method", ["proximal", "interior"])
@pytest.mark.parametrize("above", [False, True])
@pytest.mark.parametrize("seed", range(4))
def test_obstacles_that_move_are_followed_where_a_is_monotone(seed, above, method):
    """Nothing is proved of them; Newton's method ends without a solution on one in forty of these."""
    assert moving(np.random.default_rng(seed), above).solve(method, raise_on_failure=False).solved


def test_what_is_not_monotone_may_fail_but_ends():
    rng = np.random.default_rng(3)
    for _ in range(5):
        A = rng.normal(size=(20, 20))
        problem = icp.ICP(A + A.T, rng.normal(size=20))
        path = icp.Proximal().iterates(problem, np.zeros(20))
        assert sum(1 for _ in itertools.islice(path, 5000)) < 5000


def indefinite(seed, n, constraints):
    """The conditions of optimality of min ½xᵀPx + cᵀx, 0 ≤ x ≤ 1, Gx ≤ h, with `constraints` rows G and a sparse P."""
    rng = np.random.default_rng(seed)
    S = sp.random_array((n, n), density=4 / n, rng=rng, data_sampler=rng.standard_normal)
    P = (S + S.T) / 2 + sp.diags_array(rng.uniform(-1.0, 3.0, n))
    G = sp.random_array((constraints, n), density=4 / n, rng=rng)
    h = 0.5 * G.sum(axis=1) + 0.1
    A = sp.csr_array(sp.block_array([[P, G.T], [-G, None]]) if constraints else P)
    return icp.ICP(A, np.r_[rng.normal(size=n), h], upper=np.r_[np.ones(n), np.full(constraints, np.inf)])


@pytest.mark.parametrize(("n", "constraints"), [(600, 0), (400, 100)])
@pytest.mark.parametrize("seed", range(4))
def test_it_descends_to_a_solution_in_a_box_where_the_objective_is_not_convex(seed, n, constraints):
    problem = indefinite(seed, n, constraints)
    solution = run(problem)
    z, p = solution.z, problem.A @ solution.z + problem.q
    residual = np.maximum(np.minimum(p, z), z - np.r_[np.ones(n), np.full(constraints, np.inf)])
    assert solution.solved
    assert np.abs(residual).max() < 1e-6
    x = z[:n]
    assert 0.5 * x @ (problem.A[:n, :n] @ x) + problem.q[:n] @ x < 0.0


def test_it_descends_where_only_several_steps_together_see_negative_curvature():
    """Every problem in a bounded box has a solution; with a diagonal of 0 the step of one unknown has no curvature."""
    for seed in range(30):
        rng = np.random.default_rng(seed)
        A = np.triu(rng.integers(-3, 4, (3, 3)).astype(float), 1)
        assert run(icp.ICP(A + A.T, rng.normal(size=3), upper=np.ones(3))).solved, seed


def test_a_proof_of_infeasibility_meets_no_overflow():
    problem = icp.ICP(1e-320 * np.eye(6), [0.0, 0.0, 0.0, 0.0, 0.0, -1.0])
    assert not run(problem, max_iter=100).solved
