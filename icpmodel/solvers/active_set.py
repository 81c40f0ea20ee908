"""The primal–dual active set method for a fixed obstacle, cold: no other package, but what one writes in an afternoon.

Reference: Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), doi 10.1137/S1052623401383558.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..numerics.arrays import norm
from ..numerics.factorisation import factorise
from .contract import Claim, ForeignSolver
from .formulations import Target


class ColdActiveSet(ForeignSolver):
    """z = 0 at the start, and SuperLU for every system; its tolerance is Res(z)/Res(0).

    The rows with p_i ≤ a_ii r_i are taken for p_i = 0, the others for r_i = 0.
    """

    name = "active set, cold"
    forms = ("mpec",)
    asked_by = ("race", "benchmark")
    # its tolerance is of Res itself, if in other units
    ladder = (1e-8, 1e-10, 1e-12)

    def why_not(self, target: Target) -> str | None:
        return super().why_not(target) if target.problem.is_lcp else "psi is not constant"

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        return target, tolerance, time.perf_counter() + time_limit

    def run(self, model: Any) -> Claim:
        """The time limit is looked at between its steps."""
        target, tolerance, end = model
        A, q, c = target.problem.A, target.problem.q, target.c
        diagonal = A.diagonal()
        weight = np.where(diagonal > 0, diagonal, 1.0)
        z, inactive, words, start = np.zeros(q.size), None, "", 0.0
        while not words:
            p, r = A @ z + q, z - c
            residual = norm(np.minimum(p, r))
            start = start or residual
            before, inactive = inactive, p <= weight * r
            if residual <= tolerance * start:
                words = "solved"
            elif before is not None and (before == inactive).all():
                words = "the active set repeats"
            elif time.perf_counter() > end:
                words = "time limit"
            else:
                z = np.where(inactive, 0.0, c)
                lu = factorise(A[inactive][:, inactive]) if inactive.any() else None
                if lu is not None:
                    z[inactive] = lu.solve(-(A @ z + q)[inactive])
                elif inactive.any():
                    words = "singular system"
        return Claim(z, words, words == "solved")
