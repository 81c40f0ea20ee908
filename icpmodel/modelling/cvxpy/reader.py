"""From CVXPY's expressions to A, q and ψ.

Every r is taken apart as Rz + Ww(z) + r₀ with the affine part, to which CVXPY's own compiler is applied, and the
expressions w that are not affine. In each row one entry of z is the row's own: ρz_i − …, ρ > 0. Then
ψ_i(z) = z_i − r_i(z)/ρ, in which z_i cancels, and p's rows follow those of r.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp
from cvxpy.atoms.affine.affine_atom import AffAtom

from ...errors import InputError
from ...icp import ICP
from ...numerics.arrays import Vector, row_of
from ...problem.affine import Affine, Constant
from ...problem.function import Function
from ..matching import left_over, looks_like_r, own_entries
from .names import entry, named
from .nonlinear import Nonlinear, write
from .solver import cvxpy_solver

Sides = tuple[cp.Expression, cp.Expression]
Rows = tuple[sp.csr_array, sp.csr_array, Vector]


class Reading:
    """Pairs of expressions p ⟂ r, compiled once, as an ICP at the present values of the parameters.

    Parameters: `pairs` of CVXPY expressions, each pair of one shape. Raises InputError for what is no ICP.
    """

    def __init__(self, pairs: Sequence[Sides]) -> None:
        self._pairs = [_affine_first(pair) for pair in pairs]
        self._parameters = _unique(x for pair in pairs for side in pair for x in side.parameters())
        self._n = sum(p.size for p, _ in pairs)
        _check_variables(_unique(x for pair in pairs for side in pair for x in side.variables()), self._n)
        #: what is not affine, with the variable that stands for it
        self._atoms: dict[cp.Variable, cp.Expression] = {}
        affine = [_separated(side, self._atoms) for k in (0, 1) for side in (pair[k] for pair in self._pairs)]
        self._model = cp.Problem(cp.Minimize(0), [side == 0 for side in affine])
        self._is_dpp = self._model.is_dpp()
        self._solver = cvxpy_solver()
        inner = _unique(x for atom in self._atoms.values() for x in atom.variables())
        self.variables = _unique([x for x in self._model.variables() if x not in self._atoms] + inner)
        self._swapped: list[bool] | None = None
        self._gradient_holds: bool | None = None
        self._last: ICP | None = None
        self._last_values: list[Any] = []

    @property
    def p_and_r(self) -> list[Sides]:
        """Each pair as (p, r), once `icp` has found out which is which."""
        swapped = self._swapped or [False] * len(self._pairs)
        return [(b, a) if swap else (a, b) for (a, b), swap in zip(self._pairs, swapped, strict=True)]

    def icp(self) -> ICP:
        """The ICP, the same object until a parameter has a new value; what is known of A and ψ is kept where they stay.

        Raises InputError where a parameter has no value, or r is not z − ψ(z).
        """
        for parameter in self._parameters:
            if parameter.value is None:
                raise InputError(f"the parameter {parameter.name()} has no value; set its .value before solving")
        values = [np.array(_dense(parameter.value)) for parameter in self._parameters]
        same = (np.array_equal(a, b) for a, b in zip(values, self._last_values, strict=False))
        if self._last is None or not all(same):
            self._last, self._last_values = self._read(self._last), values
        return self._last

    def start(self) -> Vector | None:
        """The values of the variables stacked, 0 where there are none; None where no variable has one."""
        if all(x.value is None for x in self.variables):
            return None
        parts = [np.zeros(x.size) if x.value is None else np.ravel(x.value, order="F") for x in self.variables]
        return np.concatenate(parts).astype(np.float64)

    def write(self, z: Vector | None) -> None:
        """Give the variables the values that `z` stacks, or none."""
        if z is not None:
            write(self.variables, z)
            return
        for x in self.variables:
            x.save_value(None)

    def _read(self, last: ICP | None) -> ICP:
        (P, _, q), (R, W, constant) = self._compiled()
        own = own_entries(R)
        if own is None:
            raise InputError(self._misfit(R, *left_over(R)))
        if not np.array_equal(own, np.arange(self._n)):
            rows = np.argsort(own)
            P, q, R, W, constant = P[rows], q[rows], R[rows], W[rows], constant[rows]
        with np.errstate(over="ignore"):
            factor = -1.0 / R.diagonal()
            others = R.indices != row_of(R)
            data = (R.data * factor[row_of(R)])[others]
            c = constant * factor + 0.0
        G = sp.csr_array((data, (row_of(R)[others], R.indices[others])), shape=R.shape)
        psi: Any = Affine(G, c) if G.nnz else c
        if self._atoms:
            V = sp.csr_array(sp.diags_array(factor) @ W)
            nonlinear = Nonlinear(list(self._atoms.values()), self.variables, G, c, V)
            if self._gradient_holds is None:
                start = self.start()
                self._gradient_holds = nonlinear.gradient_holds(np.zeros(self._n) if start is None else start)
            psi = Function(nonlinear, nonlinear.jacobian if self._gradient_holds else None)
        if last is None or (last.A != P).nnz:
            return ICP(P, q, psi)
        unchanged = isinstance(last.psi, Constant) and not self._atoms and not G.nnz and np.array_equal(last.psi.c, c)
        return (last if unchanged else last.with_psi(psi)).with_q(q)

    def _compiled(self) -> tuple[Rows, Rows]:
        """p and r as (matrix of z, matrix of w, constant), row by row."""
        # of CVXPY's compilers the one in SciPy is the quickest for large matrices; with parameters it knows better
        backend = None if self._parameters else cp.SCIPY_CANON_BACKEND
        data, _, _ = self._model.get_problem_data(self._solver, ignore_dpp=not self._is_dpp, canon_backend=backend)
        columns = data[cp.settings.PARAM_PROB].var_id_to_col
        M, constant = sp.csr_array(data[cp.settings.A]), -data[cp.settings.B]
        assert M.shape[0] == 2 * self._n, "CVXPY has added rows of its own"
        M.eliminate_zeros()
        Z, W = _columns(M, self.variables, columns), _columns(M, list(self._atoms), columns)
        n = self._n
        if self._swapped is None:
            self._swapped = self._find_swapped(Z)
        first, second = np.arange(n), np.arange(n, 2 * n)
        if any(self._swapped):
            swap = np.repeat(self._swapped, [p.size for p, _ in self._pairs])
            first, second = np.where(swap, second, first), np.where(swap, first, second)
            Z, W, constant = (part[np.concatenate([first, second])] for part in (Z, W, constant))
        return (Z[:n], W[:n], constant[:n]), (Z[n:], W[n:], constant[n:])

    def _find_swapped(self, Z: sp.csr_array) -> list[bool]:
        """Which pairs of affine expressions were given as (r, p): where the first one looks more like z − ψ(z)."""
        swapped, done = [], 0
        for p, r in self._pairs:
            first, second = (Z[start : start + p.size] for start in (done, self._n + done))
            swapped.append(r.is_affine() and looks_like_r(first) > looks_like_r(second))
            done += p.size
        return swapped

    def _misfit(self, R: sp.csr_array, row: int, column: int) -> str:
        """The sentence on a `row` without an entry of its own, and on a `column` without a row."""
        sizes = [r.size for _, r in self.p_and_r]
        k = int(np.searchsorted(np.cumsum(sizes), row, side="right"))
        r = self.p_and_r[k][1]
        where = entry(r, row - sum(sizes[:k]))
        entries = R[[row]]
        what = f"r = {named(r)} is not z - psi(z){where}"
        if not (entries.data > 0).any():
            falls = "an entry appears with a negative factor only" if entries.nnz else "no entry of z appears linearly"
            return f"{what}: {falls}, a positive one was expected (for z <= c write the model for -z)"
        at, done = column, 0
        for x in self.variables:
            if at < done + x.size:
                break
            done += x.size
        left = f"{x.name()}{entry(x, at - done).removeprefix(' in entry ')}"
        return f"{what}: the entries of z that it has belong to other rows already, while no row belongs to {left}"


def _affine_first(pair: Sides) -> Sides:
    a, b = pair
    for side in pair:
        if side.is_complex():
            raise InputError(f"{named(side)} is complex; real expressions were expected: ICP is stated over the reals")
    if not a.is_affine() and not b.is_affine():
        raise InputError(f"neither {named(a)} nor {named(b)} is affine in the variables; p = Az + q must be")
    return (a, b) if a.is_affine() else (b, a)


def _check_variables(variables: list[cp.Variable], rows: int) -> None:
    for x in variables:
        given = [name for name, value in x.attributes.items() if value]
        if given:
            raise InputError(
                f"the variable {x.name()} has the attribute {given[0]}; z is any vector in an ICP, its bounds are "
                f"written as r, for example complements(p, {x.name()}) for {x.name()} >= 0"
            )
    unknowns = sum(x.size for x in variables)
    if rows != unknowns or not rows:
        entries = ", ".join(f"{x.name()} with {x.size}" for x in variables) or "no variables"
        raise InputError(
            f"the constraints have {rows} entries, the variables {unknowns} ({entries}); each entry of a variable "
            "needs one row p >= 0, r = z - psi(z) >= 0 of its own"
        )


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


def _dense(value: Any) -> Any:
    return value.toarray() if sp.issparse(value) else value


def _unique(items: Any) -> list[Any]:
    return list(dict.fromkeys(items))
