"""HiGHS on the mixed-integer form, with bounds that are widened step by step: for problems without a known bound.

Reference: Huangfu and Hall, Math. Program. Comput. 10 (2018), doi 10.1007/s12532-017-0130-5.
"""

from __future__ import annotations

from typing import Any

import numpy as np

from ..algebra.equations import solve_on
from ..algebra.linear_rows import LinearRows
from ..errors import OutOfTime, SingularOperator
from ..methods.milp import BOUNDS, active_set
from ..numerics import work
from .foreign import Claim, ForeignSolver
from .formulations import Target


class HighsMilp(ForeignSolver):
    """The active set of HiGHS's branch and bound, and the solution of its linear system.

    Asked where `Target.bounds` knows no bounds on p and r, as of indefinite A; with bounds "pyomo-highs" is asked.
    """

    name = "highs-milp"
    forms = ("mpec",)
    used_by = ("crosscheck",)
    tight = (1e-6,)
    largest = 100
    too_large = "branch and bound may take minutes"

    def why_not(self, target: Target) -> str | None:
        reason = super().why_not(target)
        if reason is None and target.bounds is not None:
            return "bounds on p and r are known, so that pyomo-highs is used"
        return reason

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        rows = LinearRows.of(target.problem, np.zeros(target.problem.n))
        return target.problem, rows.in_units(rows.scale), time_limit

    def run(self, model: Any) -> Claim:
        problem, rows, time_limit = model
        with work.work_limit(time_limit):
            try:
                choices = (active_set(rows, bound, []) for bound in BOUNDS)
                choice = next((one for one in choices if one is not None), None)
                if choice is None:
                    return Claim(None, "there is no choice of active rows within bounds that are guessed", False)
                above = choice.above if problem.upper is not None else None
                return Claim(solve_on(problem, np.zeros(problem.n), choice.active, above), "optimal", True)
            except (OutOfTime, SingularOperator) as error:
                return Claim(None, str(error), False)
