"""HiGHS through its own interface: an active-set QP solver, for small problems.

Reference: Huangfu and Hall, Math. Program. Comput. 10 (2018), doi 10.1007/s12532-017-0130-5.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from .foreign import Claim, ForeignSolver
from .formulations import Target


class Highs(ForeignSolver):
    """HiGHS for quadratic programs, by its active-set method."""

    name = "highs"
    package = "highspy"
    used_by = ("race",)

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        import highspy

        qp = self.pose(target)
        model = highspy.HighsModel()
        lp = model.lp_
        hessian = model.hessian_
        K = sp.csc_matrix(qp.K)
        P = sp.csc_matrix(sp.tril(qp.P))
        lp.num_col_, lp.num_row_, lp.col_cost_ = qp.q.size, K.shape[0], qp.q
        lp.col_lower_, lp.col_upper_ = np.full(qp.q.size, -np.inf), np.full(qp.q.size, np.inf)
        lp.row_lower_, lp.row_upper_ = qp.lower, qp.upper
        lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
        lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = K.indptr, K.indices, K.data
        hessian.dim_, hessian.format_ = qp.q.size, highspy.HessianFormat.kTriangular
        hessian.start_, hessian.index_, hessian.value_ = P.indptr, P.indices, P.data
        solver = highspy.Highs()
        for name, value in {**highs_options(tolerance), "output_flag": False, "time_limit": float(time_limit)}.items():
            solver.setOptionValue(name, value)
        solver.passModel(model)
        return solver

    def run(self, model: Any) -> Claim:
        import highspy

        model.run()
        status = model.getModelStatus()
        z = model.getSolution().col_value
        return Claim(z, model.modelStatusToString(status), status == highspy.HighsModelStatus.kOptimal)


def highs_options(tolerance: float) -> dict[str, Any]:
    """HiGHS's options for the absolute tolerance `tolerance`, which is raised to 1e-10 if it is smaller."""
    # by default HiGHS adds 1e-7 to the Hessian, which shows in the seventh digit
    feasible = dict.fromkeys(("primal_feasibility_tolerance", "dual_feasibility_tolerance"), max(tolerance, 1e-10))
    return {**feasible, "qp_regularization_value": 0.0}
