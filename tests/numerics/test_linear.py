"""The solver that fits a matrix: bands, borders, dense, sparse and large ones."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import chain

from icpmodel.numerics.linear import solver_of


def skewed(n):
    """A border and a band that are not symmetric."""
    A = sp.lil_array(sp.diags_array([-1.0, -2.0, 5.0, 0.5], offsets=[-2, -1, 0, 1], shape=(n, n)))
    A[[3, n // 2], :] = np.random.default_rng(5).normal(size=(2, n)) / n
    A[[3, n // 2], [3, n // 2]] = 5.0
    return sp.csr_array(A)


def network(seed, n=3000):
    """BᵀB for the n arcs of a random network and some more, each row of B 1 and −1: only constants have BᵀBx = 0."""
    rng = np.random.default_rng(seed)
    arcs = np.arange(n + n // 5)
    ends = np.column_stack([arcs % n, rng.integers(0, n, arcs.size)])
    signs, rows = np.tile([1.0, -1.0], arcs.size), np.repeat(arcs, 2)
    B = sp.csr_array((signs, (rows, ends.ravel())), shape=(arcs.size, n))
    L = sp.csr_array(B.T @ B)
    L.eliminate_zeros()
    return L


@pytest.mark.parametrize(
    "M",
    [
        np.zeros((3, 3)),
        [[1.0, 1.0], [1.0, 1.0]],
        [[np.nan, 0.0], [0.0, 1.0]],
        sp.block_diag([chain(40, 3.0), np.zeros((2, 2))]),
        sp.block_diag([skewed(300), np.ones((2, 2))]),
        network(0),
    ],
)
def test_what_is_not_in_the_range_of_a_singular_matrix_has_no_solution(M):
    M = sp.csr_array(M)
    f = np.arange(1.0, M.shape[0] + 1.0)
    with np.errstate(all="ignore"):
        assert solver_of(M)(f, 1e-8) is None
        assert solver_of(M)(f, 1e-8, transposed=True) is None


@settings(max_examples=20)
@given(st.integers(0, 100), st.floats(-9.0, 0.0))
def test_a_sparse_matrix_that_is_nearly_singular_is_solved_as_well_as_any(seed, size):
    """As exactly as rounding allows: what is added to the diagonal for the pivots is taken back."""
    L, rng = network(seed), np.random.default_rng(seed)
    M = sp.csr_array(L + 10.0**size * sp.eye_array(L.shape[0]))
    x = rng.normal(size=L.shape[0])
    found = solver_of(M)(M @ x, 1e-8)
    assert np.abs(found - x).max() <= 1e-15 * (5.0 + 0.5 / 10.0**size)
    assert np.abs(M @ found - M @ x).max() <= 1e-15 * (abs(M) @ np.abs(found) + np.abs(M @ x)).max()


@pytest.mark.parametrize("size", [1e-250, 1e-180, 1e180, 1e250])
def test_right_hand_sides_whose_squares_are_no_floats_are_solved(size):
    M, rng = sp.csr_array(network(0) + sp.eye_array(3000)), np.random.default_rng(0)
    x = size * rng.normal(size=M.shape[0])
    assert solver_of(M)(M @ x, 1e-8) == pytest.approx(x, rel=1e-9, abs=1e-9 * size)


@pytest.mark.parametrize("within", [0.0, 1e-14, 1.0])
@pytest.mark.parametrize("rows", [1, 3, 16, 17])
def test_a_band_with_a_few_full_rows_is_solved(rows, within):
    """Also where the band alone is singular or nearly."""
    n, rng = 3000, np.random.default_rng(rows)
    M = sp.lil_array(chain(n, 2.5))
    for i in 100 + 150 * np.arange(rows):
        M[i, [i - 1, i, i + 1]] = within, -2.5 * within, within
        M[i, i + (n // 10 if within == 1.0 else 10)] = 1.5
    M = sp.csr_array(M)
    M.eliminate_zeros()
    f = rng.normal(size=n)
    solve = solver_of(M)
    assert M @ solve(f, 1e-12) == pytest.approx(f, abs=1e-10)
    assert M.T @ solve(f, 1e-12, transposed=True) == pytest.approx(f, abs=1e-10)
