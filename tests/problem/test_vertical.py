"""Vertical LCPs, min(Az + q, Bz + d) = 0: what they are as an ICP, and their solutions against all choices of rows."""

from itertools import product

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import SEEDS

import icpmodel as icp
from icpmodel import ICP


def drawn(seed, n):
    """A and B strictly dominant with positive diagonals, so that every choice of rows has a positive determinant, the
    rows of B and d in units of their own."""
    random = np.random.default_rng(seed)
    A, B = random.uniform(-1.0, 1.0, (2, n, n))
    for M in (A, B):
        np.fill_diagonal(M, np.abs(M).sum(axis=1) * random.uniform(1.1, 3.0, n))
    q, d = random.uniform(-1.0, 1.0, (2, n))
    unit = 10.0 ** random.uniform(-4.0, 4.0, n)
    return A, q, unit[:, None] * B, unit * d


def by_all_choices(A, q, B, d):
    """The z of the choice of rows that is best: the brute force of 2^n linear solves."""
    found = []
    for choice in product((False, True), repeat=q.size):
        z = np.linalg.solve(np.where(np.array(choice)[:, None], A, B), -np.where(choice, q, d))
        found.append((np.abs(np.minimum(A @ z + q, (B @ z + d) / B.diagonal())).max(), z))
    return min(found, key=lambda one: one[0])[1]


@given(seed=SEEDS, n=st.integers(1, 4))
@settings(max_examples=25)
def test_the_solution_is_that_of_the_right_choice_of_rows(seed, n):
    A, q, B, d = drawn(seed, n)
    solution = ICP.vertical(A, q, B, d).solve(rtol=1e-12)
    np.testing.assert_allclose(solution.z, by_all_choices(A, q, B, d), atol=1e-10)
    assert solution.certificate.unique


@given(seed=SEEDS, n=st.integers(2, 6), method=st.sampled_from(["mnmj", "psor", "projection-fixed-point"]))
@settings(max_examples=25)
def test_what_takes_the_larger_of_two_couplings_solves_it_in_whatever_units_the_rows_of_b_are(seed, n, method):
    """They contract with factor max(|D^-1 offdiag(A)|, |G|) in the maximum norm, here at most 1/1.1."""
    A, q, B, d = drawn(seed, n)
    problem = ICP.vertical(A, q, B, d)
    assert problem.solve(method, max_iter=5000).solved
    unit = 2.0 ** np.arange(-3 * n, 3 * n, 6)
    again = ICP.vertical(A, q, sp.csr_array(unit[:, None] * B), unit * d)
    assert (problem.psi.G != again.psi.G).nnz == 0
    assert (problem.psi.c == again.psi.c).all()


def test_rows_whose_diagonal_divides_nothing_are_divided_by_their_largest_entry():
    """One is negative, one is zero, one is too small; and the row without a second side is an equation."""
    B = [[-2.0, 4.0, 0, 0], [1, 0, 0, 0.5], [0, 1, 1e-310, 0], [0, 0, 0, 1]]
    problem = ICP.vertical(np.eye(4), np.ones(4), B, [8.0, 0, 1, np.inf])
    z = np.array([1.0, 2, 3, 4])
    assert problem.r(z).tolist() == [(8.0 - 2 + 8) / 8, 3.0, 3.0, np.inf]


@pytest.mark.parametrize(
    ("B", "d", "words"),
    [
        ([[1.0]], [0, 0], r"^B has shape \(1, 1\); shape \(2, 2\) was expected"),
        (np.eye(2), [0, 0, 0], r"^d has shape \(3,\); shape \(2,\) was expected"),
        (np.eye(2), [0, -np.inf], r"^d\[1\] is -inf; a finite number"),
    ],
)
def test_what_is_wrong_is_named(B, d, words):
    with pytest.raises(icp.InputError, match=words):
        ICP.vertical(np.eye(2), [1.0, 1.0], B, d)
