"""Read conditions and equations in CVXPY expressions as A, q, f, ψ and ψ̄ of an ICP.

Every p and r is written as Rz + Ww(z) + r₀, where w are the parts that are not affine. Each row of r owns one entry of
z: it is ρz_i − …, ρ > 0. Then r ≥ l is z_i ≥ ψ_i(z) = z_i − (r_i(z) − l_i)/ρ, in which z_i cancels; r ≤ u likewise. The
rows of p have the order of those of r. If the owned entry of a row of r is negative, the row, its p and its bounds are
multiplied by −1. If no entry of z is left for a row of r, a new unknown s replaces r, with the equation s − r(z) = 0.
The equations are the rows of the entries of z that no r owns. Inequalities own none; they are checked at the answer.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from typing import Any

import cvxpy as cp
import numpy as np
import scipy.sparse as sp

from ...errors import InputError
from ...icp import ICP
from ...numerics.arrays import Vector
from ...problem.function import Function
from ...solve.solution import Solution
from ..affine_rows import AffineRows, SumOfTerms, obstacle
from ..inequalities import checked
from ..row_order import OrderedRows, in_order, p_before_r
from .atoms import at, frozen, unique, unstacked
from .compiled import CompiledExpressions
from .statement_checks import Part, bounds_of, check_parts

#: the names of the bounds of r, and the number that means none
_BOUNDS = (("lower", -np.inf), ("upper", np.inf))


class CvxpyReading:
    """The `Reading` of `conditions`, `equations` and `inequalities`, which are compiled once.

    z stacks the `variables` in this order, each column by column; unknowns that replace an r are its last entries.
    Raises InputError if the model is not an ICP.
    """

    def __init__(
        self, conditions: Sequence[Any], equations: Sequence[cp.Constraint], inequalities: Sequence[cp.Constraint]
    ) -> None:
        variables = unique(x for one in (*conditions, *equations, *inequalities) for x in one.variables())
        inequalities = [*inequalities, *(one for x in variables for one in bounds_of(x))]
        bounded = [[one for one in conditions if one.bounds[k] is not None] for k in (0, 1)]
        self._p = Part(conditions, [one.sides[0] for one in conditions])
        self._r = Part(conditions, [one.sides[1] for one in conditions])
        self._equations = Part(equations, [one.expr for one in equations])
        least = [-one.expr if isinstance(one, cp.NonNeg) else one.expr for one in inequalities]
        self._inequalities = Part(inequalities, least)
        self._bounds = [Part(owners, [one.bounds[k] for one in owners]) for k, owners in enumerate(bounded)]
        parts = [self._p, self._r, self._equations, self._inequalities, *self._bounds]
        check_parts(parts, self._inequalities, variables, self._p.size + self._equations.size)
        self.compiled = CompiledExpressions([side for part in parts for side in part.expressions])
        self._ends = np.cumsum([part.size for part in parts])
        self.variables, self.parameters = self.compiled.variables, self.compiled.parameters
        self.is_dpp = self.compiled.is_dpp
        self._order: np.ndarray | None = None  # puts the compiled rows of p before those of r
        self._gradient_holds: bool | None = None
        self._last: ICP | None = None
        self._obstacles: tuple[Any, Any] = (None, None)
        self._values: list[Any] = []
        self._checked: AffineRows
        self._ordered: OrderedRows

    @property
    def problem(self) -> ICP:
        """The ICP: the same object until a parameter has a new value. Facts of an unchanged A and ψ are kept."""
        values = self.compiled.parameter_values()
        same = (np.array_equal(a, b) for a, b in zip(values, self._values, strict=False))
        if self._last is None or not all(same):
            last, self._last = self._last, None  # if reading fails, no problem is kept
            self._last, self._values = self._read(last), values
        return self._last

    def parameter_jacobians(self, rows: AffineRows) -> tuple[sp.csr_array, sp.csr_array, sp.csr_array | None]:
        """The derivatives of p, ψ and ψ̄ (or None) at a solution, in the values of the compiled `rows`.

        At a solution r_i = l_i in each active row. So ψ_i = z_i − (r_i − l_i)/ρ does not depend on ρ there.
        """
        # the order of the rows depends on Z only; so W can be the identity, whose columns are the compiled rows
        tagged = rows._replace(W=sp.eye_array(rows.constant.size, format="csr"))
        p, r, lower, upper = in_order(*self._parts(tagged))[:4]
        down = sp.diags_array(-1.0 / r.Z.diagonal())
        psi, above = (down @ (r.W - bound.W if bound else r.W) for bound in (lower, upper))
        return p.W, psi, above if upper else None

    def start(self) -> Vector | None:
        if all(x.value is None for x in self.variables):
            return None
        parts = [np.zeros(x.size) if x.value is None else np.ravel(x.value, order="F") for x in self.variables]
        z = np.concatenate(parts).astype(np.float64)
        Z, W, constant = self._ordered.replaced
        s = np.zeros(constant.size)
        if s.size:
            with suppress(ArithmeticError):  # f has the same atoms and will raise the error
                s = self._function(Z, constant, W, "r")(z)
        return np.concatenate([z, s])

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        return list(zip(self.variables, unstacked(z, self.variables), strict=True))

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        return self._by_condition(self._ordered.sign * self.problem.p(z)[self._ordered.owned_columns])

    def row_name(self, row: int) -> str:
        source = int(self._ordered.sources[row])
        m = self._p.size
        return self._p.row_name(source) if source < m else self._equations.row_name(source - m)

    def distances(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions without bounds, each with the value at `z` of r as it was written."""
        columns = self._ordered.owned_columns
        r = self.problem.r(z)[columns]
        r_upper = self.problem.r_upper(z)
        if r_upper is not None:
            r = np.where(self._ordered.sign < 0, -r_upper[columns], r)
        distances = self._by_condition(r * self._ordered.r.Z.diagonal()[columns])
        return [(one, value) for one, value in distances if not one.is_bounded]

    def checked(self, solution: Solution) -> Solution:
        """`solution`, or one with another status and message if it violates an inequality."""
        return checked(solution, self._checked, self._inequalities.row_name)

    def _by_condition(self, rows: Vector) -> list[tuple[Any, Any]]:
        return list(zip(self._p.owners, unstacked(rows, self._p.expressions), strict=True))

    def _read(self, last: ICP | None) -> ICP:
        self._ordered = in_order(*self._parts(self.compiled.rows()))
        p, r, lower, upper = self._ordered[:4]
        n = p.constant.size
        before = self._obstacles
        now = self._obstacle(r, lower, "psi"), upper and self._obstacle(r, upper, "upper")
        self._check_crossing(*now)
        self._obstacles = now
        if p.W.nnz:
            return ICP(p.Z, p.constant, *now, f=self._nonlinear_map(sp.csr_array((n, n)), np.zeros(n), p.W, "f"))
        if last is None or last.n != n or last.f is not None or (last.A != p.Z).nnz:
            return ICP(p.Z, p.constant, *now)
        unchanged = all(map(np.array_equal, before, now))
        return (last if unchanged else last.with_sides(*now)).with_q(p.constant)

    def _obstacle(self, r: AffineRows, bound: AffineRows | None, name: str) -> Any:
        """z − (r − `bound`)/ρ, where None is the bound 0."""
        return obstacle(r, bound, lambda G, c, V: self._nonlinear_map(G, c, V, name))

    def _nonlinear_map(self, G: sp.csr_array, c: Vector, V: sp.csr_array, name: str) -> Function:
        """Gz + c + Vw(z); with a derivative only if CVXPY's gradients were right at the first start."""
        function = self._function(G, c, V, name)
        if self._gradient_holds is None:
            start = self.start()
            self._gradient_holds = function.w.gradient_holds(np.zeros(c.size) if start is None else start)
        return Function(function, function.jacobian if self._gradient_holds else None)

    def _function(self, G: sp.csr_array, c: Vector, V: sp.csr_array, name: str) -> SumOfTerms:
        return SumOfTerms(G, c, V, frozen(list(self.compiled.atoms.values()), self.variables), f"{name} of CVXPY")

    def _parts(self, rows: AffineRows) -> tuple[Any, ...]:
        """The compiled `rows` of p, r, the equations and both bounds of r, None if no condition has such a bound.

        Those of the inequalities are stored in `_checked`. Raises InputError for NaN.
        """
        if self._order is None:
            may_swap = [not one.is_bounded for one in self._p.owners]
            self._order = p_before_r(rows.Z, [p.size for p in self._p.expressions], may_swap)
        if not np.array_equal(self._order, np.arange(self._ends[-1])):  # `of` copies the matrix, which may be large
            rows = rows.of(self._order)
        parts = map(slice, [0, *self._ends[:-1]], self._ends)
        p, r, equations, self._checked, *bounds = map(rows.of, parts)
        stated = (self._p, p), (self._r, r), (self._equations, equations), (self._inequalities, self._checked)
        for part, side in stated:
            if (invalid := side.have_nan()).any():
                raise InputError(f"{part.row_name(int(np.argmax(invalid)))} has NaN; numbers were expected")
        return p, r, equations, *(self._spread(k, bound) for k, bound in enumerate(bounds))

    def _spread(self, k: int, bound: AffineRows) -> AffineRows | None:
        """The lower (k = 0) or upper bounds with one row for each row of r. Raises InputError for invalid bounds."""
        name, none = _BOUNDS[k]
        part = self._bounds[k]
        if not part.owners:
            return None
        invalid = np.isnan(bound.constant) | (bound.constant == -none)
        if invalid.any():
            row = int(np.argmax(invalid))
            number, place = at(part.expressions, row)
            actual = f"{name}{place} of {part.owners[number]} is {bound.constant[row]}"
            raise InputError(f"{actual}; a number was expected, or {none} for none")
        rows = np.concatenate([np.full(one.sides[1].size, one.bounds[k] is not None) for one in self._p.owners])
        return bound.constants(self._p.size, none if k else 0.0).replaced(np.flatnonzero(rows), bound)

    def _check_crossing(self, psi: Any, upper: Any) -> None:
        if isinstance(psi, np.ndarray) and isinstance(upper, np.ndarray) and (psi > upper).any():
            row = self.row_name(int(np.argmax(psi > upper)))
            raise InputError(f"lower is larger than upper in {row.removesuffix(',')}")
