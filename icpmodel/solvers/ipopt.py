"""IPOPT, which CasADi's wheel holds as a library: it minimises the products of the conditions, convex or not.

    min uᵀr + vᵀs   subject to   u, r, v, s ≥ 0,   Az + q = u − v,   r = (I − G)z − c,   s = d − (I − H)z.

The rows are those of `icpmodel.solvers.formulations`. Let ψ be constant and A row sufficient, for
example a P-matrix. Then every point at which it may stop is a solution. Otherwise it may stop where
uᵀr + vᵀs > 0.

References
----------
Wächter and Biegler, Math. Program. 106 (2006), doi 10.1007/s10107-004-0559-y. Cottle, Pang and
Stone, The Linear Complementarity Problem (2009), section 3.5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from .foreign import Claim, ForeignSolver
from .formulations import Target


class Ipopt(ForeignSolver):
    """IPOPT on the MPEC, with the derivatives of CasADi."""

    name = "ipopt"
    package = "casadi"
    extra = "ipopt"
    forms = ("mpec",)
    used_by = ("crosscheck",)
    tight = (1e-13, 1e-10)
    # nothing stops a factorisation on the way: with a full A of n = 1000 a step takes 2.6 s (2 cores, CasADi 3.8.2)
    largest = 1000
    too_large = "a step may take minutes"

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        import casadi as ca

        n = target.problem.n
        with_obstacle = np.flatnonzero(target.has_obstacle)
        two_sided = np.flatnonzero(target.two_sided)
        unit = sp.eye_array(n, format="csr")
        sign = np.where(target.capped, -1.0, 1.0)
        sizes = (n, n, with_obstacle.size, two_sided.size, two_sided.size)
        z, u, r, v, s = parts = [ca.MX.sym(name, size) for name, size in zip("zurvs", sizes, strict=True)]

        def times(matrix: Any, x: Any) -> Any:
            return ca.mtimes(ca.DM(sp.csc_matrix(matrix)), x)

        zero = [
            times(target.problem.A, z)
            + target.problem.q
            - times(sp.diags_array(sign), u)
            + times(unit[:, two_sided], v),
            times(target.I_minus_G[with_obstacle], z) - target.near[with_obstacle] - sign[with_obstacle] * r,
        ]
        if target.d is not None:
            zero.append(target.d[two_sided] - times(target.I_minus_H, z) - s)
        options = {
            "tol": tolerance,
            "max_wall_time": float(time_limit),
            # it relaxes every bound by 1e-8 unless told not to
            "bound_relax_factor": 0.0,
            # fewer steps on each of nine scenes, n = 1 to 900, and the bearing of n = 900 is not called infeasible
            "mehrotra_algorithm": "yes",
            "print_level": 0,
            "sb": "yes",
        }
        gap = ca.dot(times(unit[with_obstacle], u), r) + ca.dot(v, s)
        program = {"x": ca.vertcat(*parts), "f": gap, "g": ca.vertcat(*zero)}
        quiet: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt": options}
        return ca.nlpsol("icp", "ipopt", program, quiet), {"x0": 0.0, **_bounds(target)}, n

    def run(self, model: Any) -> Claim:
        solver, data, n = model
        x = solver(**data)["x"]
        stats = solver.stats()
        if stats["return_status"] == "NonIpopt_Exception_Thrown":  # CasADi swallows Ctrl-C, and nothing else is thrown
            raise KeyboardInterrupt
        return Claim(np.asarray(x).ravel()[:n], stats["return_status"], stats["success"])


def _bounds(target: Target) -> dict[str, Any]:
    """The bounds of (z, u, r, v, s), and of the equations.

    Where the obstacles touch there is no room between them: r = 0, which makes s = 0, and u alone stands for both.
    """
    n = target.problem.n
    has_obstacle = target.has_obstacle
    two_sided = target.two_sided
    pinned = two_sided & (target.near == target.d) & target.parallel
    below = np.where(pinned, -np.inf, 0.0)
    room = np.where(pinned, 0.0, np.inf)
    count = int(two_sided.sum())
    least = (np.full(n, -np.inf), below, np.zeros(int(has_obstacle.sum())), np.zeros(count), below[two_sided])
    of_p = np.where(has_obstacle, np.inf, 0.0)
    most = (np.full(n, np.inf), of_p, room[has_obstacle], room[two_sided], np.full(count, np.inf))
    return {"lbx": np.concatenate(least), "ubx": np.concatenate(most), "lbg": 0.0, "ubg": 0.0}
