"""Elimination in rational arithmetic."""

from fractions import Fraction
from math import gcd

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.optimize import linprog

from icpmodel.errors import OutOfTime
from icpmodel.numerics import work
from icpmodel.numerics.rational import dot, echelon_of, in_integers, reduced, relative_interior, substitute, unit_vector

ENTRIES = st.one_of(st.integers(-3, 3), st.fractions(max_denominator=7), st.floats(-1e9, 1e9)).map(Fraction)
MATRICES = st.integers(1, 5).flatmap(lambda n: st.lists(st.lists(ENTRIES, min_size=n, max_size=n), max_size=6))


@given(rows=MATRICES)
def test_an_echelon_has_the_span_of_its_rows(rows):
    n = len(rows[0]) if rows else 0
    echelon = echelon_of(rows)
    for k, (column, row) in enumerate(echelon):
        assert row[column] != 0
        assert not any(row[other] for other, _ in echelon[:k])
    free = set(range(n)) - {column for column, _ in echelon}
    assert len(free) == n - len(echelon)
    for column in free:
        x = substitute(echelon, unit_vector(column, n))
        assert x[column] == 1
        assert not any(dot(row, x) for row in rows)


@given(rows=MATRICES, unit=st.sampled_from([Fraction(6, 7), Fraction(2) ** 1000, Fraction(2) ** -1000]))
def test_whole_numbers_are_the_least_in_any_units(rows, unit):
    for row in rows:
        whole = in_integers(row)
        assert whole == in_integers([unit * x for x in row])
        assert gcd(*whole) == any(row)
        assert all(x * whole[j] == row[j] * y for j in range(len(row)) for x, y in zip(row, whole, strict=True))


@given(rows=st.lists(st.lists(st.integers(-3, 3), min_size=4, max_size=4), max_size=8))
def test_in_the_relative_interior_only_those_rows_are_0_that_are_0_everywhere(rows):
    """As linear programs say it of each row."""
    t = relative_interior(rows, 3)
    C = np.array(rows, dtype=float).reshape(-1, 4)
    for objective in C[:, :3] if rows else []:
        found = linprog(-objective, -C[:, :3], C[:, 3], bounds=(-1e3, 1e3))
        assert (found.status == 2) == (t is None)
    for row, objective in zip(rows, C, strict=True) if t is not None else []:
        value = dot(row, [*t, 1])
        assert value >= 0
        most = linprog(-objective[:3], -C[:, :3], C[:, 3], bounds=(-1e3, 1e3))
        assert (value > 0) == (objective[3] - most.fun > 1e-6)


def test_all_rows_are_positive_inside_a_body_with_many_facets():
    """Of all sums of these rows that leave out seven unknowns there are millions."""
    rng = np.random.default_rng(18)
    rows = np.hstack([rng.integers(-9, 10, (18, 7)), rng.integers(1, 9, (18, 1))]).tolist()
    t = relative_interior(rows, 7)
    assert t is not None
    assert all(dot(row, [*t, 1]) > 0 for row in rows)


def test_an_elimination_ends_with_the_time():
    with work.work_limit(0.0), pytest.raises(OutOfTime):
        reduced((), [2])
