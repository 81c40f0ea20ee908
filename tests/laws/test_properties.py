"""Laws of the problem itself, on random data: what a permutation, a frozen obstacle or ψ = 0 do to the answer."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import SEEDS, affine, around, dominant

import icpmodel as icp


def manufactured(seed, n=10):
    """A strictly dominant ICP with affine ψ, which moves by 0.4 of z at most, and its solution."""
    rng = np.random.default_rng(seed)
    G, z = rng.normal(size=(n, n)), rng.normal(size=n)
    G *= 0.4 / np.abs(G).sum(axis=1, keepdims=True)
    return around(rng, dominant(rng, n), z, affine(G)), z


@given(seed=SEEDS, size=st.floats(1e-6, 10))
def test_the_manufactured_solution_is_found_and_no_other_whatever_the_order_of_the_rows(seed, size):
    """It is unique, so any other z shows in the residual: catches a sign that is wrong anywhere in p, r or min."""
    problem, z = manufactured(seed)
    rng, (G, c) = np.random.default_rng(seed), problem.psi.linear
    assert problem.residual(z) <= 1e-13
    assert problem.residual(z + size * rng.choice([-1.0, 1.0], z.size)) >= 1e-2 * size
    solution = problem.solve(rtol=1e-11)
    assert solution.z == pytest.approx(z, abs=1e-8)
    assert solution.p == pytest.approx(problem.p(z), abs=1e-7)
    assert solution.r == pytest.approx(problem.r(z), abs=1e-8)
    assert np.abs(solution.z - z).max() <= solution.error_bound + 1e-14
    assert solution.certificate.unique
    order = rng.permutation(z.size)
    A, G = (M[order][:, order] for M in (problem.A, G))
    assert icp.ICP(A, problem.q[order], icp.Affine(G, c[order])).solve(rtol=1e-11).z == pytest.approx(
        z[order], abs=1e-8
    )
    frozen = problem.frozen(z)
    assert frozen.is_lcp
    assert not problem.is_lcp
    assert frozen.solve(rtol=1e-11).z == pytest.approx(z, abs=1e-8)


@settings(max_examples=40)
@given(seed=SEEDS)
def test_psi_zero_is_the_lcp_in_every_spelling(seed):
    problem, z = manufactured(seed)
    zero = np.zeros(z.size)
    spellings = (0, zero, icp.Affine(np.diag(zero)), icp.Elementwise(lambda z: 0 * z), lambda z: 0 * z)
    answers = [problem.with_psi(psi).solve("mnmgs", rtol=1e-11).z for psi in spellings]
    assert all(answer == pytest.approx(answers[0], abs=1e-12) for answer in answers)
    assert (answers[0] >= -1e-9).all()
    assert (problem.p(answers[0]) >= -1e-8).all()
