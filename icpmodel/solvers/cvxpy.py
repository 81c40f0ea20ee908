"""An ICP as a CVXPY problem, and two QP solvers of different kinds through it.

CVXPY writes the model in its own way, so that they also check the model that the native interfaces are given.
Reference: Diamond and Boyd, J. Mach. Learn. Res. 17 (2016).
"""

from __future__ import annotations

import warnings
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ..errors import InputError, NotApplicable, check_arguments
from ..numerics.arrays import described
from ..problem.data import ProblemLike, as_problem
from .clarabel import clarabel_options
from .foreign import Claim, ForeignSolver, missing
from .formulations import Target
from .highs import highs_options


@check_arguments
def to_cvxpy(problem: ProblemLike, formulation: str = "qp") -> Any:
    """State `problem` as a CVXPY problem in one variable named z, in the units of the ICP.

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

    "mip": p ≤ p̄b, r ≤ r̄(1 − b) with a vector b of zeros and ones, for an A of any kind. The
    certificate at z = 0 bounds |z*|, from which p̄ and r̄ follow.

    Rows without an obstacle have p_i = 0 in both. Where a row also has an upper obstacle, there is
    a second variable v ≥ 0. Then p + v and r are one pair, v and ψ̄(z) − z another.

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
    pairs, rows = _conditions(target, z)
    y = cp.hstack([z, pairs[1][0]]) if qp.q.size > target.problem.n else z
    # definiteness was decided before, so that CVXPY need not
    value = 0.5 * cp.quad_form(y, cp.psd_wrap(qp.P)) + qp.q @ y
    if form == "energy":
        return _program(value, [r >= 0 for _, r, _ in pairs])
    return _program(value - target.problem.q @ np.where(target.has_obstacle, target.near, 0.0), rows)


def _mip(target: Target) -> Any:
    import cvxpy as cp

    if target.bounds is None:
        raise NotApplicable(f"no bounds on p and r for a mixed-integer program: {target.bound_at_zero.reason}")
    z_max, p_max, r_max = target.bounds
    # without bounds on z HiGHS 1.15 crashes on some of these programs
    z = cp.Variable(target.problem.n, bounds=[-z_max, z_max], name="z")
    pairs, rows = _conditions(target, z)
    for (p, r, rows_of_pair), name in zip(pairs, ("b", "b above"), strict=False):
        b = cp.Variable(int(rows_of_pair.sum()), boolean=True, name=name)
        rows += [p <= cp.multiply(p_max[rows_of_pair], b), r <= cp.multiply(r_max[rows_of_pair], 1 - b)]
    return _program(0, rows)


def _conditions(target: Target, z: Any) -> tuple[list[Any], list[Any]]:
    """The complementary pairs and the constraints of `target` at `z`.

    The first list has (p, r, rows) for the rows with one obstacle. For rows with two it has (u, r,
    rows) and (v, s, rows) with u = p + v. The second list has the constraints: these are ≥ 0, and
    p_i = 0 in the free rows.
    """
    import cvxpy as cp

    has_obstacle = target.has_obstacle
    two_sided = target.two_sided
    p = target.problem.A @ z + target.problem.q
    r = target.I_minus_G[has_obstacle] @ z - target.near[has_obstacle]
    free = p[~has_obstacle] == 0
    p = p[has_obstacle]
    if target.upper_only.any():
        sign = np.where(target.upper_only, -1.0, 1.0)[has_obstacle]
        p = cp.multiply(sign, p)
        r = cp.multiply(sign, r)
    pairs = [(p, r, has_obstacle)]
    if target.d is not None and two_sided.any():
        v = cp.Variable(int(two_sided.sum()), name="v")
        s = target.d[two_sided] - target.I_minus_H @ z
        pairs = [
            (p + sp.eye_array(two_sided.size).tocsc()[:, two_sided][has_obstacle] @ v, r, has_obstacle),
            (v, s, two_sided),
        ]
    return pairs, [*(p >= 0 for p, _, _ in pairs), free, *(r >= 0 for _, r, _ in pairs)]


def _program(value: Any, rows: list[Any]) -> Any:
    import cvxpy as cp

    return cp.Problem(cp.Minimize(value), [row for row in rows if row.size])


class _ThroughCvxpy(ForeignSolver):
    """Base of both: `solver` is CVXPY's name, and `options` gives the arguments for a tolerance."""

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
    """Clarabel through CVXPY; where it cannot reach a tolerance it may return a worse point than at a looser one."""

    name = "cvxpy-clarabel"
    package = "clarabel"
    solver = "CLARABEL"
    tight = (1e-12, 1e-9)
    options = staticmethod(clarabel_options)


class CvxpyHighs(_ThroughCvxpy):
    """HiGHS's active-set QP solver through CVXPY, of n ≤ 1000.

    It takes the gap first, where it is quicker, and which no other solver gets when the energy applies. About one
    problem in twenty, at any settings, it ends with "Solve error" as its own constraints are violated by 1e-6 to 1e-4
    (HiGHS 1.15.1); a report then says failed.
    """

    name = "cvxpy-highs"
    package = "highspy"
    solver = "HIGHS"
    options = staticmethod(highs_options)
    forms = ("gap", "energy")
    largest = 1000
    too_large = "HiGHS's QP solver takes minutes or gives up"
