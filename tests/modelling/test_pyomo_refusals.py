"""What is no implicit complementarity problem is refused with the component's name; Pyomo's own models one by one."""

import math
import unittest

import pyomo.environ as pyo
import pytest
from pyomo.gdp import Disjunct, Disjunction
from pyomo.mpec import Complementarity, complements
from pyomo.mpec.tests.test_complementarity import CCTests
from pyomo_models import violation

import icpmodel as icp
from icpmodel.modelling.pyomo import read_pyomo


def base():
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(), pyo.Var()
    model.part = pyo.Block()
    return model


def held(model):
    """Conditions that make a square problem of x and y."""
    model.c = Complementarity(expr=complements(model.x >= 0, 2 * model.x - model.y >= 1))
    model.d = Complementarity(expr=complements(model.y >= 0, 2 * model.y - model.x >= 1))


def condition(first, second):
    def build(model):
        held(model)
        model.d.deactivate()
        model.part.odd = Complementarity(expr=complements(first(model.x, model.y), second(model.x, model.y)))

    return build


def component(name, make):
    def build(model):
        held(model)
        setattr(model.part, name, make(model))

    return build


def discrete(model):
    model.z = pyo.Var(within=pyo.Integers)
    model.c = Complementarity(expr=complements(model.z >= 0, model.z >= 1))


def without_value(model):
    held(model)
    model.part.p = pyo.Param(initialize=math.nan, mutable=True)
    model.c.deactivate()
    model.part.odd = Complementarity(expr=complements(model.x >= model.part.p, model.x >= 1))


def fixed_without_value(model):
    held(model)
    model.y.fixed = True


def fixed(x):
    def build(model):
        held(model)
        model.x.fix(x)
        model.y.fix(0.0)

    return build


REFUSED = {
    "objective": (component("odd", lambda m: pyo.Objective(expr=m.x**2)), "part.odd is an active Objective"),
    "linear objective": (component("odd", lambda m: pyo.Objective(expr=m.x)), "part.odd is an active Objective"),
    "inequality": (component("odd", lambda m: pyo.Constraint(expr=m.x <= 3)), "part.odd is an active inequality"),
    "range": (
        component("odd", lambda m: pyo.Constraint(expr=pyo.inequality(0, m.x, 3))),
        "part.odd is an active inequality",
    ),
    "no pair": (
        component("odd", lambda m: pyo.Constraint(expr=m.x == m.y)),
        "3 conditions for 2 variables .* no free variable is left for .*; every condition needs a variable of its own",
    ),
    "no condition": (
        component("odd", lambda m: Complementarity(expr=complements(m.x >= 0, m.y + m.part.z[1] + m.part.z[2] >= 0))),
        r"3 conditions for 4 variables .* no condition is left for part.z\[",
    ),
    "sos": (component("odd", lambda m: pyo.SOSConstraint(var=m.part.z, sos=1)), "active SOSConstraint part.odd"),
    "disjunction": (
        component("odd", lambda m: Disjunction(expr=[m.x >= 1, m.y >= 1])),
        r"active Disjunct part.odd_disjuncts\[0\], Disjunction part.odd,",
    ),
    "disjunct": (component("odd", lambda m: Disjunct()), "active Disjunct part.odd,"),
    "discrete": (discrete, "z is in Integers; a continuous variable was expected"),
    "strict": (condition(lambda x, y: x > 0, lambda x, y: y >= 1), "part.odd has a strict inequality"),
    "strict range": (
        condition(lambda x, y: pyo.inequality(0, y, 1, strict=True), lambda x, y: y - 1),
        "part.odd has a strict inequality",
    ),
    "nonlinear": (
        condition(lambda x, y: y**2 >= 1, lambda x, y: pyo.sin(y) >= x),
        "part.odd is nonlinear on both sides",
    ),
    "three bounds": (
        condition(lambda x, y: pyo.inequality(0, y, 1), lambda x, y: x >= 1),
        r"part.odd has 2 \+ 1 bounds",
    ),
    "bounds that cross": (
        condition(lambda x, y: pyo.inequality(x, y, x - 0.5), lambda x, y: x - y),
        "part.odd has a lower bound that is larger than the upper one, by 0.5",
    ),
    "one bound": (condition(lambda x, y: y >= 0, lambda x, y: x - 1), r"part.odd has 1 \+ 0 bounds"),
    "no bound": (condition(lambda x, y: y, lambda x, y: x - 1), r"part.odd has 0 \+ 0 bounds"),
    "equality and bound": (condition(lambda x, y: y >= 0, lambda x, y: x + y == 1), r"part.odd has 1 \+ 2 bounds"),
    "two equalities": (condition(lambda x, y: y == 0, lambda x, y: x + y == 1), r"part.odd has 2 \+ 2 bounds"),
    "no derivative": (
        condition(lambda x, y: pyo.tanh(y) >= 0, lambda x, y: x + y >= 1),
        "part.odd has the operation tanh, which Pyomo cannot differentiate",
    ),
    "branches": (
        condition(lambda x, y: pyo.Expr_if(y >= 0, y, 2 * y) >= 0, lambda x, y: x + y >= 1),
        "part.odd has the operation Expr_if, which Pyomo cannot differentiate",
    ),
    "no value": (without_value, "part.odd has a number that is not finite"),
    "fixed without value": (fixed_without_value, "c has a number that is not finite"),
    "fixed, too many": (
        lambda model: (held(model), model.y.fix(1.0)),
        "2 conditions for 1 variables that are not fixed: no free variable is left for d",
    ),
    "fixed, wrong": (fixed(3.0), "c has no free variable and does not hold: its sides are 3 and 5"),
    "constant": (
        component("odd", lambda m: pyo.Constraint(expr=0 * m.x + m.part.one == 2)),
        "part.odd has no free variable and cannot hold",
    ),
    "nothing": (lambda model: None, "unknown has no active Complementarity with a free variable"),
}


@pytest.mark.parametrize(
    ("model", "words"),
    [(None, "model is None; a Pyomo model"), (5, "model is 5"), (pyo.AbstractModel(), "is abstract")],
)
def test_what_is_no_model_is_refused(model, words):
    for read in (read_pyomo, pyo.SolverFactory("icpmodel").solve):
        with pytest.raises(icp.InputError, match=words):
            read(model)


@pytest.mark.parametrize("name", REFUSED)
def test_another_model_is_refused_by_name(name):
    build, words = REFUSED[name]
    model = base()
    model.part.z = pyo.Var([1, 2])
    model.part.one = pyo.Param(initialize=1.0, mutable=True)
    build(model)
    with pytest.raises(icp.InputError, match=words):
        read_pyomo(model)
    with pytest.raises(icp.InputError, match=words):
        pyo.SolverFactory("icpmodel").solve(model)


def test_two_conditions_of_one_variable_leave_another_without():
    model = base()
    model.c = Complementarity(expr=complements(model.x >= 0, model.x >= 1))
    model.d = Complementarity(expr=complements(model.x >= 0, 3 * model.x >= 1))
    model.e = Complementarity(expr=complements(model.y >= 0, model.y >= 1))
    model.z = pyo.Var()
    model.f = Complementarity(expr=complements(model.z >= model.y, model.y + model.z >= 1))
    with pytest.raises(
        icp.InputError, match=r"4 conditions for 3 variables that are not fixed: no free variable is left for [cd];"
    ):
        read_pyomo(model)


def test_deactivated_components_and_constant_objectives_do_no_harm():
    model = base()
    held(model)
    model.part.objective = pyo.Objective(expr=3.0)
    for name, make in {
        "a": lambda: pyo.Objective(expr=model.x**2),
        "b": lambda: pyo.Constraint(expr=model.x <= 3),
        "c": lambda: Disjunction(expr=[model.x >= 1, model.y >= 1]),
        "d": lambda: Complementarity(expr=complements(model.x**2 >= 0, model.y**2 >= 1)),
    }.items():
        setattr(model.part, name, make())
        model.part.component(name).deactivate()
    for disjunct in model.component_objects(Disjunct):
        disjunct.deactivate()
    pyo.assert_optimal_termination(pyo.SolverFactory("icpmodel").solve(model))
    assert (model.x.value, model.y.value) == pytest.approx((1, 1))


#: the models of pyomo/mpec/tests/test_complementarity.py by test: what is said of each as it stands there. In most of
#: them one condition stands for four variables.
AS_THEY_STAND = {
    "t1a": "c is an active inequality",
    **dict.fromkeys(
        (
            "t1b",
            "t1c",
            "t2a",
            "t2b",
            "t3a",
            "t3b",
            "t4a",
            "t4b",
            "t4c",
            "t4d",
            "t10",
            "t11",
            "t12",
            "t13",
            "cov4",
            "cov8",
            "list1",
            "list2",
            "list5",
        ),
        "no condition is left for ",
    ),
    "t9": None,
    "cov2": None,
}
#: which variables have to be fixed before a model has as many conditions as variables; none of them is refused then
SQUARE = {
    **dict.fromkeys(("t1b", "t1c", "t3a", "t3b", "t4a", "t4b", "t4c", "t4d", "cov4", "cov8"), "y x2 x3"),
    **dict.fromkeys(("t2a", "t2b"), "y x1 x2"),
    **dict.fromkeys(("t11", "t12"), "y x2 x3"),
}


class Collected(CCTests, unittest.TestCase):
    """Pyomo's tests, which build a model each and hand it to `_test`."""

    def _test(self, tname, M):
        self.model = M


def pyomos_models():
    """(name, model) of every test that hands one over."""
    for name in sorted(vars(CCTests)):
        if name.startswith("test_"):
            case = Collected(name)
            case.model = None
            getattr(case, name)()
            if case.model is not None:
                yield name.removeprefix("test_"), case.model


NAMES = {"cov9": "cov8", "list3": "list1", "list4": "list1"}


def test_pyomos_own_models_are_solved_or_refused_by_name():
    seen = set()
    for name, model in pyomos_models():
        words = AS_THEY_STAND[NAMES.get(name, name)]
        seen.add(NAMES.get(name, name))
        if words:
            with pytest.raises(icp.InputError, match=words):
                read_pyomo(model)
        else:
            pyo.assert_optimal_termination(pyo.SolverFactory("icpmodel").solve(model))
            assert violation(model) <= 1e-9, name
    assert seen == set(AS_THEY_STAND)


def test_pyomos_own_models_are_solved_where_they_are_square():
    """With the other variables fixed at 1/4. The lists say x1 + 2 x2 = i for several i, which cannot be mended so."""
    for name, model in pyomos_models():
        fixed = SQUARE.get(NAMES.get(name, name))
        if fixed:
            for one in fixed.split():
                model.component(one).fix(0.25)
            pyo.assert_optimal_termination(pyo.SolverFactory("icpmodel").solve(model))
            assert violation(model) <= 1e-9, name


@pytest.mark.parametrize(("on_x", "on_F"), [(1, 1), (-1, 1), (1, -1), (-1, -1)])
def test_munsons_problem_in_its_four_signs(on_x, on_F):
    """The LCP that Pyomo tests its interface to PATH with: either sign of x and of F spells the same problem."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var([1, 2, 3])
    x = [on_x * one for one in model.x.values()]
    F = [x[0] + 2 * x[1] + 3 * x[2] - 1, x[1] - x[2] + 1, x[0] + x[1] + 1]
    spelled = {1: lambda side: side >= 0, -1: lambda side: -side <= 0}
    model.f = Complementarity(range(3), rule=lambda _, i: complements(spelled[on_x](x[i]), spelled[on_F](F[i])))
    pyo.assert_optimal_termination(pyo.SolverFactory("icpmodel").solve(model))
    assert violation(model) <= 1e-9
    answer = read_pyomo(model).problem
    assert answer.A.toarray().tolist() == [[1, 2, 3], [0, 1, -1], [1, 1, 0]]
    assert answer.q.tolist() == [-1, 1, 1]
