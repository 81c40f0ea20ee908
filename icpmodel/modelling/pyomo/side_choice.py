"""The rows of a Pyomo model as matrices, and which of the two sides of a condition becomes r."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InputError
from ...numerics.arrays import row_of
from ...present.display import listed
from ..affine_rows import AffineRows
from ..matching import left_over
from ..row_order import OrderedRows, in_order
from .condition_rows import ConditionRows, Side


def as_matrices(sides: Sequence[Side], columns: dict[int, int]) -> AffineRows:
    """The `sides` as matrices. `columns` maps variable id → column of Z; W has one column for each nonlinear part."""
    ends = np.cumsum([0, *(len(one.linear) for one in sides)])
    places = np.array([columns[key] for one in sides for key in one.linear], dtype=np.int64)
    data = np.array([value for one in sides for value in one.linear.values()], dtype=np.float64)
    Z = sp.csr_array((data, places, ends), shape=(len(sides), len(columns)))
    Z.sort_indices()
    has_rest = np.array([one.nonlinear is not None for one in sides], dtype=np.float64)
    W = sp.diags_array(has_rest, format="csr")[:, has_rest > 0]
    return AffineRows(Z, sp.csr_array(W), np.array([one.constant for one in sides], dtype=np.float64))


def which_is_r(both: AffineRows) -> NDArray[np.intp]:
    """Which side of each condition becomes r, shape (m,), of the rows of side 0 followed by those of side 1.

    A side without linear terms can own no variable, so the other side is taken. An affine side in one variable is a
    bound and is preferred, then a nonlinear side, then the side with fewer variables. Ties are broken by the share of
    the largest coefficient in the side, then by its distance from 1, then by the size of the obstacle.
    """
    Z = both.Z
    count = np.diff(Z.indptr)
    largest = np.zeros(count.size)
    np.maximum.at(largest, row_of(Z), np.abs(Z.data))
    with np.errstate(all="ignore"):
        obstacle = np.abs(both.constant) / largest
        distance = np.abs(np.log2(largest))
        weight = abs(Z).sum(axis=1) / largest
    is_affine = np.diff(both.W.indptr) == 0
    bounds_none = ~(is_affine & (count == 1))
    ranks = [one.reshape(2, -1) for one in (obstacle, distance, weight, count, is_affine, bounds_none, count == 0)]
    which: NDArray[np.intp] = np.lexsort(ranks, axis=0)[0]  # the last rank decides first
    return which


def ordered_rows(rows: ConditionRows, variables: Sequence[Any], columns: dict[int, int]) -> OrderedRows:
    """The rows in the order of z, which begins with the `variables`. Raises InputError if they cannot be paired."""
    sides = rows.sides()
    stacked = as_matrices(sides, columns)
    m = len(rows.conditions)
    every = np.arange(m)
    with_width = np.flatnonzero([one.width is not None for one in rows.conditions])
    end = 2 * m + with_width.size
    owner_of_side = np.concatenate([every, every, with_width, m + np.arange(len(rows.equations))])
    _check_pairing(rows.owners(), variables, owner_of_side, [[columns[key] for key in one.ids()] for one in sides])
    which = which_is_r(stacked.of(slice(2 * m)))
    which[with_width] = 0
    p, r = (stacked.of(every + m * side) for side in (1 - which, which))
    width = stacked.of(slice(2 * m, end))
    upper = stacked.constants(m, np.inf).replaced(with_width, width) if with_width.size else None
    return in_order(p, r, stacked.of(slice(end, None)), None, upper)


def _check_pairing(
    owners: Sequence[Any], variables: Sequence[Any], owner_of_side: NDArray[np.intp], columns: Sequence[list[int]]
) -> None:
    """Raise InputError if `owners` and `variables` cannot be paired; `columns` are those of each side's variables."""
    row = np.repeat(owner_of_side, list(map(len, columns)))
    column = np.concatenate([np.zeros(0, dtype=np.intp), *columns]).astype(np.intp)
    rows, unowned = left_over(row, column, (len(owners), len(variables)))
    left = ("condition", variables, unowned), ("free variable", owners, rows)
    parts = [f"no {what} is left for {listed([some[k].name for k in ks])}" for what, some, ks in left if ks.size]
    if parts:
        actual = f"{len(owners)} conditions for {len(variables)} variables that are not fixed: {', and '.join(parts)}"
        raise InputError(f"{actual}; every condition needs a variable of its own, so fix or deactivate the surplus")
