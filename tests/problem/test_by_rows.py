"""Any range of rows can be asked for alone, and what a function of the user returns is checked before it is used."""

from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp

N = 40
WHOLE = sp.random_array((N, N), density=0.2, random_state=np.random.default_rng(0), format="csr")
Q, LOW, HIGH = np.random.default_rng(1).normal(size=(3, N))


def rows(lo, hi):
    return WHOLE[lo:hi], Q[lo:hi], LOW[lo:hi], LOW[lo:hi] + abs(HIGH[lo:hi])


@pytest.mark.parametrize("kind", [sp.csr_array, sp.coo_array, sp.csc_matrix, lambda A: A.toarray()])
@settings(max_examples=20)
@given(cuts=st.lists(st.integers(0, N), max_size=4))
def test_what_a_function_of_the_user_gives_is_stacked_to_the_whole_whatever_the_kind_of_its_matrix(kind, cuts):
    made = icp.ByRows((5, 8), lambda lo, hi: (kind(rows(lo, hi)[0]), *rows(lo, hi)[1:]))
    ends = [0, *sorted(cuts), made.n]
    parts = [made.local_rows(lo, hi) for lo, hi in pairwise(ends)]
    assert all(part.A.has_canonical_format and part.A.shape[1] == N for part in parts)
    assert (sp.vstack([part.A for part in parts]) != WHOLE).nnz == 0
    for k, expected in enumerate(rows(0, N)[1:], 1):
        assert np.array_equal(np.concatenate([part[k] for part in parts]), expected)


def with_entry(value, column=0):
    return sp.csr_array((np.array([value]), np.array([column]), np.array([0, 1, 1])), shape=(2, 3))


@pytest.mark.parametrize(
    ("found", "message"),
    [
        (None, r"rows\(1, 3\) is None; LocalRows, or"),
        ((np.eye(2, 3), 1.0), r"rows\(1, 3\) is a tuple of 2;"),
        ((np.eye(2), 1.0, 0.0), r"A of rows\(1, 3\) has shape \(2, 2\); \(2, 3\) was"),
        ((with_entry(np.nan), 1.0, 0.0), r"A of rows\(1, 3\)\[0, 0\] is nan; a finite"),
        ((np.eye(2, 3), [1.0, np.inf], 0.0), r"q of rows\(1, 3\)\[1\] is inf; a finite number"),
        ((np.eye(2, 3), 1.0, 0.0, -np.inf), r"-upper of rows\(1, 3\)\[0\] is inf; a finite number or -inf"),
    ],
)
def test_what_does_not_fit_is_named_with_the_range_in_which_it_was_asked_for(found, message):
    with pytest.raises(icp.InputError, match=message):
        icp.ByRows((3,), lambda lo, hi: found).local_rows(1, 3)


@pytest.mark.parametrize(("lo", "hi"), [(-1, 2), (2, 1), (0, 4), (0.0, 1)])
def test_a_range_lies_within_the_rows(lo, hi):
    with pytest.raises(icp.InputError, match=r"^(lo|hi) is "):
        icp.ByRows((3,), lambda lo, hi: (np.eye(3)[lo:hi], 0.0, 0.0)).local_rows(lo, hi)
