"""What a front end makes of a model: an ICP, and the way back from its z to the model. Solving needs no more."""

from __future__ import annotations

from typing import Any, Protocol, runtime_checkable

from ..icp import ICP
from ..methods.contract import Method
from ..numerics.arrays import Vector
from ..solve.solution import Solution


@runtime_checkable
class Reading(Protocol):
    """A model in another language, read as an ICP. A further language is a further class with these four."""

    @property
    def problem(self) -> ICP:
        """The ICP. Raises InputError, with the name of what is wrong, where the model is none."""

    def start(self) -> Vector | None:
        """The values that the variables have now, as z, shape (n,); None where none has one."""

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        """The variables of the model, each with its value at `z`, shape (n,)."""

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions of the model, each with p at `z`: the force that holds its r ≥ 0."""


def solved(reading: Reading, method: str | Method | None = None, *, z0: Any = None, **options: Any) -> Solution:
    """What `icpmodel.solve` finds for what was read, solved or not; the start is by default the model's own."""
    problem = reading.problem
    return problem.solve(method, z0=reading.start() if z0 is None else z0, raise_on_failure=False, **options)
