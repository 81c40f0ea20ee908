"""An ICP as a CVXPY problem: a convex quadratic or a mixed-integer program."""

from __future__ import annotations

from typing import Any

import numpy as np

from ..errors import InputError, NotApplicable
from ..numerics.arrays import described
from ..problem.data import ProblemData
from .formulations import Target

_FORMULATIONS = ("qp", "mip")


def to_cvxpy(problem: ProblemData, formulation: str = "qp") -> Any:
    """`problem` as a CVXPY problem in one variable named z, in the units of the ICP.

    "qp": ½zᵀAz + qᵀz subject to r ≥ 0 where ψ is constant and A symmetric, else the gap pᵀr subject to p ≥ 0, r ≥ 0; an
    optimum of the gap solves the ICP only if its value is 0. "mip": p ≤ p̄b, r ≤ r̄(1 − b) with a vector b of zeros and
    ones, for an A of any kind; the certificate at z = 0 bounds |z*|, from which p̄ and r̄ follow. Rows without an
    obstacle have p_i = 0 in both.

    Parameters: `problem` with constant or affine ψ (else take `problem.frozen(z)`); `formulation`.
    Returns a `cvxpy.Problem`. Raises InputError for an unknown formulation, and NotApplicable where the problem has no
    such form, with the reason.
    Reference: see `icpmodel.solvers.formulations`.

    >>> float(ICP([[2.0]], [-1.0]).to_cvxpy("mip").solve(solver="HIGHS"))
    0.0
    """
    if formulation not in _FORMULATIONS:
        raise InputError(
            f"formulation is {described(formulation)}; {' or '.join(map(repr, _FORMULATIONS))} was expected"
        )
    if problem.psi.linear is None:
        raise NotApplicable(
            f"to_cvxpy needs a psi that is constant or affine, not {problem.psi!r}: "
            "freeze its obstacle at an answer with problem.frozen(z)"
        )
    target = Target(problem)
    if formulation == "mip":
        return _mip(target)
    form = next((form for form in ("energy", "gap") if target.why_not(form) is None), None)
    if form is None:
        reason = target.why_not("gap")
        raise NotApplicable(f"no convex QP: {reason}; the formulation 'mip' needs no convexity")
    return qp_model(target, form)


def qp_model(target: Target, form: str) -> Any:
    """`target` as "energy" or "gap", in the variable z; call it only where `target.why_not(form)` is None."""
    import cvxpy as cp

    qp, z = target.qp(form), cp.Variable(target.problem.n, name="z")
    p, r = _p_and_r(target, z)
    # definiteness was decided before, so that CVXPY need not
    value = 0.5 * cp.quad_form(z, cp.psd_wrap(qp.P)) + qp.q @ z
    if form == "energy":
        return cp.Problem(cp.Minimize(value), _not_empty([r >= 0]))
    c = np.where(target.free, 0.0, target.c)
    rows = [p[~target.free] >= 0, p[target.free] == 0, r >= 0]
    return cp.Problem(cp.Minimize(value - target.problem.q @ c), _not_empty(rows))


def _mip(target: Target) -> Any:
    import cvxpy as cp

    if target.bounds is None:
        raise NotApplicable(f"no bounds on p and r for a mixed-integer program: {target.at_zero.reason}")
    held, (z_max, p_max, r_max) = ~target.free, target.bounds
    # without bounds on z HiGHS 1.15 crashes on some of these programs
    z = cp.Variable(target.problem.n, bounds=[-z_max, z_max], name="z")
    b = cp.Variable(int(held.sum()), boolean=True, name="b")
    p, r = _p_and_r(target, z)
    at_most = [p[held] <= cp.multiply(p_max[held], b), r <= cp.multiply(r_max[held], 1 - b)]
    return cp.Problem(cp.Minimize(0), _not_empty([p[held] >= 0, r >= 0, p[~held] == 0, *at_most]))


def _p_and_r(target: Target, z: Any) -> tuple[Any, Any]:
    """p, and r in the rows with an obstacle."""
    held = ~target.free
    return target.problem.A @ z + target.problem.q, target.I_minus_G[held] @ z - target.c[held]


def _not_empty(rows: list[Any]) -> list[Any]:
    return [row for row in rows if row.size]
