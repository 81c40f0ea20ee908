"""CVXPY's expressions taken apart: each is Zz + Ww(z) + constant, w being its atoms, the parts that are not affine.

The affine part is what CVXPY's own compiler makes of it, once; a new value of a parameter costs one product.
"""

from __future__ import annotations

import math
import operator
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
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
    """The `sides`, stacked column by column, compiled for all values of their parameters. `variables` are those that z
    stacks, in this order; `atoms` the parts w by the variable that stands for each; `is_dpp` whether once is enough."""

    def __init__(self, sides: Sequence[cp.Expression]) -> None:
        self.sides, self.atoms = list(sides), dict[cp.Variable, cp.Expression]()
        parts = [_separate_atoms(side, self.atoms) for side in sides]
        # CVXPY would add rows for what it knows of a variable
        bound = unique(x for part in parts for x in part.variables() if any(x.attributes.values()))
        self._plain = {x: cp.Variable(x.shape, name=x.name()) for x in bound}
        copies: dict[int, Any] = {id(x): plain for x, plain in self._plain.items()}
        self._model = cp.Problem(cp.Minimize(0), [(copied(part, copies) if copies else part) == 0 for part in parts])
        self.is_dpp = self._model.is_dpp()
        self._rows = sum(side.size for side in sides)
        self.parameters = unique(x for side in sides for x in side.parameters())
        inner = unique(x for atom in self.atoms.values() for x in atom.variables())
        known = {plain: x for x, plain in self._plain.items()}
        compiled = [known.get(x, x) for x in self._model.variables()]
        self.variables = unique([x for x in compiled if x not in self.atoms] + inner)

    def parameter_values(self) -> list[Any]:
        """Copies of what the parameters are now. Raises InputError where one has no value."""
        values = [value_of(parameter) for parameter in self.parameters]
        for parameter, value in zip(self.parameters, values, strict=True):
            if value is None:
                raise InputError(f"the parameter {parameter.name()} has no value; set its .value before solving")
        return values

    def rows(self) -> AffineRows:
        """They, at the present values of the parameters, without stored zeros."""
        # the SciPy backend of CVXPY is the quickest for large matrices; with parameters CVXPY chooses better
        backend = None if self.parameters else cp.SCIPY_CANON_BACKEND
        solver = cvxpy_solver()
        ignore = not self.is_dpp
        # CVXPY warns of the way in which it reads sparse parameters
        is_sparse = any(parameter.attributes["sparsity"] for parameter in self.parameters)
        with warnings.catch_warnings(action="ignore", category=RuntimeWarning) if is_sparse else nullcontext():
            try:
                data, *_ = self._model.get_problem_data(solver, ignore_dpp=ignore, canon_backend=backend)
            except ValueError:  # of diag(X) @ c in the SciPy backend, which the model would keep
                self._model = cp.Problem(self._model.objective, self._model.constraints)
                data, *_ = self._model.get_problem_data(solver, ignore_dpp=ignore)
        columns = data[cp.settings.PARAM_PROB].var_id_to_col
        M = sp.csr_array(data[cp.settings.A])
        constant = -data[cp.settings.B]
        assert M.shape[0] == self._rows, "CVXPY has added rows of its own"
        M.eliminate_zeros()
        variables = [self._plain.get(x, x) for x in self.variables]
        Z, W = (_columns(M, part, columns) for part in (variables, list(self.atoms)))
        return AffineRows(Z, W, constant)


def _separate_atoms(expression: cp.Expression, atoms: dict[cp.Variable, cp.Expression]) -> cp.Expression:
    """`expression` with a new variable for each largest part that is not affine; these go into `atoms`. CVXPY's
    compiler adds variables and rows for `cumsum`, which is therefore written as a product, and takes the wrong axis
    for `hstack` of three axes."""
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
    """Lx with the matrix L of ones below the diagonal, along the axis of the array."""
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


def _columns(M: sp.csr_array, variables: list[cp.Variable], columns: dict[int, int]) -> sp.csr_array:
    """The columns of `M` that belong to `variables`, in their order; zero for one that the compiled model has not."""
    none = M.shape[1]
    parts = [np.arange(x.size) + columns[x.id] if x.id in columns else np.full(x.size, none) for x in variables]
    selected = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
    if np.array_equal(selected, np.arange(none)):
        return M
    if (selected == none).any():
        M = sp.csr_array((M.data, M.indices, M.indptr), shape=(M.shape[0], none + 1))
    return sp.csr_array(M[:, selected])
