"""Which variable each row of a Pyomo model owns, and which of its two sides becomes r."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError
from ..affine_rows import AffineRows
from ..matching import cheapest, left_over
from .condition_rows import ConditionRows, Side

#: the cost of a row's own variable that has different signs on the two sides. To be missing on a side costs the square
#: of this, not to be on the side for r twice as much. Below these costs the powers of two of the coefficients decide,
#: whose sums over two sides differ by 4196 at most
_OPPOSITE_SIGN_COST = 1e4
#: the number of names in a message
_MAX_LISTED = 5


class Ownership:
    """The choice. Raises InputError where rows and variables cannot be paired.

    Attributes
    ----------
    variables : list
        Those that occur.
    free : array of bool, shape (m,)
        The rows without obstacle.
    which_r : array of shape (m,)
        The side that becomes r.
    own : array of shape (m,)
        The place in `variables` of the one that each row owns.
    row_of : dict
        The row that owns a variable, by the variable's id.
    signs : array of shape (m,)
        z_i is `signs`_i times its variable, so that its coefficient in r_i is positive, or in p_i where r_i has none.
    p, r : AffineRows
        The sides in z, w being the nonlinear expressions `flat`.
    """

    def __init__(self, rows: ConditionRows) -> None:
        self.variables = rows.variables()
        self.flat = rows.nonlinear()
        self._column = {id(variable): k for k, variable in enumerate(self.variables)}
        both = self._stack_sides([*rows.sides[0], *rows.sides[1]])
        self._nonlinear = (np.diff(both.W.indptr) > 0).reshape(2, -1)
        # a nonlinear equation has an obstacle, and p = 1
        self.free = np.array(rows.equation, dtype=bool) & ~self._nonlinear[1]
        every = np.arange(self.free.size)
        #: the rows with two bounds; their side 0 is r
        self._ranges = np.isin(every, list(rows.widths))
        self.owned_columns = self._own_variables(rows.owners, both)
        self.row_of = {id(self.variables[j]): row for row, j in enumerate(self.owned_columns.tolist())}
        both = both._replace(Z=both.Z[:, self.owned_columns])
        self.which_r = self._which_side_is_r(both)
        p, r = (both.of(every + every.size * side) for side in (1 - self.which_r, self.which_r))
        in_r = r.Z.diagonal()
        coefficient = np.where(in_r == 0, p.Z.diagonal(), in_r)
        self.signs = np.where(~self.free & (coefficient < 0), -1.0, 1.0)
        self.p = self._apply_signs(p)
        self.r = self._apply_signs(r)

    def in_z(self, sides: Sequence[Side]) -> AffineRows:
        """The affine parts of `sides` in z."""
        rows = self._stack_sides(sides)
        return self._apply_signs(rows._replace(Z=rows.Z[:, self.owned_columns]))

    def _apply_signs(self, rows: AffineRows) -> AffineRows:
        return rows._replace(Z=sp.csr_array(rows.Z @ sp.diags_array(self.signs)))

    def _stack_sides(self, sides: Sequence[Side]) -> AffineRows:
        """`sides` in the variables, W having one column for each of `flat`."""
        counts = [len(linear) for _, linear, _ in sides]
        columns = [self._column[key] for _, linear, _ in sides for key in linear]
        data = np.array([value for _, linear, _ in sides for value in linear.values()], dtype=np.float64)
        place = np.repeat(np.arange(len(sides)), counts), np.array(columns, dtype=np.int64)
        Z = sp.csr_array(sp.coo_array((data, place), shape=(len(sides), len(self.variables))))
        nonlinear = np.flatnonzero([rest is not None for _, _, rest in sides])
        ones = np.ones(nonlinear.size), (nonlinear, np.arange(nonlinear.size))
        W = sp.csr_array(sp.coo_array(ones, shape=(len(sides), len(self.flat))))
        return AffineRows(Z, W, np.array([constant for constant, _, _ in sides]))

    def _own_variables(self, owners: list[Any], both: AffineRows) -> np.ndarray:
        """Match each variable to one row, by an assignment of least cost.

        Preferred is a variable on the side that should become r, on both sides, with one sign on them. Among these
        the product of coefficients is largest, which does not depend on units.

        Reference: Duff and Koster, SIAM J. Matrix Anal. Appl. 22 (2001), doi 10.1137/S0895479899358443.
        """
        m = len(owners)
        n = len(self.variables)
        pairs = [(k, self._column[id(one)]) for k, (_, variables, _) in enumerate(self.flat) for one in variables]
        place = np.array(pairs, dtype=np.int64).reshape(-1, 2).T
        occurs = abs(both.Z) + both.W @ sp.coo_array((np.ones(len(pairs)), place), shape=(len(self.flat), n))
        row, col = sp.coo_array(occurs[:m] + occurs[m:]).coords
        coefficient, there = (np.array([M[row, col], M[row + m, col]]) for M in (both.Z, occurs))
        in_r = (self._should_be_r(both)[:, row] & (there > 0)).any(axis=0) | self.free[row]
        with np.errstate(divide="ignore"):
            size = np.where(coefficient == 0, 0.0, np.log2(np.abs(coefficient))).sum(axis=0)
        opposite = np.sign(coefficient).prod(axis=0) < 0
        missing = (coefficient == 0).sum(axis=0)
        absent = missing + 2 * ~in_r
        cost = _OPPOSITE_SIGN_COST * (_OPPOSITE_SIGN_COST * absent + opposite) - size
        owned_columns = cheapest(row, col, cost, m, m) if m == n else None
        if owned_columns is None:
            conditions, unowned = left_over(row, col, (m, n))
            left = ("condition", self.variables, unowned), ("free variable", owners, conditions)
            parts = [
                f"no {what} is left for {_list_names([some[k].name for k in ks])}" for what, some, ks in left if ks.size
            ]
            actual = f"{m} conditions for {n} variables that are not fixed: {', and '.join(parts)}"
            raise InputError(f"{actual}; every condition needs a variable of its own, so fix or deactivate the surplus")
        return owned_columns

    def _should_be_r(self, both: AffineRows) -> np.ndarray:
        """Shape (2, m): the nonlinear sides, or else those with fewer variables, so that a bound on one variable
        becomes a fixed obstacle."""
        count = np.diff(both.Z.indptr).reshape(2, -1)
        count = np.where(count == 0, np.inf, count)
        preferred = self._nonlinear | (~self._nonlinear.any(axis=0) & (count == count.min(axis=0)))
        preferred[:, self._ranges] = [[True], [False]]
        return preferred

    def _which_side_is_r(self, both: AffineRows) -> np.ndarray:
        """Which side of each condition becomes r: the nonlinear one.

        Of two affine sides it is the one with fewer variables. Ties are broken by the weight of the own variable in
        the side, then by the distance of its coefficient from 1, then by the size of the obstacle.
        """
        m = self.free.size
        mine = np.abs([both.Z.diagonal(), both.Z.diagonal(-m)])
        rows = np.diff(both.Z.indptr), abs(both.Z).sum(axis=1), np.abs(both.constant)
        count, weight, constant = (one.reshape(2, m) for one in rows)
        with np.errstate(all="ignore"):
            ranks = constant / mine, np.abs(np.log2(mine)), (weight - mine) / mine, count, mine == 0
        which: np.ndarray = np.lexsort(ranks, axis=0)[0]  # the last rank decides first
        which[self._nonlinear[0] | self._ranges] = 0
        which[self._nonlinear[1] | self.free] = 1
        return which


def _list_names(names: list[str]) -> str:
    """The first few of `names`, and how many more there are."""
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more
