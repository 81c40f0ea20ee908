"""Few unknowns: from the arrays to the judged answer in one compiled call, without a run."""

from __future__ import annotations

import numpy as np

from ..algebra.affine_lcp import MAX_PIVOTS_PER_ROW, PIVOT_UP_TO, inverse_of_I_minus_G
from ..errors import SingularOperator
from ..methods.shortcuts import Lemke
from ..numerics import work
from ..numerics.arrays import read_only
from ..problem.data import ProblemData
from .goal import Limits
from .solution import Solution, Status

_LEMKE = Lemke()
_NO_INVERSE = np.array([[]])


def solve_small(problem: ProblemData, limits: Limits) -> Solution | None:
    """The solution by one chain of Lemke's pivots; None if they do not reach the tolerance, or do not apply.

    They apply to dense A, n ≤ 64, with constant obstacles or one affine obstacle. Only the pivots refine the answer.
    """
    A = problem.matrix.dense
    n = problem.n
    psi = problem.psi
    if A is None or n > PIVOT_UP_TO or psi.linear is None or not (psi.is_constant or psi.upper is None):
        return None
    from .kernels.few_unknowns import solve_few  # loads numba

    start_time = work.clock()
    G, c = psi.linear
    d = np.full(n, np.inf) if psi.upper is None else psi.upper.value(c)
    M, inverse = A, _NO_INVERSE
    try:
        if not psi.is_constant:
            inverse = inverse_of_I_minus_G(G.toarray())
            with np.errstate(over="ignore", invalid="ignore"):
                M = A @ inverse
    except SingularOperator:
        return None
    slopes = (G.indptr, G.indices, G.data)
    arrays = read_only((A, problem.q, slopes, c, d, M, inverse))
    z, residual, tolerance = solve_few(*arrays, float(limits.rtol), MAX_PIVOTS_PER_ROW * (n + 1))
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
        seconds=work.clock() - start_time,
        cost=cost,
    )
