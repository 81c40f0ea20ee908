"""Powers of two for rows and columns: sizes, exactness, and what cannot be scaled."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import SEEDS

from icpmodel.errors import OutOfTime
from icpmodel.numerics import work
from icpmodel.numerics.equilibration import balanced, equilibrated, in_units, in_units_exactly, row_exponents


def random_matrix(seed, decades=200):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 8))
    X = rng.normal(size=(n, n)) * (rng.random((n, n)) < 0.6)
    return X * 2.0 ** rng.integers(-decades, decades + 1, size=(n, 1)) * 2.0 ** rng.integers(-decades, decades + 1, n)


@pytest.mark.parametrize("seed", range(6))
@pytest.mark.parametrize("made", [np.asarray, sp.csr_array])
def test_the_largest_entries_of_rows_and_columns_get_one_size(seed, made):
    X = random_matrix(seed)
    rows = np.abs(np.ldexp(X, row_exponents(made(X))[:, None])).max(axis=1)
    assert ((rows == 0) | ((rows >= 0.5) & (rows < 1))).all()
    S, r, c = equilibrated(made(X))
    dense = S.toarray() if sp.issparse(S) else S
    assert np.array_equal(dense, np.ldexp(X, r[:, None] + c))
    columns = np.abs(dense).max(axis=0)
    assert ((columns == 0) | ((columns >= 0.5) & (columns < 1))).all()
    assert np.abs(dense).max() < 1


def test_scaling_is_exact_or_refused():
    X = sp.csr_array([[1.0, 3e-308], [0.0, 1.0 + 2.0**-52]])
    shift, none = np.array([-1, 0]), np.zeros(2, dtype=int)
    scaled = in_units_exactly(X, -shift, shift)
    assert np.array_equal(in_units(scaled, shift, -shift).toarray(), X.toarray())
    for made in (X, X.toarray()):
        assert in_units_exactly(made, np.array([-60, 0]), none) is None  # the last digits of 3e-308 are lost
        assert in_units_exactly(made, none, np.array([1030, 0])) is None  # 2^1030 is infinite
    assert np.isinf(in_units(X, none, np.array([1030, 0])).data).any()


def dynamic(rng, steps, states=8):
    """The multipliers and states of x⁺ = (I + small)x + Bu, whose small entries are many."""
    small, B = 0.03 * rng.standard_normal((states, states)), rng.standard_normal((states, 2))
    move = sp.kron(sp.eye_array(steps + 1, k=-1), np.eye(states) + small) - sp.eye_array((steps + 1) * states)
    push = sp.kron(np.eye(steps + 1, steps, k=-1), B)
    C = sp.csr_array(sp.hstack([move, push]))
    return sp.csr_array(sp.block_array([[None, C.T], [-C, None]]))


@given(SEEDS, st.integers(2, 200))
@settings(max_examples=30)
def test_units_do_not_grow_along_a_chain_of_rows(seed, steps):
    """Those for which squared logarithms have the least sum are up to 2^525 apart for 60 steps."""
    W = balanced(dynamic(np.random.default_rng(seed), steps))
    assert W.max() / W.min() <= 2.0**24


def test_units_do_not_grow_with_entries_next_to_nothing():
    """Columns from 1 down to e^-1000, as of a Laplace transform: were they counted, W would be up to 2^200 apart."""
    B = sp.csr_array(np.exp(-np.linspace(0.0, 1.0, 100)[:, None] / np.logspace(-3, 1, 80)))
    W = balanced(sp.csr_array(sp.block_array([[sp.eye_array(100), B], [-B.T, None]])))
    assert W.max() / W.min() <= 2.0**60


def test_weights_are_not_begun_without_time_for_them():
    A = sp.csr_array(np.random.default_rng(0).normal(size=(300, 300)))
    before = work.counter()
    balanced(A)
    with work.work_limit(nanoseconds=0.5 * (work.counter() - before)), pytest.raises(OutOfTime):
        balanced(A)
