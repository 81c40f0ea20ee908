"""An ICP as a CVXPY problem, and two QP solvers of different kinds through it.

CVXPY transforms the model in its own way, so that these solvers also check the model of the native interfaces.
Reference: Diamond and Boyd, J. Mach. Learn. Res. 17 (2016).
"""

from __future__ import annotations

import warnings
from typing import Any, ClassVar

from ..errors import InputError, NotApplicable, check_arguments
from ..numerics.arrays import described
from ..problem.data import ProblemLike, as_problem
from .clarabel import clarabel_options
from .foreign import Claim, ForeignSolver, missing
from .formulations import Target
from .highs import highs_options


@check_arguments
def to_cvxpy(problem: ProblemLike, formulation: str = "qp") -> Any:
    """State `problem` as a CVXPY problem with a variable named z, in the units of the ICP.

    Parameters
    ----------
    problem : ICP
        Its ψ is constant or affine; for another one take `problem.frozen(z)`.
    formulation : {"qp", "mip"}, default "qp"
        A quadratic or a mixed-integer program.

    Returns
    -------
    cvxpy.Problem
        The problem.

    Raises
    ------
    InputError
        For an unknown formulation.
    NotApplicable
        Where the problem has no such form; the message says why.

    Notes
    -----
    "qp": minimise ½zᵀAz + qᵀz subject to r ≥ 0 where ψ is constant and A symmetric. Otherwise
    minimise the gap pᵀr subject to p ≥ 0, r ≥ 0. An optimum of the gap solves the ICP only if its
    value is 0.

    "mip": 0 ≤ p ≤ p̄b, 0 ≤ r ≤ r̄(1 − b) with a vector b of zeros and ones, for an A of any kind. The
    error bound at z = 0, or a box, bounds |z*|, from which p̄ and r̄ follow.

    Rows without an obstacle have p_i = 0 in both. For rows with an upper obstacle as well, there is a
    second variable v ≥ 0. Then p + v and r are one pair, v and ψ̄(z) − z another.

    Examples
    --------
    >>> float(ICP([[2.0]], [-1.0]).to_cvxpy("mip").solve(solver="HIGHS"))
    0.0
    """
    if formulation not in ("qp", "mip"):
        raise InputError(f"formulation is {described(formulation)}; 'qp' or 'mip' was expected")
    problem = as_problem(problem)
    if problem.psi.linear is None:
        raise NotApplicable(
            f"to_cvxpy needs a psi that is constant or affine, not {problem.psi!r}: "
            "freeze its obstacle at an answer with problem.frozen(z)"
        )
    target = Target(problem)
    if formulation == "mip":
        return _mip(target)
    if target.why_not("energy") is None:
        return _qp(target, "energy")
    if (reason := target.why_not("gap")) is not None:
        raise NotApplicable(f"no convex QP: {reason}; the formulation 'mip' needs no convexity")
    return _qp(target, "gap")


def _qp(target: Target, form: str) -> Any:
    """`target` as "energy" or "gap"; call it only where `target.why_not(form)` is None."""
    import cvxpy as cp

    qp = target.qp(form)
    z = cp.Variable(target.problem.n, name="z")
    _, r, v, rows = _conditions(target, z)
    y = cp.hstack([z, v]) if qp.q.size > target.problem.n else z
    # `Target.why_not` has checked that P is semidefinite, so that CVXPY need not
    value = 0.5 * cp.quad_form(y, cp.psd_wrap(qp.P)) + qp.q @ y
    if form == "energy":
        return _program(value, [r >= 0])
    return _program(value + target.problem.q @ (target.conditions.T.T @ target.conditions.b), rows)


def _mip(target: Target) -> Any:
    import cvxpy as cp

    if target.bounds is None:
        raise NotApplicable(f"no bounds on p and r for a mixed-integer program: {target.bound_at_zero.reason}")
    z_max, p_max, r_max = target.bounds
    # without bounds on z HiGHS 1.15 crashes on some of these programs
    z = cp.Variable(target.problem.n, bounds=[-z_max, z_max], name="z")
    u, r, _, rows = _conditions(target, z)
    b = cp.Variable(r.size, boolean=True, name="b")
    u_max = p_max[target.conditions.rows[: r.size]]
    return _program(0, [*rows, u <= cp.multiply(u_max, b), r <= cp.multiply(r_max[: r.size], 1 - b)])


def _conditions(target: Target, z: Any) -> tuple[Any, Any, Any, list[Any]]:
    """u and r with 0 ≤ u ⟂ r ≥ 0 at `z`, the variable v in them, and the linear constraints."""
    import cvxpy as cp

    conditions = target.conditions
    with_obstacle = sum(conditions.sizes[:2])
    v = cp.Variable(conditions.V.shape[1], name="v")
    u = conditions.T @ (target.problem.A @ z + target.problem.q)
    if v.size:
        u += conditions.V @ v
    r = (conditions.R @ z + conditions.b)[:with_obstacle]
    u, free = u[:with_obstacle], u[with_obstacle:]
    return u, r, v, [u >= 0, free == 0, r >= 0]


def _program(value: Any, rows: list[Any]) -> Any:
    import cvxpy as cp

    return cp.Problem(cp.Minimize(value), [row for row in rows if row.size])


class _ThroughCvxpy(ForeignSolver):
    """Base class of both: `solver` is the name in CVXPY, and `options(tolerance)` are its arguments."""

    used_by = ("crosscheck",)
    solver: ClassVar[str]
    options: ClassVar[Any]

    def why_not(self, target: Target) -> str | None:
        return missing("cvxpy") or super().why_not(target)

    def set_up(self, target: Target, tolerance: float, time_limit: float) -> Any:
        return _qp(target, self.form(target)), {**self.options(tolerance), "time_limit": float(time_limit)}

    def run(self, model: Any) -> Claim:
        problem, options = model
        with warnings.catch_warnings(action="ignore"):
            problem.solve(solver=self.solver, **options)
        return Claim(problem.var_dict["z"].value, problem.status, problem.status == "optimal")


class CvxpyClarabel(_ThroughCvxpy):
    """Clarabel through CVXPY; if it cannot reach a tolerance, it may return a worse point than at a looser one."""

    name = "cvxpy-clarabel"
    package = "clarabel"
    solver = "CLARABEL"
    tight = (1e-12, 1e-9)
    options = staticmethod(clarabel_options)


class CvxpyHighs(_ThroughCvxpy):
    """HiGHS's active-set QP solver through CVXPY, for n ≤ 1000.

    It prefers the gap, on which it is faster, and which no other solver gets if the energy applies. On about one
    problem in twenty, at any settings, it ends with "Solve error", as its own constraints are violated by 1e-6 to 1e-4
    (HiGHS 1.15.1); the verdict is then "failed".
    """

    name = "cvxpy-highs"
    package = "highspy"
    solver = "HIGHS"
    options = staticmethod(highs_options)
    forms = ("gap", "energy")
    largest = 1000
    too_large = "HiGHS's QP solver takes minutes or gives up"
