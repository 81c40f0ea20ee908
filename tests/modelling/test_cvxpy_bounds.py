"""Models in CVXPY with bounds on both sides and with equations, as their user would write them."""

import cvxpy as cp
import numpy as np
import pytest
from known_answers import PAIR

import icpmodel as icp


def clamped(F, x, low, high):
    """Whether F pushes only where x is at a bound: x is the projection of x − F."""
    return pytest.approx(np.clip(x - F, low, high), abs=1e-7) == x


@pytest.mark.parametrize(
    ("attributes", "lower", "upper"),
    [
        ({"nonneg": True}, 0.0, np.inf),
        ({"nonpos": True}, -np.inf, 0.0),
        ({"bounds": [-1.0, [1.0, np.inf]]}, -1.0, np.array([1.0, np.inf])),
        ({"bounds": [None, 0.5]}, -np.inf, 0.5),
    ],
)
def test_bounds_of_a_variable_are_those_of_its_condition_and_else_are_checked(attributes, lower, upper):
    A, load = PAIR, cp.Parameter(2, value=[-4.0, 4.0])
    x, y = cp.Variable(2, **attributes), cp.Variable(2)
    icp.Problem(icp.complements(A @ x - load, x)).solve(requires_grad=True)
    plain = icp.Problem(icp.complements(A @ y - load, y, lower=lower, upper=upper))
    plain.solve()
    assert x.value == pytest.approx(y.value, abs=1e-9)
    for sign in (-1.0, 1.0):  # where x is no r of a condition
        z = cp.Variable(2, **attributes)
        model = icp.Problem([A @ z == 2.0 * sign])
        inside = bool(np.all((2.0 * sign >= lower) & (2.0 * sign <= upper)))
        assert model.solve(raise_on_failure=False).solved is inside
        assert z.value == pytest.approx([2.0 * sign] * 2)


def test_bounds_that_are_given_are_taken_whatever_the_variable_has():
    z = cp.Variable(bounds=[-1, 1])
    for given, answer in (({}, -0.5), ({"lower": 0}, 0.0), ({"lower": 0, "upper": 1}, 0.0), ({"lower": -0.25}, -0.25)):
        assert icp.Problem(icp.complements(z + 0.5, z, **given)).solve().z == pytest.approx([answer])


def test_a_variable_with_bounds_has_the_gradients_of_one_without():
    A, found = PAIR, []
    for attributes in ({}, {"nonneg": True}):
        x, load = cp.Variable(2, **attributes), cp.Parameter(2, value=[3.0, 1.0])
        model = icp.Problem(icp.complements(A @ x - load, x - 0.3 * cp.minimum(x, 1)))
        model.solve(requires_grad=True)
        model.backward()
        found.append(load.gradient)
    assert found[0] == pytest.approx(found[1], abs=1e-12)


def test_bounds_have_the_shapes_and_units_of_what_they_bound():
    """A matrix of rows with a factor; None, infinite numbers, parameters, and ends that move with z."""
    X, y, cap = cp.Variable((2, 3), name="X"), cp.Variable(name="y"), cp.Parameter(nonneg=True)
    load = np.array([[9.0, -9, 1], [-1, 2, -9]])
    high = np.array([[1, 1, np.inf], [4, np.inf, 4.0]])
    inner = icp.complements(3 * X - load - 0.1 * y, 2 * X - y, lower=None, upper=high)
    outer = icp.complements(2 * y - cp.sum(X) / 9 - 3, y, lower=-cap, upper=0.1 * cp.square(X[0, 0]) + cap)
    model = icp.Problem([inner, outer])
    for cap.value in (0.5, 2.0):
        model.solve(rtol=1e-10)
        F, r = 3 * X.value - load - 0.1 * y.value, 2 * X.value - y.value
        assert inner.p == pytest.approx(F, abs=1e-8)
        assert inner.r == pytest.approx(r, abs=1e-8)
        assert inner.p.shape == inner.r.shape == (2, 3)
        assert clamped(F, r, -np.inf, high)
        assert clamped(outer.p, y.value, -cap.value, 0.1 * X.value[0, 0] ** 2 + cap.value)


def test_an_expression_that_falls_with_z_is_an_obstacle_above():
    """x <= u as u − x >= 0: p is its multiplier, whichever other rows there are."""
    x = cp.Variable(3)
    top, bottom = icp.complements([3, 0.5] - x[:2], 1 - x[:2]), icp.complements(x[2] - x[0] + 4, x[2])
    model = icp.Problem([top, bottom])
    model.solve(rtol=1e-12)
    assert x.value == pytest.approx([1, 0.5, 0])
    assert top.p == pytest.approx([2, 0])
    assert top.r == pytest.approx([0, 0.5])
    assert (bottom.p, bottom.r) == (pytest.approx(3), pytest.approx(0))
    both = icp.complements(2 - x, 1 - x, lower=-1, upper=3)  # −2 <= x <= 2
    icp.Problem(both).solve()
    assert x.value == pytest.approx([2, 2, 2])
    assert both.r == pytest.approx([-1, -1, -1])


def test_equations_alone_and_in_any_order_are_solved():
    """Those that fit no unknown of their own are exchanged, and those of multipliers stay."""
    a, b, u, p = cp.Variable(name="a"), cp.Variable(name="b"), cp.Variable(3), cp.Variable()
    icp.Problem([b == 3, 2 * a == -4]).solve()
    assert (a.value, b.value) == (pytest.approx(-2), pytest.approx(3))
    K = np.array([[2.0, -1, 0], [-1, 2, -1], [0, -1, 2]])
    icp.Problem([K @ u + p == [1, 2, 3], cp.sum(u) == 0]).solve()
    assert u.value == pytest.approx([-0.5, 0, 0.5])
    assert p.value == pytest.approx(2)
