"""What is no implicit complementarity problem is refused with the component's name."""

import pyomo.environ as pyo
import pytest
from pyomo.mpec import Complementarity, complements

import icpmodel as icp
from icpmodel.modelling.pyomo import read_pyomo


@pytest.mark.parametrize(
    ("model", "words"),
    [(None, "model is None; a Pyomo model"), (5, "model is 5"), (pyo.AbstractModel(), "is abstract")],
)
def test_what_is_no_model_is_refused(model, words):
    for read in (read_pyomo, pyo.SolverFactory("icpmodel").solve):
        with pytest.raises(icp.InputError, match=words):
            read(model)


@pytest.mark.parametrize("place", ["c", "d"])
def test_a_parameter_without_a_value_is_named_by_its_row(place):
    model = pyo.ConcreteModel()
    model.x, model.weight = pyo.Var(), pyo.Param(mutable=True)
    model.c = Complementarity(expr=complements(model.x >= 0, (model.weight if place == "c" else 1.0) * model.x >= 3))
    if place == "d":
        model.d = pyo.Constraint(expr=model.x <= model.weight)
    with pytest.raises(icp.InputError, match=f"{place} has a number that is not finite: .* parameter without value"):
        read_pyomo(model)


@pytest.mark.parametrize("number", ["a", 1j, 10**400], ids=["text", "complex", "huge"])
@pytest.mark.parametrize(
    "expressions",
    [
        lambda x, p: (x >= 0, x >= p),
        lambda x, p: (pyo.inequality(0, x, p), x - 5),
        lambda x, p: (x >= 0, pyo.exp(x) >= p),
        lambda x, p: (x >= 0, (x + 2) ** p >= 1),
    ],
)
def test_a_parameter_that_is_no_float_is_named_by_its_row(expressions, number):
    model = pyo.ConcreteModel()
    model.x, model.p = pyo.Var(initialize=1.0), pyo.Param(initialize=number, mutable=True, within=pyo.Any)
    model.c = Complementarity(expr=complements(*expressions(model.x, model.p)))
    with pytest.raises(icp.InputError, match=r"c has a number .*that is not finite"):
        read_pyomo(model)


def test_a_parameter_that_is_nan_in_a_nonlinear_term_is_named_by_its_row():
    model = pyo.ConcreteModel()
    model.x, model.rate = pyo.Var(initialize=1.0), pyo.Param(mutable=True, initialize=float("nan"))
    model.c = Complementarity(expr=complements(model.x >= 0, model.rate * pyo.exp(model.x) >= 1))
    with pytest.raises(icp.InputError, match="c has a number in a nonlinear term that is not finite"):
        read_pyomo(model)


def test_two_conditions_of_one_variable_leave_another_without():
    model = pyo.ConcreteModel()
    model.x, model.y, model.z = pyo.Var(), pyo.Var(), pyo.Var()
    model.c = Complementarity(expr=complements(model.x >= 0, model.x >= 1))
    model.d = Complementarity(expr=complements(model.x >= 0, 3 * model.x >= 1))
    model.e = Complementarity(expr=complements(model.y >= 0, model.y >= 1))
    model.f = Complementarity(expr=complements(model.z >= model.y, model.y + model.z >= 1))
    with pytest.raises(icp.InputError, match=r"4 conditions for 3 variables .*: no free variable is left for [cd];"):
        read_pyomo(model)


@pytest.mark.parametrize("constant", [0.0, 1.0])
def test_a_variable_with_the_coefficient_0_needs_no_value(constant):
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(), pyo.Var()
    model.c = Complementarity(expr=complements(model.x - 1 == 0, model.x))
    model.e = pyo.Constraint(expr=0.0 * model.y + constant == 0)
    if constant:
        with pytest.raises(icp.InputError, match="e has no free variable"):
            read_pyomo(model)
    else:
        assert read_pyomo(model).problem.n == 1


def test_a_row_without_a_value_at_the_start_is_named_with_its_own_variables():
    model = pyo.ConcreteModel()
    model.u, model.v, model.y = pyo.Var(initialize=1.0), pyo.Var(initialize=-1.0), pyo.Var(initialize=1.0)
    model.first = pyo.Constraint(expr=pyo.log(model.v) == 0)
    model.second = pyo.Constraint(expr=pyo.log(model.u) == 0)
    model.c = Complementarity(expr=complements(model.y >= 0, model.y + model.u + model.v >= 1))
    with pytest.raises(icp.InputError, match="first has no finite value at the start, where v = -1: give"):
        pyo.SolverFactory("icpmodel").solve(model)
