"""A Pyomo model with `Complementarity` components, read as an implicit complementarity problem.

Every row has two sides of which at least one is affine. It is given one variable x_j as its own; one side becomes
p_i = (Az + q)_i and the other r_i = z_i − ψ_i(z), divided by the size of its own coefficient, with z_i = ±x_j so that
z_i appears with a plus. The answer does not depend on these choices, the methods do: they want a large positive
diagonal of A and a small slope of ψ.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp
from pyomo.core.base.block import BlockData

from ...errors import InputError
from ...icp import ICP
from ...numerics.arrays import Vector, described
from ...problem.affine import Affine
from ...problem.function import Function
from .nonlinear import NonlinearRows
from .rows import Rows

#: what it costs a row to own a variable that is not on the side that should become r, that is missing on one side, or
#: that has different signs on the two, in powers of two of the coefficients, which count only among equals
_NOT_IN_R, _MISSING, _OPPOSITE = 2e7, 1e7, 1e5
#: how many names a message lists
_LISTED = 5


@dataclass(frozen=True, eq=False)
class Reading:
    """What was read: `problem`, the ICP, and how its z stands to the model.

    z_i = `signs`[i] · `variables`[i]; row i is that of `owners`[i], a Complementarity or equality Constraint. A
    condition with two bounds on one side has two rows, one after the other, and `multipliers` says by the number of the
    first which of the two owns the λ of `Rows`.
    """

    problem: ICP
    variables: tuple[Any, ...]
    signs: Vector
    owners: tuple[Any, ...]
    #: rows that are equations, shape (n,), bool
    equation: np.ndarray
    multipliers: dict[int, int]
    #: which side of a row is r, and what it was divided by
    which_r: np.ndarray
    scale: Vector
    #: rows whose variable has bounds of its own that no condition implies: (row, lower, upper)
    bounds: tuple[tuple[int, float, float], ...]

    def start(self) -> Vector:
        """The values that the variables have now, as z, shape (n,); 0 for a variable without value.

        Raises InputError where a condition has no finite value there.
        """
        values = [variable.value for variable in self.variables]
        z: Vector = self.signs * np.array([0.0 if value is None else value for value in values], dtype=np.float64)
        bad = ~np.isfinite(z)
        if not bad.any():
            psi = self.problem.psi.value(z)
            bad = ~(np.isfinite(psi) | np.isneginf(psi))
        if bad.any():
            row = int(np.argmax(bad))
            at = f"{self.variables[row].name} = {self.signs[row] * z[row] + 0.0:g}"
            raise InputError(
                f"{self.owners[row].name} has no finite value at the start, where {at}: give its variables other values"
            )
        return z

    def values(self, z: Vector) -> list[tuple[Any, float]]:
        """The variables of the model with their values at `z`, shape (n,); the λ are not among them."""
        added = set(self.multipliers.values())
        pairs = zip(self.variables, (self.signs * z + 0.0).tolist(), strict=True)
        return [pair for row, pair in enumerate(pairs) if row not in added]

    def forces(self, z: Vector) -> list[tuple[Any, Any, float, float]]:
        """Per condition its component, its own variable, p (of a condition a ≤ f ≤ b ⟂ g: g), and p in the direction of
        that variable: the marginal of x_j, positive at a lower bound and negative at an upper one.
        """
        p, r, found = self.problem.p(z), self.problem.r(z), []
        skipped = {row + 1 for row in self.multipliers} | set(np.flatnonzero(self.equation).tolist())
        for row, owner in enumerate(self.owners):
            if row in skipped:
                continue
            own, force, sign = row, float(p[row]), float(self.signs[row])
            if row in self.multipliers:
                added = self.multipliers[row]
                own, sign = 2 * row + 1 - added, 1.0
                side_1 = p[row] if self.which_r[row] == 0 else r[row] * self.scale[row]
                force = float(side_1 - self.signs[added] * z[added])
            found.append((owner, self.variables[own], force, sign * force))
        return found

    def out_of_bounds(self, z: Vector, tolerance: float) -> str:
        """Which variable violates a bound of its own, that no condition implies, by more than `tolerance`; or nothing."""
        for row, lower, upper in self.bounds:
            value = float(self.signs[row] * z[row])
            if not lower - tolerance <= value <= upper + tolerance:
                found = f"{self.variables[row].name} = {value:g} is not in its bounds [{lower:g}, {upper:g}]"
                return f"{found}, which no condition of the model implies"
        return ""


def read_pyomo(model: Any) -> Reading:
    """Read a Pyomo model, or block, as an ICP.

    Parameters: `model` with active `Complementarity` components, one side of each affine, equality constraints and no
    other active constraint or objective, and as many of these as variables that are not fixed.
    Returns a `Reading`. Raises InputError, with the component's name, where the model has no such form.
    """
    if not isinstance(model, BlockData):
        raise InputError(f"model is {described(model)}; a Pyomo model or block was expected")
    if not model.is_constructed():
        raise InputError(f"model {model.name} is abstract; its create_instance() was expected")
    rows = Rows(model)
    variables = rows.variables()
    if not rows.owners:
        raise InputError(f"{model.name} has no active Complementarity with a free variable")
    table = _Table(rows, variables)
    own = table.own_variables()
    which_r = table.which_side_is_r(own)
    return table.reading(own, which_r)


class _Table:
    """Both sides of all rows as arrays."""

    def __init__(self, rows: Rows, variables: list[Any]) -> None:
        self.rows, self.variables = rows, variables
        self.m, self.n = len(rows.owners), len(variables)
        self.column = {id(variable): k for k, variable in enumerate(variables)}
        #: rows without obstacle; a nonlinear equation has one, and p = 1
        self.free = np.array(rows.equation, dtype=bool)
        self.free[list(rows.sides[1].nonlinear)] = False
        self.constants = np.array([side.constants for side in rows.sides])
        self.sides = [side.matrix(self.column) for side in rows.sides]
        # every pair (row, variable) that occurs, with its two coefficients
        flat = [one for side in rows.sides for one in side.nonlinear.items()]
        nonlinear = [(row, self.column[id(variable)]) for row, (_, found, _) in flat for variable in found]
        r, j = np.array(nonlinear, dtype=np.int64).reshape(-1, 2).T
        keys = [side.row.astype(np.int64) * self.n + side.col for side in self.sides]
        pairs, place = np.unique(np.concatenate([*keys, r * self.n + j]), return_inverse=True)
        self.row, self.col = pairs // self.n, pairs % self.n
        self.coefficient = np.zeros((2, pairs.size))
        self.curved = np.zeros(pairs.size, dtype=bool)
        self.curved[place[place.size - r.size :]] = True
        for k, (side, start) in enumerate(zip(self.sides, (0, keys[0].size), strict=True)):
            self.coefficient[k, place[start : start + side.nnz]] = side.data

    def own_variables(self) -> np.ndarray:
        """The variable that each row owns, shape (m,): each variable once, on the side that should become r, on both
        sides and with one sign on them as far as that can be, and with the largest product of coefficients. The sum of
        their logarithms makes this independent of units.

        Reference: Duff and Koster, SIAM J. Matrix Anal. Appl. 22 (2001), doi 10.1137/S0895479899358443.
        """
        from scipy.sparse.csgraph import min_weight_full_bipartite_matching

        first, second = self.coefficient
        missing = (first == 0).astype(float) + (second == 0)
        with np.errstate(divide="ignore"):
            size = sum(np.where(side == 0, 0.0, np.log2(np.abs(side))) for side in self.coefficient)
        opposite = np.sign(first) * np.sign(second) < 0
        cost = _NOT_IN_R * ~self.in_r() + _MISSING * missing + _OPPOSITE * opposite - size
        order = np.lexsort((cost, self.row))
        cheapest = order[np.searchsorted(self.row[order], np.arange(self.m))]
        own: np.ndarray = self.col[cheapest]
        if self.m != self.n or np.unique(own).size < self.m:  # else no matching is cheaper
            self._refuse_what_is_not_square()
            graph = sp.csr_array((cost - cost.min() + 1.0, (self.row, self.col)), shape=(self.m, self.n))
            own = min_weight_full_bipartite_matching(graph)[1]
        return own

    def in_r(self) -> np.ndarray:
        """For every pair whether the variable is on the side that should become r: the nonlinear one, or else the one
        with fewer variables, so that a bound on a single variable is a fixed obstacle."""
        bent = np.zeros((2, self.m), dtype=bool)
        for k, side in enumerate(self.rows.sides):
            bent[k, list(side.nonlinear)] = True
        counts = np.array([np.bincount(side.row, minlength=self.m) for side in self.sides], dtype=float)
        counts[counts == 0] = np.inf
        wanted = bent | (~bent.any(axis=0) & (counts == counts.min(axis=0)))
        there = (self.coefficient != 0) | (bent[:, self.row] & self.curved)
        found: np.ndarray = (wanted[:, self.row] & there).any(axis=0) | self.free[self.row]
        return found

    def _refuse_what_is_not_square(self) -> None:
        from scipy.sparse.csgraph import maximum_bipartite_matching

        graph = sp.csr_array((np.ones(self.row.size), (self.row, self.col)), shape=(self.m, self.n))
        matched = maximum_bipartite_matching(graph, perm_type="column")
        left = [self.rows.owners[i].name for i in np.flatnonzero(matched < 0)]
        unowned = np.setdiff1d(np.arange(self.n), matched)
        lonely = [self.variables[j].name for j in unowned]
        if left or lonely:
            parts = [f"no condition is left for {_listed(lonely)}"] if lonely else []
            parts += [f"no free variable is left for {_listed(left)}"] if left else []
            raise InputError(
                f"{self.m} conditions for {self.n} variables that are not fixed: {', and '.join(parts)}; every "
                "condition needs a variable of its own, so fix or deactivate what is too much"
            )

    def own_coefficient(self, k: int, own: np.ndarray) -> Vector:
        """The coefficient of each row's own variable on side k, shape (m,); 0 where it is missing."""
        side = self.sides[k]
        hit = side.col == own[side.row]
        coefficient: Vector = np.bincount(side.row[hit], side.data[hit], self.m).astype(np.float64)
        return coefficient

    def which_side_is_r(self, own: np.ndarray) -> np.ndarray:
        """Which side becomes r, shape (m,): the nonlinear one; of two affine ones that with fewer variables, else that
        in which its own variable weighs more, or has a coefficient nearer to 1, or the smaller obstacle."""
        ranks = []
        for k, side in enumerate(self.sides):
            mine = self.own_coefficient(k, own)
            weight = np.bincount(side.row, np.abs(side.data), self.m)
            with np.errstate(all="ignore"):
                ranks.append(
                    [
                        mine == 0,
                        np.bincount(side.row, minlength=self.m),
                        np.where(mine == 0, np.inf, (weight - np.abs(mine)) / np.abs(mine)),
                        np.where(mine == 0, np.inf, np.abs(np.log2(np.abs(mine)))),
                        np.where(mine == 0, np.inf, np.abs(self.constants[k] / mine)),
                    ]
                )
        second = np.zeros(self.m, dtype=bool)
        for one, other in reversed(list(zip(*ranks, strict=True))):  # the first that differs decides
            second = np.where(other == one, second, other < one)
        second[list(self.rows.sides[0].nonlinear)] = False
        second[list(self.rows.sides[1].nonlinear)] = True
        second[self.free] = True
        return second.astype(int)

    def reading(self, own: np.ndarray, which_r: np.ndarray) -> Reading:
        """The ICP in which row i has the variable own[i], and its side which_r[i] is r."""
        m, rows = self.m, np.arange(self.m)
        position = np.argsort(own)
        both = np.array([self.own_coefficient(k, own) for k in (0, 1)])
        in_r, in_p = both[which_r, rows], both[1 - which_r, rows]
        plain = (in_r == 0) | self.free
        scale = np.where(plain, 1.0, np.abs(in_r))
        signs = np.where(self.free, 1.0, np.where(plain, np.where(in_p < 0, -1.0, 1.0), np.sign(in_r)))
        flip = np.where(self.free & (in_p < 0), -1.0, 1.0)
        parts: list[list[tuple[Any, ...]]] = [[], []]
        for k, side in enumerate(self.sides):
            is_r, column = which_r[side.row] == k, position[side.col]
            data = side.data * signs[column]
            kept = is_r & (column != side.row) & ~self.free[side.row]
            parts[0].append((data * flip[side.row], side.row, column, ~is_r))
            parts[1].append((-data / scale[side.row], side.row, column, kept))
        missing = rows[plain & ~self.free]
        parts[1].append((np.ones(missing.size), missing, missing, np.ones(missing.size, dtype=bool)))
        A, G = (_assembled(part, m) for part in parts)
        q = self.constants[1 - which_r, rows] * flip
        c = np.where(self.free, -np.inf, -self.constants[which_r, rows] / scale)
        flat = {row: one for side in self.rows.sides for row, one in side.nonlinear.items()}
        psi: Any = Affine(G, c) if G.nnz else c + 0.0
        if flat:
            columns = {key: int(position[j]) for key, j in self.column.items()}
            of_model = NonlinearRows(flat, columns, (m, m))
            obstacle = Obstacle(G, c, of_model, signs, scale)
            psi = Function(obstacle, obstacle.jacobian)
        variables = tuple(self.variables[j] for j in own)
        of = {id(variable): row for row, variable in enumerate(variables)}
        return Reading(
            problem=ICP(A, q, psi),
            variables=variables,
            signs=signs,
            owners=tuple(self.rows.owners),
            equation=np.array(self.rows.equation),
            multipliers={row: of[id(added)] for row, added in self.rows.multipliers.items()},
            which_r=which_r,
            scale=scale,
            bounds=self._bounds(own),
        )

    def _bounds(self, own: np.ndarray) -> tuple[tuple[int, float, float], ...]:
        """The bounds of variables that no side says: row, lower, upper. Raises InputError for discrete variables."""
        lower, upper = np.full(self.n, -np.inf), np.full(self.n, np.inf)
        for k, side in enumerate(self.sides):
            alone = (np.bincount(side.row, minlength=self.m) == 1)[side.row]
            alone[np.isin(side.row, list(self.rows.sides[k].nonlinear))] = False
            if k == 1:
                alone &= ~self.free[side.row]
            column, slope = side.col[alone], side.data[alone]
            ends = -self.constants[k, side.row[alone]] / slope
            both = self.free[side.row[alone]]
            np.maximum.at(lower, column[(slope > 0) | both], ends[(slope > 0) | both])
            np.minimum.at(upper, column[(slope < 0) | both], ends[(slope < 0) | both])
        found = []
        for row, j in enumerate(own.tolist()):
            variable = self.variables[j]
            if not variable.is_continuous():
                raise InputError(f"{variable.name} is in {variable.domain.name}; a continuous variable was expected")
            low, high = variable.bounds
            low, high = -np.inf if low is None else low, np.inf if high is None else high
            if low > lower[j] or high < upper[j]:
                found.append((row, float(low), float(high)))
        return tuple(found)


class Obstacle:
    """ψ(z) = Gz + c − N(x)/s with x = σz, the obstacle that a nonlinear Pyomo model has.

    Parameters: `G` CSR and `c` the affine part; `rows` the nonlinear one, N; `signs` σ and `scale` s, shape (n,).
    """

    def __init__(self, G: sp.csr_array, c: Vector, rows: NonlinearRows, signs: Vector, scale: Vector) -> None:
        self.G, self.c, self.rows, self.signs, self.scale = G, c, rows, signs, scale

    def __call__(self, z: Vector) -> Vector:
        value: Vector = self.G @ z + self.c - self.rows.value(self.signs * z) / self.scale
        return value

    def jacobian(self, z: Vector) -> sp.csr_array:
        """ψ′(z) = G − s⁻¹N′(σz)σ, CSR."""
        slope = sp.diags_array(1 / self.scale) @ self.rows.jacobian(self.signs * z) @ sp.diags_array(self.signs)
        return sp.csr_array(self.G - slope)

    def expressions(self, z: list[Any]) -> dict[int, Any]:
        """−N(σz)/s, row by row, as Pyomo expressions of the variables `z`."""
        x = [variable if sign > 0 else -variable for variable, sign in zip(z, self.signs, strict=False)]
        return {row: -one / float(self.scale[row]) for row, one in self.rows.expressions(x).items()}


def _assembled(parts: list[tuple[Any, ...]], m: int) -> sp.csr_array:
    """The m × m matrix of those (data, rows, columns) that are kept."""
    data, rows, columns = (np.concatenate([part[k][part[3]] for part in parts]) for k in range(3))
    return sp.csr_array(sp.coo_array((data, (rows, columns)), shape=(m, m)))


def _listed(names: list[str]) -> str:
    """The first few of `names`, and how many more there are."""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more
