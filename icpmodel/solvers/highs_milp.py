"""HiGHS on the mixed-integer form for problems without known bounds: the bounds are widened step by step.

Reference: Huangfu and Hall, Math. Program. Comput. 10 (2018), doi 10.1007/s12532-017-0130-5.
"""

from __future__ import annotations

from typing import Any

from ..solve.driver import solve
from .foreign import Claim, ForeignSolver
from .formulations import Target


class HighsMilp(ForeignSolver):
    """An active set by HiGHS's branch and bound, and the solution of its linear system: `icpmodel.MixedInteger`.

    It is run only where `Target.bounds` is None, as for indefinite A; otherwise "pyomo-highs" is run.
    """

    name = "highs-milp"
    forms = ("mpec",)
    used_by = ("crosscheck",)
    tight = (1e-8,)
    largest = 100
    too_large = "branch and bound may take minutes"

    def why_not(self, target: Target) -> str | None:
        reason = super().why_not(target)
        if reason is None and target.bounds is not None:
            return "bounds on p and r are known, so that pyomo-highs is used"
        return reason

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        return target.problem, tolerance, time_limit

    def run(self, model: Any) -> Claim:
        problem, rtol, time_limit = model
        solution = solve(problem, "milp", rtol=rtol, time_limit=time_limit, raise_on_failure=False)
        if not solution.solved:  # a proof of infeasibility would be this package's own
            return Claim(None, "no choice of active rows was found", False)
        return Claim(solution.z, "optimal", True)
