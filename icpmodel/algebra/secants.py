"""Steps of the modulus family where p(z) = Az + q + f(z), f_i a function of z_i alone.

A step with slopes s is a step on the affine problem with A + diag(s) and q + f(z) − diag(s)z, which has the same p(z).
With all other unknowns fixed, row i is zero at the t with p_i(z) + a_ii(t − z_i) + f_i(t) − f_i(z_i) = 0. The slope s_i
is f_i′(z_i) where Newton's step leaves little of p_i, else the mean slope between z_i and t. So Jacobi's step solves
each row.

1. Let a_ii + d > 0 for the mean slopes d of f. Then t is unique, and lies between z_i and z_i − p_i/(a_ii + m_i).
2. MNMJ with exact mean slopes: e_i⁺ = −Σ_{j≠i} a_ij e_j/(a_ii + d_i) for the error e of a row with p_i = 0 at t, d_i
   the mean slope between t and z_i*. So the bound of the affine problem with A + diag(m) holds.
3. Near the solution s is f′(z*) up to O(‖e‖), so that every step has the rate of the tangent problem.

References
----------
Ortega and Rheinboldt, Iterative Solution of Nonlinear Equations in Several Variables (1970), section 10.3.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.data import ProblemData
from ..problem.nonlinear_term import NonlinearTerm
from ..problem.user_code import USER_ULPS
from .steps import INNER_REDUCTION, Step

#: the largest number of halvings of the interval that contains t, which may be much smaller than the interval
_MAX_HALVINGS = 100


def least_diagonal(problem: ProblemData) -> Vector:
    """a_ii + m_i, the least slope of row i in z_i; a_ii where m is not known."""
    diagonal = problem.matrix.rows.diagonal
    slope_range = None if problem.f is None else problem.f.slope_range
    return diagonal if slope_range is None else diagonal + slope_range[0]


def why_not_rows(problem: ProblemData) -> str | None:
    """Why the rows of a nonlinear p are not known to increase with their own unknowns; None where they are."""
    f = problem.f
    if f is None:
        return None
    if not f.is_elementwise:
        return "f may couple rows, and its steps solve row by row: give f as Elementwise"
    if f.slope_range is None:
        return "the slopes of f are not known: give `slope_range` to Elementwise, as (0, inf) where f rises"
    least = least_diagonal(problem)
    if (least > 0.0).all():
        return None
    i = int(np.argmin(least))
    return f"each row of p must increase with its own unknown, but A[{i}, {i}] + m_{i} = {least[i]:g}, m of slope_range"


def secant_step(problem: ProblemData, step_of: Callable[[ProblemData], Step]) -> Step:
    """The step of `step_of`, on the affine problem with the mean slopes of f at each z."""

    def step(z: Vector) -> tuple[Vector, float]:
        affine, p = secant_problem(problem, z)
        following, _ = step_of(affine)(z)
        return following, problem.residual_of(p, problem.r(z), problem.r_upper(z), problem.weights_at(z, p))

    return step


def secant_problem(problem: ProblemData, z: Vector) -> tuple[ProblemData, Vector]:
    """The affine problem with the mean slopes of f at `z`, and p(z); f is evaluated once at `z`."""
    f = problem.f
    assert f is not None
    value = f.value(z)
    with np.errstate(over="ignore", under="ignore"):
        offset = problem.q + value
        p = problem.product(z) + offset
    slopes = _mean_slopes(problem, f, z, value, p)
    return with_slopes(problem, slopes, offset - slopes * z), p


def with_slopes(problem: ProblemData, slopes: Vector, q: Vector) -> ProblemData:
    """The affine problem with A + diag(`slopes`) and `q`."""
    return problem.with_matrix(problem.matrix.plus_diagonal(slopes, problem.matrix.row_weights), q)


def _mean_slopes(problem: ProblemData, f: NonlinearTerm, z: Vector, value: Vector, p: Vector) -> Vector:
    """The mean slopes of f, shape (n,), between `z`, where f has this `value`, and the zero of each row.

    In rows that Newton's step solves up to a tenth of p_i they are the slopes at `z`.
    """
    diagonal = problem.matrix.rows.diagonal
    slopes = f.jacobian(z).diagonal()
    t = z - p / (diagonal + slopes)
    near = z
    far = z - p / least_diagonal(problem)
    tolerance = INNER_REDUCTION * np.abs(p) + USER_ULPS * UNIT_ROUNDOFF * (np.abs(diagonal * z) + np.abs(value))
    bisected = np.zeros(z.size, dtype=bool)
    for _ in range(_MAX_HALVINGS):
        with np.errstate(all="ignore"):
            residual = p + diagonal * (t - z) + (f.value(t) - value)
            unsolved = ~(np.abs(residual) <= tolerance)
        if not unsolved.any():
            break
        bisected |= unsolved
        # before its zero a row has the sign of p(z); where it is not finite it counts as beyond
        before = np.sign(residual) == np.sign(p)
        near = np.where(before, t, near)
        far = np.where(before, far, t)
        t = np.where(unsolved, 0.5 * (near + far), t)
    if not bisected.any():
        return slopes
    with np.errstate(all="ignore"):
        mean = (f.value(t) - value) / (t - z)
    return np.where(bisected & np.isfinite(mean), mean, slopes)
