"""`Problem.backward` and `Problem.derivative` are as those of `cp.Problem`: the derivative by the parameters."""

import cvxpy as cp
import numpy as np
import pytest
import scipy.sparse as sp
from cvxpy.reductions.cvx_attr2constr import lower_value, recover_value_for_leaf
from hypothesis import example, given, settings
from hypothesis import strategies as st

import icpmodel as icp

K = np.array([[4.0, -1.0, 0.5], [-1.0, 5.0, -1.0], [0.0, -2.0, 4.0]])


def contact(z, load):
    return icp.complements(K @ z - load, z - 0.25)


def loaded():
    return [contact(cp.Variable(3), cp.Parameter(3, value=[3.0, -2.0, 1.0]))]


def stiffness():
    """A in all the structures that parameters may have."""
    z, symmetric = cp.Variable(3), cp.Parameter((3, 3), PSD=True, value=K + K.T)
    diagonal = cp.Parameter((3, 3), diag=True, value=np.diag([1.0, 2.0, 3.0]))
    sparse, scale = cp.Parameter((3, 3), sparsity=([0, 2, 1], [1, 1, 2])), cp.Parameter(nonneg=True, value=0.5)
    sparse.value_sparse = sp.coo_array(([0.5, -1.0, 0.25], ([0, 2, 1], [1, 1, 2])), shape=(3, 3))
    return [icp.complements((symmetric + diagonal + sparse) @ z + scale * (K @ z) - [3.0, -2.0, 1.0], z)]


def divided():
    """Rows of r with a factor, of both signs, and the sides in the other order."""
    z, y, below = cp.Variable(3), cp.Variable(2), cp.Parameter(3, value=[0.5, -1.0, 0.25])
    a, minus, above = cp.Parameter(pos=True, value=2.5), cp.Parameter(neg=True, value=-2.0), cp.Parameter(2)
    above.value = [0.5, 3.0]
    return [
        icp.complements(cp.multiply(a, z) - below - 0.2 * y[0], K @ z - [3.0, -2.0, 1.0]),
        icp.complements(2 - y + 0.1 * z[:2], minus * y + above - 0.1 * a * z[1:]),
    ]


def between():
    """Bounds below, above, on both sides and none, by expressions of parameters."""
    Z, t, high = cp.Variable((2, 2)), cp.Variable(2), cp.Parameter((2, 2), value=[[0.5, 2.0], [0.25, np.inf]])
    low, pull = cp.Parameter(value=-0.5), cp.Parameter((2, 2), value=[[3.0, 1.0], [-4.0, 2.0]])
    return [
        icp.complements(3 * Z + 0.5 * Z.T - pull, Z, lower=low * np.ones((2, 2)) - 0.1 * t[0], upper=high),
        icp.complements(t - pull[0, :], 2 * t - low, lower=None, upper=0.5 + cp.sum(high[:, 0])),
    ]


def balanced():
    """Equations with free multipliers, and an inequality, which moves nothing."""
    x, price, demand = cp.Variable(3), cp.Variable(), cp.Parameter(value=4.0)
    cost, capacity = cp.Parameter(3, value=[1.0, 2.0, 9.0]), cp.Parameter(3, value=[1.5, 9.0, 9.0])
    share, most = cp.Parameter(3, value=[1.0, 0.5, 2.0]), cp.Parameter(value=50.0)
    p = cost + 0.5 * x - cp.multiply(share, cp.sum(price))
    return [icp.complements(p, x, upper=capacity), demand == cp.sum(cp.multiply(share, x)), price <= most]


def bent():
    """ψ and ψ̄ with atoms of parameters, and with parameters as the factors of atoms."""
    z, y, a = cp.Variable(3), cp.Variable((1, 2)), cp.Parameter(3, value=[0.5, 1.0, -0.5])
    b, S = cp.Parameter(nonneg=True, value=0.75), cp.Parameter((2, 2), symmetric=True, value=[[1.0, 0.5], [0.5, 2.0]])
    R, high = cp.Parameter((2, 2), PSD=True, value=[[2.0, 1.0], [1.0, 3.0]]), 0.3 * cp.log_sum_exp(S @ z[:2] + b)
    yielding = a - b * cp.maximum(z, a) + 0.1 * cp.exp(-cp.square(z - a)) / (1 + cp.square(b * z[0]))
    return [
        icp.complements(K @ z - [3.0, -2.0, 1.0] + 0.1 * cp.sum(y), z - 0.2 * yielding),
        icp.complements(2 * y - np.array([[4.0, -3.0]]), y, lower=-0.1 * cp.quad_form(z[1:], R), upper=high),
    ]


def products():
    """Not DPP: products and quotients of parameters in p, in r and in a bound."""
    z, a, b = cp.Variable(3), cp.Parameter(value=2.0), cp.Parameter(3, value=[0.5, -1.0, 2.0])
    return [icp.complements(a * (a * (K @ z)) - cp.multiply(b, b / a) * 4, z / a, lower=-a, upper=cp.square(b) / a)]


MODELS = [loaded, stiffness, divided, between, balanced, bent, products]


def own(parameter, value):
    """Those entries of a parameter that are its own: half of a symmetric one."""
    return np.ravel(lower_value(parameter, value), order="F")


def present(parameter):
    value = parameter.value_sparse if parameter.attributes["sparsity"] else parameter.value
    return value.toarray() if sp.issparse(value) else np.asarray(value)


def put(parameter, value):
    if parameter.attributes["sparsity"]:
        entries = value[parameter.sparse_idx]
        parameter.value_sparse = sp.coo_array((entries, parameter.sparse_idx), shape=parameter.shape)
    else:
        parameter.value = value


def a_direction(parameter, random):
    entries = random.normal(size=lower_value(parameter, np.zeros(parameter.shape)).shape)
    direction = recover_value_for_leaf(parameter, entries, project=False)
    return direction.toarray() if sp.issparse(direction) else direction


def solved(model, **options):
    return model.solve(rtol=1e-13, raise_on_failure=False, **options).z


@pytest.mark.parametrize("model", MODELS)
def test_derivative_and_backward_are_what_central_differences_give_and_adjoint_to_each_other(model):
    """δ by re-solving at θ ± hδθ; ⟨g, δ⟩ = ⟨gradient, δθ⟩ over the entries that are a parameter's own."""
    problem, random, h = icp.Problem(model()), np.random.default_rng(3), 1e-5
    solved(problem, requires_grad=True)
    assert problem.value == 0
    before = [present(one) for one in problem.parameters()]
    for parameter in problem.parameters():
        parameter.delta = a_direction(parameter, random)
    for variable in problem.variables():
        variable.gradient = random.normal(size=variable.shape)
    problem.derivative()
    problem.backward()
    ends = []
    for step in (h, -h):
        for parameter, value in zip(problem.parameters(), before, strict=True):
            put(parameter, value + step * parameter.delta)
        ends.append(solved(problem))
    moved = np.concatenate([x.delta.ravel(order="F") for x in problem.variables()])
    assert np.abs(moved).max() > 1e-3
    assert moved == pytest.approx((ends[0] - ends[1]) / (2 * h), abs=1e-6)
    forward = sum(np.vdot(x.gradient, x.delta) for x in problem.variables())
    pairs = [(own(one, one.gradient), own(one, one.delta)) for one in problem.parameters()]
    assert forward == pytest.approx(sum(gradient @ delta for gradient, delta in pairs), rel=1e-12)
    for variable in problem.variables():
        assert variable.delta.shape == variable.shape


@settings(max_examples=10)
@given(st.lists(st.floats(-3, 3), min_size=3, max_size=3), st.floats(0.5, 2))
@example([0.0, 0.0, 5e-324], 2.0)
def test_the_derivative_of_z_where_it_is_known(load, a):
    """az − q ⟂ z − c, row by row: z = q/a off the obstacle, c on it."""
    z, q, A = cp.Variable(3), cp.Parameter(3, value=load), cp.Parameter(value=a)
    c = cp.Parameter(3, value=[0.1, 0.2, -0.3])
    problem = icp.Problem(icp.complements(A * z - q, z - c))
    problem.solve(requires_grad=True)
    z.gradient = np.array([1.0, 2.0, 3.0])
    problem.backward()
    free = q.value / a > c.value
    decided = np.abs(q.value / a - c.value) > 1e-6
    assert q.gradient[decided] == pytest.approx(np.where(free, z.gradient / a, 0)[decided])
    assert c.gradient[decided] == pytest.approx(np.where(free, 0, z.gradient)[decided])
    if decided.all():
        assert A.gradient == pytest.approx(-(z.gradient * q.value / a**2)[free].sum())


def test_a_derivative_changes_nothing_in_the_start_of_the_next_solve():
    """Neither side has an entry of z for itself, so that an unknown stands for r; exp(x) = a, x + y = a."""
    x, y, a = cp.Variable(), cp.Variable(), cp.Parameter(value=2.0)
    problem = icp.Problem([icp.complements(cp.exp(x) - a, 20 - cp.exp(y)), x + y == a])
    first = problem.solve(requires_grad=True).z
    assert problem.solve(requires_grad=True).z == pytest.approx(first, abs=1e-12)
    problem.backward()
    assert (x.value, a.gradient) == pytest.approx((np.log(2.0), 1.0), abs=1e-7)


def test_inequalities_have_a_part_in_the_answer_but_none_in_its_derivative():
    z, high = cp.Variable(3), cp.Parameter(value=9.0)
    load = cp.Parameter(3, value=[3.0, -2.0, 1.0])
    problem = icp.Problem([contact(z, load), z <= high])
    problem.solve(requires_grad=True)
    problem.backward()
    assert high.gradient == 0
    assert np.abs(load.gradient).max() > 0.1


@pytest.mark.parametrize("verb", ["backward", "derivative"])
def test_both_ask_for_a_solve_that_prepares_them_and_that_has_succeeded(verb):
    z, load = cp.Variable(), cp.Parameter(value=1.0)
    problem = icp.Problem(icp.complements(z - load, z))
    for prepare in (lambda: None, problem.solve):
        prepare()
        with pytest.raises(ValueError, match=rf"{verb}\(\) was called without a solve\(requires_grad=True\)"):
            getattr(problem, verb)()
    never = icp.Problem(icp.complements(-z - load, z))
    never.solve(requires_grad=True, raise_on_failure=False)
    with pytest.raises(icp.NotSolved, match="infeasible"):
        getattr(never, verb)()
    with pytest.raises(icp.NotSolved):
        never.solve(requires_grad=True)
    with pytest.raises(icp.NotSolved, match="infeasible"):
        getattr(never, verb)()
