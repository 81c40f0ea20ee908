"""Estimates of the Jacobi radius, and steps for systems that fill up."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from known_answers import SEEDS

import icpmodel as icp
from icpmodel.numerics import work
from icpmodel.numerics.fill import SymbolicAnalysis, factor_cost
from icpmodel.numerics.krylov import GCR, conjugate_residuals, couplings
from icpmodel.numerics.linear import solver_of
from icpmodel.problem.matrix import Matrix


def test_the_radius_of_the_couplings_is_that_of_the_jacobi_matrix():
    """Transport along the grid, an upwind stencil included, does not hide the diffusion."""
    A = icp.scenes.bai_nonsymmetric(n=100, mu=0).problem.A
    true = np.abs(np.linalg.eigvals(np.eye(100) - A.toarray() / 4)).max()
    assert np.linalg.eigvalsh(couplings(A).toarray())[-1] == pytest.approx(true)
    assert not couplings(Matrix([[1.0, 5.0], [0.0, 1.0]]).sparse).data.any()


def scattered(seed, n=2000, few=5):
    """Not symmetric, on a graph without geometry, which fills up; the symmetric part is definite."""
    rng = np.random.default_rng(seed)
    S = sp.random_array((n, n), density=few / n, rng=rng, data_sampler=rng.standard_normal)
    return sp.csr_array(S - S.T + sp.diags_array(rng.uniform(0.5, 2.0, n)))


@given(SEEDS, st.floats(1e-10, 1e-2))
def test_conjugate_residuals_end_at_their_tolerance_or_say_that_they_do_not(seed, tolerance):
    """In the units of the diagonal; none where that needs more steps than are allowed."""
    M, f = scattered(seed, 60), np.random.default_rng(seed).normal(size=60)
    unit = 1.0 / np.sqrt(M.diagonal())
    x = conjugate_residuals(M, f, 2000, tolerance)
    if x is not None:
        assert np.linalg.norm(unit * (f - M @ x)) <= 1.01 * tolerance * np.linalg.norm(unit * f)
    assert conjugate_residuals(M, f, 1, tolerance) is None


@pytest.mark.parametrize("transposed", [False, True])
def test_what_fills_up_is_solved_by_steps_that_cost_less_than_factors(transposed):
    M, f = scattered(1, 4000), np.random.default_rng(1).normal(size=4000)
    before = work.counter()
    x = solver_of(M)(f, 1e-9, transposed)
    assert np.linalg.norm((M.T if transposed else M) @ x - f) <= 1e-8 * np.linalg.norm(f)
    assert work.counter() - before < 0.3 * factor_cost(SymbolicAnalysis(M).exact().fill)


def test_residuals_whose_ratio_to_their_images_underflows_end_without_a_step():
    x, moved = GCR(lambda y: 1e300 * y * 1e100, np.copy, np.full(2, 1e-200)).iterate(np.zeros(2), 0.0, 3)
    assert not moved
    assert not x.any()
