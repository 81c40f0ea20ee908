"""The mixed-integer form of a problem, by HiGHS."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.sparse as sp

from ..algebra.affine_lcp import dense_matrix
from ..algebra.equations import solve_on
from ..algebra.linear_rows import Dense, LinearRows
from ..errors import MapError, OutOfTime, SingularOperator
from ..numerics import work
from ..numerics.arrays import Mask, Vector
from ..problem.data import ProblemData
from ..theory.answers import Answer
from .contract import Infeasible, Iterate, Method
from .enumeration import MAX_LINEARISATIONS

#: problems with more unknowns are refused
LARGEST = 150
#: bounds on p and r that are tried in turn, in units of the largest entry of q, c and d; beyond the second one the
#: tolerance of HiGHS, 1e-6 for y, leaves p and r too much room
BOUNDS = (1e2, 1e4)
#: what is added to a bound that a linear program gives, relative and absolute, for its tolerance of 1e-7
_MARGIN = 0.01
#: HiGHS takes entries of a matrix up to this size for 0 (its option `small_matrix_value`)
_SMALLEST_ENTRY = 1e-9
#: the first active set ends the search, whatever the objective could be
_MIP_GAP = 1e9
#: active sets that are excluded because their solution does not hold
_MAX_CUTS = 5


class ActiveRows(NamedTuple):
    """The rows at an obstacle, those of them at the upper one, and the binary variables that say so."""

    active: Mask
    above: Mask
    binaries: Vector


class ValueBounds(NamedTuple):
    """Bounds on p, −p, r and s, shape (4, n), and whether every solution keeps them."""

    limits: Dense
    certain: bool


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MixedInteger(Method):
    """p_i ≤ M(1 − y_i) and r_i ≤ M y_i with y_i ∈ {0, 1}: HiGHS finds an active set, whose linear system gives z.

    Raises
    ------
    Infeasible
        Where HiGHS finds no active set within bounds M that are certain.

    Notes
    -----
    Up to 150 unknowns are taken. M is a guess first, 100 times the largest entry of q, c and d. If that gives no active
    set, and the z with p ≥ 0 and r ≥ 0 are bounded, linear programs give an M for each row. This M is certain where
    HiGHS ignores no small entry. Elsewhere M is 10⁴ times the largest entry. Without an active set that proves nothing.

    The objective, the sum of p and r, leads the search; the first active set ends it. With an upper obstacle
    p_i ≥ −M(1 − y'_i) and s_i ≤ M y'_i, s = ψ̄ − z. An active set whose z does not solve the problem is excluded by a
    cut. An obstacle that is not affine is linearised at the last point.

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
        if problem.n > LARGEST:
            return f"branch and bound may take minutes beyond n = {LARGEST}; this n is {problem.n}"
        return None

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        yield z, None
        dense_matrix(problem)  # raises OutOfMemory where it does not fit
        for _ in range(1 if problem.psi.linear is not None else MAX_LINEARISATIONS):
            best = (np.inf, z)
            for candidate in _solutions(problem, z):
                residual = problem.residual(candidate)
                best = min(best, (residual, candidate), key=lambda pair: pair[0])
                yield candidate, residual
            if best[1] is z:
                return
            z = best[1]


def _solutions(problem: ProblemData, z: Vector) -> Iterator[Vector]:
    """Solutions of the linear systems of active sets that HiGHS finds, obstacles being linearised at `z`.

    Raises Infeasible where there are none and that is proved, and OutOfTime.
    """
    rows = LinearRows.of(problem, z)
    rows = rows.in_units(rows.scale)
    if not np.isfinite(rows.q).all():  # no float in units in which the entries of A are about 1
        return
    for limits in limits_in_turn(rows):
        cuts: list[Vector] = []
        while len(cuts) < _MAX_CUTS and (choice := active_set(rows, limits, cuts)) is not None:
            with suppress(SingularOperator, MapError):
                yield solve_on(problem, z, choice.active, choice.above if problem.upper is not None else None)
            cuts.append(choice.binaries)
        if limits.certain and not cuts and problem.psi.linear is not None:
            reason = "HiGHS finds no choice of active rows, with bounds on p and r that all z with the right signs keep"
            raise Infeasible(Answer(True, f"no z solves the problem: {reason}"))


def limits_in_turn(rows: LinearRows) -> Iterator[ValueBounds]:
    """A guess, and then bounds that are proved, or guessed where nothing is proved. Raises OutOfTime."""
    first, last = (np.full((4, rows.n), bound) for bound in BOUNDS)
    yield ValueBounds(first, False)
    proved = proved_limits(rows)
    entries = np.abs([rows.A, rows.R, rows.S])
    complete = not ((entries > 0.0) & (entries <= _SMALLEST_ENTRY)).any()
    yield ValueBounds(np.minimum(proved, last), complete and bool((proved <= last).all()))


def proved_limits(rows: LinearRows) -> Dense:
    """The largest p, −p, r and s of all z with the right signs, shape (4, n), 0 where none is asked for.

    All are ∞ where some z with the right signs go to infinity. Raises OutOfTime.
    """
    n = rows.n
    (below, above) = (np.isfinite(rows.c), np.isfinite(rows.d))
    M = np.stack([rows.A, -rows.A, rows.R, -rows.S])
    v = np.stack([rows.q, -rows.q, np.where(below, -rows.c, 0.0), np.where(above, rows.d, 0.0)])
    # p ≥ 0 where there is no upper obstacle, p ≤ 0 where there is no lower one
    signs = np.stack([~above, ~below, below, above])
    G = M[signs]
    g = v[signs]
    work.check_budget()
    if (most := _largest(G.sum(axis=0), G, np.zeros(len(g)), 1.0)) is None or most > _MARGIN:
        return np.full((4, n), np.inf)
    limits = np.zeros((4, n))
    for k, i in np.argwhere(np.stack([below, above, below, above])):
        work.check_budget()
        most = _largest(M[k, i], G, g, np.inf)
        limits[k, i] = np.inf if most is None else most + v[k, i]
    return np.maximum(limits, 0.0) * (1.0 + _MARGIN) + _MARGIN


def _largest(objective: Vector, G: Dense, g: Vector, box: float) -> float | None:
    """The largest objective · z for Gz + g ≥ 0 and |z_i| ≤ box, −∞ where there is no z, None where it is unknown."""
    from scipy.optimize import linprog

    result = linprog(-objective, -G, g, bounds=(-box, box))
    if result.status == 0:
        return -float(result.fun)
    return -math.inf if result.status == 2 else None


def active_set(rows: LinearRows, most: ValueBounds, cuts: list[Vector]) -> ActiveRows | None:
    """An active set with p and r at most as large as in `most`, and none of the `cuts`; None where there is none.

    Raises OutOfTime where HiGHS had no time to tell.
    """
    from scipy.optimize import Bounds, LinearConstraint, milp

    n = rows.n
    below = np.isfinite(rows.c)
    above = np.isfinite(rows.d)
    constraints = _constraints(rows, most)
    for cut in cuts:
        sign = np.where(cut > 0.5, 1.0, -1.0)
        constraints.append((np.append(np.zeros(n), sign)[None, :], -np.inf, sign[cut > 0.5].sum() - 1.0))
    direction = (below & ~above).astype(float) - (above & ~below)  # p and r have a sign in rows with one obstacle
    objective = direction @ (rows.A + np.where(below[:, None], rows.R, rows.S))
    lowest = np.concatenate([np.full(n, -np.inf), ~below, ~above])
    highest = np.concatenate([np.full(n, np.inf), np.ones(2 * n)])
    options = {"mip_rel_gap": _MIP_GAP, "time_limit": work.seconds_left()}
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
    return ActiveRows(lower | upper, upper & ~lower, np.round(result.x[n:]))


def _constraints(rows: LinearRows, most: ValueBounds) -> list[tuple[Any, Any, Any]]:
    """(M, lower, upper) with lower ≤ M(z, y, y') ≤ upper.

    y_i = 1: above the lower obstacle, so p_i ≤ 0; y'_i = 1: below the upper one, so p_i ≥ 0.
    """
    n = rows.n
    (below, above) = (np.isfinite(rows.c), np.isfinite(rows.d))
    nothing = sp.csr_array((n, n))
    p, minus_p, r, s = (sp.diags_array(limit) for limit in most.limits)
    return [
        (sp.hstack([rows.A, p, nothing]), -np.inf, most.limits[0] - rows.q),
        (sp.hstack([rows.A, nothing, -minus_p]), -most.limits[1] - rows.q, np.inf),
        (sp.hstack([rows.R, -r, nothing]).tocsr()[below], -np.inf, rows.c[below]),
        (rows_beside(rows.R, n)[below], rows.c[below], np.inf),
        (sp.hstack([-rows.S, nothing, -s]).tocsr()[above], -np.inf, -rows.d[above]),
        (rows_beside(rows.S, n)[above], -np.inf, rows.d[above]),
    ]


def rows_beside(M: Any, n: int) -> sp.csr_array:
    """`M`, shape (m, n), with 2n columns of zeros beside it."""
    return sp.csr_array(sp.hstack([M, sp.csr_array((M.shape[0], 2 * n))]))
