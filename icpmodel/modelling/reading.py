"""The contract of a front end, which reads a model as an ICP and maps z back to the model; and the solve."""

from __future__ import annotations

from dataclasses import replace
from typing import Any, Protocol, runtime_checkable

import numpy as np
import scipy.sparse as sp

from ..icp import ICP
from ..methods.contract import Method
from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.function import Function
from ..problem.map import Map
from ..problem.two_sided import mid, sides_of
from ..solve.goal import RTOL
from ..solve.solution import Solution, Status
from .affine_rows import SumOfTerms

#: a side counts as 0 up to this multiple of rtol, as a share of its terms: by default 1e-6, the tolerance of PATH and
#: of GAMS's other MCP solvers; a smaller rtol than the default does not make it smaller
_RTOL_FACTOR = 100.0


@runtime_checkable
class Reading(Protocol):
    """A model in another language, read as an ICP. A further language needs a class with these five members."""

    @property
    def problem(self) -> ICP:
        """The ICP. Raises InputError, with the name of the wrong part, if the model is not an ICP."""

    def start(self) -> Vector | None:
        """The present values of the variables, as z of `problem`, shape (n,); None where none has one."""

    def values(self, z: Vector) -> list[tuple[Any, Any]]:
        """The variables of the model, each with its value at `z`, shape (n,)."""

    def multipliers(self, z: Vector) -> list[tuple[Any, Any]]:
        """The conditions of the model, each with p at `z`: the force that holds its r ≥ 0."""

    def row_name(self, row: int) -> str:
        """The name of the condition or the equation of a row, for messages."""


def solved(reading: Reading, method: str | Method | None = None, *, z0: Any = None, **options: Any) -> Solution:
    """Solve the problem of `reading`, from the present values of its variables unless `z0` is given.

    Returns
    -------
    Solution
        Solved or not. It is also judged in the units of each condition: the smaller of p and r must be
        small relative to its own terms. If it is not, the solution is polished. If that does not help,
        the status is PRECISION_LIMIT. A contradiction has the names of the model.
    """
    problem = reading.problem
    start = reading.start() if z0 is None else z0
    solution = problem.solve(method, z0=start, raise_on_failure=False, **options)
    if solution.status is Status.INFEASIBLE:
        return _with_names(reading, solution)
    # the user has chosen the units of `accuracy` and of `atol`, by which the run was judged
    if not solution.solved or solution.accuracy or solution.residual > solution.tolerance:
        return solution
    limit = _RTOL_FACTOR * max(RTOL, options.get("rtol") or 0.0)
    shares = _shares(reading, solution.z)
    if not shares.max(initial=0.0) > limit:
        return solution
    finer = solution.polish()
    if not _shares(reading, finer.z).max() > limit:
        return finer
    row = int(np.argmax(shares))
    message = (
        f"{reading.row_name(row)} is satisfied only to {shares[row]:.2g} of its own terms, although the residual of "
        "all rows is small: lower rtol, or scale the variables to similar sizes"
    )
    return replace(solution, status=Status.PRECISION_LIMIT, message=message)


def _with_names(reading: Reading, solution: Solution) -> Solution:
    """The infeasible `solution` with the model's names in its contradiction and its message."""
    if solution.contradiction is None:
        return solution
    named = solution.contradiction.named(lambda row: reading.row_name(row).removesuffix(","))
    solution = replace(solution, message=f"{named}. No values of the variables meet these conditions together")
    solution.__dict__["contradiction"] = named
    return solution


@np.errstate(over="ignore", invalid="ignore", divide="ignore")
def _shares(reading: Reading, z: Vector) -> Vector:
    """|mid(z − ψ̄, p, z − ψ)|, row by row, where each of the three is divided by the sum of its terms' absolute values.

    No |z_j| counts as smaller than the rounding of the largest one, which no method resolves.
    """
    problem = reading.problem
    size = np.maximum(np.abs(z), max(UNIT_ROUNDOFF * np.abs(z).max(initial=0.0), np.finfo(float).tiny))
    terms_of_p = problem.matrix.magnitude(size) + np.abs(problem.q)
    if problem.f is not None:
        terms_of_p = terms_of_p + _terms(problem.f.map, z, size)
    sides = [(problem.p(z), terms_of_p)]
    sides += [(z - psi.value(z), _terms(psi, z, size, sp.eye_array(z.size))) for psi in sides_of(problem.psi)]
    shares = (np.where(np.isfinite(side / terms), side / terms, side) for side, terms in sides)
    return np.asarray(np.abs(mid(*shares)))


def _terms(psi: Map, z: Vector, size: Vector, D: Any = 0.0) -> Vector:
    """The sums of the absolute values of the terms of Dz − ψ(z), shape (n,), where |z| counts as `size`."""
    nonlinear = 0.0
    if psi.linear is not None:
        G, c = psi.linear
    elif isinstance(psi, Function) and isinstance(psi.fun, SumOfTerms):
        G = psi.fun.G
        c = psi.fun.c
        nonlinear = abs(psi.fun.V) @ psi.fun.w.magnitude(z)
    else:
        G = sp.csr_array((z.size, z.size))
        c = psi.value(z)
    return np.asarray(abs(D - G) @ size + np.abs(c) + nonlinear)
