"""SOLVED is said of the exact residual: judged here in fractions, outside the package's judge."""

from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from exact import ExactProblem
from hypothesis import given, settings
from known_answers import GENERATORS

import icpmodel as icp
from icpmodel.problem.verdict import certified_residual


@pytest.mark.parametrize(("kind", "upper"), [(np.array, None), (sp.csr_array, None), (sp.csr_array, 1e300)])
def test_a_row_that_overflows_is_not_certain(kind, upper):
    """Az + q is infinite in float64, z less its obstacle 0 and exactly 6e279: nothing is known of the minimum."""
    A, z = kind([[0.0, 1e132], [0.0, 1e-297]]), np.array([0.1 * 1e297, 1e297])
    problem = icp.ICP(A, [0.0, -1.0], icp.Affine([[0.0, 0.1], [0.0, 0.0]]), upper)
    with np.errstate(over="ignore"):
        assert problem.residual(z) == 0.0
    assert certified_residual(problem, z, 0.0, 1e-8) == np.inf
    assert not problem.solve(raise_on_failure=False, max_iter=100).solved
    if upper is None:
        many = icp.solve_many(A, [[0.0, -1.0]], problem.psi, raise_on_failure=False)
        assert many.statuses[0] is not icp.Status.SOLVED


@settings(max_examples=8)
@given(GENERATORS)
def test_nothing_is_solved_whose_exact_residual_is_above_the_tolerance(rng):
    n = int(rng.integers(1, 5))
    A = rng.integers(-4, 5, (n, n)) * rng.choice([0.1, 1.0, 0.3], (n, n))
    if rng.random() < 0.7:  # nearly singular
        A[0] = A[-1] * rng.choice([1.0, -3.0]) + rng.choice([0.0, 1e-11, 1e-14])
    q, c = rng.integers(-3, 4, n) * rng.choice([1.0, 1e-8, 0.7]), rng.choice([-np.inf, 0.0, -1.1757], n)
    G = rng.choice([0.0, 0.0, 0.3, -0.7], (n, n)) * (rng.random() < 0.5)
    of_A, of_z = 10.0 ** rng.choice([0, 0, 8, -8, 150, -150], 2)
    A, q, c = A * of_A, q * of_A * of_z, c * of_z
    psi = icp.Affine(G, c) if G.any() else c
    problem = icp.ICP(A, q, psi)
    for method in (None, "newton", "lemke", "mnmgs"):
        try:
            solution = problem.solve(method, raise_on_failure=False, max_iter=60)
        except icp.IcpError:
            continue
        assert (
            not solution.solved
            or ExactProblem(problem).residual(solution.z) <= Fraction(float(solution.tolerance)) ** 2
        )
    many = icp.solve_many(A, [q, -q], psi, raise_on_failure=False, time_limit=0.1)
    for z, b, status, tolerance in zip(many.Z, (q, -q), many.statuses, many.tolerances, strict=True):
        solved = status is icp.Status.SOLVED
        assert not solved or ExactProblem(problem.with_q(b)).residual(z) <= Fraction(float(tolerance)) ** 2


def test_what_rounds_where_f_cancels_q_counts():
    """p = (z - 1)³ exactly, of which q + f(z) leaves nothing; the slope of p is as small."""
    f = icp.Function(lambda z: (z - 1) ** 3 - (z - 1), lambda z: np.diag(3 * (z - 1) ** 2 - 1 + 1e-12))
    problem = icp.ICP([[1.0]], [-1.0], -np.inf, f=f)
    z = np.array([1.0 + 2.0**-21])
    assert problem.residual(z) == 0.0
    assert certified_residual(problem, z, 0.0, 1e-8) > 1e-8
