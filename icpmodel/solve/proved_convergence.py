"""Whether a method whose residual stays flat is proved to converge, and in how many steps."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..errors import IcpError, OutOfTime
from ..methods.contract import Method
from ..methods.modulus import ModulusMember
from ..numerics.arrays import Vector, norm
from ..numerics.rounding import rounded_up
from ..problem.data import ProblemData
from ..theory.answers import Allowance
from ..theory.certificates.bounds import classes_of
from ..theory.convergence.rates import Rate, predicted_rate
from ..theory.convergence.theorems import check_all


def proved_convergence(
    problem: ProblemData, method: Method, before: Vector, z: Vector, tolerance: float, iteration: int
) -> str:
    """Why `method` converges although its residual stays flat; empty where no theorem says so.

    Parameters
    ----------
    problem, method
        What is solved, and by what. Theorems are about memoryless members of the modulus family, without f.
    before, z : arrays of shape (n,)
        The last two iterates.
    tolerance : float
        The Res_D that is wanted.
    iteration : int
        The number of `z`. The theorems may take as many products with A.

    Notes
    -----
    A factor below 1 bounds the number of steps by |mid(D⁻¹p, r)| ≤ max(D⁻¹|A|, I + G)|z − z*|, where
    |ψ(x) − ψ(y)| ≤ G|x − y|. Where the step is isotone and has moved every entry down, all later steps do. For an
    M-matrix A and no upper obstacle −A⁻¹q bounds them below, as p(z) ≥ 0 there.
    """
    if not isinstance(method, ModulusMember) or not method.memoryless or problem.f is not None:
        return ""
    allowance = Allowance(float(iteration), problem.matrix.product_cost)
    try:
        checks = check_all(problem, method, allowance)
    except IcpError:  # ψ may fail
        return ""
    rate = predicted_rate(problem, method, checks)
    if isinstance(rate, Rate):
        G = problem.psi.lipschitz
        ones = np.ones(problem.n)
        matrix = problem.matrix
        growth = np.maximum(matrix.row_weights * matrix.magnitude(ones), 1.0 if G is None else 1.0 + G @ ones)
        accuracy = tolerance / norm(growth)
        steps = rate.steps(problem, z, accuracy) if 0.0 < accuracy < np.inf else None
        most = "" if steps is None else f", by step {iteration + steps} the residual is {rounded_up(tolerance)} at most"
        factor = rounded_up(rate.factor, 6, below=1.0)
        return f"it converges by theorem: each step leaves {factor} of the error{most}"
    if checks["monotone"].holds and problem.upper is None and (z <= before).all() and (z < before).any():
        with suppress(OutOfTime, MemoryError), allowance.enforced():
            if classes_of(problem).m.holds:
                return "it converges by theorem: every step moves each entry down, and -A^-1 q is below"
    return ""
