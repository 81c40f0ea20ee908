"""SOLVED is said of the exact residual: judged here in fractions, outside the package's judge."""

import math
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp
from icpmodel.problem.verdict import at_least, certain

LUCKY = (
    [[-3.000000000021828, 2.000000000014552, -4.000000000029104, -1.000000000007276]],
    [[-3, 2, -4, -1], [4, 0, 2, 0], [-4, -3, -3, -4]],
)
NEARLY_SINGULAR = {
    "two rows": ([[0.1, -0.3], [-0.3, 0.9]], [0, -1], 0.0),
    "four rows": (LUCKY[0] + LUCKY[1], [0, -1, -1, 0], [-np.inf, -np.inf, -1.1757, -np.inf]),
}


def squares(A, q, psi, z):
    """Res(z)² as a fraction; psi as z ↦ ψ(z), fractions or −inf."""
    z = [Fraction(float(x)) for x in z]
    p = [
        sum((Fraction(float(a)) * x for a, x in zip(row, z, strict=True) if a), Fraction(float(b)))
        for row, b in zip(A, q, strict=True)
    ]
    return sum((min(b, x - c) if c != -math.inf else b) ** 2 for b, x, c in zip(p, z, psi(z), strict=True))


def affine(G, c):
    def psi(z):
        moved = [sum(Fraction(float(g)) * x for g, x in zip(row, z, strict=True)) for row in G]
        return [m + Fraction(float(b)) if b > -np.inf else -math.inf for m, b in zip(moved, c, strict=True)]

    return psi


def truly_solved(A, q, psi, z, tolerance):
    return squares(A, q, psi, z) <= Fraction(float(tolerance)) ** 2


@pytest.mark.parametrize("name", NEARLY_SINGULAR)
@pytest.mark.parametrize(("exponent", "kind"), [(-498, np.array), (0, sp.csr_array), (498, sp.csr_array)])
def test_a_residual_that_rounding_made_small_is_no_solution(name, exponent, kind):
    """Law 4: SOLVED is said of the exact residual of the returned z."""
    A, q, c = NEARLY_SINGULAR[name]
    n, unit = len(q), 2.0**exponent
    A, c = np.array(A), np.broadcast_to(np.asarray(c, dtype=float), n)
    for of_A, of_z in ((1.0, unit), (unit, 1.0 / unit)):
        q_, c_ = np.array(q) * of_A * of_z, c * of_z
        psi = affine(np.zeros((n, n)), c_)
        solution = icp.ICP(kind(A * of_A), q_, c_).solve(raise_on_failure=False, max_iter=100)
        assert not solution.solved or truly_solved(A * of_A, q_, psi, solution.z, solution.tolerance)
        many = icp.solve_many(kind(A * of_A), [q_], c_, raise_on_failure=False, time_limit=0.1)
        for row, status in enumerate(many.statuses):
            assert status is not icp.Status.SOLVED or truly_solved(A * of_A, q_, psi, many.Z[row], many.tolerances[row])


def test_a_scale_that_is_all_rounding_is_none():
    """Where 0 solves the problem, what is small is told by Res(z0): here 1e10, of which float64 makes 4e113."""
    A, jump = np.array([[1.0, 0.0], [-1e120, 1e120]]), lambda z: np.where(z > 0, 1.0, 0.0)
    for kind in (np.array, sp.csr_array):
        for upper in (None, np.inf):
            solution = icp.ICP(kind(A), np.zeros(2), jump, upper).solve(z0=np.full(2, 1e10), raise_on_failure=False)
            assert solution.tolerance == pytest.approx(100.0)


@pytest.mark.parametrize(("kind", "upper"), [(np.array, None), (sp.csr_array, None), (sp.csr_array, 1e300)])
def test_a_row_that_overflows_is_not_certain(kind, upper):
    """Az + q is infinite in float64, z less its obstacle 0 and exactly 6e279: nothing is known of the minimum."""
    A, z = kind([[0.0, 1e132], [0.0, 1e-297]]), np.array([0.1 * 1e297, 1e297])
    problem = icp.ICP(A, [0.0, -1.0], icp.Affine([[0.0, 0.1], [0.0, 0.0]]), upper)
    with np.errstate(over="ignore"):
        assert problem.residual(z) == 0.0
    assert certain(problem, z, 0.0, 1e-8) == np.inf
    assert at_least(problem, z) < 1e-15  # the other row
    assert not problem.solve(raise_on_failure=False, max_iter=100).solved
    if upper is None:
        many = icp.solve_many(A, [[0.0, -1.0]], problem.psi, raise_on_failure=False)
        assert many.statuses[0] is not icp.Status.SOLVED


@settings(max_examples=15, deadline=None)
@given(st.integers(0, 2**32 - 1))
def test_nothing_is_solved_whose_exact_residual_is_above_the_tolerance(seed):
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, 5))
    A = rng.integers(-4, 5, (n, n)) * rng.choice([0.1, 1.0, 0.3], (n, n))
    if rng.random() < 0.7:  # nearly singular
        A[0] = A[-1] * rng.choice([1.0, -3.0]) + rng.choice([0.0, 1e-11, 1e-14])
    q, c = rng.integers(-3, 4, n) * rng.choice([1.0, 1e-8, 0.7]), rng.choice([-np.inf, 0.0, -1.1757], n)
    G = rng.choice([0.0, 0.0, 0.3, -0.7], (n, n)) * (rng.random() < 0.5)
    of_A, of_z = 10.0 ** rng.choice([0, 0, 8, -8, 150, -150], 2)
    A, q, c = A * of_A, q * of_A * of_z, c * of_z
    psi, map_ = affine(G, c), icp.Affine(G, c) if G.any() else c
    for method in (None, "newton", "lemke", "mnmgs"):
        try:
            solution = icp.ICP(A, q, map_).solve(method, raise_on_failure=False, max_iter=60)
        except icp.IcpError:
            continue
        assert not solution.solved or truly_solved(A, q, psi, solution.z, solution.tolerance)
    many = icp.solve_many(A, [q, -q], map_, raise_on_failure=False, time_limit=0.1)
    for z, b, status, tolerance in zip(many.Z, (q, -q), many.statuses, many.tolerances, strict=True):
        assert status is not icp.Status.SOLVED or truly_solved(A, b, psi, z, tolerance)
