"""SCS: operator splitting for cones. Reference: O'Donoghue, SIAM J. Optim. 31 (2021), doi 10.1137/20M1366307."""

from __future__ import annotations

from typing import Any

import scipy.sparse as sp

from .foreign import Claim, ForeignSolver
from .formulations import Target


class Scs(ForeignSolver):
    """SCS with its direct linear solver."""

    name = package = "scs"
    used_by = ("race",)

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        import scs

        qp = self.pose(target)
        K, b, equations = qp.conic()
        data = {"P": sp.csc_matrix(sp.triu(qp.P)), "A": K, "b": b, "c": qp.q}
        cone = {"z": equations, "l": b.size - equations}
        limits = {"max_iters": 1_000_000, "time_limit_secs": float(time_limit)}
        return scs.SCS(data, cone, verbose=False, eps_abs=tolerance, eps_rel=tolerance, **limits)

    def run(self, model: Any) -> Claim:
        result = model.solve()
        return Claim(result["x"], result["info"]["status"], result["info"]["status_val"] == 1)
