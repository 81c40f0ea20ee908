"""Scenes whose rows can be assembled alone: they are those of the whole, bit by bit, and nothing else is formed."""

import tracemalloc
from itertools import pairwise

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel import scenes
from icpmodel.scenes.registry import ASSEMBLIES

NAMES = sorted(ASSEMBLIES)


def stacked(made, cuts):
    ends = [0, *sorted(cuts), made.n]
    parts = [made.local_rows(lo, hi) for lo, hi in pairwise(ends)]
    A = sp.vstack([part.A for part in parts], format="csr")
    sides = zip(*(part[1:] for part in parts), strict=True)
    return A, *(None if side[0] is None else np.concatenate(side) for side in sides)


@pytest.mark.parametrize("name", NAMES)
@settings(max_examples=25)
@given(data=st.data(), n=st.integers(30, 400), of_all=st.lists(st.floats(0, 1), max_size=4))
def test_the_rows_of_any_cut_are_those_of_the_whole_bit_by_bit(name, data, n, of_all):
    asked = {"skew": data.draw(st.sampled_from([0.0, 0.3, 1.0, -1.0]))} if "skew" in scenes.parameters(name) else {}
    made, problem = scenes.by_rows(name, n, **asked), scenes.scene(name, n, **asked).problem
    assert made.n == problem.n
    A, q, psi, upper = stacked(made, [round(share * made.n) for share in of_all])
    assert np.array_equal(A.indptr, problem.A.indptr)
    assert np.array_equal(A.indices, problem.A.indices)
    assert np.array_equal(A.data, problem.A.data)
    assert np.array_equal(q, problem.q)
    sides = problem.psi
    assert np.array_equal(psi, sides.value(q))
    assert upper is problem.upper if upper is None else np.array_equal(upper, sides.upper.value(q))


@pytest.mark.parametrize("name", NAMES)
def test_a_range_of_a_problem_that_no_machine_holds_takes_the_memory_of_that_range(name):
    made = scenes.by_rows(name, n=10**11)
    assert abs(made.n - 10**11) < 1e-3 * 10**11
    peaks = []
    for lo, size in ((0, 1000), (made.n // 2, 1000), (made.n - 1000, 1000), (made.n // 2, 4000)):
        tracemalloc.start()
        found = made.local_rows(lo, lo + size)
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert found.A.shape == (size, made.n)
        assert np.isin(lo + np.arange(size), found.A.indices).all()
        assert found.A.sum(axis=1).min() > -1e-14
    assert peaks[3] < 5 * min(peaks[:3])
    assert max(peaks[:3]) < 1000 * 1000


def test_a_scene_by_rows_takes_the_parameters_of_the_scene_and_refuses_as_it_does():
    whole = scenes.scene("membrane,mu=2", 100, skew=0.5).problem
    made = scenes.by_rows("membrane,mu=2", 100, skew=0.5).local_rows(0, 100)
    assert (made.A != whole.A).nnz == 0
    for name, n, asked, message in (
        ("membrane", None, {"nu": 1}, "membrane has no parameter 'nu'"),
        ("membrane", None, {"mu": -1}, "mu is -1"),
        ("membran", None, {}, "no scene 'membran'; did you mean membrane"),
        ("ball", 3, {}, "number of unknowns n is 3; a whole number >= 16"),
        ("ball", 2.5, {}, "n is 2.5"),
        ("dividend", None, {}, r"dividend is not assembled by rows; the scenes that are: ball, bearing, membrane"),
    ):
        with pytest.raises(icp.InputError, match=message):
            scenes.by_rows(name, n, **asked)
