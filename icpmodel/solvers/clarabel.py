"""Clarabel, an interior-point method. Reference: Goulart and Chen (2024), arXiv 2405.12762."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from .foreign import Claim, ForeignSolver
from .formulations import Target


class Clarabel(ForeignSolver):
    """Clarabel; if it cannot reach a tolerance, it may return a worse point than at a looser one."""

    name = package = "clarabel"
    used_by = ("race",)
    tight = (1e-13, 1e-12, 1e-9)

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        import clarabel

        qp = self.pose(target)
        settings = clarabel.DefaultSettings()
        for name, value in {**clarabel_options(tolerance), "verbose": False, "time_limit": float(time_limit)}.items():
            setattr(settings, name, value)
        K, b, equations = qp.conic()
        cones = [clarabel.ZeroConeT(equations), clarabel.NonnegativeConeT(b.size - equations)]
        return clarabel.DefaultSolver(sp.csc_matrix(sp.triu(qp.P)), qp.q, K, b, cones, settings)

    def run(self, model: Any) -> Claim:
        result = model.solve()
        return Claim(np.array(result.x), str(result.status), str(result.status) == "Solved")


def clarabel_options(tolerance: float) -> dict[str, Any]:
    """Clarabel's options for `tolerance`."""
    return dict.fromkeys(("tol_gap_abs", "tol_gap_rel", "tol_feas"), tolerance)
