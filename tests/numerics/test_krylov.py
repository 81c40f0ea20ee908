"""Estimates of the Jacobi radius."""

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.numerics.krylov import couplings, radius_of
from icpmodel.problem.matrix import Matrix


def test_jacobi_radius_of_the_five_point_matrix():
    """ρ = cos(π/(m + 1)); transport along the grid, an upwind stencil included, does not hide the diffusion."""
    A = icp.scenes.membrane(n=400).problem.A
    assert 1 - radius_of(couplings(A), share=1e-3) == pytest.approx(1 - np.cos(np.pi / 21), rel=0.01)
    assert 1 <= (1 - Matrix(A).jacobi_radius) / (1 - np.cos(np.pi / 21)) <= 1.6
    skewed = icp.scenes.bai_nonsymmetric(n=400, mu=0).problem.A
    true = np.abs(np.linalg.eigvals(np.eye(400) - skewed.toarray() / 4)).max()
    assert radius_of(couplings(skewed), share=1e-3) == pytest.approx(true, rel=1e-3)
    assert Matrix([[1.0, 5.0], [0.0, 1.0]]).jacobi_radius == 0.0
    dominant = icp.scenes.bai_symmetric(n=400, mu=4).problem.A
    assert Matrix(dominant).jacobi_radius == pytest.approx(0.5)


def test_without_a_positive_diagonal_there_is_no_radius_and_no_warning():
    for A in ([[0.0, 1.0], [1.0, 1.0]], [[-1.0, 0.0], [0.0, 1.0]]):
        assert Matrix(A).jacobi_radius == np.inf


@pytest.mark.parametrize("seed", range(20))
def test_couplings_are_the_geometric_means_of_opposite_entries(seed):
    """Any pattern, with entries without opposite ones and rows without neighbours; transposing changes nothing."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 30))
    A = np.where(rng.random((n, n)) < 0.3, rng.standard_normal((n, n)), 0.0)
    np.fill_diagonal(A, rng.uniform(1.0, 2.0, n) * rng.choice([-1.0, 1.0], n))
    d = np.abs(np.diag(A))
    expected = np.sqrt(np.abs(A * A.T) / np.outer(d, d))
    np.fill_diagonal(expected, 0.0)
    assert np.allclose(couplings(sp.csr_array(A)).toarray(), expected, rtol=1e-12)
    assert np.allclose(couplings(sp.csr_array(A.T)).toarray(), expected, rtol=1e-12)
