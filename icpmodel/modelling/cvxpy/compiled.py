"""Write CVXPY expressions as Zz + Ww(z) + constant, where w are their atoms, the parts that are not affine.

CVXPY's own compiler compiles the affine part once; a new value of a parameter costs one product.
"""

from __future__ import annotations

import math
import operator
import warnings
from collections.abc import Sequence
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy.atoms.affine.affine_atom import AffAtom
from cvxpy.atoms.affine.hstack import Hstack
from cvxpy.expressions.leaf import Leaf

from ...errors import InputError
from ..affine_rows import AffineRows
from .atoms import copied, unique, value_of
from .qp_solver import cvxpy_solver


class CompiledExpressions:
    """The `sides`, stacked column by column, compiled for all values of their parameters.

    z stacks the `variables` in this order. `atoms` maps new variables to the parts w that they replace. `is_dpp` tells
    whether compiling once is enough.
    """

    def __init__(self, sides: Sequence[cp.Expression]) -> None:
        self.sides, self.atoms = list(sides), dict[cp.Variable, cp.Expression]()
        parts = [_separate_atoms(side, self.atoms) for side in sides]
        self.parameters = unique(x for side in sides for x in side.parameters())
        inner = (x for part in (*parts, *self.atoms.values()) for x in part.variables())
        self.variables = unique(x for x in inner if x not in self.atoms)
        # CVXPY would add rows for the attributes of a variable
        plain = {id(x): cp.Variable(x.shape) for x in self.variables}
        # the rows of the variables alone show which columns they have
        parts = [*(copied(part, plain) for part in parts), *plain.values(), *self.atoms]
        self._model = cp.Problem(cp.Minimize(0), [part == 0 for part in parts])
        self.is_dpp = self._model.is_dpp()

    def parameter_values(self) -> list[Any]:
        """Copies of the present values of the parameters. Raises InputError if one has no value."""
        values = [value_of(parameter) for parameter in self.parameters]
        for parameter, value in zip(self.parameters, values, strict=True):
            if value is None:
                raise InputError(f"the parameter {parameter.name()} has no value; set its .value before solving")
        return values

    def rows(self) -> AffineRows:
        """The rows of all sides at the present values of the parameters, without stored zeros."""
        # the SciPy backend of CVXPY is the quickest for large matrices; with parameters CVXPY chooses better
        backend = None if self.parameters else cp.SCIPY_CANON_BACKEND
        solver = cvxpy_solver()
        ignore = not self.is_dpp
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning):  # of how CVXPY reads sparse parameters
            try:
                data, *_ = self._model.get_problem_data(solver, ignore_dpp=ignore, canon_backend=backend)
            except ValueError:  # diag(X) @ c fails in the SciPy backend, which the model would keep
                self._model = cp.Problem(self._model.objective, self._model.constraints)
                data, *_ = self._model.get_problem_data(solver, ignore_dpp=ignore)
        M = sp.csr_array(data[cp.settings.A])
        m = sum(side.size for side in self.sides)
        n = sum(x.size for x in self.variables)
        columns = M.indices[M.indptr[m] :]
        assert M.shape[0] == m + n + sum(x.size for x in self.atoms), "CVXPY has added rows of its own"
        M = M[:m]
        M.eliminate_zeros()
        Z, W = (M[:, part] for part in (columns[:n], columns[n:]))
        return AffineRows(Z, W, -data[cp.settings.B][:m])


def _separate_atoms(expression: cp.Expression, atoms: dict[cp.Variable, cp.Expression]) -> cp.Expression:
    """`expression` with a new variable for each largest part that is not affine. Adds these parts to `atoms`.

    CVXPY's compiler adds variables and rows for `cumsum`, which is therefore written as a product, and takes the wrong
    axis for `hstack` of arrays with three axes.
    """
    if isinstance(expression, Leaf):
        return expression
    if not isinstance(expression, AffAtom) and not expression.variables():
        return expression if expression.parameters() else cp.Constant(expression.value)
    if isinstance(expression, cp.cumsum) and expression.is_affine():
        return _as_product(expression, atoms)
    if isinstance(expression, Hstack) and expression.ndim > 2:
        expression = cp.concatenate(expression.args, axis=1)
    if isinstance(expression, AffAtom):
        nested: dict[cp.Variable, cp.Expression] = {}
        arguments = [_separate_atoms(argument, nested) for argument in expression.args]
        is_same = all(map(operator.is_, arguments, expression.args))
        inner = expression if is_same else expression.copy(arguments)
        if inner.is_affine():
            atoms.update(nested)
            return inner if is_same else _separate_atoms(inner, {})
    stand_in = cp.Variable(expression.shape)
    atoms[stand_in] = expression
    return stand_in


def _as_product(cumsum: cp.cumsum, atoms: dict[cp.Variable, cp.Expression]) -> cp.Expression:
    """`cumsum` as a product Lx along its axis, where L has ones on and below the diagonal. Adds to `atoms`."""
    x = _separate_atoms(cumsum.args[0], atoms)
    axis: Any = cumsum.axis
    if axis is None:
        x = cp.vec(x, order="C")
        axis = 0
    before = math.prod(x.shape[:axis])
    after = math.prod(x.shape[axis:][1:])
    L = np.tril(np.ones((x.shape[axis], x.shape[axis])))
    along = sp.kron(sp.eye_array(after), sp.kron(L, sp.eye_array(before)))
    return cp.reshape(along @ cp.vec(x, order="F"), x.shape, order="F")
