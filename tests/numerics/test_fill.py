"""What a factorisation will cost is foreseen: exactly where it is seen to the end, cheaply where it is hopeless."""

import time

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import expander
from hypothesis import given
from hypothesis import strategies as st
from known_answers import GENERATORS, chain

from icpmodel.errors import OutOfMemory, OutOfTime
from icpmodel.numerics import work
from icpmodel.numerics.factorisation import factorise
from icpmodel.numerics.fill import SymbolicAnalysis, band_fill, factor_cost, fill_and_order


def test_a_band_a_clique_and_blocks_fill_up_themselves():
    n = 60
    tridiagonal = chain(n, 3.0)
    assert fill_and_order(tridiagonal)[0].entries == 4 * n - 2
    assert band_fill(n, 1, 1)[1:3] == (4 * n, 4 * n)
    assert band_fill(n, 1, 1, symmetric=True)[1:3] == (2 * n, n)
    assert SymbolicAnalysis(tridiagonal).fill == band_fill(n, 1, 1, symmetric=True)
    clique = np.eye(n) * n - 1.0
    assert fill_and_order(sp.csr_array(clique))[0][1:3] == (n**2 + n, sum(c**2 + c for c in range(n)))
    blocks = sp.csr_array(sp.block_diag([clique[:6, :6]] * 10))
    assert fill_and_order(blocks)[0].entries == 10 * (6**2 + 6)


@given(n=st.integers(1, 45), share=st.floats(0.0, 0.3), rng=GENERATORS)
def test_the_predicted_fill_is_about_that_of_the_factors(n, share, rng):
    """SuperLU breaks ties in another way, and what is left at the end counts as dense."""
    A = sp.csr_array(-(rng.random((n, n)) < share).astype(float))
    A = sp.csr_array(A + A.T)
    A = sp.csr_array(A - sp.diags_array(A.sum(axis=1)) + 2.0 * sp.diags_array(np.ones(n)))
    fill = fill_and_order(A)[0]
    factors = factorise(A, triangles=True).lu
    stored = factors.L.nnz + factors.U.nnz
    assert stored <= 1.2 * fill.entries
    assert fill.entries <= 1.5 * stored + 4


def test_an_expander_is_given_up_within_some_tens_of_products():
    A = expander(20_000).A
    before = work.counter()
    fill = SymbolicAnalysis(A).fill
    assert not fill.is_exact
    assert factor_cost(fill) > 1e4 * work.product_cost(*A.shape[:1], A.nnz)
    assert work.counter() - before <= 100 * work.product_cost(A.shape[0], A.nnz)


def test_rows_coupled_to_most_others_are_eliminated_last():
    """By minimum degree the hub of a star takes a time with the square of its rays."""
    star = sp.csr_array(([1.0] * 60_000, (np.arange(60_000), [7] * 60_000)), shape=(10**5, 10**5))
    A = sp.csr_array(star + star.T + sp.diags_array(np.where(np.arange(10**5) == 7, 1e5, 10.0)))
    analysis = SymbolicAnalysis(A)
    assert analysis.fill.entries == A.nnz + 10**5
    f = np.ones(10**5)
    for definite in (False, True):
        assert A @ factorise(A, definite=definite, analysis=analysis).solve(f) == pytest.approx(f)


def test_factors_that_would_not_fit_are_not_begun():
    A, parents = expander(2000).A, np.random.default_rng(5).integers(0, np.arange(1, 2000))
    tree = sp.csr_array((np.ones(1999), (np.arange(1, 2000), parents)), shape=(2000, 2000))
    tree = sp.csr_array(tree + tree.T + 2000.0 * sp.eye_array(2000))
    for triangles in (False, True):
        with work.work_limit(memory=50 * A.nnz), pytest.raises(OutOfMemory):
            factorise(A, triangles=triangles)
    with work.work_limit(memory=1e6):
        assert factorise(tree) is not None


def test_a_long_ordering_ends_with_the_time():
    """SuperLU holds the interpreter's lock: no thread of this process could end it.

    With three entries a row nothing but the breadth-first layers tells that it takes a second or two.
    """
    rng = np.random.default_rng(0)
    G = sp.random_array((20_000, 40_000), density=3 / 40_000, rng=rng)
    A = sp.csr_array(sp.block_array([[sp.eye_array(40_000), -G.T], [G, sp.eye_array(20_000)]]))
    fill_and_order(sp.csr_array(A[:9, :9]))  # loads what is compiled
    begun = time.perf_counter()
    _, order = fill_and_order(A)
    whole = time.perf_counter() - begun
    assert (np.sort(order) == np.arange(60_000)).all()
    begun = time.perf_counter()
    with work.work_limit(0.1), pytest.raises(OutOfTime):
        fill_and_order(A)
    assert time.perf_counter() - begun < 0.5 * whole + 0.1


def test_an_estimate_counts_rows_that_are_coupled_to_many():
    rng = np.random.default_rng(1)
    n = 3000
    G = sp.random_array((n, n), density=4 / n, rng=rng)
    H = sp.vstack([sp.random_array((100, n), density=0.3, rng=rng), sp.csr_array((n - 100, n))])
    fill = SymbolicAnalysis(sp.csr_array(G + G.T + H + H.T + 20.0 * sp.eye_array(n))).fill
    assert fill.rows == n


def test_an_analysis_counts_what_it_takes_and_not_what_it_might():
    """Else one whose worst case does not fit into the time that is left would end the run."""
    A = expander(2500).A
    analysis = SymbolicAnalysis(A)
    assert not analysis.fill.is_exact
    counts = []
    for analyse in (lambda: fill_and_order(A), lambda: analysis.complete):
        before = work.counter()
        analyse()
        counts.append(work.counter() - before)
    assert counts[0] == counts[1]
    with work.work_limit(nanoseconds=2.0 * counts[0]), pytest.raises(OutOfTime):
        SymbolicAnalysis(A).exact()
