"""A new kind of ψ with nothing but bind, value and jacobian: all other verbs have defaults that are right."""

import numpy as np
import pytest
import scipy.sparse as sp
from known_answers import chain

import icpmodel as icp
from icpmodel.algebra.subproblems import restricted
from icpmodel.problem.map import Map


class Wave(Map):
    """ψ_i(z) = 0.3 sin z_i + 0.2 z_{i+1} − h."""

    def __init__(self, h=1.0):
        self.h = h

    def bind(self, n):
        return self

    def value(self, z):
        return 0.3 * np.sin(z) + 0.2 * np.roll(z, -1) - self.h

    def jacobian(self, z):
        return sp.csr_array(sp.diags_array(0.3 * np.cos(z)) + 0.2 * next_one(z.size))


class BoundedWave(Wave):
    """The same, with what bounds its slope."""

    def bind(self, n):
        bound = BoundedWave(self.h)
        bound.lipschitz = sp.csr_array(0.3 * sp.eye_array(n) + 0.2 * next_one(n))
        return bound


def next_one(n):
    return sp.csr_array((np.ones(n), (np.arange(n), (np.arange(n) + 1) % n)), shape=(n, n))


def problem(n, psi, seed=0):
    rng = np.random.default_rng(seed)
    A = chain(n, 3.0)
    return icp.ICP(A, rng.normal(size=n), psi)


def assert_same_map(psi, expected, m, seed=1):
    """Values and derivatives agree, and the derivative is that of the value."""
    rng = np.random.default_rng(seed)
    y, d = rng.normal(size=(2, m))
    assert psi.value(y) == pytest.approx(expected(y), rel=1e-13, abs=1e-13)
    moved = (expected(y + 1e-6 * d) - expected(y - 1e-6 * d)) / 2e-6
    assert psi.jacobian(y) @ d == pytest.approx(moved, abs=1e-7)
    if psi.lipschitz is not None:
        assert (np.abs(psi.value(y) - psi.value(d)) <= psi.change(np.abs(y - d))).all()


@pytest.mark.parametrize("method", [None, "newton", "josephy", "psor", "multilevel", "mms"])
def test_it_is_solved_like_any_other(method):
    ours, other = problem(40, Wave()), problem(40, Wave().value)
    solution = ours.solve(method, rtol=1e-10)
    assert solution.z == pytest.approx(other.solve("mnmj", rtol=1e-11).z, abs=1e-7)
    assert solution.residual == other.residual(solution.z)


def test_what_is_known_of_it_is_what_it_says():
    silent, telling = problem(20, Wave()), problem(20, BoundedWave())
    assert not silent.is_lcp
    assert not silent.facts.has_fixed_obstacle
    assert icp.error_bound(silent, silent.solve().z).value is None
    solution = telling.solve()
    exact = telling.solve("newton", rtol=0.0, raise_on_failure=False).z
    assert np.abs(solution.z - exact).max() <= solution.error_bound <= 1e-6
    assert all("Wave" in str(one.explain()) for one in (silent, telling))


@pytest.mark.parametrize("kind", [Wave, BoundedWave])
class TestItsVerbs:
    def test_restricted(self, kind):
        rng, rows = np.random.default_rng(2), np.array([1, 4, 5, 8])
        whole, z = problem(9, kind()), rng.normal(size=9)
        part = restricted(whole, rows, z)
        assert part.p(z[rows]) == pytest.approx(whole.p(z)[rows])
        assert part.r(z[rows]) == pytest.approx(whole.r(z)[rows])

        def expected(y):
            full = z.copy()
            full[rows] = y
            return whole.psi.value(full)[rows]

        assert_same_map(part.psi, expected, 4)
        assert icp.solve(part, rtol=1e-10).solved

    def test_coarsened_level_upon_level(self, kind):
        rng, psi = np.random.default_rng(3), kind().bind(12)
        P, Q = sp.random_array((12, 6), density=0.4, rng=rng).tocsr(), sp.random_array((6, 3), rng=rng).tocsr()
        shift, further = rng.normal(size=12), rng.normal(size=6)
        kept, fewer = np.arange(0, 12, 2), np.array([0, 2, 5])
        once = psi.composed(P, shift, kept)
        assert_same_map(once, lambda y: psi.value(P @ y + shift)[kept], 6)
        twice = once.composed(Q, further, fewer)
        assert_same_map(twice, lambda y: psi.value(P @ (Q @ y + further) + shift)[kept][fewer], 3)
        # a part of a level
        rows, z = np.array([0, 2]), rng.normal(size=3)
        part = twice.restricted(rows, z)
        assert part.value(z[rows]) == pytest.approx(twice.value(z)[rows])


def test_a_map_without_a_derivative_says_so_and_is_solved_by_sweeps():
    class Flat(Wave):
        def jacobian(self, z):
            return None

        def no_derivative(self):
            return "Flat has no derivative"

    flat = problem(30, Flat())
    assert (
        flat.psi.composed(2.0 * sp.eye_array(30, format="csr"), factor=0.5).no_derivative() == "Flat has no derivative"
    )
    with pytest.raises(icp.NotApplicable, match="Flat has no derivative"):
        flat.solve("newton")
    assert flat.solve(rtol=1e-10).z == pytest.approx(problem(30, Wave()).solve(rtol=1e-10).z, abs=1e-8)
