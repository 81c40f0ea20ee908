"""A Pyomo model with `Complementarity` components, read as an implicit complementarity problem.

One side of a condition becomes p_i = (Az + q + f(z))_i, the other r_i, as `side_choice` says. `row_order` gives every r
a variable of its own, or a further unknown. The answer does not depend on these choices, the speed of the methods does:
they want a large positive diagonal of A and a small slope of ψ.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from pyomo.core.base.block import BlockData
from pyomo.core.expr.visitor import identify_variables

from ...errors import InputError, check_arguments
from ...icp import ICP
from ...numerics.arrays import Vector, described
from ...problem.function import Function
from ...solve.solution import Solution
from ..affine_rows import AffineRows, SumOfTerms, obstacle
from ..inequalities import checked
from ..row_order import OrderedRows
from .condition_rows import ConditionRows, Side
from .nonlinear import NonlinearRows
from .side_choice import as_matrices, list_names, ordered_rows

#: a component, and what follows its name in that of an inequality
NamedInequality = tuple[Any, str]


@dataclass(frozen=True, eq=False)
class PyomoReading:
    """A `Reading`: z has the values of the `variables`, then the unknowns s of `row_order`.

    Attributes
    ----------
    owners : tuple
        The components of the conditions, then those of the equations.
    ordered : OrderedRows
        The rows in the order of z.
    unknowns : callable
        The values of the variables ↦ s.
    inequalities : tuple
        Names and rows of what must be ≤ 0: the inequalities of the model, and the bounds of variables.
    """

    problem: ICP
    variables: tuple[Any, ...]
    owners: tuple[Any, ...]
    ordered: OrderedRows
    unknowns: Callable[[Vector], Vector]
    inequalities: tuple[list[NamedInequality], AffineRows]

    def start(self) -> Vector:
        """Raises InputError where a row has no finite value at the present values, 0 where there is none."""
        values = [0.0 if variable.value is None else variable.value for variable in self.variables]
        x = np.array(values, dtype=np.float64)
        z: Vector = np.concatenate([x, self.unknowns(x)])
        bad = ~np.isfinite(z)
        if not bad.any():
            psi = self.problem.psi.value(z)
            bad = ~(np.isfinite(psi) | np.isneginf(psi))
            if self.problem.upper is not None:
                bad |= np.isnan(self.problem.upper.value(z))
            if self.problem.f is not None:
                bad |= ~np.isfinite(self.problem.f.value(z))
        if bad.any():
            owner = self.owners[self.ordered.sources[np.argmax(bad)]]
            expressions = getattr(owner, "_args", None) or [owner.expr]
            used = {one.name for expression in expressions for one in identify_variables(expression)}
            names = [one.name for one in self.variables]
            at = list_names([f"{name} = {x[k]:g}" for k, name in enumerate(names) if name in used])
            raise InputError(
                f"{owner.name} has no finite value at the start, where {at}: give its variables other values"
            )
        return z

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        return list(zip(self.variables, (z + 0.0).tolist(), strict=False))

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions, each with p at `z`: of a condition a ≤ f ≤ b ⟂ g it is g. Equations have none."""
        p = self.ordered.sign * self.problem.p(z)[self.ordered.owned_columns]
        return list(zip(self.owners, p.tolist(), strict=False))

    def row_name(self, row: int) -> str:
        return str(self.owners[self.ordered.sources[row]].name)

    def marginals(self, z: Vector) -> list[tuple[Any, Any]]:
        """The variables of the conditions, each with p in its own direction: negative at an upper bound."""
        p = self.problem.p(z)
        columns = self.ordered.owned_columns.tolist()
        return [(self.variables[j], float(p[j])) for j in columns if j < len(self.variables)]

    def checked(self, solution: Solution) -> Solution:
        """`solution`, unless it violates an inequality, or a bound of a variable that no condition implies."""
        names, rows = self.inequalities
        return checked(solution, rows, lambda row: f"{names[row][0].name}{names[row][1]}")


@check_arguments
def read_pyomo(model: Any) -> PyomoReading:
    """Read a Pyomo model, or block, as an ICP.

    Parameters
    ----------
    model : pyomo.environ.ConcreteModel or Block
        It has active `Complementarity` components and equality constraints, as many of these as variables that are not
        fixed. Affine inequalities are only checked. There is no objective.

    Returns
    -------
    PyomoReading
        `problem` is the ICP, `start()` its z at the values of the variables, and `values(z)` the variables with their
        values at z.

    Raises
    ------
    InputError
        With the component's name, for other models.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> from pyomo.mpec import Complementarity, complements
    >>> model = pyo.ConcreteModel()
    >>> model.x = pyo.Var()
    >>> model.c = Complementarity(expr=complements(model.x >= 0, 2 * model.x >= 3))
    >>> read_pyomo(model).problem
    ICP(n=1, nnz=1, psi=Constant(0))
    """
    if not isinstance(model, BlockData):
        raise InputError(f"model is {described(model)}; a Pyomo model or block was expected")
    if not model.is_constructed():
        raise InputError(f"model {model.name} is abstract; its create_instance() was expected")
    rows = ConditionRows(model)
    if not rows.owners and not rows.equations:
        raise InputError(f"{model.name} has no active Complementarity with a free variable")
    return _reading(rows)


def _reading(rows: ConditionRows) -> PyomoReading:
    variables = rows.variables()
    columns = {id(variable): k for k, variable in enumerate(variables)}
    flat = [nonlinear for _, _, nonlinear in rows.rows() if nonlinear is not None]
    ordered = ordered_rows(rows, variables, columns)

    def sum_of_terms(G: sp.csr_array, c: Vector, V: sp.csr_array) -> SumOfTerms:
        used = np.unique(V.indices)
        w = NonlinearRows([flat[k] for k in used], columns)
        return SumOfTerms(G, c, sp.csr_array(V[:, used]), w, "psi of Pyomo")

    def nonlinear_map(G: sp.csr_array, c: Vector, V: sp.csr_array) -> Function:
        terms = sum_of_terms(G, c, V)
        return Function(terms, terms.jacobian)

    p, r, lower, upper = ordered[:4]
    psi = obstacle(r, lower, nonlinear_map)
    above = None if upper is None else obstacle(r, upper, nonlinear_map)
    f = nonlinear_map(0.0 * p.Z, np.zeros(p.constant.size), p.W) if p.W.nnz else None
    Z, W, constant = ordered.replaced
    return PyomoReading(
        problem=ICP(p.Z, p.constant, psi, above, f),
        variables=tuple(variables),
        owners=tuple(rows.all_owners()),
        ordered=ordered,
        unknowns=sum_of_terms(Z, constant, W),
        inequalities=_inequalities(rows, variables, columns),
    )


def _inequalities(
    rows: ConditionRows, variables: list[Any], columns: dict[int, int]
) -> tuple[list[NamedInequality], AffineRows]:
    """The names and rows of all that is to be checked. Raises InputError for a variable that is in no condition, and
    for a discrete one."""
    names = list[NamedInequality]()
    sides = list[Side]()
    for constraint, side in rows.inequalities:
        if unknown := [key for key in side[1] if key not in columns]:
            actual = f"{constraint.name} is an inequality in {rows.name_of(unknown[0])}, which is in no condition"
            raise InputError(f"{actual}: each variable needs a condition or an equation of its own")
        names.append((constraint, ""))
        sides.append(side)
    for variable in variables:
        if not variable.is_continuous():
            raise InputError(f"{variable.name} is in {variable.domain.name}; a continuous variable was expected")
        for sign, relation, end in zip((-1.0, 1.0), (">=", "<="), variable.bounds, strict=True):
            if end is not None and np.isfinite(end):
                names.append((variable, f" {relation} {end:g}"))
                sides.append((-sign * float(end), {id(variable): sign}, None))
    return names, as_matrices(sides, columns)
