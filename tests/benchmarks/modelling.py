"""Reading a model against its language's own writer."""

import io
from functools import partial

import icpmodel as icp
from icpmodel import modelling

from .harness import affine, elementwise, pair, timer


def table(cvxpy_n=1_000_000, pyomo_n=100_000, repeats=3):
    """Reading CVXPY and Pyomo models of the membrane against what these languages take to write them.

    CVXPY: its data for OSQP with p ≥ 0, r ≥ 0; the expressions are built anew each time. Pyomo: its NL writer, which
    gets the 2n sides as constraints.

    Parameters
    ----------
    cvxpy_n : unknowns of the CVXPY model (the nearest square)
    pyomo_n : conditions of the Pyomo models
    repeats : pairs of timings
    """
    yield "language", "model", "n", "read, s", "its own writer, s", "ratio", "lowest", "highest"
    for language, name, problem, read, write in (*in_cvxpy(cvxpy_n), *in_pyomo(pyomo_n)):
        yield language, name, problem.n, *pair(timer(read), timer(write), repeats)


def in_cvxpy(n):
    import cvxpy as cp

    problem = icp.scenes.membrane(n=n).problem

    def sides():
        z = cp.Variable(problem.n)
        return problem.A @ z + problem.q, z - problem.psi.value(problem.q)

    def read():
        return icp.Problem(icp.complements(*sides())).icp()

    def write():
        return cp.Problem(cp.Minimize(0), [side >= 0 for side in sides()]).get_problem_data(cp.OSQP)

    yield "CVXPY", "fixed obstacle", problem, read, write


def in_pyomo(n):
    import pyomo.environ as pyo
    from pyomo.repn.plugins.nl_writer import NLWriter

    problem = icp.scenes.membrane(n=n).problem
    models = {"fixed obstacle": problem, "affine psi": affine(problem), "nonlinear psi": elementwise(problem, 0.3)}
    for name, one in models.items():
        plain = one.to_pyomo()
        sides = [condition._args for condition in plain.complementarity.values()]
        plain.sides = pyo.Constraint(range(one.n), [0, 1], rule=lambda _, i, k, sides=sides: sides[i][k])
        plain.complementarity.deactivate()
        read = partial(modelling.read_pyomo, one.to_pyomo())
        yield "Pyomo", name, one, read, lambda plain=plain: NLWriter().write(plain, io.StringIO())
