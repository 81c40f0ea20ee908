"""The problem as it stands, p ≥ 0 ⟂ r ≥ 0, written with Pyomo's `Complementarity` and transformed by Pyomo.

HiGHS gets it as a mixed-integer program (mpec.simple_disjunction, then gdp.bigm: p_i = 0 or r_i = 0), which needs no
convexity but bounds on p and r; IPOPT gets it as a nonlinear program (mpec.simple_nonlinear: p_i r_i ≤ 0).
Reference: Bynum et al., Pyomo: Optimization Modeling in Python (2021), doi 10.1007/978-3-030-68928-5.
"""

from __future__ import annotations

import shutil
from typing import Any

import numpy as np

from ..numerics.arrays import Vector
from .contract import Claim, ForeignSolver, missing
from .formulations import Target
from .pyomo_model import add_conditions, affine_row


class PyomoHighs(ForeignSolver):
    """HiGHS's branch and bound on the big-M form, of n ≤ 250. Its bounds on p and r are `Target.bounds`."""

    name, package = "pyomo-highs", "highspy"
    forms = ("mpec",)
    asked_by = ("crosscheck",)
    # tighter than 1e-8, or with a large M, HiGHS's rounding errors make a solvable problem "infeasible"
    tight = (1e-8, 1e-6)
    largest = 250
    too_large = "branch and bound may take minutes"

    def why_not(self, target: Target) -> str | None:
        reason = missing("pyomo") or super().why_not(target)
        if reason is None and target.bounds is None:
            reason = f"no bounds on p and r for the big-M form: {target.at_zero.reason}"
        return reason

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        from pyomo.contrib.appsi.solvers import Highs

        solver = Highs()
        solver.config.time_limit = float(time_limit)
        solver.config.load_solution = False
        solver.highs_options = {f"{of}_feasibility_tolerance": tolerance for of in ("mip", "primal", "dual")}
        return _model(target, target.bounds, "mpec.simple_disjunction", "gdp.bigm"), solver

    def run(self, model: Any) -> Claim:
        from pyomo.contrib.appsi.base import TerminationCondition

        posed, solver = model
        result = solver.solve(posed)
        if result.termination_condition is not TerminationCondition.optimal:
            return Claim(None, result.termination_condition.name, False)
        values = result.solution_loader.get_primals()
        return Claim(np.array([values[one] for one in posed.z.values()]), "optimal", True)


class PyomoIpopt(ForeignSolver):
    """IPOPT on the nonlinear form, where its executable is on the PATH."""

    name, package = "pyomo-ipopt", "pyomo"
    forms = ("mpec",)
    asked_by = ("crosscheck",)

    def why_not(self, target: Target) -> str | None:
        return super().why_not(target) if shutil.which("ipopt") else "no ipopt executable on the PATH"

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        from pyomo.environ import SolverFactory

        # IPOPT relaxes every bound by 1e-8 unless told not to
        options = {"tol": tolerance, "bound_relax_factor": 0.0, "max_cpu_time": float(time_limit)}
        solver = SolverFactory("ipopt", executable=shutil.which("ipopt"), options=options)
        return _model(target, None, "mpec.simple_nonlinear"), solver

    def run(self, model: Any) -> Claim:
        posed, solver = model
        result = solver.solve(posed, load_solutions=False)
        words = str(result.solver.termination_condition)
        if len(result.solution) == 0:
            return Claim(None, words, False)
        posed.solutions.load_from(result)
        return Claim(np.array([one.value for one in posed.z.values()], dtype=np.float64), words, words == "optimal")


def _model(target: Target, bounds: tuple[Vector, Vector, Vector] | None, *transformations: str) -> Any:
    """`target` as a transformed Pyomo model with variables z, p and r; `bounds` as `Target.bounds`, or None."""
    import pyomo.environ as pyo

    problem, B, free = target.problem, target.I_minus_G, target.free.tolist()
    rows = range(problem.n)
    held = [i for i in rows if not free[i]]
    z_max, p_max, r_max = bounds or (np.full(problem.n, np.inf),) * 3
    model = pyo.ConcreteModel()
    model.z = pyo.Var(rows, bounds=lambda _, i: (-float(z_max[i]), float(z_max[i])))
    model.p = pyo.Var(rows, bounds=lambda _, i: (0.0, 0.0 if free[i] else float(p_max[i])))
    model.r = pyo.Var(held, bounds=lambda _, i: (0.0, float(r_max[i])))
    model.p_is = pyo.Constraint(rows, rule=lambda m, i: m.p[i] == affine_row(problem.A, m.z, i) + float(problem.q[i]))
    model.r_is = pyo.Constraint(held, rule=lambda m, i: m.r[i] == affine_row(B, m.z, i) - float(target.c[i]))
    add_conditions(model, free, lambda i: model.p[i], lambda i: model.r[i])
    for transformation in transformations:
        pyo.TransformationFactory(transformation).apply_to(model)
    return model
