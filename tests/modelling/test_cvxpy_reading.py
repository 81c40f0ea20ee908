"""Models in CVXPY are the ICPs that they state: A, q and ψ, values, duals and parameters."""

import cvxpy as cp
import numpy as np
import pytest
from cvxpy.reductions.dcp2cone.cone_matrix_stuffing import ConeMatrixStuffing
from known_answers import chain

import icpmodel as icp


def an_m_matrix(random, n):
    A = -random.uniform(0, 1, (n, n)) * (random.random((n, n)) < 0.5)
    return A + np.diag(1.0 - A.sum(axis=1) + random.random(n))


def stacked(*values):
    return np.concatenate([np.ravel(value, order="F") for value in values])


def solves(problem, z):
    return icp.certify(problem, z, bound=False).residual_max <= 1e-7 * (1 + np.abs(z).max())


@pytest.mark.parametrize("seed", range(20))
def test_an_affine_model_of_several_variables_is_the_icp_of_the_stacked_ones(seed):
    """A vector, a matrix and a scalar; p in pieces of other shapes than the variables; G of a general affine ψ."""
    random = np.random.default_rng(seed)
    A, q = an_m_matrix(random, 9), random.normal(size=9)
    G = np.zeros((9, 9)) if seed % 2 else 0.1 * random.uniform(-1, 1, (9, 9)) * (1 - np.eye(9))
    c = random.normal(size=9)
    x, X, s = cp.Variable(3), cp.Variable((2, 2), name="X"), cp.Variable((2, 1))
    z = cp.hstack([x, cp.vec(X, order="F"), s[:, 0]])
    p, r = A @ z + q, z - G @ z - c
    model = icp.Problem(
        [
            icp.complements(p[:2], r[:2]),
            icp.complements(r[7:], p[7:]) if seed % 3 else icp.complements(p[7:], r[7:]),
            icp.complements(cp.reshape(p[3:7], (2, 2), order="C"), cp.reshape(r[3:7], (2, 2), order="C")),
            icp.complements(p[2], r[2]),
        ]
    )
    expected = icp.ICP(A, q, icp.Affine(G, c))
    assert model.icp().is_lcp == (seed % 2 == 1)
    model.solve(rtol=1e-10)
    assert solves(expected, stacked(x.value, X.value, s.value))
    assert sorted(v.id for v in model.variables()) == sorted(v.id for v in (x, X, s))
    assert model.solution.z == pytest.approx(stacked(*(v.value for v in model.variables())))
    for constraint in model.constraints:
        assert min(constraint.p.min(), constraint.r.min()) >= -1e-7
        assert np.abs(constraint.p * constraint.r).max() <= 1e-6
        assert constraint.p.shape == constraint.r.shape == constraint.sides[0].shape


def test_the_sides_may_be_swapped_where_only_one_is_r():
    A, z = np.array([[4.0, -1.0], [-1.0, 4.0]]), cp.Variable(2)
    for p, r in ((A @ z - 1, z - 0.5), (A @ z - 1, z - 0.3 * cp.exp(-z)), (A @ z - 1, z - 0.3 * z[::-1])):
        straight, swapped = icp.complements(p, r), icp.complements(r, p)
        first = icp.Problem(straight).solve(rtol=1e-12).z
        assert icp.Problem(swapped).solve(rtol=1e-12).z == pytest.approx(first)
        assert swapped.p == pytest.approx(straight.p)
        assert swapped.r == pytest.approx(straight.r)
        assert straight.p == pytest.approx(p.value)


NONLINEAR = {
    "minimum": lambda z, y: cp.minimum(z, y, 0.4),
    "maximum": lambda z, y: cp.maximum(z, 2 * y, 0.3),
    "exp": lambda z, y: cp.exp(z - 2) + 0.1 * y,
    "square": lambda z, y: cp.square(y) / 9,
    "stretched": lambda z, y: 0.1 * cp.minimum(z, y[0], 0.9) + 0.1 * cp.maximum(cp.vstack([z, y]), z[0], y)[0],
    "log": lambda z, y: 0.1 * cp.log(z + y),
    "power": lambda z, y: 0.1 * cp.power(z, 3),
    "sqrt": lambda z, y: 0.1 * cp.sqrt(z + 1),
    "inverse": lambda z, y: 0.1 * cp.inv_pos(z + 1),
    "norm": lambda z, y: 0.1 * cp.norm(z) * np.ones(3),
    "norm1": lambda z, y: 0.1 * cp.norm1(z - 0.2) * np.arange(3),
    "product": lambda z, y: 0.1 * cp.multiply(z, y),
    "quadratic form": lambda z, y: 0.1 * cp.quad_form(z, np.diag([1.0, 2.0, 3.0])) * np.ones(3),
    "inner product": lambda z, y: 0.1 * (z @ y) * np.ones(3),
    "sum": lambda z, y: 0.1 * cp.cumsum(cp.exp(-z)),
    "stacked": lambda z, y: 0.1 * cp.hstack([cp.abs(z[0]), cp.max(y), cp.log_sum_exp(z)]),
    "quotient": lambda z, y: 0.1 * y[0] / (z - 4) - 0.1 * z / (1 + y),
    "sliced": lambda z, y: 0.1 * cp.exp(cp.hstack([y, z]))[::2],
    "matrix": lambda z, y: 0.01 * cp.sum(cp.square(cp.vstack([z, y])) @ np.ones((3, 3)), axis=0),
}


def model_with(psi):
    z, y = cp.Variable(3, name="z"), cp.Variable(3, name="y")
    A = chain(3, 4.0).toarray()
    parts = psi(z, y)
    model = icp.Problem([icp.complements(A @ z - y - 1, z - parts), icp.complements(3 * y - 0.5 * z - 0.5, y)])
    return model, z, y, parts


@pytest.mark.parametrize("name", NONLINEAR)
def test_psi_has_cvxpys_values_and_derivatives(name):
    """ψ against the expression's own value, ψ′ against difference quotients, and p, r, pᵀr at the answer."""
    model, z, y, parts = model_with(NONLINEAR[name])
    random = np.random.default_rng(0)
    z.value, y.value = random.uniform(0.5, 1.5, 3), random.uniform(0.5, 1.5, 3)
    problem = model.icp()
    order = [v.name() for v in model.variables()]
    point = stacked(*(v.value for v in model.variables()))
    own = slice(0, 3) if order == ["z", "y"] else slice(3, 6)
    z.value = y.value = None  # what was read does not hang on the variables
    value = problem.psi.value(point)
    z.value, y.value = (point[own], np.delete(point, range(own.start, own.stop)))
    assert value[own] == pytest.approx(parts.value, rel=1e-12)
    J = problem.psi.jacobian(point).toarray()
    for k in range(6):
        h = np.zeros(6)
        h[k] = 1e-6
        quotient = (problem.psi.value(point + h) - problem.psi.value(point - h)) / 2e-6
        assert J[:, k] == pytest.approx(quotient, abs=1e-6)
    model.solve(rtol=1e-10)
    first = model.constraints[0]
    assert first.r == pytest.approx(z.value - parts.value)
    assert min(first.p.min(), first.r.min()) >= -1e-8
    assert np.abs(first.p * first.r).max() <= 1e-8


def count_compilations(monkeypatch):
    calls = []
    compile_ = ConeMatrixStuffing.apply
    monkeypatch.setattr(ConeMatrixStuffing, "apply", lambda *args: calls.append(1) or compile_(*args))
    return calls


def test_a_series_is_compiled_once_and_gives_the_answers_of_new_models(monkeypatch):
    random = np.random.default_rng(1)
    A, B, c, weight = cp.Parameter((3, 3)), random.normal(size=(3, 3)), cp.Parameter(3), cp.Parameter(nonneg=True)

    def pair(z, A, c, weight):
        return icp.complements(A @ z + B @ c, z - weight * cp.exp(-z) - 0.1 * c)

    z = cp.Variable(3)
    model = icp.Problem(pair(z, A, c, weight))
    calls, counts = count_compilations(monkeypatch), []
    for _ in range(4):
        A.value, c.value, weight.value = an_m_matrix(random, 3), random.normal(size=3), random.random()
        model.solve(rtol=1e-12)
        counts.append(len(calls))
        fresh = cp.Variable(3)
        icp.Problem(pair(fresh, A.value, c.value, weight.value)).solve(rtol=1e-12)
        assert z.value == pytest.approx(fresh.value, abs=1e-9)
    assert counts == [1, 2, 3, 4]  # the first one, and the new models


def test_values_that_are_refused_leave_nothing_behind():
    """Neither the obstacle that was read with them, nor signs and scales of rows."""
    z, load, floor = cp.Variable(), cp.Parameter(value=1.0), cp.Parameter(value=0.0)
    model = icp.Problem(icp.complements(z - load, z - floor))
    model.solve()
    floor.value, load.value = 5.0, np.inf
    with pytest.raises(icp.InputError):
        model.solve()
    load.value = 1.0
    assert model.solve().z == pytest.approx([5.0])
    sign = cp.Parameter(value=1.0)
    turned = icp.complements(z + load, sign * z, upper=5)
    model = icp.Problem(turned)
    model.solve()
    before, sign.value, load.value = turned.p, -1.0, np.inf
    with pytest.raises(icp.InputError):
        model.solve()
    sign.value = load.value = 1.0
    model.solve()
    assert turned.p == pytest.approx(before)


#: z ∈ R² ↦ p that CVXPY calls affine and does not compile as it stands; and the answer of p ≥ 0 ⟂ z ≥ 0
NOT_COMPILED = {
    "a root": (lambda z: z - cp.sqrt(2), [np.sqrt(2)] * 2),
    "a factor": (lambda z: cp.exp(1) * z - 1, [np.exp(-1)] * 2),
    "a norm": (lambda z: z - cp.norm(np.array([3.0, 4.0])), [5, 5]),
    "0 times a function": (lambda z: z - 1 + 0 * cp.exp(z), [1, 1]),
    "0 entry by entry": (lambda z: z - 1 + cp.multiply([0.0, 0.0], cp.exp(z)), [1, 1]),
    "0 in a sum": (lambda z: z - cp.cumsum(0 * cp.exp(z)) - 1, [1, 1]),
    "a power": (lambda z: cp.power(z, 1.0) + z**0 - 2, [1, 1]),
    "a diagonal": (lambda z: z + cp.diag(cp.vstack([z, z])) @ np.ones(2) - 2, [2 / 3, 2 / 3]),
    "three axes": (
        lambda z: (
            z
            - cp.reshape(
                cp.hstack([cp.reshape(2 * z, (1, 1, 2), order="C"), cp.reshape(z, (1, 1, 2), order="C")])[0, 1],
                (2,),
                order="C",
            )
            - [1, -1]
            + z
        ),
        [1, 0],
    ),
}


@pytest.mark.parametrize("name", NOT_COMPILED)
def test_what_cvxpy_calls_affine_is_read_as_its_value_says(name):
    of, answer = NOT_COMPILED[name]
    z = cp.Variable(2)
    condition = icp.complements(of(z), z)
    icp.Problem(condition).solve()
    assert z.value == pytest.approx(answer)
    assert condition.sides[0].value == pytest.approx(condition.p)


def test_an_expression_without_a_value_is_named():
    """A start outside the domain is an error that says which expression; from inside, or the edge, it is solved."""
    z = cp.Variable(2, name="z")
    model = icp.Problem(icp.complements(4 * z - 2, z - 0.1 * cp.log(z)))
    with pytest.raises(icp.MapError, match=r"log\(z\) is -inf here; start where it is finite"):
        model.solve()
    z.value = [-1, 1]
    with pytest.raises(icp.MapError, match=r"log\(z\) is nan here"):
        model.solve()
    z.value = [1, 1]
    assert model.solve().solved
    assert z.value == pytest.approx([0.5, 0.5])
    z.value = None
    assert icp.Problem(icp.complements(z**2.5 + cp.sqrt(z) - [2, -1], z)).solve().z == pytest.approx([1, 0])


#: x ∈ R² ↦ one condition, or equations, with any expressions on both sides; and the answer
BENT = {
    "p": (lambda x: [icp.complements(cp.exp(x) - 2, x + 1)], [np.log(2), np.log(2)]),
    "p is like r": (lambda x: [icp.complements(2 * x - 1, cp.exp(x) - 1)], [0.5, 0.5]),
    "both": (lambda x: [icp.complements(cp.exp(x) - [2, 0], x + cp.power(x, 3))], [np.log(2), 0]),
    "both swapped": (lambda x: [icp.complements(x + cp.power(x, 3), cp.exp(x) - [2, 0])], [np.log(2), 0]),
    "r is a power": (lambda x: [icp.complements(cp.exp(x) - [2, 5], cp.power(x, 3) - 1)], [1, np.log(5)]),
    "bounds": (lambda x: [icp.complements(cp.exp(x) - [2, 5], cp.power(x, 3), lower=-8, upper=1)], [np.log(2), 1]),
    "a matrix": (
        lambda x: [
            icp.complements(
                cp.reshape(cp.hstack([cp.exp(x[1]) - 3, cp.power(x[0], 3) - x[1]]), (2, 1), order="C"),
                cp.vstack([x[1] - 1, cp.exp(x[0]) - 2]),
            )
        ],
        [np.log(3) ** (1 / 3), np.log(3)],
    ),
    "two in one entry": (
        lambda x: [icp.complements(np.array([[3, 2], [2, 3]]) @ x, cp.hstack([x[1], x[1] - 1]))],
        [-2 / 3, 1],
    ),
    "an equation": (lambda x: [icp.complements(x[0] - 1, x[0]), cp.exp(x[1]) == x[0] + 1], [1, np.log(2)]),
    "equations": (lambda x: [cp.multiply(x, x[::-1] + 1) == [4, 3], x >= 0], [2, 1]),
}


@pytest.mark.parametrize("name", BENT)
def test_both_sides_and_equations_may_be_any_expression(name):
    """From 1 and from the last answer; p and r are the sides in one order; the derivative in a shift of x is 1."""
    of, answer = BENT[name]
    x, shift = cp.Variable(2, name="x"), cp.Parameter(value=0.0)
    model = icp.Problem(of(x - shift))
    x.value = np.ones(2)
    for shift.value in (0.0, 0.25):
        model.solve(rtol=1e-11, requires_grad=True)
        assert x.value == pytest.approx(np.array(answer) + shift.value, abs=1e-8)
    if isinstance(one := model.constraints[0], type(icp.complements(x, x))):
        p, r = sorted((side.value for side in one.sides), key=lambda value: np.abs(value - one.p).max())
        assert one.p == pytest.approx(p, abs=1e-8)
        assert one.r == pytest.approx(r, abs=1e-8)
    shift.delta = 1.0
    model.derivative()
    assert x.delta == pytest.approx([1.0, 1.0], abs=1e-6)


x, X, s, i = cp.Variable(2, name="x"), cp.Variable((2, 2), name="X"), cp.Variable(name="s"), cp.Variable(2, name="i")
REFUSED = {
    "a constraint": (lambda: icp.complements(x >= 0, x), r"was given the constraint 0.0 <= x as p; give the exp"),
    "shapes": (lambda: icp.complements(2 * x, s), r"p = 2.0 \* x has shape \(2,\), r = s \(\)"),
    "no list": (lambda: icp.Problem(3), r"constraints is 3; a list of complements\(p, r\)"),
    "no pair": (
        lambda: icp.Problem([x >= 0]),
        r"have 0 entries, the variables 2 \(x with 2\); .*; inequalities are only checked: a <= b with a multiplier of",
    ),
    "a bent inequality": (
        lambda: icp.Problem([icp.complements(x, x), cp.norm(x) <= 1]),
        r"the inequality .*\(x, 2\) <= 1.0 is not affine in the variables; only affine ones are checked; ask",
    ),
    "a cone": (
        lambda: icp.Problem([icp.complements(x, x), cp.SOC(s, x)]),
        r"constraints\[1\] is SOC\(.*\); complements\(p, r\), equations a == b and inequalities a <= b were expected",
    ),
    "complex": (lambda: icp.Problem(icp.complements(1j * x, x)), r"is complex; real expressions were expected"),
    "an attribute": (
        lambda: icp.Problem(icp.complements(cp.Variable(integer=True, name="y") - 1, s)),
        r"the variable y has the attribute integer; .* nonneg, nonpos, bounds",
    ),
    "CVXPY's own problem": (
        lambda: cp.Problem(cp.Minimize(0), [icp.complements(x, x)]),
        r"complements\(x, x\) is no constraint of cvxpy.Problem: icpmodel.Problem\(",
    ),
    "the shape of a bound": (
        lambda: icp.complements(x, x, upper=[1, 2, 3]),
        r"upper = \[1. 2. 3.\] has shape \(3,\), r = x \(2,\)",
    ),
    "a bound that is NaN": (
        lambda: icp.Problem(icp.complements(x, x, upper=[1, np.nan])).icp(),
        r"upper\[1\] of complements\(x, x, upper=.*\) is nan; a number was expected, or inf for none",
    ),
    "a bound on the wrong side": (
        lambda: icp.Problem(icp.complements(x, x, lower=cp.Parameter(value=np.inf))).icp(),
        r"lower\[0\] of complements\(x, x, lower=.*\) is inf; a number was expected, or -inf for none",
    ),
    "bounds that cross": (
        lambda: icp.Problem([icp.complements(x, x), icp.complements(i, i, lower=[0, 2], upper=1)]).icp(),
        r"lower is larger than upper in complements\(i, i, lower=\[0. 2.\], upper=1.0\), entry \[1\]",
    ),
    "no value": (
        lambda: icp.Problem(icp.complements(s - cp.Parameter(name="load"), s)).icp(),
        r"the parameter load has no value; set its .value before solving",
    ),
    "NaN": (
        lambda: icp.Problem(icp.complements(x + np.array([1, np.nan]), x)).icp(),
        r"complements\(x \+ .*, x\), entry \[1\], has NaN; numbers were expected",
    ),
    "NaN of a matrix in the second of two conditions": (
        lambda: icp.Problem([icp.complements(x, x), icp.complements(2 * i, np.array([[1, 0], [np.nan, 1]]) @ i)]).icp(),
        r"complements\(2.0 \* i, .*\), entry \[1\], has NaN",
    ),
    "NaN in an equation": (
        lambda: icp.Problem([icp.complements(x, x), i == [0, np.nan]]).icp(),
        r"i == .*, entry \[1\], has NaN",
    ),
}


@pytest.mark.parametrize("name", REFUSED)
def test_what_is_no_icp_is_refused_with_the_expression_and_the_reason(name):
    make, sentence = REFUSED[name]
    with pytest.raises(icp.InputError, match=sentence):
        make()


def test_parameters_of_three_axes_are_stacked_along_the_second():
    P = cp.Parameter((2, 2, 2), value=np.arange(8.0).reshape(2, 2, 2))
    x = cp.Variable((2, 4, 2), nonneg=True)
    icp.Problem(icp.complements(2 * x - cp.hstack([P, P]), x)).solve()
    assert x.value == pytest.approx(np.concatenate([P.value] * 2, axis=1) / 2)
