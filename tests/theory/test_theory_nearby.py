"""The bound of a z for which better points are sought: proved like any other, near the error, and what it decides."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given
from hypothesis import strategies as st
from known_answers import GENERATORS, PAIR

import icpmodel as icp
from icpmodel.theory.certificates.bounds import h_plus_proof, sharpened
from icpmodel.theory.certificates.nearby import points_near

#: rows for which the sweeps are foreseen to cost more than a hierarchy, and others
FEW, MANY = (3, 12), (80, 120)


def drawn(rng, sizes, kind):
    """A problem of small whole numbers and eighths, so that no product is rounded, A an H₊-matrix; z*; and how ψ is."""
    n = int(rng.integers(*sizes))
    off = rng.integers(-3, 4, (n, n)) * (rng.random((n, n)) < min(4 / n, 0.5))
    if kind == "M":
        off = -np.abs(off)
    np.fill_diagonal(off, 0)
    A = off + np.diag(np.abs(off).sum(axis=1) + rng.integers(0, 2, n) + (np.arange(n) == 0)).astype(float)
    A[np.arange(1, n), np.arange(n - 1)] -= 1.0  # joined to row 0, which is strictly dominant
    A[np.arange(1, n), np.arange(1, n)] += 1.0
    z = rng.integers(-8, 9, n).astype(float)
    at = rng.random(n) < 0.5
    p, r = np.where(at, rng.integers(0, 5, n), 0.0), np.where(at, 0.0, rng.integers(0, 5, n))
    if kind == "affine":
        G = np.diag(rng.integers(-3, 4, n) / 8) + np.diag(rng.integers(-2, 3, n - 1) / 8, 1)
        psi = icp.Affine(sp.csr_array(G), z - r - G @ z)
    elif kind == "elementwise":
        c = z - r - 0.5 * np.abs(z)
        psi = icp.Elementwise(lambda x: 0.5 * np.abs(x) + c, lambda x: 0.5 * np.sign(x), lipschitz=0.5)
    else:
        psi = z - r
    return icp.ICP(sp.csr_array(A), p - A @ z, psi), z


def improved(problem, z):
    """(δ(z), the best of δ over the better points, the same in norm), or None without a proof."""
    proof = h_plus_proof(problem)
    if isinstance(proof, str):
        return None
    delta, euclidean = proof.bound(problem, z, *problem.rounding(z))
    points = points_near(problem, z, proof, float(delta.max()))
    return delta, *sharpened(problem, z, proof, points, delta, euclidean)


@given(
    rng=GENERATORS,
    kind=st.sampled_from(["M", "H", "affine", "elementwise"]),
    sizes=st.sampled_from([FEW, FEW, MANY]),
    distance=st.sampled_from([1e-12, 1e-6, 1e-2, 1.0, 1e6]),
    smooth=st.booleans(),
)
def test_no_error_is_above_the_bound_in_exact_arithmetic(rng, kind, sizes, distance, smooth):
    problem, exact = drawn(rng, sizes, kind)
    off = np.ones(problem.n) if smooth else rng.standard_normal(problem.n)
    z = exact + distance * off
    found = improved(problem, z)
    if found is None:
        return
    plain, delta, euclidean = found
    errors = [abs(Fraction(a) - Fraction(b)) for a, b in zip(z.tolist(), exact.tolist(), strict=True)]
    assert all(error <= Fraction(bound) for error, bound in zip(errors, delta.tolist(), strict=True))
    assert sum(error * error for error in errors) <= Fraction(euclidean) ** 2
    assert delta.max() <= plain.max()


class TestLargeA:
    @pytest.mark.parametrize("name", ["membrane", "ball"])
    def test_the_bound_of_an_answer_is_near_its_error_and_decides_its_rows(self, name):
        problem = icp.scenes.scene(name, 3000).problem
        solution, exact = problem.solve("multilevel"), problem.solve(rtol=1e-13, raise_on_failure=False).polish().z
        error, bound = np.abs(solution.z - exact).max(), solution.error_bound
        assert error <= bound <= 3 * error
        assert icp.error_bound(problem, solution.z, sharp=False).value > 30 * error
        known = solution.active_set
        assert known.active.any()
        assert known.undecided.sum() <= 3


def test_what_was_found_before_a_limit_is_kept():
    """A limit that comes between two better points costs the second one only."""
    problem = icp.ICP(PAIR, [-1.0, -1.0])
    z, proof = np.array([1.0, 1.5]), h_plus_proof(problem)

    def points():
        yield np.ones(2)
        raise icp.errors.OutOfTime("no more")

    delta, euclidean = proof.bound(problem, z, *problem.rounding(z))
    assert sharpened(problem, z, proof, points(), delta, euclidean)[0].max() < 0.51 < delta.max()
