"""What is no implicit complementarity problem is refused with the component's name; Pyomo's own models one by one."""

import unittest

import pyomo.environ as pyo
import pytest
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


@pytest.mark.parametrize(
    ("model", "words"),
    [(None, "model is None; a Pyomo model"), (5, "model is 5"), (pyo.AbstractModel(), "is abstract")],
)
def test_what_is_no_model_is_refused(model, words):
    for read in (read_pyomo, pyo.SolverFactory("icpmodel").solve):
        with pytest.raises(icp.InputError, match=words):
            read(model)


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


#: the models of pyomo/mpec/tests/test_complementarity.py by test: what is said of each as it stands there. In most of
#: them one condition stands for four variables.
AS_THEY_STAND = {
    **dict.fromkeys(
        (
            "t1a",
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


@pytest.mark.parametrize("unit", [1e-12, 1.0, 1e12])
@pytest.mark.parametrize("kind", ["condition", "equation"])
def test_a_condition_without_free_variables_is_judged_by_its_own_terms(kind, unit):
    """The units of a row change nothing: .3 - .1 - .2 counts as 0, and 1e-3 beside it does not."""
    for off, refused in ((0.0, False), (1e-3, True)):
        model = base()
        held(model)
        model.z = pyo.Var(initialize=0.3)
        model.z.fix()
        zero = unit * (model.z - 0.1 - 0.2 + off)
        if kind == "condition":
            model.e = Complementarity(expr=complements(zero >= 0, model.z >= 0))
        else:
            model.e = pyo.Constraint(expr=zero == 0)
        if refused:
            with pytest.raises(icp.InputError, match="e has no free variable"):
                read_pyomo(model)
        else:
            assert read_pyomo(model).problem.n == 2


@pytest.mark.parametrize(
    ("expression", "words"),
    [
        (lambda model: model.x**2 <= 1, "odd is a nonlinear inequality"),
        (lambda model: model.x + model.z <= 1, "odd is an inequality in z, which is in no condition"),
    ],
)
def test_an_inequality_that_cannot_be_checked_is_refused(expression, words):
    model = base()
    held(model)
    model.z = pyo.Var()
    model.odd = pyo.Constraint(expr=expression(model))
    with pytest.raises(icp.InputError, match=words):
        read_pyomo(model)
