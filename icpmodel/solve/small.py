"""Few unknowns over fixed obstacles: from the arrays to the judged answer in one compiled call, without a run."""

from __future__ import annotations

import numpy as np

from ..algebra.affine_lcp import PIVOT_UP_TO, PIVOTS
from ..methods.shortcuts import Lemke
from ..numerics import work
from ..problem.data import ProblemData
from .goal import Limits
from .solution import Solution, Status

_LEMKE = Lemke()


def pivoted(problem: ProblemData, limits: Limits) -> Solution | None:
    """The solution of a problem that `Lemke` solves by one chain of pivots; None where it does not, or is too large.

    It takes dense A, n ≤ 64, and constant obstacles. The refinement of the pivots is all there is.
    """
    M = problem.matrix.dense
    n = problem.n
    if M is None or n > PIVOT_UP_TO or not problem.psi.is_constant:
        return None
    from .kernels.few_unknowns import solve_few  # loads numba

    begun = work.clock()
    at_0 = np.zeros(n)
    below = problem.psi.value(at_0)
    above = np.full(n, np.inf) if problem.upper is None else problem.upper.value(at_0)
    z, residual, tolerance = solve_few(M, problem.q, below, above, float(limits.rtol), PIVOTS * (n + 1))
    if not residual <= tolerance:
        return None
    cost = work.COSTS.pivot_entry * n**3 / 3.0
    work.count(cost)
    return Solution(
        problem=problem,
        z=z,
        status=Status.SOLVED,
        message="solved",
        method=_LEMKE,
        adapted_method=_LEMKE,
        last_method=_LEMKE,
        why=f"n = {n} is small",
        residual=residual,
        tolerance=tolerance,
        atol=limits.atol,
        iterations=1,
        seconds=work.clock() - begun,
        cost=cost,
    )
