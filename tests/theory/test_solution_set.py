"""All solutions of small problems: each is one, in fractions, and none is missing."""

import itertools
import math
import signal
from fractions import Fraction

import numpy as np
import pytest
from exact import dot, fractions, rational, solve_rational
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

import icpmodel as icp

#: of steps from a point of a face along it
LENGTHS = [Fraction(1, 4**k) for k in range(10)]


@st.composite
def problems(draw):
    """(A, q, G, c, H, d) of small integers: ψ(z) = Gz + c, ψ̄(z) = Hz + d; degenerate and singular ones are frequent."""
    n = draw(st.integers(1, 6))
    few, rows = st.integers(-2, 2), st.integers(-1, 2)
    A = draw(arrays(np.int64, (n, n), elements=few))
    G, H = np.zeros((2, n, n), dtype=int)
    if draw(st.booleans()):
        G = H = draw(arrays(np.int64, (n, n), elements=st.sampled_from([0, 0, 0, 1, -1])))
        H = draw(st.sampled_from([G, np.zeros((n, n), dtype=int)]))
    c = draw(arrays(np.float64, n, elements=st.sampled_from([0.0, 0.0, -1.0, 1.0, -np.inf])))
    d = np.full(n, np.inf)
    if n <= 4 and draw(st.booleans()):
        d = np.where(np.isfinite(c), c, 0.0) + draw(arrays(np.float64, n, elements=st.sampled_from([0, 1, 2, np.inf])))
    return A, draw(arrays(np.int64, n, elements=rows)), G, c, H, d


def is_solution(z, p, r, s):
    """Whether z solves the problem in every row. A row (a, b) of p, r or s has the value az + b; None: no obstacle."""
    for of_p, of_r, of_s in zip(p, r, s, strict=True):
        value, below, above = (None if row is None else dot(row[0], z) + row[1] for row in (of_p, of_r, of_s))
        if (below is not None and below < 0) or (above is not None and above < 0):
            return False
        if (value > 0 and below != 0) or (value < 0 and above != 0):
            return False
    return True


def corners(p, r, s):
    """The solutions in which n independent rows of p, r and s are 0: each set of solutions without a line has one."""
    rows = [row for row in (*p, *r, *s) if row is not None]
    found = set()
    for chosen in itertools.combinations(rows, len(p)):
        z = solve_rational([a for a, _ in chosen], [-b for _, b in chosen])
        if z is not None and is_solution(z, p, r, s):
            found.add(tuple(z))
    return found


def on_face(z, face):
    """Whether `z` lies on the affine hull of the face."""
    away = z - face.point
    coefficients = np.linalg.lstsq(face.directions.T, away, rcond=None)[0]
    return np.abs(face.directions.T @ coefficients - away).max() <= 1e-9


def against_brute_force(A, q, G, c, H, d):
    one, other = np.eye(len(q)) - G, np.eye(len(q)) - H
    found = icp.all_solutions(icp.ICP(A, q, icp.Affine(G, c), upper=icp.Affine(H, d)))
    assert found.complete
    p = list(zip(rational(A), fractions(q), strict=True))
    r = [(a, -b) if math.isfinite(b) else None for a, b in zip(rational(one), fractions(c), strict=True)]
    s = [(a, b) if math.isfinite(b) else None for a, b in zip(rational(-other), fractions(d), strict=True)]
    exactly = lambda z: [Fraction(x).limit_denominator(10**7) for x in z]  # noqa: E731
    points, known = {tuple(exactly(z)) for z in found.points}, corners(p, r, s)
    assert len(points) == len(found.points)
    assert points <= known
    for z in known - points:
        assert any(on_face(np.array(z, dtype=float), face) for face in found.faces)
    for face in found.faces:
        z = exactly(face.point)
        assert np.linalg.matrix_rank(face.directions) == len(face.directions)
        for step in [exactly(direction) for direction in face.directions]:
            moved = lambda t, z=z, step=step: [a + t * b for a, b in zip(z, step, strict=True)]  # noqa: E731
            assert any(is_solution(moved(t), p, r, s) and is_solution(moved(-t), p, r, s) for t in LENGTHS)
    for z, end in itertools.permutations(known, 2):  # what a segment of solutions joins is not isolated
        if z in points:
            assert not is_solution([a + (b - a) / 1024 for a, b in zip(z, end, strict=True)], p, r, s)


@settings(max_examples=40, derandomize=True)
@given(problems())
def test_all_solutions_are_those_of_brute_force(data):
    against_brute_force(*data)


@pytest.mark.slow
@settings(max_examples=1000, suppress_health_check=list(HealthCheck))
@given(problems())
def test_all_solutions_are_those_of_brute_force_on_many(data):
    against_brute_force(*data)


def test_between_two_equal_obstacles_p_has_either_sign():
    """z_0 = 0 and z_1 is free: p_0 = z_1, so that the pieces at the lower and at the upper obstacle are half-lines."""
    found = icp.all_solutions(icp.ICP([[0, 1], [0, 0]], [0, 0], [0, -np.inf], upper=[0, np.inf]))
    assert {tuple(np.sign(face.point)) for face in found.faces} == {(0, 1), (0, -1)}


@pytest.mark.parametrize(
    ("A", "q", "c", "points"),
    [
        (
            [[-7.071956807429365e301, 8.2506162753342595e301], [9.429275743239153e301, -1.1786594678048941e301]],
            [-2.6469779601696886e-22, 3.1763735522036263e-22],
            [0.0, 0.0],
            1,
        ),
        (
            np.ldexp([[6.6, 9.899999999999999], [-3.3, -3.3]], 900),
            np.ldexp([8 * 5e-324, 2 * 5e-324], 900),
            [2 * 5e-324, -3 * 5e-324],
            2,
        ),
    ],
)
def test_underflow_excludes_no_solution(A, q, c, points):
    """z is subnormal, all data but ψ are not: the units of rows and products lose digits that γ does not count."""
    problem = icp.ICP(A, q, c)
    assert len(icp.all_solutions(problem).points) == points
    assert icp.certify(problem, c).unique is not (points > 1)


@pytest.mark.parametrize("n", [1, 4, 12])
def test_a_negative_identity_has_all_corners_of_the_cube(n):
    found = icp.all_solutions(icp.ICP(-np.eye(n), np.ones(n)))
    assert sorted(map(tuple, found.points)) == sorted(np.ndindex(*[2] * n))
    assert found.faces == ()


def test_a_bimatrix_game_has_all_its_equilibria():
    """Battle of the sexes as an LCP in scaled strategies: two pure equilibria, a mixed one, and z = 0."""
    payoff, other = np.array([[3.0, 0.0], [0.0, 2.0]]), np.array([[2.0, 0.0], [0.0, 3.0]])
    A = np.block([[np.zeros((2, 2)), 4.0 - payoff], [4.0 - other.T, np.zeros((2, 2))]])
    found = icp.all_solutions(icp.ICP(A, -np.ones(4)))
    strategies = {tuple((point[:2] / point[:2].sum()).round(9)) for point in found.points}
    assert strategies == {(1.0, 0.0), (0.0, 1.0), (0.6, 0.4)}


def test_ctrl_c_leaves_what_is_found_until_then():
    """The alarm raises what Ctrl-C does. All 2¹⁸ corners of a cube are solutions, which takes far longer."""
    before = signal.signal(signal.SIGALRM, signal.default_int_handler)
    signal.setitimer(signal.ITIMER_REAL, 1.0, 10.0)  # again, where Python loses one in a finaliser
    try:
        with pytest.raises(icp.Interrupted) as pressed:
            icp.all_solutions(icp.ICP(-np.eye(18), np.ones(18)))
    finally:
        signal.setitimer(signal.ITIMER_REAL, 0.0)
        signal.signal(signal.SIGALRM, before)
    found = pressed.value.report
    assert not found.complete
    assert set(np.unique(found.points)) <= {0.0, 1.0}
    assert "not all 262144 linear pieces were examined" in str(found)


def test_what_cannot_be_enumerated_is_refused():
    with pytest.raises(icp.NotApplicable, match="affine"):
        icp.all_solutions(icp.ICP([[1.0]], [1.0], np.sin))
    with pytest.raises(icp.NotApplicable, match="pieces"):
        icp.all_solutions(icp.ICP(np.eye(40), np.ones(40)))
    assert not icp.all_solutions(icp.ICP(-np.eye(12), np.ones(12)), time_limit=0).complete
