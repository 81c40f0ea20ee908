"""Inequalities that stand beside the conditions of a model: they determine nothing, and are checked at the answer."""

from __future__ import annotations

import contextlib
from collections.abc import Callable
from dataclasses import replace

import numpy as np

from ..errors import MapError
from ..numerics.rounding import gamma
from ..solve.solution import Solution, Status
from .affine_rows import AffineRows


def checked(solution: Solution, rows: AffineRows, name: Callable[[int], str]) -> Solution:
    """`solution` where all `rows`, in the first entries of its z, are ≤ 0; else one that says which is not.

    Parameters
    ----------
    solution : Solution
        Of the conditions and equations.
    rows : AffineRows
        The inequalities, with a constant −inf in a row that says nothing.
    name : callable
        What a message calls the inequality of a row.

    Returns
    -------
    Solution
        Its status is INFEASIBLE where it is proved that no solution of the conditions satisfies the inequalities,
        STAGNATED where they are violated otherwise.
    """
    z = solution.z
    Z = rows.wider(z.size - rows.Z.shape[1]).Z
    constant = rows.constant
    values, sizes = Z @ z + constant, np.asarray(abs(Z).sum(axis=1))
    terms = abs(Z) @ np.abs(z) + np.where(np.isfinite(constant), np.abs(constant), 0.0)
    noise = gamma(np.diff(Z.indptr) + 2) * terms
    # a residual is a step in z
    violated = values > sizes * max(solution.tolerance, solution.residual, solution.accuracy or 0.0) + noise
    if not violated.any():
        return solution
    error = None
    with contextlib.suppress(MapError):
        error = solution.certificate.bound.componentwise
    proved = np.zeros(violated.size, dtype=bool) if error is None else violated & (values > abs(Z) @ error + noise)
    row = int(np.argmax(np.where(proved if proved.any() else violated, values, -np.inf)))
    if proved[row]:
        status, more = Status.INFEASIBLE, "the conditions have no other solution"
    else:
        status = Status.STAGNATED
        more = "the conditions may have another solution, or a more accurate one: start elsewhere, or lower rtol"
    message = f"{name(row)} is violated by {values[row]:.3g}: no condition of the model implies it; {more}"
    return replace(solution, status=status, message=message)
