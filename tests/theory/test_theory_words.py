"""What theory says in words: numbers rounded to the side that the sentence claims, and short names for large things."""

import re
from decimal import Decimal

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st
from known_answers import PAIR

import icpmodel as icp
from icpmodel.numerics.rounding import rounded_down, rounded_up
from icpmodel.theory import check, error_bound

P = icp.ICP(PAIR, [1, -2])
FLOATS = st.floats(allow_nan=False, allow_infinity=False)


@given(FLOATS, st.integers(1, 17))
@example(5e-324, 3)
@example(1.7976931348623157e308, 3)
@example(0.0, 3)
@example(1e140, 12)
@example(-0.0, 3)
@example(1.1919817078931344e207, 17)  # 17 digits say more than the float that they are read as
def test_at_most_is_never_below_and_at_least_never_above(x, digits):
    assert Decimal(rounded_down(x, digits)) <= Decimal(x) <= Decimal(rounded_up(x, digits))
    for text in (rounded_down(x, digits), rounded_up(x, digits)):
        if digits > 2 and 1e-300 < abs(x) < 1e300:
            assert abs(Decimal(text) - Decimal(x)) <= abs(Decimal(x)) * Decimal(10) ** (1 - digits)
            assert len(re.sub("e.*|[-.]", "", text).strip("0")) <= digits


@given(st.floats(0.9, 1, exclude_max=True))
@example(float(np.nextafter(1.0, 0.0)))
def test_what_is_below_one_is_shown_below_one(x):
    assert x <= float(rounded_up(x, 3, below=1.0)) < 1
    assert Decimal(x) <= Decimal(rounded_up(x, 3, below=1.0))


def test_a_number_that_is_not_finite_has_its_name():
    assert (rounded_up(np.inf), rounded_down(-np.inf), rounded_up(np.nan)) == ("inf", "-inf", "nan")


@pytest.mark.parametrize("seed", range(20))
def test_the_printed_error_bound_is_a_bound(seed):
    z = np.random.default_rng(seed).normal(size=2)
    bound = error_bound(P, z)
    for text in (str(bound), str(icp.certify(P, z)), bound.in_words(2 * bound.value)):
        assert float(re.search(r"<= (\S+) in every entry", text).group(1)) >= bound.value


def test_a_bound_below_what_was_asked_for_is_shown_below_it():
    bound = error_bound(P, [0.1, 0.2])
    accuracy = bound.value * (1 + 1e-9)
    assert float(re.search("<= (\\S+) in", bound.in_words(accuracy)).group(1)) <= accuracy


@pytest.mark.parametrize("name", ["4.1", "4.2", "4.3", "4.4", "sharper", "rowwise"])
def test_the_number_in_a_reason_is_rounded_upwards(name):
    found = check(name, P, icp.PSOR() if name == "rowwise" else icp.MNMGS())
    assert float(re.search("is at most (.*), below 1", found.reason).group(1)) >= found.number
