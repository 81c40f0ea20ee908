"""OSQP through its own interface: operator splitting, then polishing (guess the active set and solve).

At its default settings OSQP calls an answer "solved" that is wrong in the third digit.
Reference: Stellato, Banjac, Goulart, Bemporad and Boyd, Math. Program. Comput. 12 (2020),
doi 10.1007/s12532-020-00179-2.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from .foreign import Claim, ForeignSolver
from .formulations import Target


class Osqp(ForeignSolver):
    """OSQP, version 1 or later."""

    name = package = "osqp"
    polishes: ClassVar[bool] = True

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        import osqp

        qp = self.pose(target)
        model = osqp.OSQP()
        rows = sp.csc_matrix(qp.K), qp.lower, qp.upper
        accuracy = {"eps_abs": tolerance, "eps_rel": tolerance, "eps_prim_inf": 1e-12, "eps_dual_inf": 1e-12}
        polishing = {"polishing": self.polishes, "polish_refine_iter": 10}
        limits = {"max_iter": 1_000_000, "time_limit": float(time_limit), "verbose": False}
        model.setup(sp.csc_matrix(sp.triu(qp.P)), qp.q, *rows, **accuracy, **polishing, **limits)
        return model

    def run(self, model: Any) -> Claim:
        """Solve; raise KeyboardInterrupt after Ctrl-C, which OSQP itself turns into a status."""
        import osqp

        result = model.solve(raise_error=False)
        status = osqp.SolverStatus
        if result.info.status_val == status.OSQP_SIGINT:
            raise KeyboardInterrupt
        polished = ", polished" if result.info.status_polish == 1 else ""
        solved = result.info.status_val == status.OSQP_SOLVED
        return Claim(np.array(result.x), f"{result.info.status}{polished}", solved)


class OsqpUnpolished(Osqp):
    """OSQP without polishing, its default: a race shows how accurate it is, also at its default tolerance, 1e-3."""

    name = "osqp, not polished"
    used_by = ("race",)
    polishes = False
