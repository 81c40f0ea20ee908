"""CVXPY's expressions as matrices: each is Zz + Ww(z) + constant, w being the parts that are not affine.

The affine part is what CVXPY's own compiler makes of it, once; a new value of a parameter costs one product.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Sequence
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy.atoms.affine.affine_atom import AffAtom

from ...errors import InputError
from ...numerics.arrays import Vector
from .qp_solver import cvxpy_solver

#: Z, W and the constant of some rows
AffineRows = tuple[sp.csr_array, sp.csr_array, Vector]


class Compiled:
    """The `sides`, CVXPY expressions stacked column by column, compiled for all values of their parameters.

    `variables` are those that z stacks, in this order; `atoms` the parts w, each with the variable that stands for it.
    """

    def __init__(self, sides: Sequence[cp.Expression]) -> None:
        self.atoms: dict[cp.Variable, cp.Expression] = {}
        self._model = cp.Problem(cp.Minimize(0), [_separated(side, self.atoms) == 0 for side in sides])
        self._is_dpp = self._model.is_dpp()
        self._rows = sum(side.size for side in sides)
        self._parameters = unique(x for side in sides for x in side.parameters())
        inner = unique(x for atom in self.atoms.values() for x in atom.variables())
        self.variables = unique([x for x in self._model.variables() if x not in self.atoms] + inner)

    def parameter_values(self) -> list[Any]:
        """Copies of what the parameters are now. Raises InputError where one has no value."""
        for parameter in self._parameters:
            if parameter.value is None:
                raise InputError(f"the parameter {parameter.name()} has no value; set its .value before solving")
        values = (parameter.value for parameter in self._parameters)
        return [value.toarray() if sp.issparse(value) else np.array(value) for value in values]

    def rows(self) -> AffineRows:
        """Z, W and the constant at the present values of the parameters, without stored zeros."""
        # of CVXPY's compilers the one in SciPy is the quickest for large matrices; with parameters it knows better
        backend = None if self._parameters else cp.SCIPY_CANON_BACKEND
        data, _, _ = self._model.get_problem_data(cvxpy_solver(), ignore_dpp=not self._is_dpp, canon_backend=backend)
        columns = data[cp.settings.PARAM_PROB].var_id_to_col
        M, constant = sp.csr_array(data[cp.settings.A]), -data[cp.settings.B]
        assert M.shape[0] == self._rows, "CVXPY has added rows of its own"
        M.eliminate_zeros()
        return _columns(M, self.variables, columns), _columns(M, list(self.atoms), columns), constant


def _separated(expression: cp.Expression, atoms: dict[cp.Variable, cp.Expression]) -> cp.Expression:
    """`expression` with a new variable for each largest part that is not affine; these go into `atoms`.

    CVXPY's compiler adds variables and rows for `cumsum`, which is therefore written as a product.
    """
    if expression.is_affine() and cp.cumsum not in expression.atoms():
        return expression
    if isinstance(expression, cp.cumsum) and expression.is_affine():
        return _as_product(expression)
    if isinstance(expression, AffAtom):
        found: dict[cp.Variable, cp.Expression] = {}
        inner = expression.copy([_separated(argument, found) for argument in expression.args])
        if inner.is_affine():
            atoms.update(found)
            return _separated(inner, {})
    stand_in = cp.Variable(expression.shape)
    atoms[stand_in] = expression
    return stand_in


def _as_product(cumsum: cp.cumsum) -> cp.Expression:
    """Lx with the matrix L of ones below the diagonal, along the axis of the array."""
    x, axis = _separated(cumsum.args[0], {}), cumsum.axis
    if not isinstance(axis, int):
        return np.tril(np.ones((x.size, x.size))) @ cp.vec(x, order="C")
    before, after = math.prod(x.shape[:axis]), math.prod(x.shape[axis:][1:])
    L = np.tril(np.ones((x.shape[axis], x.shape[axis])))
    along = sp.kron(sp.eye_array(after), sp.kron(L, sp.eye_array(before)))
    return cp.reshape(along @ cp.vec(x, order="F"), x.shape, order="F")


def _columns(M: sp.csr_array, variables: list[cp.Variable], columns: dict[int, int]) -> sp.csr_array:
    """The columns of `M` that belong to `variables`, in their order; zero for one that the compiled model has not."""
    none = M.shape[1]
    parts = [np.arange(x.size) + columns[x.id] if x.id in columns else np.full(x.size, none) for x in variables]
    wanted = np.concatenate(parts) if parts else np.zeros(0, dtype=np.int64)
    if np.array_equal(wanted, np.arange(none)):
        return M
    if (wanted == none).any():
        M = sp.csr_array((M.data, M.indices, M.indptr), shape=(M.shape[0], none + 1))
    return sp.csr_array(M[:, wanted])


def unique(items: Iterable[Any]) -> list[Any]:
    """Each of the `items` once, in order of appearance."""
    return list(dict.fromkeys(items))
