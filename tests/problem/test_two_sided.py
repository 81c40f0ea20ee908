"""Two obstacles as one map, the problem that has them, and the last word on their residual, held against fractions."""

import math
import pickle
from fractions import Fraction

import numpy as np
import pytest
import scipy.sparse as sp
from exact import ExactProblem, fractions
from hypothesis import given, settings
from hypothesis import strategies as st
from known_answers import GENERATORS, sine

import icpmodel as icp
from icpmodel.problem.two_sided import TwoSidedObstacle, mid
from icpmodel.problem.verdict import certified_residual


def maps(rng, n):
    """One map of each kind that a user can give, with a Lipschitz matrix where it can have one."""
    G, c = rng.normal(size=(n, n)) * 0.4, rng.normal(size=n)
    return [
        icp.Constant(c),
        icp.Affine(G, c),
        icp.Elementwise(np.sin, np.cos, lipschitz=1.0, c=c),
        icp.Function(lambda z: np.sin(G @ z) + c, lambda z: np.cos(G @ z)[:, None] * G, lipschitz=np.abs(G)),
        icp.Intervention(sp.csr_array(-np.abs(rng.normal(size=(n, n))))),
    ]


def pair(rng, n):
    lower, upper = (maps(rng, n)[rng.integers(5)] for _ in range(2))
    return TwoSidedObstacle(lower, upper).bind(n)


@given(GENERATORS)
def test_what_is_known_of_both_is_true_of_each(rng):
    """G bounds the differences of both, `change` too; links, isotone, constant, a user's word likewise."""
    n = int(rng.integers(2, 5))
    both = pair(rng, n)
    x, y = rng.normal(size=(2, n)) * 3
    delta = np.abs(x - y)
    for one in (both.lower, both.upper):
        moved = np.abs(one.value(x) - one.value(y)) * (1 - 1e-12)
        assert (moved <= both.lipschitz @ delta + 1e-15).all()
        assert (moved <= both.change(delta)).all()
        assert not both.isotone() or (one.value(x) <= one.value(np.maximum(x, y)) + 1e-12).all()
        assert not both.is_constant or not moved.any()
    assert both.value(x).tolist() == both.lower.value(x).tolist()
    sides = both.lower, both.upper
    assert both.calls_user_code == any(one.calls_user_code for one in sides)
    assert both.has_policies == any(one.has_policies for one in sides)
    assert (both.links is None) == any(one.links is None for one in sides)
    assert (both.linear is None) == any(one.linear is None for one in sides)


@settings(max_examples=40)
@given(GENERATORS)
def test_both_sides_go_along_wherever_the_map_goes(rng):
    """To some rows, to a coarser level, to other units."""
    n = int(rng.integers(2, 5))
    both, z = pair(rng, n), rng.normal(size=n)
    rows = np.flatnonzero(rng.random(n) < 0.5)
    rows = rows if rows.size else np.array([0])
    P, shift, kept = sp.csr_array(rng.normal(size=(n, 2))), rng.normal(size=n), np.array([1, 0])
    y = rng.normal(size=2)
    for made, at, expected in (
        (both.restricted(rows, z), z[rows], lambda one: one.value(z)[rows]),
        (both.composed(P, shift, kept), y, lambda one: one.value(P @ y + shift)[kept]),
        (both.composed(4.0 * sp.eye_array(z.size, format="csr"), factor=0.25), z, lambda one: one.value(4.0 * z) / 4.0),
    ):
        assert made.value(at) == pytest.approx(expected(both.lower), rel=1e-12, abs=1e-12)
        assert made.upper.value(at) == pytest.approx(expected(both.upper), rel=1e-12, abs=1e-12)


def test_the_median_at_the_ends_and_where_the_obstacles_cross():
    inf, nan = np.inf, np.nan
    for p, below, above, result in (
        (2.0, inf, -inf, 2.0),
        (2.0, 1.0, -inf, 1.0),
        (5.0, 0.0, 0.0, 0.0),
        (0.0, -2.0, 1.0, -2.0),
        (0.0, -1.0, 2.0, 2.0),
        (9.0, 1.0, 3.0, 3.0),
    ):
        assert mid(*(np.array([x]) for x in (p, below, above))).tolist() == [result]
    for given_ in ((nan, 1.0, -1.0), (0.0, nan, -1.0), (0.0, 1.0, nan)):
        assert np.isnan(mid(*(np.array([x]) for x in given_))).all()
    assert mid(np.array([3.0]), np.array([2.0])).tolist() == [2.0]


@pytest.mark.parametrize(
    ("psi", "upper", "words"),
    [
        ([0.0, 2.0], [1.0, 1.0], "cross in row 1: psi has 2 there, upper 1"),
        (icp.Affine([[0, 1], [1, 0]], 3.0), icp.Affine([[0, 1], [0, 0]], 2.0), "cross in row 0: psi has 3 there"),
        (0.0, [1.0, -np.inf], r"upper\[1\] is -inf"),
        (0.0, [1.0, 2.0, 3.0], r"upper has shape \(3,\)"),
        (0.0, "one", "upper is 'one'"),
        (TwoSidedObstacle(icp.Constant(0.0), icp.Constant(1.0)), 2.0, "psi has an upper obstacle already"),
        (0.0, TwoSidedObstacle(icp.Constant(0.0), icp.Constant(1.0)), "upper has two sides"),
    ],
)
def test_bad_obstacles_are_named_with_what_was_found(psi, upper, words):
    with pytest.raises(icp.InputError, match=words):
        icp.ICP(np.eye(2), np.ones(2), psi, upper=upper)


def test_problems_share_what_they_have_in_common():
    problem = icp.ICP([[2.0, 1.0], [1.0, 2.0]], [1.0, -9.0], -1.0, upper=[1.0, np.inf])
    assert problem.with_q([1.0, 1.0]).facts is problem.facts
    assert problem.with_psi(-2.0).upper.value(np.zeros(2)).tolist() == [1.0, np.inf]
    assert problem.with_upper(None).upper is None
    assert problem.with_upper(4.0).matrix is problem.matrix
    again = pickle.loads(pickle.dumps(problem))
    assert again.solve().z.tolist() == problem.solve().z.tolist()


def test_obstacles_are_frozen_at_a_point_though_rounding_parts_them_where_they_touch():
    touching = icp.ICP(np.eye(1), [-9.0], lambda z: 0.1 * z + 0.2, upper=lambda z: 0.3 + (z - 1) * 0.1)
    low = touching.psi.value(np.array([-2.0]))
    assert low > touching.upper.value(np.array([-2.0]))
    assert touching.frozen([-2.0]).solve().z.tolist() == low.tolist()
    assert touching.with_upper(None).frozen([-2.0]).psi.value(np.zeros(1)).tolist() == low.tolist()


def test_the_upper_obstacle_of_one_problem_serves_another():
    for upper in (3.0, icp.Affine(0.5 * np.eye(1), [1.0]), sine(0.5, [1.0]), lambda z: 0.5 * z + 1.0):
        one = icp.ICP(np.eye(1), [-9.0], 0.0, upper=upper)
        other = icp.ICP(np.eye(1), [-9.0], 0.0, upper=one.upper)
        assert other.upper.value(np.ones(1)) == one.upper.value(np.ones(1))
        many = icp.solve_many(np.eye(1), [[-9.0]], 0.0, upper=one.upper, Z0=[[1.0]], raise_on_failure=False)
        assert many.Z.shape == (1, 1)


def test_fixed_obstacles_are_found_on_both_sides():
    """Where each moves with its own z_i, and by less: z_i = ψ_i(z_i) and z_i = ψ̄_i(z_i), +inf where there is none."""
    low = sine(0.5, [0.0, -np.inf, 1.0])
    top = icp.Elementwise(lambda z: 0.5 * np.tanh(z), lipschitz=0.5, c=[3.0, 1.0, np.inf])
    facts = icp.ICP(np.eye(3), np.ones(3), low, upper=top).facts
    assert facts.has_fixed_obstacle
    c, d = facts.obstacle, facts.upper_obstacle
    assert c[[0, 2]] == pytest.approx(0.5 * np.sin(c[[0, 2]]) + [0.0, 1.0], abs=1e-12)
    assert d[:2] == pytest.approx(0.5 * np.tanh(d[:2]) + [3.0, 1.0], abs=1e-12)
    assert (c[1], d[2]) == (-np.inf, np.inf)
    fails = icp.Elementwise(lambda z: np.where(z > 1, np.nan, 0.9 * z), lipschitz=0.9, c=1.0)
    with pytest.raises(icp.MapError, match="upper_0"):
        _ = icp.ICP(np.eye(1), np.ones(1), -1.0, upper=fails).facts.upper_obstacle


near_one = st.sampled_from([0.0, 1.0, -1.0, 3.0, 0.1, -0.3, 1.0 + 2.0**-40, 2.0**60, -(2.0**60), 1e-8])


@st.composite
def given_problems(draw):
    """A problem with two affine obstacles and a z, whose rows may cancel, of any size."""
    n = draw(st.integers(1, 3))
    vector = st.lists(near_one, min_size=n, max_size=n).map(np.array)
    matrix = st.lists(vector, min_size=n, max_size=n).map(np.array)
    A, G, H = draw(matrix), draw(matrix) * draw(st.sampled_from([0, 1])), draw(matrix) * draw(st.sampled_from([0, 1]))
    q, c, d, z = (draw(vector) for _ in range(4))
    mask = st.lists(st.booleans(), min_size=n, max_size=n).map(np.array)
    c, d = np.where(draw(mask), -np.inf, c), np.where(draw(mask), np.inf, d)
    touch = draw(mask) & np.isfinite(c)
    d, H = np.where(touch, c, d), np.where(touch[:, None], G, H)
    unit = 2.0 ** draw(st.sampled_from([-450, 0, 420]))
    same = (G == H).all(axis=1)
    d = np.where(same, np.maximum(c, d), d)  # else it is bad input
    kind = draw(st.sampled_from([np.array, sp.csr_array]))
    upper = icp.Affine(H, d * unit) if draw(st.booleans()) else None
    return icp.ICP(kind(A), q * unit, icp.Affine(G, c * unit) if G.any() else c * unit, upper=upper), z * unit


@given(given_problems())
def test_a_certain_residual_is_never_below_the_exact_one_and_tight(drawn):
    problem, z = drawn
    exact = ExactProblem(problem).residual(z)
    root = float(Fraction(math.isqrt(int(exact * 4**1200)), 2**1200))
    assert certified_residual(problem, z, 0.0, root * (1 + 1e-12) + 1e-300) <= root * (1 + 1e-12) + 1e-300
    assert root == 0.0 or Fraction(certified_residual(problem, z, 0.0, root / 2)) ** 2 >= exact


@given(given_problems())
def test_the_rounding_errors_of_p_and_of_both_r_are_bounded(drawn):
    problem, z = drawn
    known, at = ExactProblem(problem), fractions(z)
    sides = known.obstacles(at)
    p, below = known.p(at), [x - low for x, (low, _) in zip(at, sides, strict=True)]
    rounding_p, rounding_r = problem.rounding(z)
    found = [(p, problem.p(z), rounding_p), (below, problem.r(z), rounding_r)]
    if problem.upper is not None:
        found.append(([x - top for x, (_, top) in zip(at, sides, strict=True)], problem.r_upper(z), rounding_r))
    for exact, computed, bound in found:
        for x, y, b in zip(exact, computed, bound, strict=True):
            assert x == y if isinstance(x, float) else abs(x - Fraction(float(y))) <= Fraction(float(b))


@pytest.mark.parametrize(("scale", "sides"), [(1.0, 1), (1e160, 1), (1e-170, 2), (1.0, "moving")])
def test_the_residual_of_a_large_problem_is_that_of_the_median(scale, sides):
    """In one compiled pass over A, NaN and crossing rows included, and safe against overflow."""
    rng, n = np.random.default_rng(3), 90_000
    A = sp.csr_array(sp.diags_array([rng.normal(size=n - abs(k)) for k in range(-6, 7)], offsets=range(-6, 7)))
    c = scale * np.where(rng.random(n) < 0.2, -np.inf, rng.normal(size=n))
    d = np.where(rng.random(n) < 0.2, np.inf, np.where(np.isfinite(c), c, 0.0) + scale * rng.random(n).round(1))
    problem, z = icp.ICP(A, scale * rng.normal(size=n), c, upper=None if sides == 1 else d), scale * rng.normal(size=n)
    if sides == "moving":
        problem = problem.with_sides(icp.Affine(sp.eye_array(n), 0.0), icp.Affine(-0.5 * sp.eye_array(n), 0.3))
    D = abs(A).max(axis=1).toarray()
    for residual, at in ((problem.residual(z), z), (problem.residual_at_0(), np.zeros(n))):
        expected = scale * np.linalg.norm(problem.natural_map(at, omega=D) / D / scale)
        assert residual == pytest.approx(expected, rel=1e-12, abs=0)
    assert np.isnan(problem.residual(np.where(np.arange(n) == 77, np.nan, z)))


def test_a_function_above_is_called_upper_in_messages():
    for above in (lambda z: z[:1], icp.Function(lambda z: z[:1])):
        with pytest.raises(icp.MapError, match=r"^upper\(z\) has shape \(1,\)"):
            icp.ICP(np.eye(2), [1.0, 2.0], upper=above).solve()
