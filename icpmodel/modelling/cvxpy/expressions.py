"""Pairs of CVXPY's expressions read as A, q and ψ.

Every r is taken apart as Rz + Ww(z) + r₀, w being what is not affine. In each row one entry of z is the row's own:
ρz_i − …, ρ > 0. Then ψ_i(z) = z_i − r_i(z)/ρ, in which z_i cancels, and p's rows follow those of r.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp

from ...errors import InputError
from ...icp import ICP
from ...numerics.arrays import Vector, row_of
from ...problem.affine import Affine
from ...problem.function import Function
from ..matching import looks_like_r, own_entries, unowned
from .compiled import AffineRows, AtomObstacle, Compiled, at, named, unique, unstacked


class CvxpyReading:
    """The `conditions`, compiled once: a `Reading`. Raises InputError for what is no ICP. `variables` are those that z
    stacks, in this order, each column by column."""

    def __init__(self, conditions: Sequence[Any]) -> None:
        self._conditions = conditions
        self._pairs = [_affine_first(*one.sides) for one in conditions]
        self._n = sum(p.size for p, _ in self._pairs)
        sides = [one.sides[k] for one in conditions for k in (0, 1)]
        _check_variables(unique(x for side in sides for x in side.variables()), self._n)
        self._compiled = Compiled([p for p, _ in self._pairs] + [r for _, r in self._pairs])
        self.variables = self._compiled.variables
        self._order: np.ndarray | None = None  # in which the compiled rows are those of p, then those of r
        self._gradient_holds: bool | None = None
        self._last: ICP | None = None
        self._values: list[Any] = []
        #: entry of z that each row owns, and ρ
        self._own, self._scale = np.arange(self._n), np.ones(self._n)

    @property
    def problem(self) -> ICP:
        """The same object until a parameter has a new value; what is known of A and ψ is kept where they stay."""
        values = self._compiled.parameter_values()
        same = (np.array_equal(a, b) for a, b in zip(values, self._values, strict=False))
        if self._last is None or not all(same):
            self._last, self._values = self._read(self._last), values
        return self._last

    def start(self) -> Vector | None:
        if all(x.value is None for x in self.variables):
            return None
        parts = [np.zeros(x.size) if x.value is None else np.ravel(x.value, order="F") for x in self.variables]
        return np.concatenate(parts).astype(np.float64)

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        return list(zip(self.variables, unstacked(z, self.variables), strict=True))

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        return self._by_condition(self.problem.p(z))

    def distances(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions, each with its r, as it was written, at `z`."""
        return self._by_condition(self.problem.r(z) * self._scale)

    def _by_condition(self, rows: Vector) -> list[tuple[Any, Any]]:
        return list(zip(self._conditions, unstacked(rows[self._own], [p for p, _ in self._pairs]), strict=True))

    def _read(self, last: ICP | None) -> ICP:
        (P, _, q), (R, W, constant) = self._p_and_r()
        own = own_entries(R)
        if own is None:
            raise InputError(self._misfit(R, *unowned(R)))
        self._own = own
        if not np.array_equal(own, np.arange(self._n)):
            rows = np.argsort(own)
            P, q, R, W, constant = P[rows], q[rows], R[rows], W[rows], constant[rows]
        self._scale = R.diagonal()
        with np.errstate(over="ignore"):
            factor = -1.0 / self._scale
            others = R.indices != row_of(R)
            data = (R.data * factor[row_of(R)])[others]
            c = constant * factor + 0.0
        G = sp.csr_array((data, (row_of(R)[others], R.indices[others])), shape=R.shape)
        psi: Any = Affine(G, c) if G.nnz else c
        if self._compiled.atoms:
            psi = self._bent(G, c, sp.csr_array(sp.diags_array(factor) @ W))
        if last is None or (last.A != P).nnz:
            return ICP(P, q, psi)
        unchanged = psi is c and last.psi.is_constant and np.array_equal(last.psi.value(c), c)
        return (last if unchanged else last.with_psi(psi)).with_q(q)

    def _bent(self, G: sp.csr_array, c: Vector, V: sp.csr_array) -> Function:
        """ψ with atoms; its derivative only where CVXPY's gradients held at the first start."""
        obstacle = AtomObstacle(self._compiled.atoms.values(), self.variables, G, c, V)
        if self._gradient_holds is None:
            start = self.start()
            self._gradient_holds = obstacle.gradient_holds(np.zeros(self._n) if start is None else start)
        return Function(obstacle, obstacle.jacobian if self._gradient_holds else None)

    def _p_and_r(self) -> tuple[AffineRows, AffineRows]:
        Z, W, constant = self._compiled.rows()
        n = self._n
        if self._order is None:
            self._order = self._p_before_r(Z)
        if not np.array_equal(self._order, np.arange(2 * n)):  # it would copy a matrix that may be large
            Z, W, constant = (part[self._order] for part in (Z, W, constant))
        return (Z[:n], W[:n], constant[:n]), (Z[n:], W[n:], constant[n:])

    def _p_before_r(self, Z: sp.csr_array) -> np.ndarray:
        """The order of the rows that turns round the pairs of which the first side looks more like z − ψ(z)."""
        order, done = np.arange(2 * self._n), 0
        for k, (p, r) in enumerate(self._pairs):
            first, second = (slice(start, start + p.size) for start in (done, self._n + done))
            if r.is_affine() and looks_like_r(Z[first]) > looks_like_r(Z[second]):
                order[first], order[second] = order[second], order[first].copy()
                self._pairs[k] = r, p
            done += p.size
        return order

    def _misfit(self, R: sp.csr_array, row: int, column: int) -> str:
        expressions = [r for _, r in self._pairs]
        k, place = at(expressions, row)
        what = f"r = {named(expressions[k])} is not z - psi(z)" + (f" in entry {place}" if place else "")
        entries = R[[row]]
        if not (entries.data > 0).any():
            falls = "an entry appears with a negative factor only" if entries.nnz else "no entry of z appears linearly"
            return f"{what}: {falls}, a positive one was expected (for z <= c write the model for -z)"
        k, place = at(self.variables, column)
        left = f"{self.variables[k].name()}{place}"
        return f"{what}: the entries of z that it has belong to other rows already, while no row belongs to {left}"


def _affine_first(a: cp.Expression, b: cp.Expression) -> tuple[cp.Expression, cp.Expression]:
    for side in (a, b):
        if side.is_complex():
            raise InputError(f"{named(side)} is complex; real expressions were expected: ICP is stated over the reals")
    if not a.is_affine() and not b.is_affine():
        raise InputError(f"neither {named(a)} nor {named(b)} is affine in the variables; p = Az + q must be")
    return (a, b) if a.is_affine() else (b, a)


def _check_variables(variables: list[cp.Variable], rows: int) -> None:
    for x in variables:
        given = [name for name, value in x.attributes.items() if value]
        if given:
            advice = f"its bounds are written as r, for example complements(p, {x.name()}) for {x.name()} >= 0"
            found = f"the variable {x.name()} has the attribute {given[0]}"
            raise InputError(f"{found}; z is any vector in an ICP, {advice}")
    unknowns = sum(x.size for x in variables)
    if rows != unknowns or not rows:
        entries = ", ".join(f"{x.name()} with {x.size}" for x in variables) or "no variables"
        found = f"the constraints have {rows} entries, the variables {unknowns} ({entries})"
        raise InputError(f"{found}; each entry of a variable needs one row p >= 0, r = z - psi(z) >= 0 of its own")
