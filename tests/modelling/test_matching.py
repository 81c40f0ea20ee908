"""The own entry of every row against all permutations."""

from itertools import permutations

import numpy as np
import pytest
import scipy.sparse as sp

from icpmodel.modelling.matching import looks_like_r, own_entries, unowned


def cost(R, columns):
    """1 for a 1, else 2 + log(largest of the row / entry); None where an entry is not positive."""
    entries = R[np.arange(len(R)), columns]
    if (entries <= 0).any():
        return None
    return float(np.where(entries == 1, 1.0, 2 + np.log(np.maximum(R.max(axis=1), 0) / entries)).sum())


@pytest.mark.parametrize("seed", range(60))
def test_the_choice_is_the_best_of_all_permutations_and_misses_none(seed):
    random = np.random.default_rng(seed)
    n = random.integers(1, 6)
    R = random.choice([-2.0, 0, 0, 0.5, 1, 1, 3], (n, n))
    possible = [c for c in (cost(R, list(order)) for order in permutations(range(n))) if c is not None]
    sparse = sp.csr_array(R)
    own = own_entries(sparse)
    if not possible:
        assert own is None
        row, column = unowned(sparse)
        assert row in range(n)
        assert column in range(n)
    else:
        assert sorted(own) == list(range(n))
        # rows that do not compete take their best entry
        assert cost(R, own) == pytest.approx(min(possible))


def test_what_is_left_over_is_no_more_than_must_be():
    """Rows 0 and 1 both want column 0 only; row 2 and column 2 are content."""
    row, column = unowned(sp.csr_array([[1.0, 0, 0], [2.0, -1, 0], [0, 0, 1.0]]))
    assert row in (0, 1)
    assert column == 1


def test_a_side_looks_like_r_by_its_ones_and_its_lonely_entries():
    for R, expected in (
        ([[2.0, 0], [0, 0.5]], 2),
        ([[2.0, 0], [2.0, 0]], 0),
        ([[-1.0, 0], [0, 1]], 0),
        ([[1.0, 5], [5, 1]], 1),
        ([[0.0, 0], [0, 1]], 0),
    ):
        assert looks_like_r(sp.csr_array(R)) == expected
