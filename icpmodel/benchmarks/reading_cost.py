"""What it costs to read a model written in a modelling language, against the language's own writers."""

from __future__ import annotations

import io
from collections.abc import Callable, Iterator
from typing import Any

import numpy as np
import scipy.sparse as sp

from .. import modelling
from ..icp import ICP
from ..present.table import Table
from ..problem.affine import Affine
from ..problem.elementwise import Elementwise
from ..scenes import scene
from ..study.timing import as_repeats, clocked, machine, timed

#: language, model, n, what reads the model from scratch, and what writes the same expressions for another solver
_Pair = tuple[str, str, int, Callable[[], object], Callable[[], object]]


def reading_cost(cvxpy_n: int = 1_000_000, pyomo_n: int = 100_000, repeats: int = 3) -> Table:
    """Reading CVXPY and Pyomo models of the membrane against what these languages take to write them, timed in turn.

    CVXPY: `Problem([complements(p, r)]).icp` against `get_problem_data` for OSQP with p ≥ 0, r ≥ 0; the expressions are
    built anew each time. Pyomo: `read_pyomo` against its NL writer, which gets the 2n sides as constraints, side ≥ 0,
    and is thus spared Pyomo's transformation of complementarity conditions; ψ fixed, affine, a quarter of each of two
    neighbours, and nonlinear, 0.3 sin(z_i) + c_i. The ratio is the median of the ratios pair by pair.
    Parameters: `cvxpy_n` unknowns of the CVXPY model (the nearest square); `pyomo_n` conditions of the Pyomo models;
    `repeats` pairs of timings, ≥ 3. Returns a `Table` (seconds).

    >>> icp.benchmarks.reading_cost(cvxpy_n=100, pyomo_n=100, repeats=3).heads[:5]
    ('language', 'model', 'n', 'read, s', 'its own writer, s')
    """
    repeats = as_repeats(repeats)
    rows = []
    for language, model, n, read, write in (*_cvxpy(cvxpy_n), *_pyomo(pyomo_n)):
        taken = timed({"read": clocked(read), "write": clocked(write)}, repeats, warm=False)
        medians = (taken.median("read"), taken.median("write"))
        rows.append((language, model, n, *medians, *taken.ratio("read", "write")))
    heads = ("language", "model", "n", "read, s", "its own writer, s", "ratio", "lowest", "highest")
    return Table(f"Reading a model against its language's own writer ({machine()})", heads, tuple(rows))


def _cvxpy(n: int) -> Iterator[_Pair]:
    import cvxpy as cp

    problem = scene("membrane", n).problem

    def sides() -> tuple[cp.Expression, cp.Expression]:
        z = cp.Variable(problem.n)
        return problem.A @ z + problem.q, z - problem.psi.value(problem.q)

    def read() -> ICP:
        return modelling.Problem(modelling.complements(*sides())).icp

    def write() -> object:
        return cp.Problem(cp.Minimize(0), [side >= 0 for side in sides()]).get_problem_data(cp.OSQP)

    yield "CVXPY", "fixed obstacle", problem.n, read, write


def _pyomo(n: int) -> Iterator[_Pair]:
    import pyomo.environ as pyo
    from pyomo.repn.plugins.nl_writer import NLWriter

    problem = scene("membrane", n).problem
    m, c = int(np.sqrt(problem.n)), problem.psi.value(np.zeros(problem.n))
    neighbours = sp.diags_array([0.25, 0.25], offsets=[-1, 1], shape=(m, m))
    models = {
        "fixed obstacle": problem,
        "affine psi": problem.with_psi(Affine(sp.kron(sp.eye_array(m), neighbours), c)),
        "nonlinear psi": problem.with_psi(Elementwise(lambda z: 0.3 * np.sin(z), c=c)),
    }
    for name, one in models.items():
        model, plain = one.to_pyomo(), one.to_pyomo()
        sides = [condition._args for condition in plain.complementarity.values()]
        plain.sides = pyo.Constraint(range(problem.n), [0, 1], rule=lambda _, i, k, sides=sides: sides[i][k])
        plain.complementarity.deactivate()

        def read(model: Any = model) -> object:
            return modelling.read_pyomo(model)

        def write(plain: Any = plain) -> object:
            return NLWriter().write(plain, io.StringIO())

        yield "Pyomo", name, problem.n, read, write
