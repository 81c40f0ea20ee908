"""IPOPT, a library in CasADi's wheel: it minimises the sum of the products of the conditions, convex or not.

    min uᵀr   subject to   u, r ≥ 0,   u = Tp(z) + Vv,   r = Rz + b,   and Tp(z) = 0 in the free rows.

The matrices are those of `icpmodel.solvers.formulations.Conditions`.
Let p be affine, ψ constant and A row sufficient, for example a P-matrix. Then every stationary
point is a solution. Otherwise IPOPT may stop at one with uᵀr > 0.

References
----------
Wächter and Biegler, Math. Program. 106 (2006), doi 10.1007/s10107-004-0559-y. Cottle, Pang and
Stone, The Linear Complementarity Problem (2009), section 3.5.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..errors import MapError
from ..numerics.arrays import Vector
from ..problem.nonlinear_term import NonlinearTerm
from .foreign import Claim, ForeignSolver
from .formulations import Target

#: for affine p
_OPTIONS: dict[str, Any] = {
    # by default IPOPT relaxes every bound by 1e-8
    "bound_relax_factor": 0.0,
    # fewer steps on each of nine scenes, n = 1 to 900, and the bearing of n = 900 is not called infeasible
    "mehrotra_algorithm": "yes",
    "print_level": 0,
    "sb": "yes",
}


class Ipopt(ForeignSolver):
    """IPOPT on the MPEC or, with nonlinear p, on the NLP; the derivatives, except f′, are CasADi's."""

    name = "ipopt"
    package = "casadi"
    extra = "ipopt"
    forms = ("mpec", "nlp")
    used_by = ("crosscheck",)
    tight = (1e-13, 1e-10)
    # nothing interrupts a factorisation: with a full A of n = 1000 a step takes 2.6 s (2 cores, CasADi 3.8.2)
    largest = 1000
    too_large = "a step may take minutes"

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        import casadi as ca

        n = target.problem.n
        f = None if target.problem.f is None else _as_casadi(target.problem.f)
        program = _program(target, f)
        options = {**_OPTIONS, "tol": tolerance, "max_wall_time": float(time_limit)}
        settings: dict[str, Any] = {"print_time": False, "error_on_fail": False, "ipopt": options}
        if f is not None:
            settings["hess_lag"] = _curvature(program)
            # on 14 of 15 problems of the literature it took 27 steps at most; on the other one it did not end
            options |= {"mehrotra_algorithm": "no", "max_iter": 300}
        # f is returned, as CasADi does not keep it alive; with f the start is 1, as at 0 the slope of a power is 0
        return ca.nlpsol("icp", "ipopt", program, settings), {"x0": 0.0 if f is None else 1.0, **_bounds(target)}, n, f

    def run(self, model: Any) -> Claim:
        solver, data, n, _ = model
        x = solver(**data)["x"]
        stats = solver.stats()
        if stats["return_status"] == "NonIpopt_Exception_Thrown":  # by Ctrl-C only, which CasADi does not pass on
            raise KeyboardInterrupt
        return Claim(np.asarray(x).ravel()[:n], stats["return_status"], stats["success"])


def _program(target: Target, f: Any) -> dict[str, Any]:
    """The variables (z, v, u, r), the objective and the equations, in symbols of CasADi."""
    import casadi as ca

    conditions = target.conditions
    with_obstacle = sum(conditions.sizes[:2])
    n = target.problem.n
    sizes = (n, conditions.V.shape[1], conditions.b.size, with_obstacle)
    z, v, u, r = parts = [ca.MX.sym(name, size) for name, size in zip("zvur", sizes, strict=True)]

    def times(matrix: Any, x: Any) -> Any:
        return ca.mtimes(ca.DM(sp.csc_matrix(matrix)), x)

    p = times(target.problem.A, z) + target.problem.q + (0.0 if f is None else f(z))
    zero = [
        times(conditions.T, p) + times(conditions.V, v) - u,
        times(conditions.R[:with_obstacle], z) + conditions.b[:with_obstacle] - r,
    ]
    return {"x": ca.vertcat(*parts), "f": ca.dot(u[:with_obstacle], r), "g": ca.vertcat(*zero)}


def _curvature(program: dict[str, Any]) -> Any:
    """The Hessian of the objective alone: where the objective is 0, the multipliers of f″ are 0."""
    import casadi as ca

    factor = ca.MX.sym("factor")
    multipliers = ca.MX.sym("multipliers", program["g"].size1())
    second = ca.hessian(factor * program["f"], program["x"])[0]
    return ca.Function("curvature", [program["x"], ca.MX(), factor, multipliers], [ca.triu(second)])


def _as_casadi(f: NonlinearTerm) -> Any:
    """f and f′ as a CasADi callback; where the user's code fails, it gives NaN, at which IPOPT shortens its step."""
    import casadi as ca

    n = f.n
    dense = ca.Sparsity.dense(n)
    links = f.map.links
    pattern = ca.Sparsity.dense(n, n) if links is None else ca.DM(sp.csc_matrix(links)).sparsity()

    def slopes(z: Vector) -> Any:
        return ca.project(ca.DM(sp.csc_matrix(f.jacobian(z))), pattern)

    class Code(ca.Callback):
        def __init__(self, name: str, function: Callable[[Vector], Any], inputs: int, output: Any) -> None:
            super().__init__()
            self.function = function
            self.inputs = inputs
            self.output = output
            self.construct(name, {})

        def get_n_in(self) -> int:
            return self.inputs

        def get_sparsity_in(self, _: int) -> Any:
            return dense

        def get_sparsity_out(self, _: int) -> Any:
            return self.output

        def eval(self, arguments: Any) -> Any:
            try:
                return [ca.DM(self.function(np.asarray(arguments[0]).ravel()))]
            except MapError:
                return [ca.DM(self.output, np.nan)]

        def has_jacobian(self) -> bool:
            return self.inputs == 1

        def has_jac_sparsity(self, *_: int) -> bool:
            return self.inputs == 1

        def get_jac_sparsity(self, *_: Any) -> Any:
            return pattern

        def get_jacobian(self, name: str, *_: Any) -> Any:
            self.derivative = Code(name, slopes, 2, pattern)
            return self.derivative

    return Code("f", f.value, 1, dense)


def _bounds(target: Target) -> dict[str, Any]:
    """The bounds of (z, v, u, r), and of the equations.

    Where the obstacles touch, r = 0 implies s = 0. Then r and v are fixed at 0, and p + v may have either sign.
    """
    rows = target.conditions.rows
    below, above, free = target.conditions.sizes
    unbounded = np.full(target.problem.n + target.conditions.V.shape[1], np.inf)
    meet = target.parallel & (target.c == target.d)[rows[: below + above]]
    first = np.arange(below + above) < below
    u_min, r_min = (np.where(meet & of, -np.inf, 0.0) for of in (first, ~first))
    u_max, r_max = (np.where(meet & of, 0.0, np.inf) for of in (~first, first))
    lower = np.concatenate([-unbounded, u_min, np.zeros(free), r_min])
    upper = np.concatenate([unbounded, u_max, np.zeros(free), r_max])
    return {"lbx": lower, "ubx": upper, "lbg": 0.0, "ubg": 0.0}
