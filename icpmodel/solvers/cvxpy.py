"""Three QP solvers of different kinds through CVXPY: Clarabel (interior point), OSQP (splitting), HiGHS (active set).

CVXPY writes the model in its own way, so that these also check the model that the native interfaces are given.
Reference: Diamond and Boyd, J. Mach. Learn. Res. 17 (2016).
"""

from __future__ import annotations

import warnings
from typing import Any, ClassVar

from .clarabel import clarabel_options
from .contract import Claim, ForeignSolver, missing
from .cvxpy_model import qp_model
from .formulations import Target
from .highs import highs_options
from .osqp import osqp_options


class _ThroughCvxpy(ForeignSolver):
    """What the three share: `solver` is CVXPY's name, and `options` gives the arguments for a tolerance."""

    asked_by = ("crosscheck",)
    solver: ClassVar[str]
    options: ClassVar[Any]

    def why_not(self, target: Target) -> str | None:
        return missing("cvxpy") or super().why_not(target)

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        return qp_model(target, self.form(target)), {**self.options(tolerance), "time_limit": float(time_limit)}

    def run(self, model: Any) -> Claim:
        problem, options = model
        with warnings.catch_warnings():
            warnings.filterwarnings("ignore", message="Solution may be inaccurate")
            problem.solve(solver=self.solver, **options)
        return Claim(problem.var_dict["z"].value, problem.status, problem.status == "optimal")


class CvxpyClarabel(_ThroughCvxpy):
    """Clarabel through CVXPY; where it cannot reach a tolerance it may return a worse point than at a looser one."""

    name, package, solver = "cvxpy-clarabel", "clarabel", "CLARABEL"
    tight = (1e-12, 1e-9)
    options = staticmethod(clarabel_options)


class CvxpyOsqp(_ThroughCvxpy):
    """OSQP through CVXPY."""

    name, package, solver = "cvxpy-osqp", "osqp", "OSQP"
    options = staticmethod(osqp_options)


class CvxpyHighs(_ThroughCvxpy):
    """HiGHS's active-set QP solver through CVXPY, of n ≤ 1000.

    It takes the gap first, where it is quicker and where no other solver looks when the energy applies. About one
    problem in twenty, at any settings, it ends with "Solve error" as its own constraints are violated by 1e-6 to 1e-4
    (HiGHS 1.15.1); a report then says failed.
    """

    name, package, solver = "cvxpy-highs", "highspy", "HIGHS"
    options = staticmethod(highs_options)
    forms = ("gap", "energy")
    largest = 1000
    too_large = "HiGHS's QP solver takes minutes or gives up"
