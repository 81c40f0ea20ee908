"""The arguments of `solve_many` that may be lists, one item for each problem: matrices, obstacles, q and starts."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from copy import deepcopy
from typing import Any

import numpy as np
from numpy.typing import NDArray

from ...algebra.affine_lcp import PIVOT_UP_TO
from ...errors import InputError
from ...numerics.arrays import as_float64, axes
from ...numerics.labels import along_unknowns, check_labels, parts_of
from ...problem.data import ProblemData
from ...problem.map import Map

Matrix = NDArray[np.float64]


def check_row_labels(A: Any, **rows: Any) -> None:
    """Raise InputError where objects of pandas, lists or tables with a row per problem, have other labels than A."""
    labelled = parts_of("A", A)
    for name, several in rows.items():
        labelled |= parts_of(name, along_unknowns(several))
    check_labels(labelled)


def rows_of(value: Any, name: str, infinite: float) -> Matrix:
    """`value` as a float64 matrix, one row per problem; finite but for the value `infinite`, if that is not 0."""
    array = as_float64(value, name)
    if array.ndim not in (1, 2) or array.size == 0:
        raise InputError(f"{name} has shape {array.shape}; one row per problem was expected")
    array = np.atleast_2d(array)
    right = np.isfinite(array) | ((array == infinite) & (infinite != 0.0))
    if not right.all():
        i, j = np.argwhere(~right)[0]
        expected = f"a finite number or {infinite}" if infinite else "a finite number"
        raise InputError(f"{name}[{i}, {j}] is {array[i, j]}; {expected} was expected")
    return array


def list_obstacles(value: Any, name: str, none: float) -> tuple[list[Any] | None, Matrix | None]:
    """The list of obstacles, one per problem, None for a single one; and their matrix if they are rows of numbers."""
    maps = list_items(value, lambda one: isinstance(one, Map) or callable(one))
    if maps is None and isinstance(value, list | tuple | np.ndarray) and axes(value, name) == 2:
        rows = rows_of(value, name, none)
        return list(rows), rows
    return maps, None


def list_items(value: Any, is_one: Callable[[Any], bool]) -> list[Any] | None:
    """The items of a list of values, with copies of those that are not `is_one`; None for a single value."""
    listed = isinstance(value, list | tuple) or (isinstance(value, np.ndarray) and value.ndim > 0)
    if listed and any(map(is_one, value)):
        return [one if is_one(one) else deepcopy(one) for one in value]
    return None


def common_count(**several: Any) -> int:
    """The number of problems, by the lists that are not None. Raises InputError where they differ (1 is for all)."""
    counts = {name: len(values) for name, values in several.items() if values is not None}
    k = max(counts.values())
    if not set(counts.values()) <= {1, k}:
        actual = ", ".join(f"{count} of {name}" for name, count in counts.items())
        raise InputError(f"there are {actual}; as many of each were expected, or one for all")
    return k


class Stack(Sequence[ProblemData]):
    """The problems of small dense `matrices`, shape (k, n, n), each made when it is asked for."""

    def __init__(self, matrices: Matrix, make: Callable[[Any], ProblemData]) -> None:
        self.matrices = matrices
        self._make = make

    @classmethod
    def of(cls, matrices: list[Any] | None, make: Callable[[Any], ProblemData]) -> Stack | None:
        """The stack of `matrices`; None unless these are several, small, dense, of one size and finite."""
        if matrices is None or len(matrices) == 1:
            return None
        if not all(isinstance(one, np.ndarray | list | tuple) for one in matrices):
            return None
        n = len(matrices[0])
        if n > PIVOT_UP_TO:
            return None
        arrays = [as_float64(one, "A") for one in matrices]
        if any(one.shape != (n, n) for one in arrays):
            return None
        stack = np.array(arrays)
        return cls(stack, make) if np.isfinite(stack).all() else None

    def __len__(self) -> int:
        return len(self.matrices)

    def __getitem__(self, row: Any) -> Any:
        if isinstance(row, slice):
            return Stack(self.matrices[row], self._make)
        return self._make(self.matrices[row])
