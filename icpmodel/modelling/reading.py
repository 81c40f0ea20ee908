"""What a front end makes of a model: an ICP, and the way back from its z to the model. Solving needs no more."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from ..icp import ICP
from ..methods.contract import Method
from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.between import mid, sides_of
from ..problem.function import Function
from ..problem.map import Map
from ..solve.solution import Solution, Status

#: the share of its terms up to which a side counts as 0, the tolerance of PATH and of GAMS's other MCP solvers; and so
#: many times a larger rtol that was asked for
_SHARE, _SLACK = 1e-6, 100.0


@runtime_checkable
class SumOfTerms(Protocol):
    """A ψ of a front end that knows what z − ψ(z) is the sum of."""

    def terms(self, z: Vector) -> Vector:
        """The sums of the absolute values of the terms of z − ψ(z), shape (n,)."""


@runtime_checkable
class Reading(Protocol):
    """A model in another language, read as an ICP. A further language is a further class with these five."""

    @property
    def problem(self) -> ICP:
        """The ICP. Raises InputError, with the name of what is wrong, where the model is none."""

    def start(self) -> Vector | None:
        """The values that the variables have now, as z, shape (n,); None where none has one."""

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        """The variables of the model, each with its value at `z`, shape (n,)."""

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions of the model, each with p at `z`: the force that holds its r ≥ 0."""

    def row_name(self, row: int) -> str:
        """What a message calls the condition or the equation of a row."""


def solved(reading: Reading, method: str | Method | None = None, *, z0: Any = None, **options: Any) -> Solution:
    """What `icpmodel.solve` finds for what was read, solved or not; the start is by default the model's own.

    A solution of the ICP is also judged side by side, each in the units of its own: of every condition the smaller of
    p and r has to be small beside the terms that it is the sum of. Where it is not, the solution is polished; where
    that does not help, the status is PRECISION_LIMIT.
    """
    problem = reading.problem
    found = problem.solve(method, z0=reading.start() if z0 is None else z0, raise_on_failure=False, **options)
    # a certified error, and the paper's residual, are what was asked for in units that the user has chosen
    if not found.solved or found.accuracy or found.residual > found.tolerance:
        return found
    share = max(_SHARE, _SLACK * float(options.get("rtol") or 0.0))
    if not (left := _left(reading, found.z)) > share:
        return found
    finer = found.polish()
    if not _left(reading, finer.z) > share:
        return finer
    row = int(np.argmax(_shares(reading, found.z)))
    told = (
        f"{reading.row_name(row)} holds to {left:.2g} of its own terms only, although the residual of all is small: "
        f"lower rtol, or give the variables units in which they are of one size"
    )
    return replace(found, status=Status.PRECISION_LIMIT, message=told)


def _left(reading: Reading, z: Vector) -> float:
    return float(_shares(reading, z).max(initial=0.0))


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _shares(reading: Reading, z: Vector) -> Vector:
    """|mid(z − ψ̄, p, z − ψ)|, row by row, where each of the three is divided by the sum of its terms' absolute values.

    No z_j counts as smaller than the rounding of the largest, as the steps of no method resolve it.
    """
    problem = reading.problem
    size = np.maximum(np.abs(z), max(UNIT_ROUNDOFF * np.abs(z).max(initial=0.0), np.finfo(float).tiny))
    of_p = problem.p(z), problem.matrix.magnitude(size) + np.abs(problem.q)
    sides = [of_p, *((z - psi.value(z), _terms(psi, z, size)) for psi in sides_of(problem.psi))]
    shares = (np.where(np.isfinite(side / terms), side / terms, side) for side, terms in sides)
    return np.asarray(np.abs(mid(*shares)))


def _terms(psi: Map, z: Vector, size: Vector) -> Vector:
    """The sums of the absolute values of the terms of z − ψ(z), shape (n,), where |z| counts as `size`."""
    if psi.linear is not None:
        G, c = psi.linear
        return np.asarray(abs(sp.eye_array(z.size) - G) @ size + np.abs(c))
    if isinstance(psi, Function) and isinstance(psi.fun, SumOfTerms):
        return psi.fun.terms(z)
    return size + np.abs(psi.value(z))
