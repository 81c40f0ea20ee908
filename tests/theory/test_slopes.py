"""Nonlinear p: the error bounds hold for problems with a known answer, and say what they rest on."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from known_answers import PAIR

import icpmodel as icp
from icpmodel import ICP
from icpmodel.theory.certificates.bounds import error_bound
from icpmodel.theory.certificates.certificate import active_set


def dominant(rng: np.random.Generator, n: int) -> np.ndarray:
    """An H+-matrix."""
    A = rng.normal(size=(n, n))
    return A + np.diag(1.1 * np.abs(A).sum(1))


def definite(rng: np.random.Generator, n: int) -> np.ndarray:
    """A positive definite matrix, not symmetric, that is no H-matrix."""
    A = rng.normal(size=(n, n))
    return A @ A.T / n + 0.1 * np.eye(n) + np.triu(A, 1) - np.triu(A, 1).T


KINDS: dict[str, tuple[Any, float]] = {
    "grows": (icp.Elementwise(lambda z: np.exp(z) + z**3, slope_range=(0, np.inf)), 0.0),
    "falls": (icp.Elementwise(lambda z: -np.arctan(z), slope_range=(-1, 0)), 1.0),
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("matrix", [dominant, definite])
def test_the_bound_and_the_active_set_hold(matrix, kind):
    """A problem around a known z*: p* and r* complementary, then points at any distance from it."""
    f, shift = KINDS[kind]
    rng = np.random.default_rng(3)
    proved = 0
    for _ in range(20):
        n = int(rng.integers(1, 7))
        A = matrix(rng, n) + shift * np.eye(n)
        exact = rng.normal(size=n)
        touches = rng.random(n) < 0.5
        p = np.where(touches, rng.exponential(size=n), 0.0)
        psi = exact - np.where(touches, 0.0, rng.exponential(size=n))
        problem = ICP(A, p - A @ exact - f.bind(n).value(exact), psi, f=f)
        for distance in (0.0, 1e-9, 1e-2, 1.0):
            z = exact + distance * rng.normal(size=n)
            bound = error_bound(problem, z)
            if bound.value is None:
                continue
            proved += 1
            assert (np.abs(z - exact) <= bound.componentwise + 1e-14).all()
            found = active_set(problem, z, bound)
            assert not (found.active & ~touches).any()
            assert not (found.inactive & touches).any()
    assert proved > 20
    assert "given that f is continuous and has the slopes" in bound.in_words()


def test_the_bound_is_attained_by_a_row_alone():
    """p = z³ + z − 2, z* = 1: at z = 1 + e the bound is |p(z)|/1, as the slope is at least 1; a sharp one is e."""
    problem = ICP([[1.0]], [-2.0], -9.0, f=icp.Elementwise(lambda z: z**3, slope_range=(0, np.inf)))
    assert error_bound(problem, [1.1], sharp=False).value == pytest.approx(1.1**3 + 1.1 - 2.0)
    assert error_bound(problem, [1.1]).value == pytest.approx(0.1, rel=0.05)


def test_without_known_slopes_nothing_is_proved_and_a_broken_word_is_seen():
    unknown = ICP([[1.0]], [-2.0], f=lambda z: z**3)
    assert error_bound(unknown, [1.0]).reason.endswith("the slopes of f are not known")
    elementwise = ICP([[1.0]], [-2.0], f=icp.Elementwise(np.exp))
    assert "give `slope_range`" in error_bound(elementwise, [1.0]).reason
    broken = ICP([[1.0]], [-2.0], f=icp.Elementwise(lambda z: z**3, slope_range=(0, 0.5)))
    assert "slope_range is wrong" in error_bound(broken, [1.0]).reason
    assert error_bound(unknown.with_q([1.0]), [0.0], rigorous=True).value is None


def test_a_proof_says_that_it_assumes_a_continuous_f():
    """z − ½ + sign(z) has no zero, though it is strongly monotone."""
    step = icp.Elementwise(lambda z: np.where(z >= 0, 1.0, -1.0), slope_range=(0, np.inf))
    problem = ICP([[1.0]], [-0.5], -10.0, f=step)
    bound = icp.certify(problem, [0.0]).bound
    assert "given that f is continuous" in bound.proof
    assert "given that f is continuous" in bound.in_words()
    assert "given that f is continuous" in problem.explain().sections()["solution"]


def test_an_accuracy_can_be_asked_for_and_the_derivative_is_certain():
    f = icp.Elementwise(np.exp, np.exp, slope_range=(0, np.inf))
    solution = ICP(PAIR, [-3.0, 5.0], f=f).solve(accuracy=1e-9)
    assert solution.error_bound <= 1e-9
    assert solution.derivative().certain
    assert "given that f is continuous and has the slopes" in solution.derivative().reason
    assert solution.active_set.active.tolist() == [False, True]


def test_a_fixed_unknown_does_not_hide_f():
    """z + z² = 0 has two solutions, whatever stands in the row of an unknown between 0 and 0."""
    f = icp.Function(lambda z: np.array([z[0] ** 2, 0.0]), lambda z: np.diag([2.0 * z[0], 0.0]))
    problem = ICP([[1.0, 0.0], [0.0, 0.0]], [0.0, 0.0], [-np.inf, 0.0], upper=0.0, f=f)
    assert not error_bound(problem, [0.0, 0.0]).unique


@pytest.mark.parametrize("matrix", ["H+", "definite"])
def test_a_better_point_makes_the_bound_sharp_where_p_is_nonlinear(matrix):
    """z* is planted with integers, so that A z* + q + f(z*) is exact; the bound stays above the error."""
    n = 100
    A = n**2 * (2 * np.eye(n) - np.eye(n, k=1) - np.eye(n, k=-1))
    if matrix == "definite":
        A = A @ A / n**2
    rng = np.random.default_rng(0)
    exact = rng.integers(-3, 4, size=n).astype(float)
    touches = rng.random(n) < 0.5
    psi = exact - np.where(touches, 0.0, 1.0)
    f = icp.Elementwise(lambda z: z**3, slope_range=(0, np.inf))
    problem = ICP(A, np.where(touches, 1.0, 0.0) - A @ exact - exact**3, psi, f=f)
    z = exact + 1e-3 * rng.normal(size=n)
    error = np.abs(z - exact)
    bound = error_bound(problem, z, sharp=True)
    assert (error <= bound.componentwise).all()
    assert bound.value <= 1.01 * error.max()
    assert error_bound(problem, z, sharp=False).value > 100 * error.max()


def test_why_there_is_no_bound_names_the_matrix_with_the_slopes():
    falls = icp.Elementwise(lambda z: -np.tanh(z), slope_range=(-1, 0))
    reasons = str(icp.error_bound(ICP([[2.0, 0.0], [0.0, 0.5]], [-1.0, -1.0], f=falls), np.zeros(2)))
    assert "with the least slopes of f added to its diagonal, A is not an H+-matrix: A[1, 1] = -0.5" in reasons
