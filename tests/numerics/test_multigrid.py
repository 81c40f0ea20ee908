"""Krylov steps with multigrid: to the tolerance, or None; what levels on ranks begin with."""

import warnings

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.numerics.kernels.vcycle import split_off
from icpmodel.numerics.multigrid import KrylovMultigrid, linear_solve


@pytest.mark.parametrize("skew", [0.0, 0.5])
def test_it_reaches_the_tolerance_for_many_right_hand_sides(skew):
    A = icp.scenes.membrane(n=2500, skew=skew).problem.A
    solver = KrylovMultigrid(A)
    for seed, tolerance in enumerate((1e-2, 1e-6, 1e-10)):
        f = np.random.default_rng(seed).normal(size=2500)
        assert np.linalg.norm(A @ solver.solve(f, tolerance) - f) <= 2 * tolerance * np.linalg.norm(f)


@pytest.mark.parametrize("A", [[[1.0, -1.0], [-1.0, 1.0]], [[1.0, 2.0], [2.0, 1.0]], [[-1.0]]])
def test_singular_and_indefinite_matrices_warn_of_nothing(A):
    A, f = sp.csr_array(A), np.arange(1.0, 1.0 + len(A))
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        x = KrylovMultigrid(A).solve(f, 1e-8)
        linear_solve(A, f)
    assert x is None or np.allclose(A @ x, f, rtol=1e-7)


@settings(deadline=None)
@given(seed=st.integers(0, 10**6), n=st.integers(1, 12), low=st.integers(0, 12), share=st.floats(0.0, 1.0))
def test_rows_are_split_into_their_own_columns_and_those_of_others(seed, n, low, share):
    rng = np.random.default_rng(seed)
    low, high = min(low, n), min(low, n) + int(rng.integers(0, n - min(low, n) + 1))
    rows = sp.random_array((n, n), density=share, rng=rng) + sp.eye_array(n)
    rows = sp.csr_array(rows)[low:high]
    rows.sort_indices()
    whole, indices, data = rows.toarray(), rows.indices.copy(), rows.data.copy()
    indptr, diag, at, columns, others = split_off(rows.indptr, indices, data, low)
    own = sp.csr_array((data[: indptr[-1]], indices[: indptr[-1]], indptr), shape=(high - low, high - low))
    np.testing.assert_array_equal(own.toarray(), whole[:, low:high])
    np.testing.assert_array_equal(data[diag], np.diagonal(whole[:, low:high]))
    beyond = np.zeros_like(whole)
    beyond[at, columns] = others
    beyond[:, low:high] = whole[:, low:high]
    np.testing.assert_array_equal(beyond, whole)
