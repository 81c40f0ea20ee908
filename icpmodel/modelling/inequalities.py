"""Inequalities of a model besides its conditions: they determine no unknown, and are checked at the answer."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import MapError
from ..numerics.arrays import Vector
from ..numerics.rounding import gamma
from ..solve.goal import RTOL
from ..solve.solution import Solution, Status
from .affine_rows import AffineRows


def checked(solution: Solution, rows: AffineRows, name: Callable[[int], str]) -> Solution:
    """`solution` if all `rows` are ≤ 0 at its z; else one with another status, whose message names a violated row.

    A row counts as ≤ 0 up to the default rtol of the sum of its terms' absolute values.

    Parameters
    ----------
    solution : Solution
        A solution of the conditions and equations.
    rows : AffineRows
        The inequalities in the first entries of z; a row with the constant −inf always holds.
    name : callable
        Row → the name of its inequality in messages.

    Returns
    -------
    Solution
        It is polished if the solution violates a row. Its status is INFEASIBLE if it is proved that no
        solution of the conditions satisfies the inequalities, STAGNATED if they are violated otherwise.
    """
    rows = rows.wider(solution.z.size - rows.Z.shape[1])
    values, terms = _values(rows, solution.z)
    if not (values > RTOL * terms).any():
        return solution
    solution = solution.polish()
    values, terms = _values(rows, solution.z)
    absolute = abs(rows.Z)
    # the residual is in the units of z, whose error may be as large
    violated = values > RTOL * terms + solution.residual * np.asarray(absolute.sum(axis=1))
    if not violated.any():
        return solution
    error = None
    noise = gamma(np.diff(rows.Z.indptr) + 2) * terms
    with contextlib.suppress(MapError):
        error = solution.certificate.bound.componentwise
    proved = np.zeros(violated.size, dtype=bool) if error is None else violated & (values > absolute @ error + noise)
    row = int(np.argmax(np.where(proved if proved.any() else violated, values, -np.inf)))
    if proved[row]:
        status, more = Status.INFEASIBLE, "the conditions have no other solution"
    else:
        status = Status.STAGNATED
        more = "the conditions may have another solution, or a more accurate one: start elsewhere, or lower rtol"
    message = f"{name(row)} is violated by {values[row]:.3g}: no condition of the model implies it; {more}"
    return replace(solution, status=status, message=message)


def _values(rows: AffineRows, z: Vector) -> tuple[Vector, Vector]:
    """The rows at `z`, and the sums of the absolute values of their terms."""
    Z, _, constant = rows
    finite = np.where(np.isfinite(constant), constant, 0.0)
    return Z @ z + constant, abs(Z) @ np.abs(z) + np.abs(finite)
