"""Peers: what others would use for the same problem, through their own interfaces, at a tolerance that is asked for.

A peer is an independent solver (see `crosscheck`) that also says how long its set-up took. Its QP is made before the
clock starts, in handy units; turning that into its own format, its factorisations and its iterations are its own time.
A peer that is not installed is left out by name.
"""

from __future__ import annotations

import time
from abc import abstractmethod
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import norm
from ..numerics.factorisation import factorise
from .contract import Answer, IndependentSolver, missing
from .formulations import QP, Target
from .osqp import claimed, set_up

#: a matrix that is fuller than this is given to a dense solver where a peer has one
_DENSE = 0.1


@dataclass(frozen=True, eq=False)
class Timed(Answer):
    """An answer with the `seconds` that it took in all, and how many of them are `setup`, None where it has none."""

    seconds: float
    setup: float | None


class Peer(IndependentSolver):
    """A QP solver at the tolerance `tolerance`, which means to each what it means to it.

    Parameters: `tolerance` > 0. `package` is the module to import, `ladder` the tolerances to ask for in turn until the
    answer is good enough.
    """

    package: ClassVar[str]
    forms: ClassVar[tuple[str, ...]] = ("energy", "gap")
    ladder: ClassVar[tuple[float, ...]] = tuple(10.0**-k for k in range(3, 13))

    def __init__(self, tolerance: float = 1e-9) -> None:
        self.tolerance = tolerance

    def why_not(self, target: Target) -> str | None:
        return missing(self.package) or super().why_not(target)

    def solve(self, target: Target, *, time_limit: float) -> Timed:
        qp = target.qp(self.form(target))
        begin = time.perf_counter()
        model = self.set_up(qp, time_limit)
        between = time.perf_counter()
        answer = self.run(model)
        seconds = time.perf_counter() - begin
        return Timed(answer.z, answer.claim, answer.claims_solved, seconds, between - begin)

    @abstractmethod
    def set_up(self, qp: QP, time_limit: float) -> Any:
        """The peer's model of `qp`, which stops after about `time_limit` seconds where the peer can do that."""

    @abstractmethod
    def run(self, model: Any) -> Answer:
        """Solve the `model` that `set_up` made."""


class Osqp(Peer):
    """OSQP with polishing, as `crosscheck` uses it."""

    name: ClassVar[str] = "osqp"
    package: ClassVar[str] = "osqp"

    def set_up(self, qp: QP, time_limit: float) -> Any:
        return set_up(qp, self.tolerance, time_limit)

    def run(self, model: Any) -> Answer:
        return claimed(model.solve(raise_error=False))


class OsqpUnpolished(Osqp):
    """OSQP as it comes, without polishing; 1e-3 is its default tolerance."""

    name: ClassVar[str] = "osqp, not polished"

    def set_up(self, qp: QP, time_limit: float) -> Any:
        return set_up(qp, self.tolerance, time_limit, polish=False)


class Clarabel(Peer):
    """Clarabel, an interior-point method. Reference: Goulart and Chen (2024), arXiv 2405.12762."""

    name: ClassVar[str] = "clarabel"
    package: ClassVar[str] = "clarabel"

    def set_up(self, qp: QP, time_limit: float) -> Any:
        import clarabel

        settings = clarabel.DefaultSettings()
        settings.verbose, settings.time_limit = False, float(time_limit)
        settings.tol_gap_abs = settings.tol_gap_rel = settings.tol_feas = self.tolerance
        K, b, equations = _conic(qp)
        cones = [clarabel.ZeroConeT(equations), clarabel.NonnegativeConeT(b.size - equations)]
        return clarabel.DefaultSolver(sp.csc_matrix(sp.triu(qp.P)), qp.q, K, b, cones, settings)

    def run(self, model: Any) -> Answer:
        result = model.solve()
        return Answer(np.array(result.x), str(result.status), str(result.status) == "Solved")


class Scs(Peer):
    """SCS, operator splitting for cones. Reference: O'Donoghue, SIAM J. Optim. 31 (2021), doi 10.1137/20M1366307."""

    name: ClassVar[str] = "scs"
    package: ClassVar[str] = "scs"

    def set_up(self, qp: QP, time_limit: float) -> Any:
        import scs

        K, b, equations = _conic(qp)
        data = {"P": sp.csc_matrix(sp.triu(qp.P)), "A": K, "b": b, "c": qp.q}
        cone = {"z": equations, "l": b.size - equations}
        limits = {"max_iters": 1_000_000, "time_limit_secs": float(time_limit)}
        return scs.SCS(data, cone, verbose=False, eps_abs=self.tolerance, eps_rel=self.tolerance, **limits)

    def run(self, model: Any) -> Answer:
        result = model.solve()
        return Answer(result["x"], result["info"]["status"], result["info"]["status_val"] == 1)


class Piqp(Peer):
    """PIQP, a proximal interior-point method; it has no time limit of its own.

    Reference: Schwan, Jiang, Kuhn and Jones (2023), arXiv 2304.00290.
    """

    name: ClassVar[str] = "piqp"
    package: ClassVar[str] = "piqp"

    def set_up(self, qp: QP, time_limit: float) -> Any:
        """See `Peer.set_up`; rows that bound one unknown are given as bounds."""
        import piqp

        dense = qp.P.nnz > _DENSE * qp.q.size**2
        model = piqp.DenseSolver() if dense else piqp.SparseSolver()
        settings = model.settings
        settings.verbose = False  # and at most 250 iterations: it has no time limit
        settings.eps_abs = settings.eps_rel = self.tolerance
        settings.eps_duality_gap_abs = settings.eps_duality_gap_rel = self.tolerance
        K, equal = sp.csr_array(qp.K), qp.lower == qp.upper
        single = (np.diff(K.indptr) == 1) & ~equal
        single[single] = K.data[K.indptr[:-1][single]] == 1.0
        bounds = np.full(qp.q.size, -np.inf)
        np.maximum.at(bounds, K.indices[K.indptr[:-1][single]], qp.lower[single])
        rows = ~equal & ~single

        def matrix(of: Any) -> Any:
            return of.toarray() if dense else sp.csc_matrix(of)

        A, b = (matrix(K[equal]), qp.lower[equal]) if equal.any() else (None, None)
        G, h = (matrix(K[rows]), qp.lower[rows]) if rows.any() else (None, None)
        model.setup(matrix(qp.P), qp.q, A, b, G, h, None, bounds, None)
        return model

    def run(self, model: Any) -> Answer:
        status = model.solve().name
        return Answer(np.array(model.result.x), status.removeprefix("PIQP_").lower(), status == "PIQP_SOLVED")


class Highs(Peer):
    """HiGHS, an active-set QP solver: small problems only. Its tolerances are absolute and at least 1e-10.

    Reference: Huangfu and Hall, Math. Program. Comput. 10 (2018), doi 10.1007/s12532-017-0130-5.
    """

    name: ClassVar[str] = "highs"
    package: ClassVar[str] = "highspy"
    ladder: ClassVar[tuple[float, ...]] = tuple(10.0**-k for k in range(3, 11))

    def set_up(self, qp: QP, time_limit: float) -> Any:
        import highspy

        model = highspy.HighsModel()
        lp, hessian = model.lp_, model.hessian_
        K, P = sp.csc_matrix(qp.K), sp.csc_matrix(sp.tril(qp.P))
        lp.num_col_, lp.num_row_, lp.col_cost_ = qp.q.size, K.shape[0], qp.q
        lp.col_lower_, lp.col_upper_ = np.full(qp.q.size, -np.inf), np.full(qp.q.size, np.inf)
        lp.row_lower_, lp.row_upper_ = qp.lower, qp.upper
        lp.a_matrix_.format_ = highspy.MatrixFormat.kColwise
        lp.a_matrix_.start_, lp.a_matrix_.index_, lp.a_matrix_.value_ = K.indptr, K.indices, K.data
        hessian.dim_, hessian.format_ = qp.q.size, highspy.HessianFormat.kTriangular
        hessian.start_, hessian.index_, hessian.value_ = P.indptr, P.indices, P.data
        solver = highspy.Highs()
        tolerance = max(self.tolerance, 1e-10)
        options = {"output_flag": False, "time_limit": float(time_limit), "qp_regularization_value": 0.0}
        for name in ("primal_feasibility_tolerance", "dual_feasibility_tolerance"):
            options[name] = tolerance
        for name, value in options.items():
            solver.setOptionValue(name, value)
        solver.passModel(model)
        return solver

    def run(self, model: Any) -> Answer:
        import highspy

        model.run()
        status = model.getModelStatus()
        z = np.array(model.getSolution().col_value)
        return Answer(z, model.modelStatusToString(status), status == highspy.HighsModelStatus.kOptimal)


class ColdActiveSet(IndependentSolver):
    """The primal–dual active set method for a fixed obstacle, z = 0 at the start and SuperLU for every system.

    The rows with p_i ≤ a_ii r_i are taken for p_i = 0, the others for r_i = 0. Parameters: `tolerance`, Res(z)/Res(0).
    Reference: Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), doi 10.1137/S1052623401383558.
    """

    name: ClassVar[str] = "active set, cold"
    forms: ClassVar[tuple[str, ...]] = ("mpec",)
    # its tolerance is of Res itself, if in other units
    ladder: ClassVar[tuple[float, ...]] = (1e-8, 1e-10, 1e-12)

    def __init__(self, tolerance: float = 1e-9) -> None:
        self.tolerance = tolerance

    def why_not(self, target: Target) -> str | None:
        return super().why_not(target) if target.problem.is_lcp else "psi is not constant"

    def solve(self, target: Target, *, time_limit: float) -> Timed:
        """See `IndependentSolver.solve`; the time limit is looked at between its steps."""
        begin = time.perf_counter()
        A, q, c = target.problem.A, target.problem.q, target.c
        diagonal = A.diagonal()
        weight = np.where(diagonal > 0, diagonal, 1.0)
        z, inactive, claim, start = np.zeros(q.size), None, "", 0.0
        while not claim:
            p, r = A @ z + q, z - c
            residual = norm(np.minimum(p, r))
            start = start or residual
            before, inactive = inactive, p <= weight * r
            if residual <= self.tolerance * start:
                claim = "solved"
            elif before is not None and (before == inactive).all():
                claim = "the active set repeats"
            elif time.perf_counter() - begin > time_limit:
                claim = "time limit"
            else:
                z = np.where(inactive, 0.0, c)
                lu = factorise(A[inactive][:, inactive]) if inactive.any() else None
                if lu is not None:
                    z[inactive] = lu.solve(-(A @ z + q)[inactive])
                elif inactive.any():
                    claim = "singular system"
        return Timed(z, claim, claim == "solved", time.perf_counter() - begin, None)


#: every peer, in the order in which a table has them
PEERS: tuple[Any, ...] = (Osqp, Clarabel, Piqp, Scs, ColdActiveSet)
#: … and those that show in a race what default tolerances are worth, and what does not grow
RACERS: tuple[Any, ...] = (OsqpUnpolished, *PEERS, Highs)


def _conic(qp: QP) -> tuple[sp.csc_matrix, Any, int]:
    """(K, b, number of equations) of Kx + s = b with s = 0 in the equations, which come first, and s ≥ 0 else."""
    equal = qp.lower == qp.upper
    K = qp.K
    if equal.any():
        order = np.argsort(~equal, kind="stable")
        K, equal, lower = sp.csr_array(K)[order], equal[order], qp.lower[order]
    else:
        lower = qp.lower
    return sp.csc_matrix(-K), -lower, int(equal.sum())
