"""Singular or not, by structure and by pivots, whatever SuperLU says of it; what of a full matrix fits, and scaling."""

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import assume, given, settings
from hypothesis import strategies as st
from known_answers import GENERATORS, SEEDS, chain

from icpmodel.numerics.arrays import as_csr
from icpmodel.numerics.factorisation import DenseFactors, factorise
from icpmodel.numerics.fill import SymbolicAnalysis, fill_and_order, signs_of_symmetry
from icpmodel.numerics.symmetric_factors import SymmetricFactors


def test_pivots_on_the_diagonal_are_those_of_the_matrix_itself():
    """[0, 1; 1, 0] has none; a positive definite matrix has positive ones."""
    assert factorise(sp.csr_array([[0.0, 1.0], [1.0, 0.0]]), definite=True, triangles=True) is None
    S = sp.csr_array([[1.0, 0.5, 0.0], [0.5, 1.0, 0.5], [0.0, 0.5, 1.0]])
    assert (factorise(S, definite=True, triangles=True).pivots > 0).all()
    S[0, 0] = 0.1
    assert (factorise(S, definite=True, triangles=True).pivots < 0).sum() == 1


@given(
    st.integers(60, 90), st.sampled_from(["full", "expander"]), st.sampled_from(["definite", "indefinite", "skewed"])
)
@settings(max_examples=15)
def test_what_fills_up_is_factorised_as_dense_and_solved_both_ways(n, pattern, kind):
    rng = np.random.default_rng(n)
    A = rng.normal(size=(n, n)) * (rng.random((n, n)) < (1.0 if pattern == "full" else 0.2))
    A = A + (n * np.eye(n) if kind == "skewed" else A.T + (4.0 * n if kind == "definite" else 0.1) * np.eye(n))
    M, (x, y) = sp.csr_array(A), rng.normal(size=(2, n))
    assert SymbolicAnalysis(M).is_dense
    factors = factorise(M, definite=kind == "definite")
    assert isinstance(factors, DenseFactors)
    assert factors.solve(M @ x) == pytest.approx(x, abs=1e-7)
    assert factors.solve(M.T @ y, "T") == pytest.approx(y, abs=1e-7)
    assert np.log(np.abs(factors.pivots)).sum() == pytest.approx(np.linalg.slogdet(A)[1])
    if kind == "indefinite":
        assert factorise(M, definite=True) is None


def patterned(kind, rng):
    """Symmetric with few and many columns to a supernode, and with many that fill the same rows, or optimality
    conditions [Q, −Bᵀ; B, R]; strictly dominant."""
    if kind == "cube":
        line = chain(9)
        off = sp.csr_array(sum(sp.kron(sp.kron(*pair), last) for *pair, last in _axes(line)))
    elif kind == "expander":
        off = sp.random_array((400, 400), density=0.01, rng=rng)
    elif kind == "programme":
        B = sp.csr_array(rng.normal(size=(90, 150)))
        off = sp.block_array([[sp.csr_array((150, 150)), -B.T], [B, sp.csr_array((90, 90))]])
    else:
        off = sp.block_diag([rng.normal(size=(k, k)) for k in rng.integers(1, 90, 8)])
        off = sp.csr_array(off + sp.random_array(off.shape, density=0.001, rng=rng))
    off = off if kind == "programme" else off + off.T
    return as_csr(off + sp.diags_array(1.0 + abs(off).sum(axis=1)), "A", keep_diagonal=True)


def _axes(line):
    one = sp.eye_array(line.shape[0])
    return (line, one, one), (one, line, one), (one, one, line)


@given(GENERATORS, st.sampled_from(["cube", "expander", "programme", "blocks"]))
@settings(max_examples=8)
def test_factors_of_one_pattern_solve_and_their_pivots_are_those_of_elimination(rng, kind):
    A = patterned(kind, rng)
    n, M = A.shape[0], A.toarray()
    pattern, free = SymmetricFactors(A, fill_and_order(A, symmetric=True)[0], signs_of_symmetry(A)), rng.random(n) < 0.7
    factors = pattern.factors(A.data)
    f, x = rng.normal(size=n), rng.normal(size=n)
    assert factors.solve(M @ x) == pytest.approx(x, abs=1e-11)
    assert factors.solve(M.T @ f, "T") == pytest.approx(f, abs=1e-11)
    assert (factors.pivots > 0).all()
    assert np.log(factors.pivots).sum() == pytest.approx(np.linalg.slogdet(M)[1])
    B = sp.random_array((n, 5), density=0.01, rng=rng)
    symmetric = signs_of_symmetry(A)[:, None] * M
    expected = B.T @ np.linalg.solve(symmetric, B.toarray())
    assert factors.congruence(B) == pytest.approx(expected, abs=1e-12 * np.abs(expected).max())
    C = sp.random_array((n, 4), density=0.01, rng=rng)
    skewed = sp.csr_array(A + sp.random_array(A.shape, density=1 / n, rng=rng))
    expected = B.T @ np.linalg.solve(skewed.toarray(), C.toarray())
    product = factorise(skewed, triangles=True).product(sp.csr_array(B.T), sp.csr_array(C))
    assert product == pytest.approx(expected, abs=1e-11 * np.abs(expected).max())
    of_free = pattern.factors(A.data, free)
    M[~(free[:, None] & free) & ~np.eye(n, dtype=bool)] = 0.0
    assert of_free.solve(M @ x) == pytest.approx(x, abs=1e-11)


@pytest.mark.parametrize("n", [60, 3000])
def test_a_pattern_or_entries_that_are_not_symmetric_have_no_signs(n):
    rng = np.random.default_rng(0)
    A = sp.csr_array(sp.random_array((n, n), density=3.0 / n, rng=rng) + sp.eye_array(n))
    assert signs_of_symmetry(A) is None
    B = A + A.T
    B.data[B.indices == n // 2] *= 1.0 + 1e-9
    assert signs_of_symmetry(B) is None


@pytest.mark.parametrize(
    "A",
    [
        [[1.0, 2.0], [3.0, 1.0]],
        [[1.0, 2.0], [0.0, 1.0]],
        [[1.0, 1.0, -1.0], [1.0, 1.0, 1.0], [1.0, 1.0, 1.0]],  # 1 and 2 have one sign, and 2 and 3, but 1 and 3 two
    ],
)
def test_no_signs_are_found_where_there_are_none(A):
    assert signs_of_symmetry(as_csr(sp.csr_array(A), "A", keep_diagonal=True)) is None


def test_a_matrix_that_cannot_be_factorised_says_so_and_the_next_one_can():
    A = sp.csr_array([[2.0, 1.0], [1.0, 2.0]])
    pattern = SymmetricFactors(A, fill_and_order(A, symmetric=True)[0], np.ones(2))
    assert pattern.factors(np.array([0.0, 1.0, 1.0, 0.0])) is None
    assert pattern.factors(np.array([2.0, np.nan, np.nan, 2.0])) is None
    assert pattern.factors(A.data).solve(np.array([3.0, 3.0])) == pytest.approx([1.0, 1.0])


def a_band(kind, n, below, above, rng):
    """Random entries on some diagonals: definite, symmetric and indefinite, or neither."""
    A = np.triu(np.tril(rng.normal(size=(n, n)), above), -below)
    if kind == "neither":
        return A
    A = A + A.T
    return A + np.diag(np.abs(A).sum(axis=1) + 1.0) if kind == "definite" else A


@settings(max_examples=20)
@given(
    kind=st.sampled_from(["definite", "indefinite", "neither"]),
    reach=st.tuples(st.integers(0, 6), st.integers(0, 6)),
    units=st.integers(-140, 140),
    seed=SEEDS,
)
def test_a_band_is_solved_both_ways_as_the_dense_matrix_is(kind, reach, units, seed):
    """By Cholesky's factor where it is definite, also where its diagonal is of many sizes; else with exchanges."""
    rng, n = np.random.default_rng(seed), 120
    A = a_band(kind, n, *reach, rng)
    assume(np.linalg.cond(A) < 1e8)
    of_rows = np.ldexp(1.0, rng.integers(-abs(units), abs(units) + 1, n)) if kind == "definite" else np.ones(n)
    M, f = sp.csr_array(of_rows[:, None] * A * of_rows), rng.normal(size=(n, 2))
    assert SymbolicAnalysis(M).is_band
    for definite in {False, kind == "definite"}:
        factors = factorise(M, definite=definite)
        for trans, B in (("N", A), ("T", A.T)):
            x = factors.solve(of_rows[:, None] * f, trans)
            assert B @ (of_rows[:, None] * x) == pytest.approx(f, abs=1e-6)
            assert factors.solve(of_rows * f[:, 0], trans) == pytest.approx(x[:, 0], rel=1e-9, abs=0)
    if kind == "indefinite" and np.linalg.eigvalsh(A).min() < -1e-8:
        assert factorise(M, definite=True) is None
