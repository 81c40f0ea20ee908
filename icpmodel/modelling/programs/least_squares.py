"""Least squares with bounds, without BᵀB: an ICP in the residual r = c − Bx and in x.

    r + Bx − c = 0  (r of any sign),        −Bᵀr  ⟂  lb ≤ x ≤ ub

has the condition of B, where BᵀB has its square.
Reference: Björck, Numerical Methods for Least Squares Problems (1996), sections 2.5 and 5.2.
"""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError, NotSolved, by_name
from ...numerics import work
from ...numerics.arrays import Vector, as_number, as_truth, as_vector, norm
from ...numerics.rounding import gamma, sheltered
from ...numerics.threads import one_blas_thread
from ...present.shown import Shown
from .program import Program
from .program_arguments import bounds, matrix
from .solve_program import solve_program

#: corrections by an orthogonal factorisation on the free columns
_CORRECTIONS = 5


@dataclass(frozen=True, eq=False, repr=False)
class LeastSquares(Shown):
    """The result of `solve_lsq`, in the words of `scipy.optimize.lsq_linear`.

    Attributes
    ----------
    x : ndarray, shape (n,)
    cost : float
        ½‖Bx − c‖².
    fun : ndarray, shape (m,)
        Bx − c.
    optimality : float
        The largest |entry| of Bᵀ(Bx − c) with the sign that a bound does not explain.
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

        >>> icp.solve_lsq([[1.0]], [1.0]).success
        True
        """
        return self.status == "optimal"

    def __repr__(self) -> str:
        if not self.success:
            return f"LeastSquares({self.status}: {self.message})"
        with np.printoptions(threshold=8, precision=6):
            return f"LeastSquares({self.status}: x = {self.x}, cost = {self.cost:.6g})"


@sheltered
@by_name("solve_lsq")
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
    B : array or sparse matrix, shape (m, n)
        Of any rank.
    c : array, shape (m,)
    lb, ub : array, shape (n,), or float, optional
        −inf and +inf where there is no bound.
    tolerance, time_limit, raise_on_failure
        As in `solve_qp`.

    Returns
    -------
    LeastSquares

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
    >>> icp.solve_lsq([[1, 2], [3, 4], [5, 6]], [1, 0, 1], lb=0, ub=[0.1, np.inf]).x.round(6)
    array([0.      , 0.142857])
    """
    begin = time.perf_counter()
    as_truth(raise_on_failure, "raise_on_failure")
    as_number(tolerance, "tolerance", above=0)
    limit = None if time_limit is None else as_number(time_limit, "time_limit", above=0)
    B = matrix(B, "B")
    m, n = B.shape
    c = as_vector(c, m, "c")
    low, high = bounds(lb, ub, n)
    if (low > high).any():
        i = int(np.argmax(low > high))
        raise InputError(f"lb[{i}] = {low[i]:g} is above ub[{i}] = {high[i]:g}; lb <= ub was expected")
    H = sp.csr_array(sp.block_array([[sp.eye_array(m), B], [-B.T, None]], format="csr"))
    free = np.full(m, np.inf)
    none = sp.csr_array((0, m + n)), np.zeros(0)
    sides = np.concatenate([-free, low]), np.concatenate([free, high])
    found = solve_program(
        Program(H, np.concatenate([-c, np.zeros(n)]), *none, *none, *sides),
        tolerance=tolerance,
        time_limit=None if limit is None else max(begin + limit - time.perf_counter(), 0.0),
    )
    x = np.zeros(n)
    if found.values is not None:
        box = found.values.box[m:]
        x = np.where(box < 0, low, np.where(box > 0, high, found.values.x[m:]))
        x = _corrected(B, c, x, low, high, np.inf if limit is None else begin + limit)
    fun = B @ x - c
    gradient = B.T @ fun
    mask = np.where(x >= high, 1, np.where(x <= low, -1, 0))
    wrong = np.where(mask > 0, np.maximum(gradient, 0.0), np.where(mask < 0, np.minimum(gradient, 0.0), gradient))
    size = abs(B)
    rounding = gamma(m + n + 2) * (size @ np.abs(x) + np.abs(c))
    status = found.status
    message = found.message
    if (np.abs(wrong) <= size.T @ (tolerance * np.abs(fun) + rounding)).all():
        status = "optimal"
        message = "solved"
    told = found.iterations, status, message, time.perf_counter() - begin
    solution = LeastSquares(x, 0.5 * norm(fun) ** 2, fun, float(np.abs(wrong).max()), mask, *told)
    if raise_on_failure and not solution.success:
        raise NotSolved(solution)
    return solution


@sheltered
@by_name("solve_nnls")
def solve_nnls(B: Any, c: Any, *, tolerance: float = 1e-9, time_limit: float | None = None) -> tuple[Vector, float]:
    """Minimise ‖Bx − c‖₂ subject to x ≥ 0, without forming BᵀB; in the words of `scipy.optimize.nnls`.

    Parameters
    ----------
    B : array or sparse matrix, shape (m, n)
        Of any rank.
    c : array, shape (m,)
    tolerance, time_limit
        As in `solve_qp`.

    Returns
    -------
    x : ndarray, shape (n,)
    rnorm : float
        ‖Bx − c‖₂.

    Raises
    ------
    InputError
        Where an argument is wrong.
    NotSolved
        Where no optimum is found, with a `LeastSquares`.

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


def _corrected(B: sp.csr_array, c: Vector, x: Vector, low: Vector, high: Vector, end: float) -> Vector:
    """x after steps by an orthogonal factorisation of the free columns, while they reduce the residual, until `end`."""
    from scipy.linalg import lstsq

    if work.dense_cost(max(B.shape)) > work.dense_cost(_DENSE):
        return x
    dense = B.toarray()
    for _ in range(_CORRECTIONS):
        r = c - B @ x
        if time.perf_counter() > end:
            break
        gradient = B.T @ r
        free = np.where(x >= high, gradient < 0, np.where(x <= low, gradient > 0, True))
        with one_blas_thread():
            step = lstsq(dense[:, free], r, lapack_driver="gelsy", check_finite=False)[0]
        better = x.copy()
        better[free] = np.clip(x[free] + step, low[free], high[free])
        if not norm(c - B @ better) < norm(r):
            break
        x = better
    return x


#: rows and columns up to which that is done
_DENSE = 2000
