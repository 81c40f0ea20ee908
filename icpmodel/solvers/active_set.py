"""The primal–dual active set method for a fixed obstacle, cold: no other package, but what one writes in an afternoon.

Reference: Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), doi 10.1137/S1052623401383558.
"""

from __future__ import annotations

import time
from typing import Any

import numpy as np

from ..numerics.factorisation import factorise
from .foreign import Claim, ForeignSolver
from .formulations import Target


class ColdActiveSet(ForeignSolver):
    """The active-set method from z = 0, with a factorisation for every system.

    Its tolerance is Res_D(z)/Res_D(0). Rows with p_i ≤ a_ii r_i take the equation p_i = 0, the
    others r_i = 0. Where there is an obstacle above, rows with p_i < a_ii(z_i − ψ̄_i) take z_i =
    ψ̄_i.
    """

    name = "active set, cold"
    forms = ("mpec",)
    asked_by = ("race",)
    # its tolerance is of Res_D itself, if in other units

    def why_not(self, target: Target) -> str | None:
        return super().why_not(target) if target.problem.psi.is_constant else "psi is not constant"

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        return target, tolerance, time.perf_counter() + time_limit

    def run(self, model: Any) -> Claim:
        target, tolerance, end = model
        A = target.problem.A
        q = target.problem.q
        c = target.c
        d = target.d
        diagonal = A.diagonal()
        weight = np.where(diagonal > 0, diagonal, 1.0)
        z = np.zeros(q.size)
        before = np.zeros(0)
        start = 0.0
        while True:
            p = A @ z + q
            r = z - c
            residual = target.problem.residual_of(p, r, None if d is None else z - d)
            start = start or residual
            inactive = p <= weight * r
            side = c
            rows = inactive
            if d is not None:
                above = p < weight * (z - d)
                inactive = inactive & ~above
                side = np.where(above, d, c)
                rows = inactive - 1.0 * above
            if residual <= tolerance * start:
                return Claim(z, "solved", True)
            if np.array_equal(before, rows):
                return Claim(z, "the active set repeats", False)
            if time.perf_counter() > end:
                return Claim(z, "time limit", False)
            before = rows
            z = np.where(inactive, 0.0, side)
            if inactive.any():
                lu = factorise(A[inactive][:, inactive])
                if lu is None:
                    return Claim(z, "singular system", False)
                z[inactive] = lu.solve(-(A @ z + q)[inactive])
