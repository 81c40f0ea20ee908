"""Least squares with bounds, without BᵀB: an ICP in the residual r = c − Bx and in x.

    r + Bx − c = 0  (r of any sign),        −Bᵀr  ⟂  lb ≤ x ≤ ub

has the condition number of B; that of BᵀB is its square.
Reference: Björck, Numerical Methods for Least Squares Problems (1996), sections 2.5 and 5.2.
"""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError, NotSolved, OutOfTime
from ...numerics import work
from ...numerics.arrays import Mask, Vector, as_truth, as_vector, inner, norm, with_entries
from ...numerics.factorisation import largest_of_columns
from ...numerics.labels import along_rows, along_unknowns, check_labels
from ...numerics.rounding import UNIT_ROUNDOFF, gamma, public_entry
from ...present.display import Displayable
from .program import saddle_matrix
from .program_arguments import bounds, check_order, matrix, program_limits
from .solve_qp import INTERRUPTED, solve_avi

#: the largest number of columns for which x is corrected by orthogonal factorisations: there may be one per column
_MAX_COLUMNS = 2000
#: the cost of an orthogonal factorisation relative to LU: 3 to 4 were measured for 500 to 2000 rows
_ORTHOGONAL_COST = 3.0
#: the largest exponent of the units of x
_MAX_EXPONENT = 900


@dataclass(frozen=True, eq=False, repr=False)
class LeastSquares(Displayable):
    """The result of `solve_lsq`, with the attributes of that of `scipy.optimize.lsq_linear`.

    Attributes
    ----------
    x : ndarray, shape (n,)
    cost : float
        ½‖Bx − c‖².
    fun : ndarray, shape (m,)
        Bx − c.
    optimality : float
        The largest |entry| of the gradient Bᵀ(Bx − c), without those whose sign is right at an active bound.
    active_mask : ndarray of int, shape (n,)
        −1 where x_i = lb_i, 1 where x_i = ub_i, else 0.
    nit : int
        Steps of all methods.
    status, message : str
        As in `ProgramSolution`.
    seconds : float

    Examples
    --------
    >>> icp.solve_lsq([[1.0], [1.0]], [1.0, 2.0])
    LeastSquares(optimal: x = [1.5], cost = 0.25)
    """

    x: Vector
    cost: float
    fun: Vector
    optimality: float
    active_mask: np.ndarray
    nit: int
    status: str
    message: str
    seconds: float

    @property
    def success(self) -> bool:
        """Whether x is optimal.

        Examples
        --------
        >>> icp.solve_lsq([[1.0]], [1.0]).success
        True
        """
        return self.status == "optimal"

    def __repr__(self) -> str:
        if not self.success:
            return f"LeastSquares({self.status}: {self.message})"
        with np.printoptions(threshold=8, precision=6):
            return f"LeastSquares({self.status}: x = {self.x}, cost = {self.cost:.6g})"


@public_entry
@np.errstate(all="ignore")  # residuals may overflow
def solve_lsq(
    B: Any,
    c: Any,
    lb: Any = None,
    ub: Any = None,
    *,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    raise_on_failure: bool = True,
) -> LeastSquares:
    """Minimise ½‖Bx − c‖² subject to lb ≤ x ≤ ub, without forming BᵀB.

    Parameters
    ----------
    B : array or sparse matrix of shape (m, n)
        Of any rank.
    c : array of shape (m,)
        The right-hand side.
    lb, ub : float or array of shape (n,), optional
        −inf and +inf where there is no bound.
    tolerance : float, default 1e-9
        The largest violation of any condition of optimality.
    time_limit : float, optional
        Seconds, as in `solve_qp`.
    raise_on_failure : bool, default True
        Whether a run that fails raises NotSolved.

    Returns
    -------
    LeastSquares
        x, the cost and the status.

    Raises
    ------
    InputError
        Where an argument is wrong, or bounds cross.
    NotSolved
        Where no optimum is found, with the `solution`, unless `raise_on_failure` is False.

    References
    ----------
    Björck, Numerical Methods for Least Squares Problems (1996), section 5.2.

    Examples
    --------
    >>> B = [[1, 2], [3, 4], [5, 6]]
    >>> icp.solve_lsq(B, [1, 0, 1], lb=0, ub=[0.1, np.inf]).x.round(6)
    array([0.      , 0.142857])
    """
    start_time = work.clock()
    as_truth(raise_on_failure, "raise_on_failure")
    check_labels({"B": along_rows(B), "c": c})
    check_labels({"B": along_unknowns(B), "lb": lb, "ub": ub})
    B = matrix(B, "B")
    n = B.shape[1]
    if not n:
        raise InputError(f"B has shape {B.shape}; at least one column was expected")
    c = as_vector(c, B.shape[0], "c")
    low, high = bounds(lb, ub, n)
    check_order(low, high)
    with program_limits(tolerance, time_limit, start_time):
        x, violations, iterations, status, message = _solve_scaled(B, c, low, high, tolerance)
    fun = B @ x - c
    solution = LeastSquares(
        x=x,
        cost=0.5 * inner(fun, fun),
        fun=fun,
        optimality=float(violations.max(initial=0.0)),
        active_mask=np.where(x >= high, 1, np.where(x <= low, -1, 0)),
        nit=iterations,
        status=status,
        message=message,
        seconds=work.clock() - start_time,
    )
    if raise_on_failure and not solution.success:
        raise NotSolved(solution)
    return solution


#: x, the |gradient| with 0 where its sign is right at an active bound, iterations, status and message
Outcome = tuple[Vector, Vector, int, str, str]


def _solve_scaled(B: sp.csr_array, c: Vector, low: Vector, high: Vector, tolerance: float) -> Outcome:
    """Solve in units in which the squares of the largest entries stay in the range of floats."""
    nearest = np.clip(0.0, low, high)
    largest = (np.abs(values).max(initial=0.0) for values in (B.data, c, nearest))
    exponent_B, exponent_c, exponent_x = (int(np.frexp(size)[1]) for size in largest)
    # x and the bounds remain floats, too
    least = max(exponent_x, -_MAX_EXPONENT) if nearest.any() else -_MAX_EXPONENT
    exponent_c = min(max(exponent_c, exponent_B + least), exponent_B + _MAX_EXPONENT)
    scaled = with_entries(B, np.ldexp(B.data, -exponent_B))
    lower, upper = (np.ldexp(side, exponent_B - exponent_c) for side in (low, high))
    x, violations, nit, status, message = _solve(scaled, np.ldexp(c, -exponent_c), lower, upper, tolerance)
    x = np.clip(np.ldexp(x, exponent_c - exponent_B), low, high)
    if not (np.isfinite(x).all() and np.isfinite(violations).all()):
        status = "solver_error"
        message = "x leaves the range of floats"
    return x, np.ldexp(violations, exponent_B + exponent_c), nit, status, message


def _solve(B: sp.csr_array, c: Vector, low: Vector, high: Vector, tolerance: float) -> Outcome:
    m, n = B.shape
    x = np.clip(0.0, low, high)
    # if B is dense, or an orthogonal factorisation costs no more than a Newton step of the ICP without its factors
    if _is_dense(B) or _step_cost(m, n) <= work.newton_cost(m + n, m + n + 2 * B.nnz, mixed=False):
        x, violations, status, message = _by_active_set(B, c, x, low, high, tolerance)
        if status != "solver_error":
            return x, violations, 0, status, message
    last, steps, *failure = _by_conditions(B, c, low, high, tolerance)
    if norm(c - B @ last) <= norm(c - B @ x) + tolerance * norm(c):  # not where it is NaN
        x = last
    with work.work_limit(0.0 if failure[1] == INTERRUPTED else np.inf):
        x, violations, status, message = _by_active_set(B, c, x, low, high, tolerance)
    if status == "solver_error" and failure[0] != "optimal":
        status, message = failure
    return x, violations, steps, status, message


def _by_conditions(
    B: sp.csr_array, c: Vector, low: Vector, high: Vector, tolerance: float
) -> tuple[Vector, int, str, str]:
    """Solve the ICP in r and x; return x, which may be NaN, the steps, the status and the message."""
    m, n = B.shape
    try:
        work.charge_matrices(m + 2 * B.nnz, 8)  # H, and what `solve_avi` reads of it
    except OutOfTime as error:
        return np.full(n, np.nan), 0, "user_limit", str(error)
    H = saddle_matrix(sp.eye_array(m, format="csr"), sp.csr_array(B.T))
    free = np.full(m, np.inf)
    g = np.concatenate([-c, np.zeros(n)])
    lb = np.concatenate([-free, low])
    ub = np.concatenate([free, high])
    outcome = solve_avi(H, g, lb=lb, ub=ub, tolerance=tolerance, raise_on_failure=False)
    return outcome.x[m:], outcome.iterations, outcome.status, outcome.message


def _is_dense(B: sp.csr_array) -> bool:
    """Whether `B` takes no more memory as an array."""
    return 3 * B.nnz >= 2 * math.prod(B.shape)


def _by_active_set(
    B: Any, c: Vector, x: Vector, low: Vector, high: Vector, tolerance: float
) -> tuple[Vector, Vector, str, str]:
    """Improve `x` by steps with orthogonal factorisations of the free columns while they reduce the residual.

    Returns x, the |gradient| with 0 where its sign is right at an active bound, the status and the message. The status
    is "optimal" if this gradient is small relative to ‖r‖ and the columns of B, up to the rounding errors of r. Rows
    with r_i = 0 at a solution are only as accurate as the rounding errors of the others.
    """
    size = abs(B)
    columns = largest_of_columns(B)
    if _is_dense(B):
        B = B.toarray()
    at_start = norm(c - B @ x)
    for tries in itertools.count(2):  # one more in each round: the last ones cost as much as those that succeeded
        r = c - B @ x
        gradient = B.T @ r
        free = ((low < x) | (gradient > 0)) & ((x < high) | (gradient < 0))
        violations = np.where(free, np.abs(gradient), 0.0)
        small = tolerance * norm(r) * columns
        rounding = gamma(sum(B.shape) + 2) * (size @ np.abs(x) + np.abs(c))
        # where columns are nearly dependent, small gradients leave long steps to better points
        gap = inner(violations, np.minimum(np.abs(x), np.where(gradient > 0, high - x, x - low)))
        is_small = (violations <= small).all() and not gap > tolerance * norm(r) * norm(c)
        if is_small or free.size > _MAX_COLUMNS or work.seconds_left() == 0.0:
            break
        # a residual that consists of rounding errors must be halved, since it might fall for ever
        enough = 0.5 * norm(r) if norm(r) <= norm(rounding) else norm(r)
        try:
            points = itertools.islice(_nearer(B, c, x, low, high, free), tries)
            better = next((y for y in points if norm(c - B @ y) < enough), None)
        except KeyboardInterrupt:
            return x, violations, "user_limit", INTERRUPTED
        if better is None:
            break
        x = better
    # an x so large that its rounding errors exceed the residual at the start is no solution
    is_known = norm(rounding) <= max(at_start, norm(c))
    if is_known and (violations <= small + size.T @ rounding).all():
        return x, violations, "optimal", "solved"
    return x, violations, "solver_error", "the gradient has a wrong sign"


def _nearer(B: Any, c: Vector, x: Vector, low: Vector, high: Vector, free: Mask) -> Iterator[Vector]:
    """Points that may have a smaller residual than `x`. The first is a step of all `free` unknowns, clipped to bounds.

    The second is made by steps, which stop at bounds, of the unknowns between bounds and the one with the largest
    gradient. Up to rounding its residual is smaller (Lawson and Hanson 1995, chapter 23). Where it is not, the
    unknown with the next gradient takes its place, and so on.
    """
    r = c - B @ x
    yield np.clip(x + _step(B, r, free), low, high)
    inside = (low < x) & (x < high)
    gradient = np.where(free & ~inside, np.abs(B.T @ r), 0.0)
    for j in np.argsort(-gradient)[: max(np.count_nonzero(gradient), 1)]:
        moved = inside.copy()
        moved[j] |= gradient[j] > 0.0
        yield _to_bounds(B, c, x, moved, low, high)


def _step(B: Any, r: Vector, free: Mask) -> Vector:
    """The step in the `free` unknowns to the least residual, by an orthogonal factorisation; 0 beyond a work limit."""
    from scipy.linalg import lstsq

    step = np.zeros(free.size)
    columns = int(free.sum())
    cost = _step_cost(r.size, columns)
    if cost <= work.nanoseconds_left() and work.memory_suffices(16.0 * r.size * columns):
        work.count(cost)
        part = B[:, free] if isinstance(B, np.ndarray) else B[:, free].toarray()
        # columns are scaled to length 1; `dependent` is the default rcond of numpy.linalg.lstsq
        sizes = np.linalg.norm(part, axis=0)
        unit = np.where(sizes > 0.0, sizes, 1.0)
        part /= unit
        dependent = 2.0 * max(part.shape) * UNIT_ROUNDOFF
        step[free] = lstsq(part, r, dependent, lapack_driver="gelsy", check_finite=False)[0] / unit
    return step


def _step_cost(rows: int, columns: int) -> float:
    """The cost of an orthogonal factorisation."""
    per_entry = work.COSTS.dense_entry + work.COSTS.dense_flop * min(rows, columns) / 3.0
    return work.COSTS.call + _ORTHOGONAL_COST * rows * columns * per_entry


def _to_bounds(B: Any, c: Vector, x: Vector, free: Mask, low: Vector, high: Vector) -> Vector:
    """Minimise the residual over the `free` unknowns; one that meets its bound on the way stays there."""
    while free.any() and work.seconds_left() > 0.0:
        step = _step(B, c - B @ x, free)
        bound = np.where(step > 0.0, high, low)
        with np.errstate(all="ignore"):
            share = np.where(step != 0.0, (bound - x) / step, np.inf)
        least = share.min()
        if not least < 1.0:  # nor where it is NaN
            return np.clip(x + step, low, high)
        meets = share <= least
        x = np.where(meets, bound, x + least * step)
        free = free & ~meets
    return x


@public_entry
def solve_nnls(B: Any, c: Any, *, tolerance: float = 1e-9, time_limit: float | None = None) -> tuple[Vector, float]:
    """Minimise ‖Bx − c‖₂ subject to x ≥ 0, without forming BᵀB, and return what `scipy.optimize.nnls` does.

    Parameters
    ----------
    B : array or sparse matrix of shape (m, n)
        Of any rank.
    c : array of shape (m,)
        The right-hand side.
    tolerance : float, default 1e-9
        The largest violation of any condition of optimality.
    time_limit : float, optional
        Seconds, as in `solve_qp`.

    Returns
    -------
    x : array of shape (n,)
        The solution.
    rnorm : float
        ‖Bx − c‖₂.

    Raises
    ------
    InputError
        Where an argument is wrong.
    NotSolved
        Where no optimum is found; its `solution` is a `LeastSquares`.

    References
    ----------
    Lawson and Hanson, Solving Least Squares Problems (1995), chapter 23.

    Examples
    --------
    >>> x, rnorm = icp.solve_nnls([[3, 2], [1, 1]], [3, 2])
    >>> x.round(9), round(rnorm, 9)
    (array([0. , 1.6]), 0.447213595)
    """
    solution = solve_lsq(B, c, 0.0, tolerance=tolerance, time_limit=time_limit)
    return solution.x, norm(solution.fun)
