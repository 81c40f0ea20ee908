"""OSQP through its own interface: an operator-splitting QP solver, with polishing (guess the active set and solve).

At its default settings OSQP calls "solved" what is wrong in the third digit; here it must reach 1e-10.
Reference: Stellato, Banjac, Goulart, Bemporad and Boyd, Math. Program. Comput. 12 (2020),
doi 10.1007/s12532-020-00179-2.
"""

from __future__ import annotations

from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from .contract import Answer, IndependentSolver, missing
from .formulations import QP, Target


class Osqp(IndependentSolver):
    """OSQP, version 1 or later, on the energy or else the gap."""

    name: ClassVar[str] = "osqp"
    forms: ClassVar[tuple[str, ...]] = ("energy", "gap")

    def why_not(self, target: Target) -> str | None:
        return missing("osqp") or super().why_not(target)

    def solve(self, target: Target, *, time_limit: float) -> Answer:
        """See `IndependentSolver.solve`. Raises KeyboardInterrupt, which OSQP itself turns into a status."""
        qp = target.qp(self.form(target))
        return claimed(set_up(qp, 1e-10, time_limit).solve(raise_error=False))


def set_up(qp: QP, tolerance: float, time_limit: float, *, polish: bool = True) -> Any:
    """An `osqp.OSQP` that is to solve `qp` to `tolerance`, absolute and relative, and then to `polish`."""
    import osqp

    model = osqp.OSQP()
    model.setup(
        sp.csc_matrix(sp.triu(qp.P)),
        qp.q,
        sp.csc_matrix(qp.K),
        qp.lower,
        qp.upper,
        verbose=False,
        eps_abs=tolerance,
        eps_rel=tolerance,
        eps_prim_inf=1e-12,
        eps_dual_inf=1e-12,
        max_iter=1_000_000,
        time_limit=float(time_limit),
        polishing=polish,
        polish_refine_iter=10,
    )
    return model


def claimed(result: Any) -> Answer:
    """The `result` of an `osqp.OSQP` as an answer. Raises KeyboardInterrupt, which OSQP itself turns into a status."""
    import osqp

    status = osqp.SolverStatus
    if result.info.status_val == status.OSQP_SIGINT:
        raise KeyboardInterrupt
    polished = ", polished" if result.info.status_polish == 1 else ""
    return Answer(np.array(result.x), f"{result.info.status}{polished}", result.info.status_val == status.OSQP_SOLVED)
