"""Implicit complementarity problems written with CVXPY's variables, parameters and expressions."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

import cvxpy as cp
import numpy as np
from cvxpy.atoms.affine.promote import promote
from cvxpy.constraints.nonpos import Inequality
from cvxpy.constraints.zero import Equality, Zero

from ...crosscheck.report import Report
from ...errors import InputError, NotSolved
from ...icp import ICP
from ...methods.contract import Method
from ...numerics.arrays import described
from ...present.shown import Shown, cut
from ...solve.solution import Solution
from ..reading import solved
from .compiled import named
from .expressions import CvxpyReading


class Complementarity(Shown):
    """p ≥ 0, r ≥ 0, pᵀr = 0, entry by entry, between two CVXPY expressions of one shape; `complements` makes it.

    `sides` the two as they were given; `bounds` what bounds r below and above, each an expression or None: 0 below, and
    nothing above. After a solve `p` and `r` are their values, in the shape of the expressions: each is the multiplier
    of the other one's sign, p > 0 where r is at its lower bound, p < 0 where it is at its upper one. Before, and after
    a solve that failed, they are None.

    >>> import cvxpy as cp
    >>> z = cp.Variable(2)
    >>> contact = icp.complements(2 * z - [2, -2], z)
    >>> _ = icp.Problem([contact]).solve()
    >>> z.value, contact.p, contact.r
    (array([1., 0.]), array([0., 2.]), array([1., 0.]))
    """

    def __init__(
        self,
        first: cp.Expression,
        second: cp.Expression,
        bounds: tuple[cp.Expression | None, cp.Expression | None] = (None, None),
    ) -> None:
        self.sides, self.bounds = (first, second), bounds
        self.p: np.ndarray | None = None
        self.r: np.ndarray | None = None

    @property
    def is_bounded(self) -> bool:
        """Whether r has other bounds than 0 below and nothing above, and p any sign.

        >>> import cvxpy as cp
        >>> z = cp.Variable()
        >>> icp.complements(z - 1, z).is_bounded, icp.complements(z - 1, z, upper=3).is_bounded
        (False, True)
        """
        return any(bound is not None for bound in self.bounds)

    def __repr__(self) -> str:
        bounds = zip(("lower", "upper"), self.bounds, strict=True)
        told = "".join(f", {name}={named(bound)}" for name, bound in bounds if bound is not None)
        return cut(f"complements({named(self.sides[0])}, {named(self.sides[1])}{told}", 480) + ")"


def complements(p: Any, r: Any, *, lower: Any = 0.0, upper: Any = None) -> Complementarity:
    """The constraint p ≥ 0 ⟂ r ≥ 0 of a `Problem`: p = Az + q affine, r = z − ψ(z). With bounds l = `lower` and u =
    `upper` of r it is l ≤ r ≤ u, p_i ≥ 0 where r_i = l_i, p_i ≤ 0 where r_i = u_i, and p_i = 0 in between.

    Parameters: `p` and `r`, CVXPY expressions of one shape; `lower` and `upper`, expressions or numbers for all entries
    or of the shape of r, −inf, +inf or None for none. Where only one of p and r can be r, because the other is not
    affine, or does not have one entry of z for itself in each row, their order does not matter, unless r has bounds.
    Returns a `Complementarity`. Raises InputError where they are no such expressions.
    Reference: Dirkse and Ferris, Optim. Methods Softw. 5 (1995), for mixed complementarity.

    >>> import cvxpy as cp
    >>> z = cp.Variable(2, name="z")
    >>> icp.complements(2 * z - 1, z - 3)
    complements(2.0 * z + -1.0, z + -3.0)
    >>> box = icp.complements(z - [3, 0.5], z, upper=1)
    >>> icp.Problem(box).solve().z, box.p
    (array([1. , 0.5]), array([-2.,  0.]))
    """
    p, r = _expression(p, "p"), _expression(r, "r")
    if p.shape != r.shape:
        found = f"p = {named(p)} has shape {p.shape}, r = {named(r)} {r.shape}"
        raise InputError(f"complements(p, r) goes entry by entry: {found}")
    is_zero = not isinstance(lower, cp.Expression) and np.ndim(lower) == 0 and lower == 0
    below = None if is_zero else _bound(-np.inf if lower is None else lower, "lower", r)
    return Complementarity(p, r, (below, None if upper is None else _bound(upper, "upper", r)))


def _bound(value: Any, name: str, r: cp.Expression) -> cp.Expression:
    """`value` as an expression of the shape of r."""
    bound = _expression(value, name)
    if bound.shape == r.shape:
        return bound
    if bound.is_scalar():
        return promote(bound if bound.shape == () else cp.reshape(bound, (), order="F"), r.shape)
    found = f"{name} = {named(bound)} has shape {bound.shape}, r = {named(r)} {r.shape}"
    raise InputError(f"complements(p, r) goes entry by entry: {found}")


def _expression(side: Any, name: str) -> cp.Expression:
    if isinstance(side, cp.Constraint):
        advice = "give the expressions p and r without >= 0, and other bounds of r as lower and upper"
        raise InputError(f"complements was given the constraint {side} as {name}; {advice}")
    if isinstance(side, cp.Expression):
        return side
    try:
        if not isinstance(side, str | None):  # CVXPY would make NaN of None, and 1.0 of "1"
            return cp.Expression.cast_to_const(side)
    except Exception:
        pass
    raise InputError(f"complements was given {described(side)} as {name}; a CVXPY expression was expected")


class Problem(Shown):
    """An ICP in CVXPY's terms: find z, all variables of the constraints, with every p ≥ 0 ⟂ r ≥ 0.

    Parameters: `constraints`, one or a list of `complements(p, r)` and of equations p == 0, affine ones. Over all of
    them every entry of every variable needs one row of its own, r = z − ψ(z) or an equation (any of them), so that
    there are as many rows as unknowns. p is affine; ψ, and bounds of r, any CVXPY expression, convex, concave or
    neither (minimum, exp, log, power, norms, …), of which `.grad` gives the derivative. A row az − ψ is divided by a;
    where a < 0, r ≥ 0 is an obstacle above z. Variables have any shape and no attributes. Parameters may stand
    anywhere; CVXPY compiles the model once, and a new value costs one product (unless it is not DPP: then it is
    compiled anew). A multiplier is a variable like any other; an equation has none of its own.

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
    >>> x, force = cp.Variable(2), cp.Variable()
    >>> _ = icp.Problem([icp.complements(x - [2, 1] - force, x, upper=0.75), cp.sum(x) == 1]).solve()
    >>> x.value.round(6), float(force.value.round(6))
    (array([0.75, 0.25]), -0.75)
    """

    def __init__(self, constraints: Any) -> None:
        if isinstance(constraints, Complementarity | cp.Constraint):
            constraints = [constraints]
        wanted = "complements(p, r) and equations p == 0"
        if not isinstance(constraints, list | tuple):
            raise InputError(f"constraints is {described(constraints)}; a list of {wanted} was expected")
        for k, constraint in enumerate(constraints):
            if isinstance(constraint, Inequality):
                advice = "bounds of r belong to its condition, as complements(p, r, lower=..., upper=...)"
                raise InputError(f"constraints[{k}] is the inequality {constraint}, which has no p; {advice}")
            if not isinstance(constraint, Complementarity | Equality | Zero):
                raise InputError(f"constraints[{k}] is {constraint}; {wanted} were expected")
        self.constraints = list(constraints)
        self.solution: Solution | None = None
        self._conditions = [one for one in self.constraints if isinstance(one, Complementarity)]
        equations = [one.expr for one in self.constraints if not isinstance(one, Complementarity)]
        self._reading = CvxpyReading(self._conditions, equations)

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
        for condition in self._conditions:
            condition.p = condition.r = None
        if solution.solved:
            for condition, p in reading.multipliers(solution.z):
                condition.p, condition.r = p, condition.sides[1].value
            for condition, r in reading.distances(solution.z):
                condition.r = r
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
        return f"Problem([{cut(', '.join(map(str, self.constraints)), 400)}])"
