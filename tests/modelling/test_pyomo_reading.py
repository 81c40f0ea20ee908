"""Reading Pyomo models: the same words in any order and sign give the same A, q and psi."""

import numpy as np
import pyomo.environ as pyo
import pytest
from pyomo.core.expr.calculus.derivatives import Modes, differentiate
from pyomo.mpec import Complementarity, ComplementarityList, complements
from pyomo_models import linear, random_problem, violation, written

import icpmodel as icp
from icpmodel.modelling.pyomo import read_pyomo
from icpmodel.modelling.pyomo.nonlinear import NonlinearRows, flattened

KINDS = ("constant", "affine", "nonlinear")


def differences(problem, other, z):
    yield abs(problem.A - other.A).max()
    yield np.abs(problem.q - other.q).max()
    yield np.abs(problem.psi.value(z) - other.psi.value(z)).max()
    yield np.abs((problem.psi.jacobian(z) - other.psi.jacobian(z)).toarray()).max()


@pytest.mark.parametrize("seed", range(8))
@pytest.mark.parametrize("kind", KINDS)
def test_order_sign_blocks_params_and_fixed_variables_change_nothing(kind, seed):
    """Every variant of a model is the ICP that it was written from: the same rows, and z the variables themselves."""
    random = np.random.default_rng([seed, KINDS.index(kind)])
    n = int(random.integers(4, 12))
    problem, G = random_problem(random, n, kind)
    model = written(problem, G, random, kind)
    reading = read_pyomo(model)
    assert max(differences(reading.problem, problem, random.uniform(-2, 2, n))) <= 1e-12
    assert list(reading.variables) == list(model.part[0].inner.x.values())


@pytest.mark.parametrize("seed", range(6))
def test_the_rows_may_come_in_any_order_and_the_variables_have_any_names(seed):
    """A permutation of conditions against variables is found again: z keeps the order of the conditions."""
    random = np.random.default_rng(seed)
    problem, _ = random_problem(random, 7, "constant")
    order = random.permutation(7).tolist()
    model = pyo.ConcreteModel()
    model.x = pyo.Var(order)
    model.rows = ComplementarityList(
        rule=(
            complements(linear(problem.A, model.x, i) >= -float(problem.q[i]), model.x[i] >= float(problem.psi.c[i]))
            for i in order
        )
    )
    read = read_pyomo(model).problem
    assert max(differences(read, permuted(problem, order), np.zeros(7))) <= 1e-12


def permuted(problem, order):
    return icp.ICP(problem.A[order][:, order], problem.q[order], problem.psi.c[order])


def test_upper_bounds_turn_the_condition_and_keep_the_diagonal():
    """x <= u with F(x) <= 0 is an obstacle above x."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var([1, 2])
    model.rows = Complementarity([1, 2], rule=lambda m, i: complements(3 * m.x[i] + m.x[3 - i] <= i, m.x[i] <= 5))
    problem = read_pyomo(model).problem
    assert problem.A.toarray().tolist() == [[3, 1], [1, 3]]
    assert problem.q.tolist() == [-1, -2]
    assert (problem.psi.value(np.zeros(2)).tolist(), problem.upper.c.tolist()) == ([-np.inf, -np.inf], [5, 5])


def test_an_equality_is_a_row_without_obstacle_whatever_its_sign():
    """F = 0 with x free, as a condition or as a constraint; the diagonal of A becomes positive."""
    for form in (
        lambda m: Complementarity(expr=complements(m.x, 2 * m.x - m.y == 3)),
        lambda m: Complementarity(expr=complements(m.y - 2 * m.x == -3, m.x)),
        lambda m: pyo.Constraint(expr=2 * m.x == 3 + m.y),
    ):
        model = pyo.ConcreteModel()
        model.x, model.y = pyo.Var(), pyo.Var()
        model.free = form(model)
        model.held = Complementarity(expr=complements(model.y >= 0, model.y - model.x >= -1))
        problem = read_pyomo(model).problem
        rows = np.argsort(np.isneginf(problem.psi.c))  # constraints come after the conditions
        assert problem.A.toarray()[rows][:, rows].tolist() == [[1, -1], [-1, 2]]
        assert problem.q[rows].tolist() == [1, -3]
        assert problem.psi.c[rows].tolist() == [0, -np.inf]


def two_variables(expr):
    """One condition of x and y, and y = 1."""
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(), pyo.Var()
    model.c = Complementarity(expr=expr(model.x, model.y))
    model.other = pyo.Constraint(expr=model.y == 1)
    return model


def test_a_range_with_an_infinite_end_is_the_condition_without_it():
    inf = float("inf")
    for expr, low, high, x in (
        (lambda x, y: complements(pyo.inequality(1, x, inf), 2 * x - y), 1, inf, 1),
        (lambda x, y: complements(2 * x - y, pyo.inequality(-inf, x, -1)), -inf, -1, -1),
        (lambda x, y: complements(pyo.inequality(-inf, x, inf), 2 * x - y), -inf, inf, 0.5),
    ):
        model = two_variables(expr)
        problem = read_pyomo(model).problem
        assert problem.psi.value(np.zeros(2)).tolist() == [low, -inf]
        assert (problem.upper is None) == (high == inf)
        assert high == inf or problem.upper.value(np.zeros(2)).tolist() == [high, inf]
        pyo.SolverFactory("icpmodel").solve(model, options={"method": "newton"})
        assert (model.x.value, model.y.value) == pytest.approx((x, 1))


def test_a_parameter_may_be_infinite_for_a_while():
    model = pyo.ConcreteModel()
    model.x = pyo.Var()
    model.capacity = pyo.Param(mutable=True, initialize=float("inf"))
    model.c = Complementarity(expr=complements(pyo.inequality(0, model.x, model.capacity), model.x - 2))
    for capacity, x in ((float("inf"), 2.0), (1.0, 1.0)):
        model.capacity = capacity
        pyo.SolverFactory("icpmodel").solve(model)
        assert model.x.value == pytest.approx(x)


@pytest.mark.parametrize("width", [2.0, 1e-3, 1e-12, 0.0])
def test_a_range_that_closes_keeps_its_dual(width):
    model = pyo.ConcreteModel()
    model.x, model.dual, model.rc = pyo.Var(), pyo.Suffix(direction=pyo.Suffix.IMPORT), pyo.Suffix()
    model.rc.direction = pyo.Suffix.IMPORT
    model.c = Complementarity(expr=complements(pyo.inequality(1, model.x, 1 + width), model.x - 5))
    pyo.SolverFactory("icpmodel").solve(model)
    assert [model.x.value, model.dual[model.c], model.rc[model.x]] == pytest.approx([1 + width, width - 4, width - 4])


def test_a_closed_range_of_a_fixed_variable_says_nothing_of_the_other_side():
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(), pyo.Var()
    model.x.fix(1.0)
    model.c = Complementarity(expr=complements(pyo.inequality(1, model.x, 1), model.y - 5))
    model.d = Complementarity(expr=complements(model.y >= 0, model.y >= 2))
    pyo.SolverFactory("icpmodel").solve(model)
    assert model.y.value == pytest.approx(2.0)


EXPRESSIONS = {
    "product": lambda x: x[0] * x[1] * x[0],
    "exp": lambda x: pyo.exp(x[0] * x[1]),
    "quotient": lambda x: x[0] / (1 + x[1] ** 2),
    "power": lambda x: x[0] ** x[1] + 2.0 ** x[0],
    "exponent": lambda x: x[0] ** 3 - x[1] ** -1.5,
    "logs": lambda x: pyo.log(x[0]) - 2 * pyo.log10(x[1]),
    "roots": lambda x: pyo.sqrt(x[0] + x[1]),
    "waves": lambda x: pyo.sin(x[0]) * pyo.cos(x[1]) - pyo.tan(x[0]),
    "arcs": lambda x: pyo.asin(x[0] / 2) + pyo.acos(x[1] / 2) + pyo.atan(x[0]),
    "abs": lambda x: abs(x[0] - 2 * x[1]),
    "nested": lambda x: pyo.exp(-((x[0] - x[1]) ** 2) / 2) * (x[0] + 3) * (x[0] + 3),
}


@pytest.mark.parametrize("name", EXPRESSIONS)
def test_values_and_derivatives_are_pyomos(name):
    """NumPy on all rows of a shape against Pyomo's own evaluation and reverse numeric derivative, row by row."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(4))
    x = list(model.x.values())
    pairs = [(0, 1), (2, 3), (3, 0), (1, 2)]
    rows = {i: EXPRESSIONS[name]([x[j], x[k]]) * (i + 0.5) for i, (j, k) in enumerate(pairs)}
    flat = [flattened(row, "row") for row in rows.values()]
    own = NonlinearRows(flat, {id(one): j for j, one in enumerate(x)})
    assert len(own.compiled) == 1
    for z in np.random.default_rng(3).uniform(0.2, 1.2, (5, 4)):
        for one, value in zip(x, z, strict=True):
            one.set_value(float(value))
        expected = [pyo.value(row) for row in rows.values()]
        slopes = [differentiate(row, wrt_list=x, mode=Modes.reverse_numeric) for row in rows.values()]
        assert own.value(z) == pytest.approx(expected, rel=1e-13)
        assert own.jacobian(z).toarray() == pytest.approx(np.array(slopes, dtype=float), rel=1e-12)
        again = [pyo.value(one) for one in own.expressions(x)]
        assert again == pytest.approx(expected, rel=1e-13)


@pytest.mark.parametrize("seed", range(10))
def test_mixed_and_double_bounded_conditions_hold_at_the_answer(seed):
    """Conditions of all kinds in one model, by Pyomo's standard form: equalities, bounds on one side and on both."""
    random = np.random.default_rng(seed)
    n = 8
    problem, G = random_problem(random, n, "affine")
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(n))

    def rule(m, i):
        F = linear(problem.A, m.x, i) + float(problem.q[i])
        low, high = -float(random.uniform(0, 0.5)), float(random.uniform(0, 0.5))
        kind = random.integers(7)
        bent = F + 0.2 * pyo.sin(m.x[i])
        on_x.update({i: {3: -F, 6: bent}.get(kind, F)} if kind not in (2, 5) else {})
        return (
            lambda: complements(F, pyo.inequality(low, m.x[i], high)),
            lambda: complements(pyo.inequality(low, m.x[i] - linear(G, m.x, i), high), F),
            lambda: complements(pyo.inequality(low, F, high), m.x[i]),
            lambda: complements(m.x[i] <= high, F <= 0),
            lambda: complements(F >= 0, m.x[i] >= low),
            lambda: complements(m.x[i], low == F),
            lambda: complements(pyo.inequality(low, m.x[i], high), bent),
        )[kind]()

    on_x = {}
    model.rows = Complementarity(range(n), rule=rule)
    reading = read_pyomo(model)
    solution = reading.problem.solve(rtol=1e-12)
    for variable, value in reading.values(solution.z):
        variable.set_value(value)
    assert len(reading.values(solution.z)) == n
    assert violation(model) <= 1e-9
    for owner, force in reading.multipliers(solution.z):
        if owner.index() in on_x:
            assert force == pytest.approx(pyo.value(on_x[owner.index()]), abs=1e-9)


@pytest.mark.parametrize("seed", range(4))
def test_both_sides_may_be_nonlinear_and_are_zero_as_the_model_says(seed):
    """Conditions with one and two bounds and an equation around a known point, judged by Pyomo's own values."""
    random = np.random.default_rng(seed)
    x0, y0, w0 = random.uniform(0.5, 1.5, 3).tolist()
    model = pyo.ConcreteModel()
    model.x, model.y, model.w = (pyo.Var(initialize=one + 0.1) for one in (x0, y0, w0))
    held = float(seed % 2)
    first = model.x**2 + model.y - x0**2 - y0 + held
    second = model.x**3 + model.x - x0**3 - x0 + 1 - held
    model.one = Complementarity(expr=complements(first >= 0, second >= 0))
    width = pyo.inequality(y0**3, model.y**3, y0**3 + 1)
    model.two = Complementarity(expr=complements(width, pyo.exp(model.y) - np.exp(y0) + 1))
    model.three = pyo.Constraint(expr=model.w**3 + model.w == w0**3 + w0 + (model.x - x0))
    reading = read_pyomo(model)
    assert reading.problem.f is not None
    z = reading.problem.solve(z0=reading.start(), rtol=1e-12).z
    values = {variable.name: value for variable, value in reading.values(z)}
    assert values == pytest.approx({"x": x0, "y": y0, "w": w0}, abs=1e-8)


@pytest.mark.parametrize("sign", [1.0, -1.0])
def test_a_bound_that_moves_is_an_obstacle_above_as_below(sign):
    """x_i ≥ 1 + .3x_j gets no further unknown, and its mirror image gets none: both have dominant diagonals."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(5))
    x = model.x
    model.c = Complementarity(
        range(5),
        rule=lambda _, i: complements(
            sign * x[i] - 0.3 * sign * x[(i + 1) % 5] >= 1.0, sign * (3.0 * x[i] - x[(i - 1) % 5]) >= -2.0
        ),
    )
    problem = read_pyomo(model).problem
    assert problem.n == 5
    assert icp.theory.classify(problem.A).h_plus.holds


def test_the_side_that_bounds_a_variable_is_r_where_the_other_is_nonlinear():
    model = pyo.ConcreteModel()
    model.x = pyo.Var(initialize=1.0)
    model.c = Complementarity(expr=complements(model.x >= 0, pyo.exp(model.x) + model.x + 3 >= 0))
    reading = read_pyomo(model)
    assert reading.multipliers(np.zeros(1))[0][1] == pytest.approx(4.0)
