"""An implicit complementarity problem as a Pyomo model."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..crosscheck.pyomo import affine_row
from ..errors import NotApplicable
from ..maps import Affine, Constant, Function
from ..problem import ICP
from .pyomo_reader import Obstacle


def to_pyomo(problem: ICP) -> Any:
    """`problem` as a Pyomo model: variables z[i], and complements(p_i ≥ 0, r_i ≥ 0) for every row i with an obstacle.

    A row without obstacle is the equality constraint `equation[i]`, p_i = 0. `objective` is the constant 0, without
    which some solvers do not start: every point that satisfies the conditions is a solution.
    Parameters: `problem` with a ψ that is constant, affine, or was read from a Pyomo model.
    Returns a `pyomo.environ.ConcreteModel`. Raises NotApplicable for another ψ.

    >>> model = to_pyomo(ICP([[2.0]], [-1.0], psi=3.0))
    >>> print(*model.complementarity[0]._args)
    0  <=  2.0*z[0] - 1.0 0  <=  z[0] - 3.0
    """
    import pyomo.environ as pyo
    from pyomo.mpec import Complementarity, complements

    obstacle = problem.psi.fun if isinstance(problem.psi, Function) else problem.psi
    if not isinstance(obstacle, Constant | Affine | Obstacle):
        raise NotApplicable(
            f"{problem.psi!r} is Python code, which has no Pyomo expression; constant and affine ψ have one"
        )
    model = pyo.ConcreteModel()
    model.z = pyo.Var(range(problem.n))
    bends = obstacle.expressions(list(model.z.values())) if isinstance(obstacle, Obstacle) else {}
    G = None if isinstance(obstacle, Constant) else obstacle.G
    free, c, q = np.isneginf(obstacle.c), obstacle.c.tolist(), problem.q.tolist()

    def p(i: int) -> Any:
        return affine_row(problem.A, model.z, i) + q[i]

    def r(i: int) -> Any:
        moving = 0.0 if G is None else affine_row(G, model.z, i)
        return model.z[i] - moving - bends.get(i, 0.0) - c[i]

    held = np.flatnonzero(~free).tolist()
    model.complementarity = Complementarity(held, rule=lambda _, i: complements(p(i) >= 0, r(i) >= 0))
    model.equation = pyo.Constraint(np.flatnonzero(free).tolist(), rule=lambda _, i: p(i) == 0)
    model.objective = pyo.Objective(expr=0.0)
    return model
