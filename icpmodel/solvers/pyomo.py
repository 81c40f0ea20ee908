"""The problem as it stands, p ≥ 0 ⟂ r ≥ 0, written with Pyomo's `Complementarity` and transformed by Pyomo.

HiGHS gets it as a mixed-integer program (mpec.simple_disjunction, then gdp.bigm: p_i = 0 or r_i = 0), which needs no
convexity but bounds on p and r; IPOPT gets it as a nonlinear program (mpec.simple_nonlinear: p_i r_i ≤ 0).
Reference: Bynum et al., Pyomo: Optimization Modeling in Python (2021), doi 10.1007/978-3-030-68928-5.
"""

from __future__ import annotations

import shutil
import time
from typing import Any, ClassVar

import numpy as np

from ..numerics.arrays import Vector
from .contract import Answer, IndependentSolver, missing
from .formulations import Target

#: the tolerances of HiGHS that are set together
_FEASIBLE = ("mip", "primal", "dual")


class PyomoHighs(IndependentSolver):
    """HiGHS's branch and bound on the big-M form, of n ≤ 250 (it takes minutes beyond).

    Its bounds on p and r are `Target.bounds`.
    """

    name: ClassVar[str] = "pyomo-highs"
    forms: ClassVar[tuple[str, ...]] = ("mpec",)
    largest: ClassVar[int | None] = 250
    too_large: ClassVar[str] = "branch and bound may take minutes"

    def why_not(self, target: Target) -> str | None:
        reason = missing("pyomo") or missing("highspy") or super().why_not(target)
        if reason is None and target.bounds is None:
            reason = f"no bounds on p and r for the big-M form: {target.at_zero.reason}"
        return reason

    def solve(self, target: Target, *, time_limit: float) -> Answer:
        from pyomo.contrib.appsi.base import TerminationCondition
        from pyomo.contrib.appsi.solvers import Highs
        from pyomo.environ import TransformationFactory

        model = _model(target, target.bounds)
        TransformationFactory("mpec.simple_disjunction").apply_to(model)
        TransformationFactory("gdp.bigm").apply_to(model)
        end = time.perf_counter() + time_limit
        # tighter than 1e-8, or with a large M, HiGHS's rounding errors make a solvable problem "infeasible"
        for tolerance in (1e-8, 1e-6):
            solver = Highs()
            solver.config.time_limit = max(end - time.perf_counter(), 1.0)
            solver.config.load_solution = False
            solver.highs_options = dict.fromkeys((f"{what}_feasibility_tolerance" for what in _FEASIBLE), tolerance)
            result = solver.solve(model)
            if result.termination_condition is not TerminationCondition.infeasible:
                break
        if result.termination_condition is not TerminationCondition.optimal:
            return Answer(None, result.termination_condition.name, False)
        values = result.solution_loader.get_primals()
        return Answer(np.array([values[model.z[i]] for i in range(target.problem.n)]), "optimal", True)


class PyomoIpopt(IndependentSolver):
    """IPOPT on the nonlinear form, where its executable is on the PATH."""

    name: ClassVar[str] = "pyomo-ipopt"
    forms: ClassVar[tuple[str, ...]] = ("mpec",)

    def why_not(self, target: Target) -> str | None:
        if shutil.which("ipopt") is None:
            return "no ipopt executable on the PATH"
        return missing("pyomo") or super().why_not(target)

    def solve(self, target: Target, *, time_limit: float) -> Answer:
        from pyomo.environ import SolverFactory, TransformationFactory

        model = _model(target, None)
        TransformationFactory("mpec.simple_nonlinear").apply_to(model)
        # IPOPT relaxes every bound by 1e-8 unless told not to
        options = {"tol": 1e-10, "bound_relax_factor": 0.0, "max_cpu_time": float(time_limit)}
        solver = SolverFactory("ipopt", executable=shutil.which("ipopt"), options=options)
        result = solver.solve(model, load_solutions=False)
        if len(result.solution) == 0:
            return Answer(None, str(result.solver.termination_condition), False)
        model.solutions.load_from(result)
        z = np.array([model.z[i].value for i in range(target.problem.n)], dtype=np.float64)
        claim = str(result.solver.termination_condition)
        return Answer(z, claim, claim == "optimal")


def _model(target: Target, bounds: tuple[Vector, Vector, Vector] | None) -> Any:
    """The MPEC as a Pyomo model with variables z, p, r; `bounds` as `Target.bounds`, or None."""
    import pyomo.environ as pyo
    from pyomo.mpec import Complementarity, complements

    problem, B, held = target.problem, target.I_minus_G, np.flatnonzero(~target.free).tolist()
    z_max, p_max, r_max = (None, None, None) if bounds is None else bounds

    def upper(bound: Vector | None, i: int) -> float | None:
        return None if bound is None else float(bound[i])

    model = pyo.ConcreteModel()
    rows = range(problem.n)
    model.z = pyo.Var(rows, bounds=lambda _, i: (None if z_max is None else -float(z_max[i]), upper(z_max, i)))
    # a row without obstacle has p_i = 0 and no complementarity
    model.p = pyo.Var(rows, bounds=lambda _, i: (0.0, 0.0 if target.free[i] else upper(p_max, i)))
    model.r = pyo.Var(held, bounds=lambda _, i: (0.0, upper(r_max, i)))
    model.p_is = pyo.Constraint(rows, rule=lambda m, i: m.p[i] == affine_row(problem.A, m.z, i) + float(problem.q[i]))
    model.r_is = pyo.Constraint(held, rule=lambda m, i: m.r[i] == affine_row(B, m.z, i) - float(target.c[i]))
    model.complementarity = Complementarity(held, rule=lambda m, i: complements(m.p[i] >= 0, m.r[i] >= 0))
    model.objective = pyo.Objective(expr=0.0)  # any point that satisfies the constraints is a solution
    return model


def affine_row(matrix: Any, z: Any, i: int) -> Any:
    """(Mz)_i as a Pyomo expression: `matrix` M CSR, shape (n, n), `z` Pyomo variables by number."""
    entries = slice(matrix.indptr[i], matrix.indptr[i + 1])
    pairs = zip(matrix.data[entries].tolist(), matrix.indices[entries].tolist(), strict=True)
    return sum(value * z[j] for value, j in pairs)
