"""A Pyomo model with `Complementarity` components, read as an implicit complementarity problem.

Every row has two sides and owns one variable x_j. One side, the affine one if there is one, becomes
p_i = (Az + q + f(z))_i. The other becomes r_i = z_i − ψ_i(z), divided by the size of its own coefficient. The sign of
z_i = ±x_j is such that z_i has a positive coefficient. The answer does not depend on these choices, the speed of the
methods does: they want a large positive diagonal of A and a small slope of ψ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from pyomo.core.base.block import BlockData

from ...errors import InputError, check_arguments
from ...icp import ICP
from ...numerics.arrays import Vector, described
from ...problem.function import Function
from ...solve.solution import Solution
from ..affine_rows import SumOfTerms, obstacle
from ..inequalities import checked
from .condition_rows import ConditionRows, Side
from .nonlinear import NonlinearRows
from .ownership import Ownership

#: a component, and what follows its name in that of an inequality
NamedInequality = tuple[Any, str]


@dataclass(frozen=True, eq=False)
class PyomoReading:
    """A `Reading`: z_i = `signs`[i] · `variables`[i]; `owners`[i] is the Complementarity or Constraint of row i.

    Attributes
    ----------
    added : dict
        A condition with two bounds on one side may have two rows, one after the other. The number of the first →
        that of the two that owns the λ of `ConditionRows`.
    equation : array of bool, shape (n,)
        Whether a row is an equation.
    which_r, scale : array of shape (n,)
        The side of a row that is r, and the number by which it was divided.
    inequalities : tuple
        Names, Z and c of Zz + c ≤ 0: those of the model, and the bounds of variables.
    """

    problem: ICP
    variables: tuple[Any, ...]
    signs: Vector
    owners: tuple[Any, ...]
    equation: np.ndarray
    added: dict[int, int]
    which_r: np.ndarray
    scale: Vector
    inequalities: tuple[list[NamedInequality], sp.csr_array, Vector]

    def start(self) -> Vector:
        """Raises InputError where a condition has no finite value at the present values, 0 where there is none."""
        values = [0.0 if variable.value is None else variable.value for variable in self.variables]
        z: Vector = self.signs * np.array(values, dtype=np.float64)
        bad = ~np.isfinite(z)
        if not bad.any():
            psi = self.problem.psi.value(z)
            upper = self.problem.upper
            bad = ~(np.isfinite(psi) | np.isneginf(psi))
            if upper is not None:
                bad |= np.isnan(upper.value(z))
        if bad.any():
            row = int(np.argmax(bad))
            at = f"{self.variables[row].name} = {self.signs[row] * z[row] + 0.0:g}"
            fault = f"has no finite value at the start, where {at}: give its variables other values"
            raise InputError(f"{self.owners[row].name} {fault}")
        return z

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        added = set(self.added.values())
        pairs = zip(self.variables, (self.signs * z + 0.0).tolist(), strict=True)
        return [pair for row, pair in enumerate(pairs) if row not in added]

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions, each with p at `z`: of a condition a ≤ f ≤ b ⟂ g it is g. Equations have none."""
        return [(owner, p) for owner, p, _, _ in self._forces(z)]

    def row_name(self, row: int) -> str:
        return str(self.owners[row].name)

    def marginals(self, z: Vector) -> list[tuple[Any, Any]]:
        """The variables of the conditions, each with p in its own direction: negative at an upper bound."""
        return [(variable, sign * p) for _, p, variable, sign in self._forces(z)]

    def _forces(self, z: Vector) -> list[tuple[Any, float, Any, float]]:
        p = self.problem.p(z)
        r = self.problem.r(z)
        forces = []
        skipped = {row + 1 for row in self.added} | set(np.flatnonzero(self.equation).tolist())
        for row, owner in enumerate(self.owners):
            if row in skipped:
                continue
            row_of_variable = row
            force = float(p[row])
            sign = float(self.signs[row])
            if row in self.added:
                added = self.added[row]
                row_of_variable = 2 * row + 1 - added
                sign = 1.0
                side_1 = p[row] if self.which_r[row] == 0 else r[row] * self.scale[row]
                force = float(side_1 - self.signs[added] * z[added])
            forces.append((owner, force, self.variables[row_of_variable], sign))
        return forces

    def checked(self, solution: Solution) -> Solution:
        """`solution`, unless it violates an inequality, or a bound of a variable that no condition implies."""
        names, Z, constant = self.inequalities
        return checked(solution, Z, constant, lambda row: f"{names[row][0].name}{names[row][1]}") if names else solution


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
    if not rows.owners:
        raise InputError(f"{model.name} has no active Complementarity with a free variable")
    return _reading(rows, Ownership(rows))


def _reading(rows: ConditionRows, owned: Ownership) -> PyomoReading:
    """The ICP in which row i has the variable own[i], and its side which_r[i] is r."""
    p, r, free = owned.p, owned.r, owned.free
    p = p.times(np.where(free & (p.Z.diagonal() < 0), -1.0, 1.0))
    with_obstacle = np.flatnonzero(~free)
    r = r.of(with_obstacle).spread(with_obstacle, free.size, np.inf)

    def nonlinear_map(G: sp.csr_array, c: Vector, V: sp.csr_array) -> Function:
        used = np.unique(V.indices)
        w = NonlinearRows([owned.flat[k] for k in used], owned.row_of, owned.signs)
        psi = SumOfTerms(G, c, sp.csr_array(V[:, used]), w, "psi of Pyomo")
        return Function(psi, psi.jacobian)

    upper = None
    if rows.widths:
        width = owned.in_z(list(rows.widths.values()))
        upper = obstacle(r, width.spread(np.array(list(rows.widths)), free.size, np.inf), nonlinear_map)
    f = nonlinear_map(0.0 * p.Z, np.zeros(free.size), p.W) if p.W.nnz else None
    own = r.Z.diagonal()
    return PyomoReading(
        problem=ICP(p.Z, p.constant, obstacle(r, None, nonlinear_map), upper, f),
        variables=tuple(owned.variables[j] for j in owned.owned_columns),
        signs=owned.signs,
        owners=tuple(rows.owners),
        equation=np.array(rows.equation),
        added={row: owned.row_of[id(multiplier)] for row, multiplier in rows.multipliers.items()},
        which_r=owned.which_r,
        scale=np.where(own == 0, 1.0, own),
        inequalities=_inequalities(rows, owned),
    )


def _inequalities(rows: ConditionRows, owned: Ownership) -> tuple[list[NamedInequality], sp.csr_array, Vector]:
    """The names, Z and c of all that is to be checked: Zz + c ≤ 0. Raises InputError for a variable that is in no
    condition, and for a discrete one."""
    names = list[NamedInequality]()
    sides = list[Side]()
    for constraint, constant, linear in rows.inequalities:
        if unknown := [key for key in linear if key not in owned.row_of]:
            actual = f"{constraint.name} is an inequality in {rows.name_of(unknown[0])}, which is in no condition"
            raise InputError(f"{actual}: each variable needs a condition or an equation of its own")
        names.append((constraint, ""))
        sides.append((constant, linear, None))
    for j in owned.owned_columns.tolist():
        variable = owned.variables[j]
        if not variable.is_continuous():
            raise InputError(f"{variable.name} is in {variable.domain.name}; a continuous variable was expected")
        for sign, relation, end in zip((-1.0, 1.0), (">=", "<="), variable.bounds, strict=True):
            if end is not None and np.isfinite(end):
                names.append((variable, f" {relation} {end:g}"))
                sides.append((-sign * float(end), {id(variable): sign}, None))
    checked = owned.in_z(sides)
    return names, checked.Z, checked.constant
