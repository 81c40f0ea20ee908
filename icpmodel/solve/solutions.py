"""The result of `solve_many`: all rows as arrays, and each of them as a `Solution`."""

from __future__ import annotations

import operator
from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple, SupportsIndex, overload

import numpy as np
from numpy.typing import NDArray

from ..methods.aor import MNMGS
from ..methods.contract import Method
from ..numerics.arrays import ReadOnly, Vector
from ..present.display import Plottable, cut
from ..present.table import Table, Tabular
from ..problem.data import ProblemData
from ..theory.answers import Answer
from .goal import Limits
from .solution import Solution, Status


class RunRecord(NamedTuple):
    """The fields of a row's `Solution` besides z and its residual."""

    method: Method
    adapted_method: Method
    last_method: Method
    why: str
    iterations: int = 0
    seconds: float = 0.0
    infeasible: Answer | None = None
    cost: float = 0.0

    @classmethod
    def of(cls, solution: Solution) -> RunRecord:
        """The record of `solution`."""
        return cls(*(getattr(solution, name) for name in cls._fields))

    @classmethod
    def of_compiled(cls, method: Method, rows: int, seconds: float) -> RunRecord:
        """The record of `rows` rows solved in one compiled call."""
        why = f"{rows} problems were solved in compiled code at once; the seconds are their mean"
        return cls(method, method, method, why, 1, seconds / max(rows, 1))


#: the record of a row that was not tried
NOT_BEGUN = RunRecord(MNMGS(), MNMGS(), MNMGS(), "no method was tried")


@dataclass(frozen=True, eq=False)
class BatchData:
    """The data of the problems, without arrays of the user, which may change later.

    `problems` has one problem for all rows, or one for each. `below` and `above` are pairs: the obstacle of all rows,
    and the list of obstacles row by row, which is None if all rows have the same one. The `limits` hold for all rows
    together.
    """

    problems: Sequence[ProblemData]
    Q: NDArray[np.float64]
    below: tuple[Any, list[Any] | None]
    above: tuple[Any, list[Any] | None]
    limits: Limits

    def sides(self, row: int) -> list[Any]:
        """ψ and ψ̄, or None, of one row."""
        return [one if maps is None else maps[row if len(maps) > 1 else 0] for one, maps in (self.below, self.above)]

    def problem(self, row: int) -> ProblemData:
        """The problem of one row, which shares with the others what they have in common."""
        problem = self.problems[row if len(self.problems) > 1 else 0].with_q(self.Q[row])
        if self.below[1] is None and self.above[1] is None:
            return problem
        return problem.with_sides(*self.sides(row))


@dataclass(frozen=True, eq=False, repr=False)
class Solutions(ReadOnly, Plottable, Tabular):
    """The answers of `solve_many`, one row per problem.

    It is also a sequence: `many[0]` is a `Solution`, made on access, and `many[:2]` a list of these.

    Attributes
    ----------
    Z : array of shape (k, n)
        The answers, read-only.
    statuses : tuple of Status
        Why each run stopped.
    residuals : array of shape (k,)
        Res_D(z) of the returned rows, recomputed from A, q, ψ and z.
    tolerances : array of shape (k,)
        The tolerances that the residuals were compared with.
    seconds : float
        The time for all rows together.
    messages : dict
        What went wrong, by the index of the row; only of rows that failed.

    Examples
    --------

    >>> many = icp.solve_many([[2.0]], [[-2.0], [3.0]])
    >>> many.Z
    array([[1.],
           [0.]])
    >>> many[1].p, many[1].certificate.unique, len(many)
    (array([3.]), True, 2)
    """

    Z: NDArray[np.float64]
    statuses: tuple[Status, ...]
    residuals: Vector
    tolerances: Vector
    seconds: float
    messages: dict[int, str]
    _data: BatchData
    _compiled_record: RunRecord
    _records: dict[int, RunRecord]

    def __len__(self) -> int:
        return len(self.Z)

    @overload
    def __getitem__(self, row: SupportsIndex) -> Solution: ...
    @overload
    def __getitem__(self, row: slice) -> list[Solution]: ...
    def __getitem__(self, row: SupportsIndex | slice) -> Solution | list[Solution]:
        if isinstance(row, slice):
            return [self[k] for k in range(*row.indices(len(self)))]
        k = operator.index(row)
        if not -len(self) <= k < len(self):
            raise IndexError(f"there is no row {k}; there are {len(self)}")
        k %= len(self)
        outcome = self._records.get(k) or (NOT_BEGUN if k in self.messages else self._compiled_record)
        limits = self._data.limits
        return Solution(
            problem=self._data.problem(k),
            z=self.Z[k],
            status=self.statuses[k],
            message=self.messages.get(k, "solved"),
            residual=float(self.residuals[k]),
            tolerance=float(self.tolerances[k]),
            **outcome._asdict(),
            atol=limits.atol,
            time_limit=limits.time_limit,
            memory_limit=limits.memory_limit,
        )

    def __iter__(self) -> Iterator[Solution]:
        return (self[k] for k in range(len(self)))

    def table(self) -> Table:
        """One row per problem: its status, its residual, and the tolerance.

        Returns
        -------
        Table
            The table.
        """
        words = (status.value for status in self.statuses)
        columns = range(len(self)), words, self.residuals.tolist(), self.tolerances.tolist()
        return Table("", ("row", "status", "residual", "tolerance"), tuple(zip(*columns, strict=True)))

    @property
    def failed(self) -> list[int]:
        """The rows whose status is not SOLVED.

        Examples
        --------
        >>> icp.solve_many([[-1.0]], [[1.0], [-1.0]], raise_on_failure=False).failed
        [1]
        """
        return sorted(self.messages)

    @property
    def message(self) -> str:
        """What went wrong, in one sentence.

        Examples
        --------
        >>> icp.solve_many([[2.0]], [[-2.0], [3.0]]).message
        'all 2 rows are solved'
        """
        if not self.messages:
            return f"all {len(self.Z)} rows are solved"
        first = self.failed[0]
        return f"{len(self.messages)} of {len(self.Z)} rows failed, first row {first}: {self.messages[first]}"

    def __repr__(self) -> str:
        return f"Solutions(k={len(self)}, n={self.Z.shape[1]}, {cut(self.message, 400)}, seconds={self.seconds:.3g})"
