"""PIQP: a proximal interior-point method. Reference: Schwan, Jiang, Kuhn and Jones (2023), arXiv 2304.00290."""

from __future__ import annotations

import operator
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..theory.matrices.eigenvalue import is_dense
from .foreign import Claim, ForeignSolver
from .formulations import Target


class Piqp(ForeignSolver):
    """PIQP. It has no time limit of its own, but stops after 250 iterations."""

    name = package = "piqp"
    used_by = ("race",)

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        """Make PIQP's model; inequalities with the single entry 1 are passed as bounds of that unknown."""
        import piqp

        qp = self.pose(target)
        dense = is_dense(qp.P)
        model = piqp.DenseSolver() if dense else piqp.SparseSolver()
        settings = model.settings
        settings.verbose = False
        settings.eps_abs = settings.eps_rel = tolerance
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = tolerance
        K = sp.csr_array(qp.K)
        equal = qp.lower == qp.upper
        single = (np.diff(K.indptr) == 1) & ~equal
        single[single] = K.data[K.indptr[:-1][single]] == 1.0
        columns = K.indices[K.indptr[:-1][single]]
        lower = np.full(qp.q.size, -np.inf)
        upper = -lower
        has_upper = np.isfinite(qp.upper[~equal]).any()
        np.maximum.at(lower, columns, qp.lower[single])
        np.minimum.at(upper, columns, qp.upper[single])
        rows = ~equal & ~single
        matrix: Any = operator.methodcaller("toarray") if dense else sp.csc_matrix
        A, b = (matrix(K[equal]), qp.lower[equal]) if equal.any() else (None, None)
        G, h = (matrix(K[rows]), qp.lower[rows]) if rows.any() else (None, None)
        uppers = (qp.upper[rows] if rows.any() else None, upper) if has_upper else (None, None)
        model.setup(matrix(qp.P), qp.q, A, b, G, h, uppers[0], lower, uppers[1])
        return model

    def run(self, model: Any) -> Claim:
        status = model.solve().name
        return Claim(np.array(model.result.x), status.removeprefix("PIQP_").lower(), status == "PIQP_SOLVED")
