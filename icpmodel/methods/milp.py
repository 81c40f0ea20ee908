"""The problem as a mixed-integer program, solved by HiGHS."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from functools import partial
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.affine_lcp import dense_matrix
from ..algebra.equations import solve_on
from ..algebra.linear_rows import LinearRows
from ..errors import MapError, OutOfTime, SingularOperator
from ..numerics import work
from ..numerics.arrays import Mask, Vector
from ..problem.data import ProblemData
from .contract import Iterate, Method, with_options
from .enumeration import successive_linearisations

#: problems with more unknowns are refused
MAX_UNKNOWNS = 150
#: bounds on p and r that are tried in turn, in units of the largest entry of q, c and d; beyond the second one the
#: tolerance of HiGHS, 1e-6 for y, leaves p and r too much room
BOUNDS = (1e2, 1e4)
#: the largest number of active sets that are excluded for each bound because their z is no solution
_MAX_CUTS = 5


class ActiveRows(NamedTuple):
    """The rows at an obstacle, those of them at the upper one, and the binary variables and z of HiGHS."""

    active: Mask
    above: Mask
    binaries: Vector
    z: Vector


@with_options
class MixedInteger(Method):
    """p_i ≤ M(1 − y_i) and r_i ≤ M y_i with y_i ∈ {0, 1}: HiGHS finds an active set, whose linear system gives z.

    Notes
    -----
    Up to 150 unknowns are taken. M is 100, and then 10⁴, times the largest entry of q, c and d. If HiGHS finds no
    active set, nothing is proved.

    The objective, the sum of p and r, leads the search; the first active set ends it. With an upper obstacle
    p_i ≥ −M(1 − y'_i) and s_i ≤ M y'_i, s = ψ̄ − z. An active set whose z does not solve the problem is excluded by a
    cut. Where its equations are singular, z is that of HiGHS. An obstacle that is not affine is linearised at the best
    point so far.

    References
    ----------
    Pardalos and Rosen, SIAM J. Sci. Stat. Comput. 9 (1988): the LCP as a mixed-integer program. Huangfu and Hall, Math.
    Program. Comput. 10 (2018): HiGHS.

    Examples
    --------
    >>> ICP([[0, 1], [1, 0]], [-1, -1]).solve("milp").z
    array([1., 1.])
    """

    name: ClassVar[str] = "milp"
    finite: ClassVar[bool] = True

    def why_not(self, problem: ProblemData) -> str | None:
        if (reason := problem.psi.no_derivative()) is not None:
            return reason
        if problem.n > MAX_UNKNOWNS:
            return f"branch and bound may take minutes beyond n = {MAX_UNKNOWNS}; this n is {problem.n}"
        return None

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        return successive_linearisations(problem, z, partial(_solutions, problem))


def _solutions(problem: ProblemData, z: Vector) -> Iterator[Vector]:
    """Solutions of the linear systems of active sets that HiGHS finds, obstacles being linearised at `z`.

    Raises OutOfTime.
    """
    dense_matrix(problem)  # raises OutOfMemory where it does not fit
    rows = LinearRows.of(problem, z)
    scale = rows.scale
    rows = rows.in_units(scale)
    if not np.isfinite(rows.q).all():  # q overflows in units in which the entries of A are about 1
        return
    for bound in BOUNDS:
        cuts: list[Vector] = []
        while len(cuts) < _MAX_CUTS and (choice := active_set(rows, bound, cuts)) is not None:
            with suppress(MapError):
                try:
                    yield solve_on(problem, z, choice.active, choice.above if problem.upper is not None else None)
                except SingularOperator:  # the active set has several solutions, one of which HiGHS found
                    yield scale * choice.z
            cuts.append(choice.binaries)


def active_set(rows: LinearRows, bound: float, cuts: list[Vector]) -> ActiveRows | None:
    """An active set with |p_i|, r_i ≤ `bound`, and none of the `cuts`; None where HiGHS finds none.

    Raises OutOfTime where the time limit ended the search.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    n = rows.n
    below = np.isfinite(rows.c)
    above = np.isfinite(rows.d)
    constraints = _constraints(rows, bound)
    for cut in cuts:
        sign = np.where(cut > 0.5, 1.0, -1.0)
        constraints.append((np.append(np.zeros(n), sign)[None, :], -np.inf, sign[cut > 0.5].sum() - 1.0))
    signs = (below & ~above).astype(float) - (above & ~below)  # of p and r in rows with one obstacle
    objective = signs @ (rows.A + np.where(below[:, None], rows.R, rows.S))
    lowest = np.concatenate([np.full(n, -np.inf), ~below, ~above])
    highest = np.concatenate([np.full(n, np.inf), np.ones(2 * n)])
    # the first active set ends the search, whatever the objective could be
    options = {"mip_rel_gap": np.inf, "time_limit": work.seconds_left()}
    work.check_budget()
    result = milp(
        np.append(objective, np.zeros(2 * n)),
        integrality=np.append(np.zeros(n), np.ones(2 * n)),
        bounds=Bounds(lowest, highest),
        constraints=[LinearConstraint(*one) for one in constraints if one[0].shape[0]],
        options=options,
    )
    if result.status == 1:
        raise OutOfTime("branch and bound did not end within the time limit")
    if result.x is None:
        return None
    lower = result.x[n : 2 * n] < 0.5
    upper = result.x[2 * n :] < 0.5
    return ActiveRows(lower | upper, upper & ~lower, np.round(result.x[n:]), result.x[:n])


def _constraints(rows: LinearRows, bound: float) -> list[tuple[Any, Any, Any]]:
    """(M, lower, upper) with lower ≤ M(z, y, y') ≤ upper.

    y_i = 1: above the lower obstacle, so p_i ≤ 0; y'_i = 1: below the upper one, so p_i ≥ 0.
    """
    n = rows.n
    below = np.isfinite(rows.c)
    above = np.isfinite(rows.d)
    zero = sp.csr_array((n, n))
    big_M = bound * sp.eye_array(n)
    return [
        (sp.hstack([rows.A, big_M, zero]), -np.inf, bound - rows.q),
        (sp.hstack([rows.A, zero, -big_M]), -bound - rows.q, np.inf),
        (sp.hstack([rows.R, -big_M, zero]).tocsr()[below], -np.inf, rows.c[below]),
        (sp.hstack([rows.R, zero, zero]).tocsr()[below], rows.c[below], np.inf),
        (sp.hstack([-rows.S, zero, -big_M]).tocsr()[above], -np.inf, -rows.d[above]),
        (sp.hstack([rows.S, zero, zero]).tocsr()[above], -np.inf, rows.d[above]),
    ]
