"""Which variable each row of a Pyomo model owns, and which of its two sides becomes r."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...errors import InputError
from ...numerics.arrays import Vector
from ..matching import cheapest, left_over
from .condition_rows import ConditionRows

#: what it costs a row to own a variable that is not on the side that should become r, that is missing on one side, or
#: that has different signs on the two, in powers of two of the coefficients, which count only among equals
_NOT_IN_R = 2e7
_MISSING = 1e7
_OPPOSITE = 1e5
#: how many names a message lists
_LISTED = 5


class Ownership:
    """The choice, with both sides of all rows as arrays. Raises InputError where rows and variables cannot be paired.

    Attributes
    ----------
    own : array of shape (m,)
        The column of the variable that each row owns.
    which_r : array of shape (m,)
        The side that becomes r.
    sides : two COO arrays of shape (m, n)
        The coefficients; `constants`, shape (2, m), go with them.
    free : array of bool, shape (m,)
        The rows without obstacle.
    bent : array of bool, shape (2, m)
        Whether a side is nonlinear.
    column : dict
        The column of a variable by its id.
    owner : array of shape (n,)
        The row that owns the variable of each column.
    row_of : dict
        The row that owns a variable, by the variable's id.
    """

    def __init__(self, rows: ConditionRows) -> None:
        self.variables = rows.variables()
        self.m, self.n = len(rows.owners), len(self.variables)
        self.column = {id(variable): k for k, variable in enumerate(self.variables)}
        self.bent = np.array([[rest is not None for _, _, rest in side] for side in rows.sides])
        # a nonlinear equation has an obstacle, and p = 1
        self.free = np.array(rows.equation, dtype=bool) & ~self.bent[1]
        #: the rows with two bounds, of which side 0 is r
        self.ranges = np.isin(np.arange(self.m), list(rows.widths))
        self.constants = np.array([[constant for constant, _, _ in side] for side in rows.sides])
        self.sides = [self._matrix([linear for _, linear, _ in side]) for side in rows.sides]
        self._list_pairs(rows)
        self.own = self._own_variables(rows)
        self.owner = np.argsort(self.own)
        self.row_of = {key: int(self.owner[j]) for key, j in self.column.items()}
        self.which_r = self._which_side_is_r()

    def _matrix(self, rows: list[dict[int, float]]) -> sp.coo_array:
        counts = [len(linear) for linear in rows]
        columns = [self.column[key] for linear in rows for key in linear]
        data = np.array([value for linear in rows for value in linear.values()], dtype=np.float64)
        place = np.repeat(np.arange(self.m), counts), np.array(columns, dtype=np.int64)
        return sp.coo_array((data, place), shape=(self.m, self.n))

    def _list_pairs(self, rows: ConditionRows) -> None:
        """Every pair (row, variable) that occurs, with its two coefficients, and whether it is in a nonlinear part."""
        of_variable = ((row, found) for of_side in rows.nonlinear() for row, (_, found, _) in of_side.items())
        nonlinear = [(row, self.column[id(variable)]) for row, found in of_variable for variable in found]
        r, j = np.array(nonlinear, dtype=np.int64).reshape(-1, 2).T
        keys = [side.row.astype(np.int64) * self.n + side.col for side in self.sides]
        pairs, place = np.unique(np.concatenate([*keys, r * self.n + j]), return_inverse=True)
        self._row, self._col = pairs // self.n, pairs % self.n
        self._coefficient = np.zeros((2, pairs.size))
        self._curved = np.zeros(pairs.size, dtype=bool)
        self._curved[place[place.size - r.size :]] = True
        for k, (side, start) in enumerate(zip(self.sides, (0, keys[0].size), strict=True)):
            self._coefficient[k, place[start : start + side.nnz]] = side.data

    def _own_variables(self, rows: ConditionRows) -> np.ndarray:
        """Match each variable to one row, by an assignment of least cost.

        Preferred is a variable on the side that should become r, on both sides, with one sign on them. Among these
        the product of coefficients is largest, which does not depend on units.

        Reference: Duff and Koster, SIAM J. Matrix Anal. Appl. 22 (2001), doi 10.1137/S0895479899358443.
        """
        first, second = self._coefficient
        missing = (first == 0).astype(float) + (second == 0)
        with np.errstate(divide="ignore"):
            size = sum(np.where(side == 0, 0.0, np.log2(np.abs(side))) for side in self._coefficient)
        opposite = np.sign(first) * np.sign(second) < 0
        cost = _NOT_IN_R * ~self._in_r() + _MISSING * missing + _OPPOSITE * opposite - size
        own = cheapest(self._row, self._col, cost, self.m, self.n) if self.m == self.n else None
        if own is None:
            raise InputError(self._not_square(rows))
        return own

    def _in_r(self) -> np.ndarray:
        """For every pair whether the variable is on the side that should become r.

        That is the nonlinear side, or else the side with fewer variables. So a bound on one variable becomes a fixed
        obstacle.
        """
        counts = np.array([np.bincount(side.row, minlength=self.m) for side in self.sides], dtype=float)
        counts[counts == 0] = np.inf
        wanted = self.bent | (~self.bent.any(axis=0) & (counts == counts.min(axis=0)))
        wanted[:, self.ranges] = [[True], [False]]
        there = (self._coefficient != 0) | (self.bent[:, self._row] & self._curved)
        return np.asarray((wanted[:, self._row] & there).any(axis=0) | self.free[self._row])

    def _not_square(self, rows: ConditionRows) -> str:
        conditions, unowned = left_over(self._row, self._col, (self.m, self.n))
        left = [("condition", self.variables, unowned), ("free variable", rows.owners, conditions)]
        parts = [f"no {what} is left for {_listed([some[k].name for k in ks])}" for what, some, ks in left if ks.size]
        advice = "every condition needs a variable of its own, so fix or deactivate the surplus"
        return f"{self.m} conditions for {self.n} variables that are not fixed: {', and '.join(parts)}; {advice}"

    def own_coefficient(self, k: int) -> Vector:
        """The coefficient of each row's own variable on side k, shape (m,); 0 where it is missing."""
        side = self.sides[k]
        hit = side.col == self.own[side.row]
        return np.bincount(side.row[hit], side.data[hit], self.m).astype(np.float64)

    def _which_side_is_r(self) -> np.ndarray:
        """The nonlinear one; of two affine ones that with fewer variables, else that in which its own variable weighs
        more, or has a coefficient nearer to 1, or the smaller obstacle."""
        ranks = []
        for k, side in enumerate(self.sides):
            mine = np.abs(self.own_coefficient(k))
            weight = np.bincount(side.row, np.abs(side.data), self.m)
            with np.errstate(all="ignore"):
                by_own = ((weight - mine) / mine, np.abs(np.log2(mine)), np.abs(self.constants[k] / mine))
            there = [np.where(mine == 0, np.inf, rank) for rank in by_own]
            ranks.append([mine == 0, np.bincount(side.row, minlength=self.m), *there])
        second = np.zeros(self.m, dtype=bool)
        for one, other in reversed(list(zip(*ranks, strict=True))):  # the first that differs decides
            second = np.where(other == one, second, other < one)
        second[self.bent[0] | self.ranges] = False
        second[self.bent[1] | self.free] = True
        return second.astype(int)


def _listed(names: list[str]) -> str:
    """The first few of `names`, and how many more there are."""
    more = f" and {len(names) - _LISTED} more" if len(names) > _LISTED else ""
    return ", ".join(names[:_LISTED]) + more
