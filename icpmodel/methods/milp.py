"""The mixed-integer form of a problem, by HiGHS."""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..algebra.affine_lcp import dense_matrix
from ..algebra.equations import solve_on
from ..algebra.linear_rows import LinearRows
from ..errors import MapError, OutOfTime, SingularOperator
from ..numerics import work
from ..numerics.arrays import Mask, Vector
from ..problem.data import ProblemData
from ..theory.answers import Answer
from .contract import Infeasible, Iterate, Method

#: problems with more unknowns are refused
LARGEST = 150
#: bounds on p and r that are tried in turn, in units of the largest entry of q, c and d
BOUNDS = (1e2, 1e4)
#: beyond such a bound that is certain HiGHS's tolerances, 1e-6, leave too much room for a proof
_CERTAIN = 1e4
#: the first active set ends the search, whatever the objective could be
_ANY_GAP = 1e9
#: active sets that are excluded because their solution does not hold, and linearisations of an obstacle
_CUTS, _LINEARISATIONS = 20, 20


class ActiveRows(NamedTuple):
    """The rows at an obstacle, those of them at the upper one, and the binary variables that say so."""

    active: Mask
    above: Mask
    binaries: NDArray[np.float64]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class MixedInteger(Method):
    """p_i ≤ M(1 − y_i) and r_i ≤ M y_i with y_i ∈ {0, 1}: HiGHS finds an active set, whose linear system gives z.

    Raises
    ------
    Infeasible
        Where HiGHS finds no active set within bounds M that are certain: those of the data, where every row has two
        constant obstacles.

    Notes
    -----
    Elsewhere M is a guess, 100 times the largest entry of q, c and d and then 10⁴ times; that nothing is found then
    proves nothing. The objective, the sum of p and r, leads the search; the first active set ends it. With an obstacle
    above p_i ≥ −M(1 − y'_i) and s_i ≤ M y'_i, s = ψ̄ − z. An active set whose z does not solve the problem is excluded
    by a cut, and the program solved again. An obstacle that is not affine is linearised at the last point.

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
    memoryless: ClassVar[bool] = False
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
        for _ in range(1 if problem.psi.linear is not None else _LINEARISATIONS):
            best = (np.inf, z)
            for found in _solutions(problem, z):
                residual = problem.residual(found)
                best = min(best, (residual, found), key=lambda pair: pair[0])
                yield found, residual
            if best[1] is z:
                return
            z = best[1]


def _solutions(problem: ProblemData, z: Vector) -> Iterator[Vector]:
    """Solutions of the linear systems of active sets that HiGHS finds, obstacles being linearised at `z`.

    Raises Infeasible where there are none and that is proved, and OutOfTime.
    """
    rows = LinearRows.of(problem, z)
    certain = certain_bound(rows) if problem.psi.linear is not None else math.inf
    for bound in (certain,) if certain <= _CERTAIN else BOUNDS:
        cuts: list[NDArray[np.float64]] = []
        while len(cuts) < _CUTS and (found := active_set(rows, bound, cuts)) is not None:
            with suppress(SingularOperator, MapError):
                yield solve_on(problem, z, found.active, found.above if problem.upper is not None else None)
            cuts.append(found.binaries)
        if bound == certain and not cuts:
            limits = f"with p and r at most {certain:.3g}, as the obstacles imply"
            raise Infeasible(Answer(True, f"no z solves the problem: its mixed-integer form has no solution {limits}"))


def scale_of(rows: LinearRows) -> float:
    """The largest |entry| of q, c and d, 1 where all are 0."""
    sizes = np.concatenate([rows.q, rows.c, rows.d])
    return float(np.abs(sizes[np.isfinite(sizes)]).max(initial=0.0)) or 1.0


def certain_bound(rows: LinearRows) -> float:
    """A bound on |p|, r and s at every solution, in units of `scale_of`; infinite where none is known."""
    identity = np.eye(rows.n)
    if not (np.array_equal(rows.R, identity) and np.array_equal(rows.S, identity)):
        return math.inf
    with np.errstate(invalid="ignore"):
        size = np.maximum(np.abs(rows.c), np.abs(rows.d))
        largest = max(float((np.abs(rows.A) @ size + np.abs(rows.q)).max()), float((rows.d - rows.c).max()))
    return 1.01 * largest / scale_of(rows) if math.isfinite(largest) else math.inf


def active_set(rows: LinearRows, bound: float, cuts: list[NDArray[np.float64]]) -> ActiveRows | None:
    """An active set with p and r at most `bound` in units of `scale_of`, and none of the `cuts`; None where there is
    none. Raises OutOfTime where HiGHS had no time to tell."""
    from scipy.optimize import Bounds, LinearConstraint, milp

    n, scale = rows.n, scale_of(rows)
    below, above = np.isfinite(rows.c), np.isfinite(rows.d)
    q, c, d = rows.q / scale, np.where(below, rows.c, 0.0) / scale, np.where(above, rows.d, 0.0) / scale
    nothing, M = sp.csr_array((n, n)), bound * sp.eye_array(n)
    # y_i = 1: above the lower obstacle, so p_i ≤ 0; y'_i = 1: below the upper one, so p_i ≥ 0
    constraints = [
        LinearConstraint(sp.hstack([rows.A, M, nothing]), -np.inf, bound - q),
        LinearConstraint(sp.hstack([rows.A, nothing, -M]), -bound - q, np.inf),
        LinearConstraint(sp.hstack([rows.R, -M, nothing]).tocsr()[below], -np.inf, c[below]),
        LinearConstraint(rows_beside(rows.R, n)[below], c[below], np.inf),
        LinearConstraint(sp.hstack([-rows.S, nothing, -M]).tocsr()[above], -np.inf, -d[above]),
        LinearConstraint(rows_beside(rows.S, n)[above], -np.inf, d[above]),
    ]
    for cut in cuts:
        sign = np.where(cut > 0.5, 1.0, -1.0)
        constraints.append(LinearConstraint(np.append(np.zeros(n), sign), -np.inf, sign[cut > 0.5].sum() - 1.0))
    direction = (below & ~above).astype(float) - (above & ~below)  # p and r have a sign in rows with one obstacle
    objective = direction @ (rows.A + np.where(below[:, None], rows.R, rows.S))
    lowest = np.concatenate([np.full(n, -np.inf), ~below, ~above])
    highest = np.concatenate([np.full(n, np.inf), np.ones(2 * n)])
    options = {"mip_rel_gap": _ANY_GAP} | ({} if math.isinf(left := work.seconds_left()) else {"time_limit": left})
    work.afford()
    found = milp(
        np.append(objective, np.zeros(2 * n)),
        integrality=np.append(np.zeros(n), np.ones(2 * n)),
        bounds=Bounds(lowest, highest),
        constraints=[one for one in constraints if one.A.shape[0]],
        options=options,
    )
    if found.status == 1:
        raise OutOfTime("branch and bound did not end in what was left of the time")
    if found.x is None:
        return None
    lower, upper = found.x[n : 2 * n] < 0.5, found.x[2 * n :] < 0.5
    return ActiveRows(lower | upper, upper & ~lower, np.round(found.x[n:]))


def rows_beside(M: Any, n: int) -> sp.csr_array:
    """`M`, shape (m, n), with 2n columns of zeros beside it."""
    return sp.csr_array(sp.hstack([M, sp.csr_array((M.shape[0], 2 * n))]))
