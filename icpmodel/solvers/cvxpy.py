"""Three QP solvers of different kinds through CVXPY: Clarabel (interior point), OSQP (splitting), HiGHS (active set).

CVXPY writes the model in its own way, so that these rows also check the model that the native interface was given.
Reference: Diamond and Boyd, J. Mach. Learn. Res. 17 (2016); Goulart and Chen, Clarabel (2024), arXiv 2405.12762;
Huangfu and Hall, Math. Program. Comput. 10 (2018), doi 10.1007/s12532-017-0130-5.
"""

from __future__ import annotations

import time
import warnings
from typing import Any, ClassVar

from .contract import Answer, IndependentSolver, missing
from .formulations import QP, Target


class _ThroughCvxpy(IndependentSolver):
    """What the three share. `solver` is CVXPY's name, `package` the module behind it; `options` are tried in turn,
    tightest first, as an interior-point method that cannot reach a tolerance may return a worse point than before."""

    solver: ClassVar[str]
    package: ClassVar[str]
    options: ClassVar[tuple[dict[str, Any], ...]]

    def why_not(self, target: Target) -> str | None:
        return missing("cvxpy") or missing(self.package) or super().why_not(target)

    def solve(self, target: Target, *, time_limit: float) -> Answer:
        import cvxpy as cp

        y, model = _model(target.qp(self.form(target)))
        end = time.perf_counter() + time_limit
        for k, options in enumerate(self.options):
            last = k + 1 == len(self.options)
            # at least a second, so that a later attempt is not lost to a nearly spent limit
            limit = max(end - time.perf_counter(), 1.0)
            try:
                with warnings.catch_warnings():
                    warnings.filterwarnings("ignore", message="Solution may be inaccurate")
                    model.solve(solver=self.solver, time_limit=limit, **options)
            except cp.SolverError:
                if last:
                    raise
                continue
            if model.status == cp.OPTIMAL or last:
                break
        looser = f", at the tolerances {options}" if k else ""
        return Answer(y.value, f"{model.status}{looser}", model.status == cp.OPTIMAL)


class CvxpyClarabel(_ThroughCvxpy):
    """Clarabel through CVXPY, on the energy or else the gap, at 1e-12 and, where that fails, at 1e-9."""

    name: ClassVar[str] = "cvxpy-clarabel"
    forms: ClassVar[tuple[str, ...]] = ("energy", "gap")
    solver: ClassVar[str] = "CLARABEL"
    package: ClassVar[str] = "clarabel"
    options: ClassVar[tuple[dict[str, Any], ...]] = tuple(
        {"tol_gap_abs": tol, "tol_gap_rel": tol, "tol_feas": tol} for tol in (1e-12, 1e-9)
    )


class CvxpyOsqp(_ThroughCvxpy):
    """OSQP through CVXPY, on the energy or else the gap."""

    name: ClassVar[str] = "cvxpy-osqp"
    forms: ClassVar[tuple[str, ...]] = ("energy", "gap")
    solver: ClassVar[str] = "OSQP"
    package: ClassVar[str] = "osqp"
    options: ClassVar[tuple[dict[str, Any], ...]] = (
        {"eps_abs": 1e-10, "eps_rel": 1e-10, "max_iter": 1_000_000, "polishing": True},
    )


class CvxpyHighs(_ThroughCvxpy):
    """HiGHS's active-set QP solver through CVXPY, on the gap, of n ≤ 1000.

    It takes the gap first, where it is quicker and where no other solver looks when the energy applies. By default it
    adds 1e-7 to the Hessian, which shows in the seventh digit; that is switched off. About one
    problem in twenty, at any settings, it ends with "Solve error" as its own constraints are violated by 1e-6 to 1e-4
    (HiGHS 1.15.1); the report then says failed.
    """

    name: ClassVar[str] = "cvxpy-highs"
    forms: ClassVar[tuple[str, ...]] = ("gap", "energy")
    solver: ClassVar[str] = "HIGHS"
    package: ClassVar[str] = "highspy"
    options: ClassVar[tuple[dict[str, Any], ...]] = (
        {"primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10, "qp_regularization_value": 0.0},
    )
    largest: ClassVar[int | None] = 1000
    too_large: ClassVar[str] = "HiGHS's QP solver takes minutes or gives up"


def _model(qp: QP) -> tuple[Any, Any]:
    """The QP as a CVXPY variable and problem. Its rows are equations or have a lower bound only."""
    import cvxpy as cp

    y = cp.Variable(qp.q.size)
    equal = qp.lower == qp.upper
    K = qp.K.tocsr()
    constraints = []
    if equal.any():
        constraints.append(K[equal] @ y == qp.lower[equal])
    if not equal.all():
        constraints.append(K[~equal] @ y >= qp.lower[~equal])
    # definiteness was decided before: psd_wrap saves CVXPY's own eigenvalue estimate
    energy = 0.5 * cp.quad_form(y, cp.psd_wrap(qp.P)) + qp.q @ y
    return y, cp.Problem(cp.Minimize(energy), constraints)
