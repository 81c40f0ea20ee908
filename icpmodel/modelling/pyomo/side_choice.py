"""The rows of a Pyomo model as matrices, and which of the two sides of a condition becomes r."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...errors import InputError
from ...numerics.arrays import row_of
from ..affine_rows import AffineRows
from ..matching import left_over
from ..row_order import OrderedRows, in_order
from .condition_rows import ConditionRows, Side

#: the number of names in a message
_MAX_LISTED = 5


def as_matrices(sides: Sequence[Side], columns: dict[int, int]) -> AffineRows:
    """The `sides` in the variables, by the `columns` of their ids; W has one column for each nonlinear part."""
    counts = [len(linear) for _, linear, _ in sides]
    places = [columns[key] for _, linear, _ in sides for key in linear]
    data = np.array([value for _, linear, _ in sides for value in linear.values()], dtype=np.float64)
    entries = np.repeat(np.arange(len(sides)), counts), np.array(places, dtype=np.int64)
    Z = sp.csr_array(sp.coo_array((data, entries), shape=(len(sides), len(columns))))
    nonlinear = np.flatnonzero([rest is not None for _, _, rest in sides])
    ones = np.ones(nonlinear.size), (nonlinear, np.arange(nonlinear.size))
    W = sp.csr_array(sp.coo_array(ones, shape=(len(sides), nonlinear.size)))
    return AffineRows(Z, W, np.array([constant for constant, _, _ in sides], dtype=np.float64))


def which_is_r(both: AffineRows) -> NDArray[np.intp]:
    """Which side of each condition becomes r, shape (m,), of the rows of side 0 followed by those of side 1.

    A side without linear terms owns no variable, and is taken last. An affine side in one variable bounds it, and is
    taken first; else the nonlinear side is. Of two affine ones it is the one with fewer variables. Ties are broken by
    the weight of the largest coefficient in the side, then by its distance from 1, then by the size of the obstacle.
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
    """The rows in the order of z, which begins with the `variables`. Raises InputError where they cannot be paired."""
    sides = rows.rows()
    stacked = as_matrices(sides, columns)
    m = len(rows.owners)
    every = np.arange(m)
    with_width = np.array(list(rows.widths), dtype=np.intp)
    numbers = np.concatenate([every, every, with_width, m + np.arange(len(rows.equations))])
    inner = [[columns[id(one)] for one in nonlinear[1]] for _, _, nonlinear in sides if nonlinear is not None]
    _check_pairing(rows.all_owners(), variables, numbers, stacked, inner)
    which = which_is_r(stacked.of(slice(2 * m)))
    which[with_width] = 0
    p, r = (stacked.of(every + m * side) for side in (1 - which, which))
    end = 2 * m + with_width.size
    width = stacked.of(slice(2 * m, end))
    upper = stacked.constants(m, np.inf).replaced(with_width, width) if rows.widths else None
    return in_order(p, r, stacked.of(slice(end, None)), None, upper)


def _check_pairing(
    owners: Sequence[Any],
    variables: Sequence[Any],
    numbers: NDArray[np.intp],
    stacked: AffineRows,
    columns: Sequence[Sequence[int]],
) -> None:
    """Raise InputError where `owners` and `variables` cannot be paired. The rows `stacked` belong to the owners of
    these `numbers`; the nonlinear parts have variables in these `columns`."""
    counts = [len(inner) for inner in columns]
    data = np.ones(sum(counts)), np.concatenate([np.zeros(0), *columns]), np.append(0, np.cumsum(counts))
    inner = sp.csr_array(data, shape=(len(columns), len(variables)))
    row, column = sp.coo_array(abs(stacked.Z) + stacked.W @ inner).coords
    rows, unowned = left_over(numbers[row], column, (len(owners), len(variables)))
    left = ("condition", variables, unowned), ("free variable", owners, rows)
    parts = [f"no {what} is left for {list_names([some[k].name for k in ks])}" for what, some, ks in left if ks.size]
    if parts:
        actual = f"{len(owners)} conditions for {len(variables)} variables that are not fixed: {', and '.join(parts)}"
        raise InputError(f"{actual}; every condition needs a variable of its own, so fix or deactivate the surplus")


def list_names(names: list[str]) -> str:
    """The first few of `names`, and how many more there are."""
    more = f" and {len(names) - _MAX_LISTED} more" if len(names) > _MAX_LISTED else ""
    return ", ".join(names[:_MAX_LISTED]) + more
