"""What users see of an object: a short repr, a view in a notebook that folds, a width that fits."""

import inspect
from dataclasses import replace
from enum import Enum

import cvxpy as cp
import numpy as np
import pytest
from public_names import public_objects

import icpmodel as icp
from icpmodel.modelling.jax import SolutionFunction
from icpmodel.present import Card, Table
from icpmodel.present.display import Displayable
from icpmodel.solvers import Target
from icpmodel.study.competitors import Entry

LONG = "a very long text " * 100


@pytest.fixture(scope="module")
def objects():
    """One of every public class, with much in it where it can have."""
    scene = icp.scenes.membrane(n=400)
    words = dict.fromkeys(("name", "title", "models", "why_no_reference", "why_no_solution"), LONG)
    solution = scene.problem.solve("mnmgs", history=True)
    broken = icp.scenes.hard_jump().problem.solve(raise_on_failure=False)
    stability = icp.stability("units", points=3, n=9)
    race = icp.study.Race(
        title=LONG,
        measure="error",
        entries=tuple(Entry(f"method {k}", "own", 0.1, seconds=(1.0,), claim=LONG) for k in range(20)),
        skipped=((LONG, LONG),),
    )
    z = cp.Variable(200, name="z" * 50)
    condition = icp.complements(np.eye(200) @ z - 1, z - 0.5 * cp.minimum(z, 1))
    explained = icp.ICP(np.eye(30), np.ones(30)).explain()
    target = Target(icp.ICP(2 * np.eye(40), -np.ones(40)))
    one = icp.ICP([[2.0]], [-2.0]).solve()
    derivative = icp.Derivative(one)
    solutions = icp.all_solutions(icp.ICP(np.ones((2, 2)), [-1.0, -1.0]))
    return [
        icp.contradiction(icp.ICP([[0, -1], [1, 0]], [1, -3], upper=[2, np.inf])),
        icp.select_method(scene),
        scene,
        solutions,
        solutions.faces[0],
        icp.contact_state(icp.ICP.from_friction_index(np.eye(2), [1, -3], [0, -0.5], [np.inf, 0.5], [-1, 0]).solve()),
        replace(scene, **words, z_exact=solution.z),
        scene.problem,
        icp.scenes.by_rows("membrane", n=10**9),
        icp.scenes.by_rows("membrane", n=10**9).local_rows(0, 1000),
        solution,
        broken,
        solution.history,
        solution.certificate,
        broken.certificate,
        broken.certificate.bound,
        solution.active_set,
        icp.solve_many(np.eye(60), np.ones((50, 60))),
        icp.solve_many(-np.eye(2), np.array([[1.0, 1.0], [-1.0, 1.0]]), raise_on_failure=False),
        icp.Progress(3, np.arange(1000.0), 1.0, 0.1),
        race,
        stability,
        stability.plane,
        stability.plane.x,
        icp.study.Fields(one.problem, {"z": np.ones(1)}),
        icp.study.sensitivity(one),
        SolutionFunction(one.problem, {}, {}, True),
        derivative,
        derivative.adjoint([1.0]),
        derivative.one_sided(dq=[1.0]),
        explained,
        explained.classes,
        explained.forecasts[0],
        explained.forecasts[0].rate,
        explained.forecasts[0].checks["4.1"],
        icp.theory.Answer(None, LONG, np.arange(1000.0)),
        icp.crosscheck(one, None, ["osqp"]),
        target,
        target.qp("energy"),
        icp.solvers.Claim(np.arange(1000.0), LONG, True),
        icp.solvers.chosen_solvers(["osqp"])[0],
        icp.scenes.Quantity(3.0, lambda z: 0.0, None),
        condition,
        icp.Problem(condition),
        icp.solve_lsq(np.eye(60), np.ones(60)),
        icp.solve_qp(np.eye(300), np.ones(300)),
        Table(LONG, ("a", "b"), (("x", LONG),) * 50),
        Card({LONG: LONG}),
        icp.AOR(1.0, 0.5),
        icp.Affine(np.eye(300), np.arange(300.0)).bind(300),
        icp.Constant(np.arange(1000.0)),
        icp.Elementwise(np.tanh, lipschitz=np.ones(1000)),
        icp.Function(lambda z: 0.1 * z),
        icp.scenes.dividend(n=31).problem.psi,
        icp.Accelerated(of=icp.MNMAOR(theta1=1.25, phi=np.ones(500), phi2=np.ones(500))),
        *(icp.methods.named(name) for name in icp.methods.names()),
    ]


def public_classes():
    """Those that users name, but for enums, errors, and what Pyomo makes a class of its own."""
    for name, value in public_objects():
        if inspect.isclass(value) and not issubclass(value, Enum | BaseException) and not name.endswith("PyomoSolver"):
            yield value


def test_every_public_class_is_shown_and_has_an_object_here(objects):
    classes = set(public_classes())
    assert [one.__name__ for one in classes if not issubclass(one, Displayable)] == []
    here = [one for one in classes if not one.__module__.startswith("icpmodel.distributed")]  # those need PETSc
    assert [one.__name__ for one in here if not any(isinstance(thing, one) for thing in objects)] == []


def test_a_repr_has_less_than_500_characters_and_no_address(objects):
    for thing in objects:
        told = repr(thing)
        assert len(told) < 500, told[:500]
        # CVXPY has the last word where a condition is a constraint as well
        assert told.startswith(type(thing).__name__) or " object at" not in told or isinstance(thing, cp.Constraint)


def test_a_notebook_shows_it_in_lines_that_fold(objects):
    """Preformatted text wraps, and a table scrolls in its own box."""
    for thing in objects:
        page = thing._repr_html_()
        assert page.count("<pre") == page.count('<pre style="white-space: pre-wrap; overflow-wrap: anywhere"'), page
        assert "<pre" in page or "<table" in page
        assert " object at 0x" not in page
