"""All solutions of small problems: each is one, in fractions, and none is missing."""

from fractions import Fraction

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import icpmodel as icp


def in_fractions(A, z):
    return [sum((Fraction(float(a)) * x for a, x in zip(row, z, strict=True)), Fraction(0)) for row in A]


def is_solution(z, A, q, G, c, d):
    """Whether the integer or half-integer `z` solves the problem exactly."""
    z = [Fraction(x).limit_denominator(10**6) for x in z]
    p = [a + Fraction(float(b)) for a, b in zip(in_fractions(A, z), q, strict=True)]
    r = [x - g - Fraction(float(b)) for x, g, b in zip(z, in_fractions(G, z), c, strict=True)]
    above = [Fraction(1) if np.isinf(b) else Fraction(float(b)) - x for x, b in zip(z, d, strict=True)]
    rows = zip(p, r, above, strict=True)
    return all(
        (a == 0 or b == 0 or (a < 0 and s == 0)) and b >= 0 and s >= 0 and (a >= 0 or s == 0) for a, b, s in rows
    )


@st.composite
def planted(draw):
    """A problem of small integers with a solution that is known; degenerate and singular ones are frequent."""
    n = draw(st.integers(1, 5))
    entries = st.integers(-2, 2)
    A = np.array(draw(st.lists(entries, min_size=n * n, max_size=n * n))).reshape(n, n)
    G = np.zeros((n, n), dtype=int)
    if draw(st.booleans()):
        G = np.array(draw(st.lists(st.sampled_from([0, 0, 0, 1]), min_size=n * n, max_size=n * n))).reshape(n, n)
    z = np.array(draw(st.lists(st.integers(-2, 3), min_size=n, max_size=n)))
    side = np.array(draw(st.lists(st.sampled_from("dflu"), min_size=n, max_size=n)))
    room = np.array(draw(st.lists(st.integers(0, 2), min_size=n, max_size=n)))
    c = z - G @ z - np.where(side == "l", 0, room)
    d = np.where(side == "u", z, np.where(side == "d", z + room, np.inf))
    p = np.where(side == "l", room, np.where(side == "u", -room, 0))
    return A, p - A @ z, G, c.astype(float), d, z.astype(float)


def contains(found, z):
    """Whether `z` is one of the points, or lies on the affine hull of a face."""
    if any(np.abs(point - z).max() <= 1e-9 for point in found.points):
        return True
    for face in found.faces:
        coefficients = np.linalg.lstsq(face.directions.T, z - face.point, rcond=None)[0]
        if np.abs(face.directions.T @ coefficients - (z - face.point)).max() <= 1e-9:
            return True
    return False


@settings(max_examples=60, deadline=None, derandomize=True)
@given(planted())
def test_every_solution_is_one_and_the_planted_one_is_among_them(data):
    A, q, G, c, d, z = data
    found = icp.all_solutions(icp.ICP(A, q, icp.Affine(G, c), upper=d))
    assert found.complete
    assert contains(found, z)
    for point in [*found.points, *(face.point for face in found.faces)]:
        assert is_solution(point, A, q, G, c, d)


@pytest.mark.parametrize("n", [1, 4, 8])
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


def test_a_segment_is_told_with_its_direction():
    found = icp.all_solutions(icp.ICP([[1, 1], [1, 1]], [-1, -1]))
    (face,) = found.faces
    assert face.point.sum() == pytest.approx(1.0)
    assert abs(face.directions.sum()) <= 1e-12


def test_what_cannot_be_enumerated_is_refused():
    with pytest.raises(icp.NotApplicable, match="affine"):
        icp.all_solutions(icp.ICP([[1.0]], [1.0], np.sin))
    with pytest.raises(icp.NotApplicable, match="pieces"):
        icp.all_solutions(icp.ICP(np.eye(40), np.ones(40)))
    assert not icp.all_solutions(icp.ICP(-np.eye(12), np.ones(12)), time_limit=0).complete
