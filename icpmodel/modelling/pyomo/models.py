"""A Pyomo model with `Complementarity` components, read as an implicit complementarity problem.

One side of a condition becomes p_i = (Az + q + f(z))_i, the other r_i, see `side_choice`. `row_order` gives every r a
variable of its own, or a further unknown. These choices do not change the answer, but the speed of the methods, for
which the diagonal of A should be large and positive, and the slope of ψ small.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp
from pyomo.common.gc_manager import PauseGC
from pyomo.core.base.block import BlockData
from pyomo.core.expr.visitor import identify_variables

from ...errors import InputError, check_arguments
from ...icp import ICP
from ...numerics.arrays import Vector, described
from ...present.display import listed
from ...problem.function import Function
from ...solve.solution import Solution
from ..affine_rows import AffineRows, SumOfTerms, obstacle
from ..inequalities import checked
from .condition_rows import ConditionRows, Side
from .nonlinear import NonlinearRows
from .side_choice import as_matrices, ordered_rows


class PyomoReading:
    """The `Reading` of a Pyomo model: z has the values of the `variables`, then the unknowns s of `row_order`.

    Attributes
    ----------
    problem : ICP
        The problem.
    owners : list
        The components of the conditions, then those of the equations.
    ordered : OrderedRows
        The rows in the order of z.
    """

    def __init__(self, rows: ConditionRows) -> None:
        self.owners = rows.owners()
        self.variables = rows.variables()
        self._columns = {id(variable): k for k, variable in enumerate(self.variables)}
        self._nonlinear = [side.nonlinear for side in rows.sides() if side.nonlinear]
        self.ordered = ordered_rows(rows, self.variables, self._columns)
        p, r, lower, upper = self.ordered[:4]
        psi = obstacle(r, lower, self._map)
        above = upper and obstacle(r, upper, self._map)
        f = self._map(0.0 * p.Z, np.zeros(p.constant.size), p.W) if p.W.nnz else None
        self.problem = ICP(p.Z, p.constant, psi, above, f)
        self._inequalities = self._read_inequalities(rows)

    def _terms(self, G: sp.csr_array, c: Vector, V: sp.csr_array) -> SumOfTerms:
        used = np.unique(V.indices)
        w = NonlinearRows([self._nonlinear[k] for k in used], self._columns)
        return SumOfTerms(G, c, sp.csr_array(V[:, used]), w, "psi of Pyomo")

    def _map(self, G: sp.csr_array, c: Vector, V: sp.csr_array) -> Function:
        terms = self._terms(G, c, V)
        return Function(terms, terms.jacobian)

    def _read_inequalities(self, rows: ConditionRows) -> tuple[AffineRows, list[tuple[Any, str]]]:
        """The inequalities of the model and the bounds of the variables, as rows that must be ≤ 0, and their names.

        A name is a component and the text after its name. Raises InputError for a variable that is in no condition, and
        for a discrete one.
        """
        sides = [side for _, side in rows.inequalities]
        names = [(constraint, "") for constraint, _ in rows.inequalities]
        for constraint, side in rows.inequalities:
            if unknown := [key for key in side.linear if key not in self._columns]:
                actual = f"{constraint.name} is an inequality in {rows.name_of(unknown[0])}, which is in no condition"
                raise InputError(f"{actual}: each variable needs a condition or an equation of its own")
        for variable in self.variables:
            if not variable.is_continuous():
                raise InputError(f"{variable.name} is in {variable.domain.name}; a continuous variable was expected")
            for sign, relation, end in zip((1.0, -1.0), (">=", "<="), variable.bounds, strict=True):
                if end is not None and np.isfinite(end):
                    names.append((variable, f" {relation} {end:g}"))
                    sides.append(Side(-sign * float(end), {id(variable): sign}))
        return as_matrices(sides, self._columns).times(np.full(len(sides), -1.0)), names

    def start(self) -> Vector:
        """z at the present values of the variables, 0 for none. Raises InputError if a row is not finite there."""
        x = np.array([variable.value or 0.0 for variable in self.variables], dtype=np.float64)
        Z, W, constant = self.ordered.replaced
        z: Vector = np.concatenate([x, self._terms(Z, constant, W)(x)])
        bad = ~np.isfinite(z)
        if not bad.any():
            r = self.problem.r(z)
            bad = ~np.isfinite(self.problem.p(z)) | np.isnan(r) | np.isneginf(r)
            if self.problem.upper is not None:
                bad |= np.isnan(self.problem.upper.value(z))
        if bad.any():
            owner = self.owners[self.ordered.sources[np.argmax(bad)]]
            expressions = getattr(owner, "_args", None) or [owner.expr]
            used = {id(one) for expression in expressions for one in identify_variables(expression)}
            at = listed([f"{one.name} = {x[k]:g}" for k, one in enumerate(self.variables) if id(one) in used])
            raise InputError(
                f"{owner.name} has no finite value at the start, where {at}: give its variables other values"
            )
        return z

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        return list(zip(self.variables, (z + 0.0).tolist(), strict=False))

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions, each with p at `z`; p of a condition a ≤ f ≤ b ⟂ g is g. Equations have none."""
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
        """`solution`, or one with another status and message if it violates an inequality or a bound of a variable."""
        rows, names = self._inequalities
        return checked(solution, rows, lambda row: f"{names[row][0].name}{names[row][1]}")


@check_arguments
def read_pyomo(model: Any) -> PyomoReading:
    """Read a Pyomo model, or block, as an ICP.

    Parameters
    ----------
    model : pyomo.environ.ConcreteModel or Block
        It has active `Complementarity` components and equality constraints, together as many as variables that are not
        fixed. Affine inequalities are only checked. An objective must be constant.

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
    with PauseGC():  # as Pyomo's writers do: many small objects come and go
        rows = ConditionRows(model)
        if not rows.owners():
            raise InputError(f"{model.name} has no active Complementarity with a free variable")
        return PyomoReading(rows)
