"""Implicit complementarity problems written with CVXPY's variables, parameters and expressions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cvxpy as cp
import numpy as np

from ...crosscheck.report import Report
from ...errors import InputError, NotSolved
from ...icp import ICP
from ...methods.contract import Method
from ...numerics.arrays import described
from ...solve.solution import Solution
from ..reading import solved
from .compiled import named
from .expressions import CvxpyReading


class Complementarity:
    """p ≥ 0, r ≥ 0, pᵀr = 0, entry by entry, between two CVXPY expressions of one shape; `complements` makes it.

    `sides` the two as they were given. After a solve `p` and `r` are their values, in the shape of the expressions:
    each is the multiplier of the other one's sign. Before, and after a solve that failed, they are None.

    >>> import cvxpy as cp
    >>> z = cp.Variable(2)
    >>> contact = icp.complements(2 * z - [2, -2], z)
    >>> _ = icp.Problem([contact]).solve()
    >>> z.value, contact.p, contact.r
    (array([1., 0.]), array([0., 2.]), array([1., 0.]))
    """

    def __init__(self, first: cp.Expression, second: cp.Expression) -> None:
        self.sides = (first, second)
        self.p: np.ndarray | None = None
        self.r: np.ndarray | None = None

    def __repr__(self) -> str:
        return f"complements({named(self.sides[0])}, {named(self.sides[1])})"


def complements(p: Any, r: Any) -> Complementarity:
    """The constraint p ≥ 0 ⟂ r ≥ 0 of a `Problem`: p = Az + q affine, r = z − ψ(z).

    Parameters: `p` and `r`, CVXPY expressions of one shape. Where only one of them can be r, because the other is not
    affine, or does not have one entry of z for itself in each row, their order does not matter.
    Returns a `Complementarity`. Raises InputError where they are no such expressions.

    >>> import cvxpy as cp
    >>> z = cp.Variable(2, name="z")
    >>> icp.complements(2 * z - 1, z - 3)
    complements(2.0 * z + -1.0, z + -3.0)
    """
    p, r = _expression(p), _expression(r)
    if p.shape != r.shape:
        found = f"p = {named(p)} has shape {p.shape}, r = {named(r)} {r.shape}"
        raise InputError(f"complements(p, r) goes entry by entry: {found}")
    return Complementarity(p, r)


def _expression(side: Any) -> cp.Expression:
    if isinstance(side, cp.Constraint):
        raise InputError(f"complements was given the constraint {side}; give the two expressions p and r without >= 0")
    if isinstance(side, cp.Expression):
        return side
    try:
        if side is not None:  # CVXPY would make NaN of it
            return cp.Expression.cast_to_const(side)
    except Exception:
        pass
    raise InputError(f"complements was given {described(side)}; CVXPY expressions were expected")


class Problem:
    """An ICP in CVXPY's terms: find z, all variables of the constraints, with every p ≥ 0 ⟂ r ≥ 0.

    Parameters: `constraints`, one or a list of `complements(p, r)`. Over all of them every entry of every variable
    needs one row r = z − ψ(z) of its own, so that there are as many rows as unknowns. p is affine; ψ any CVXPY
    expression, convex, concave or neither (minimum, exp, log, power, norms, …), of which `.grad` gives the derivative.
    A row az − ψ with a > 0 is divided by a. Variables have any shape and no attributes. Parameters may stand anywhere;
    CVXPY compiles the model once, and a new value costs one product (unless it is not DPP: then it is compiled anew).

    z stacks the variables in the order of `variables`, each column by column. Raises InputError for a model that is not
    of this form, with the expression and the reason.
    Reference: Diamond and Boyd, J. Mach. Learn. Res. 17 (2016); Agrawal et al., Differentiable convex optimization
    layers (2019), for DPP.

    >>> import cvxpy as cp
    >>> z, load = cp.Variable(2), cp.Parameter(2)
    >>> pair = icp.complements(np.array([[2, -1], [-1, 2]]) @ z - load, z - 0.3 * cp.minimum(z, 1))
    >>> problem = icp.Problem(pair)
    >>> for load.value in ([1, -3], [4, 4]):
    ...     _ = problem.solve()
    ...     print(z.value.round(6) + 0.0)
    [0.5 0. ]
    [4. 4.]
    """

    def __init__(self, constraints: Complementarity | Iterable[Complementarity]) -> None:
        if isinstance(constraints, Complementarity):
            constraints = [constraints]
        if not isinstance(constraints, list | tuple):
            raise InputError(f"constraints is {described(constraints)}; a list of complements(p, r) was expected")
        for k, constraint in enumerate(constraints):
            if not isinstance(constraint, Complementarity):
                raise InputError(f"constraints[{k}] is {constraint}; complements(p, r) was expected")
        self.constraints = list(constraints)
        self.solution: Solution | None = None
        self._reading = CvxpyReading(self.constraints)

    @property
    def variables(self) -> list[cp.Variable]:
        """The variables in the order in which z stacks them.

        >>> x, y = cp.Variable(2, name="x"), cp.Variable(name="y")
        >>> icp.Problem([icp.complements(y + 1, y), icp.complements(x - y, x)]).variables
        [Variable((), y), Variable((2,), x)]
        """
        return list(self._reading.variables)

    @property
    def icp(self) -> ICP:
        """The ICP at the present values of the parameters. Raises InputError where a parameter has none.

        >>> z = cp.Variable(2)
        >>> icp.Problem(icp.complements(z - 1, 2 * z - 6)).icp
        ICP(n=2, nnz=2, psi=Constant(3))
        """
        return self._reading.problem

    def solve(
        self, method: str | Method | None = None, *, z0: Any = None, raise_on_failure: bool = True, **options: Any
    ) -> Solution:
        """Solve it and write the values to the variables and constraints; the options are those of `icpmodel.solve`.

        Parameters: `method` a name, a `Method` or None; `z0` the start, by default the values that the variables have
        (0 where they have none), so that a series starts each problem from the answer before.
        Returns the `Solution`, which is also kept in `solution`. Raises NotSolved where the run fails, unless
        `raise_on_failure` is False; the variables then have no values, and `solution.z` is the best iterate.

        >>> z = cp.Variable()
        >>> icp.Problem(icp.complements(2 * z - 3, z - cp.exp(z - 3))).solve("newton").z.round(6), float(z.value)
        (array([1.5]), 1.5)
        """
        reading = self._reading
        self.solution = solution = solved(reading, method, z0=z0, **options)
        for variable, value in reading.values(solution.z):
            variable.save_value(value if solution.solved else None)
        for constraint in self.constraints:
            constraint.p = constraint.r = None
        if solution.solved:
            for constraint, p in reading.multipliers(solution.z):
                constraint.p = p
            for constraint, r in reading.distances(solution.z):
                constraint.r = r
        elif raise_on_failure:
            raise NotSolved(solution)
        return solution

    def crosscheck(
        self,
        solvers: Iterable[str] | None = None,
        *,
        atol: float | None = None,
        time_limit: float = 60.0,
        progress: bool = False,
    ) -> Report:
        """Have independent solvers check the answer of the last `solve`; `icpmodel.crosscheck.crosscheck` says how.

        It solves first where the parameters have changed since, or nothing was solved.

        >>> z = cp.Variable(2)
        >>> icp.Problem(icp.complements(2 * z - [1, -1], z)).crosscheck(["osqp"]).agrees
        True
        """
        icp = self.icp
        if self.solution is None or self.solution.problem is not icp:
            self.solve(raise_on_failure=False)
        return icp.crosscheck(self.solution, solvers, atol=atol, time_limit=time_limit, progress=progress)

    def __repr__(self) -> str:
        return f"Problem({self.constraints})"
