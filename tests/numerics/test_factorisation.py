"""Singular or not, by structure and by pivots, whatever SuperLU says of it; what of a full matrix fits, and scaling."""

import numpy as np
import pytest
import scipy.sparse as sp

from icpmodel.numerics.arrays import times_rows
from icpmodel.numerics.factorisation import factorise


@pytest.mark.parametrize("diagonal_pivots", [False, True])
@pytest.mark.parametrize(
    "A",
    [
        np.zeros((3, 3)),
        [[1.0, 1.0], [0.0, 0.0]],
        [[1.0, 0.0], [1.0, 0.0]],
        [[1.0, 1.0], [1.0, 1.0]],
        [[0.0, 1.0, 2.0], [0.0, 0.0, 3.0], [0.0, 4.0, 5.0]],
        [[1.0, np.nan], [np.nan, 1.0]],
        [[np.inf, 0.0], [0.0, 1.0]],
    ],
)
def test_what_is_singular_or_not_finite_has_no_factors(A, diagonal_pivots):
    assert factorise(sp.csr_array(np.asarray(A, dtype=float)), diagonal_pivots=diagonal_pivots) is None


def test_columns_that_share_too_few_rows_are_seen_without_a_factorisation():
    """Three columns with entries in two rows only: no row and no column is empty."""
    A = np.eye(6)
    A[3:, 3:] = 0.0
    A[4:, 3:] = [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]
    A[3, 0] = 1.0
    assert factorise(sp.csr_array(A)) is None


@pytest.mark.parametrize("seed", range(20))
def test_it_solves_with_and_without_a_symmetric_pattern(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 30))
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.3) + 4 * np.eye(n)[rng.permutation(n)]
    if seed % 2:
        A = A + A.T + 20 * np.eye(n)
    f = rng.normal(size=n)
    assert np.allclose(A @ factorise(sp.csr_array(A)).solve(f), f, atol=1e-8)


def test_pivots_on_the_diagonal_are_those_of_the_matrix_itself():
    """[0, 1; 1, 0] has none; a positive definite matrix has positive ones."""
    assert factorise(sp.csr_array([[0.0, 1.0], [1.0, 0.0]]), diagonal_pivots=True) is None
    S = sp.csr_array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.5], [0.0, 0.5, 1.0]])
    assert (factorise(S, diagonal_pivots=True).U.diagonal() > 0).all()
    S[0, 0] = 0.1
    assert (factorise(S, diagonal_pivots=True).U.diagonal() < 0).sum() == 1


@pytest.mark.parametrize("n", [1, 2, 40])
def test_a_full_matrix_small_enough_to_fit_in_any_case_has_its_factors(n):
    """Its factors have as many entries as factors can: the limit that is taken for granted leaves room for them all."""
    A = np.random.default_rng(n).normal(size=(n, n)) + n * np.eye(n)
    x = factorise(sp.csr_array(A)).solve(np.ones(n))
    np.testing.assert_allclose(A @ x, np.ones(n), rtol=1e-12)


def test_rows_are_multiplied_as_by_a_diagonal_matrix():
    rng = np.random.default_rng(0)
    A, d = sp.random_array((7, 7), density=0.3, rng=rng, format="csr"), rng.normal(size=7)
    np.testing.assert_array_equal(times_rows(d, A).toarray(), d[:, None] * A.toarray())
