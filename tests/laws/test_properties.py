"""Laws of the problem itself, on random data: what a permutation or ψ = 0 must do to the answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp

SEEDS = st.integers(0, 10**9)


def manufactured(seed, n=10, slope=0.4):
    """A strictly dominant ICP with affine ψ and a complementary pair (p*, r*) that is exact to rounding."""
    rng = np.random.default_rng(seed)
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.4)
    A += np.diag(np.abs(A).sum(axis=1) + rng.uniform(0.5, 2, n) - np.diag(A))
    G = rng.normal(size=(n, n))
    G *= slope / np.abs(G).sum(axis=1, keepdims=True)
    z, active = rng.normal(size=n), rng.random(n) < 0.5
    p, r = np.where(active, rng.random(n), 0.0), np.where(active, 0.0, rng.random(n))
    return A, p - A @ z, G, z - r - G @ z, z, p, r


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS)
def test_the_manufactured_solution_is_found_with_its_p_and_r(seed):
    A, q, G, c, z, p, r = manufactured(seed)
    solution = icp.ICP(A, q, icp.Affine(G, c)).solve(rtol=1e-11)
    assert solution.z == pytest.approx(z, abs=1e-8)
    assert solution.p == pytest.approx(p, abs=1e-7)
    assert solution.r == pytest.approx(r, abs=1e-8)
    assert np.abs(solution.z - z).max() <= solution.error_bound + 1e-14
    assert solution.certificate.unique


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_a_permutation_permutes_the_answer(seed):
    A, q, G, c, *_ = manufactured(seed)
    order = np.random.default_rng(seed).permutation(q.size)
    direct = icp.ICP(A, q, icp.Affine(G, c)).solve(rtol=1e-11).z
    grid = np.ix_(order, order)
    permuted = icp.ICP(A[grid], q[order], icp.Affine(G[grid], c[order])).solve(rtol=1e-11).z
    assert permuted == pytest.approx(direct[order], abs=1e-8)


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_psi_zero_is_the_lcp_in_every_spelling(seed):
    A, q, *_ = manufactured(seed)
    n = q.size
    spellings = (0, np.zeros(n), icp.Affine(np.zeros((n, n))), icp.Elementwise(lambda z: 0 * z), lambda z: 0 * z)
    answers = [icp.ICP(A, q, psi).solve("mnmgs", rtol=1e-11).z for psi in spellings]
    assert all(answer == pytest.approx(answers[0], abs=1e-12) for answer in answers)
    assert (answers[0] >= -1e-9).all()
    assert (A @ answers[0] + q >= -1e-8).all()


@settings(max_examples=40, deadline=None)
@given(seed=SEEDS)
def test_the_frozen_obstacle_has_the_same_solution(seed):
    A, q, G, c, z, *_ = manufactured(seed)
    problem = icp.ICP(A, q, icp.Affine(G, c))
    frozen = problem.frozen(z)
    assert frozen.is_lcp
    assert not problem.is_lcp
    assert frozen.solve(rtol=1e-11).z == pytest.approx(z, abs=1e-8)


@settings(max_examples=60, deadline=None)
@given(seed=SEEDS, size=st.floats(1e-6, 10))
def test_every_change_of_the_answer_shows_in_the_residual(seed, size):
    """The solution is unique, so no other z may pass: catches a sign that is wrong anywhere in p, r or min."""
    A, q, G, c, z, *_ = manufactured(seed)
    problem = icp.ICP(A, q, icp.Affine(G, c))
    moved = z + size * np.random.default_rng(seed + 1).choice([-1.0, 1.0], q.size)
    assert problem.residual(z) <= 1e-13
    assert problem.residual(moved) >= 1e-2 * size
