"""`solve_qp`: a convex quadratic program from its arrays."""

from __future__ import annotations

import time
from dataclasses import dataclass
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import InputError, NotSolved, by_name
from ...numerics.arrays import (
    Vector,
    as_array,
    as_csr,
    as_number,
    as_real,
    as_truth,
    as_vector,
    axes,
    check_indices,
    row_of,
)
from ...numerics.rounding import UNIT_ROUNDOFF, sheltered
from ...numerics.threads import one_blas_thread
from ...present.shown import Shown
from ...theory.matrices.definiteness import definiteness
from .program import Program
from .solve_program import solve_program

#: largest n for which Cholesky's factors of a dense P are asked first whether it is semidefinite: 128 MB
_DENSE = 4000


@dataclass(frozen=True, eq=False, repr=False)
class QpSolution(Shown):
    """What `solve_qp` found.

    `x` of shape (n,); the multipliers `y` of Ax = b, of any sign, `z` ≥ 0 of Gx ≤ h, and `z_box` of the bounds, ≥ 0
    where x_i = ub_i and ≤ 0 where x_i = lb_i: Px + q + Gᵀz + Aᵀy + z_box = 0. `objective` = ½xᵀPx + qᵀx. `status` is
    "optimal"; "optimal_inaccurate"; "infeasible", "unbounded", which are proved, or with "_inaccurate" proved up to
    rounding, x and the multipliers being NaN; "infeasible_or_unbounded"; "user_limit" or "solver_error", x being the
    best iterate. `message` says what that rests on. `violation` is how far x and the multipliers are from optimal: the
    largest of what is wrong in a row, of Ax = b, Gx ≤ h, stationarity or complementarity, as a share of the sum of its
    |terms|, and of what the objective may be above the least one, as a share of its own. `iterations` are Newton steps.

    >>> icp.solve_qp([[2.0]], [-2.0])
    QpSolution(optimal: x = [1.], objective = -1)
    """

    x: Vector
    y: Vector
    z: Vector
    z_box: Vector
    objective: float
    status: str
    message: str
    violation: float
    iterations: int
    seconds: float

    @property
    def found(self) -> bool:
        """Whether x is optimal.

        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).found
        True
        """
        return self.status == "optimal"

    def __repr__(self) -> str:
        if not self.found:
            return f"QpSolution({self.status}: {self.message})"
        with np.printoptions(threshold=8, precision=6):
            return f"QpSolution({self.status}: x = {self.x}, objective = {self.objective:.6g})"


@sheltered
@by_name("solve_qp")
def solve_qp(
    P: Any,
    q: Any,
    G: Any = None,
    h: Any = None,
    A: Any = None,
    b: Any = None,
    lb: Any = None,
    ub: Any = None,
    *,
    initvals: Any = None,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    raise_on_failure: bool = True,
) -> QpSolution:
    """Minimise ½xᵀPx + qᵀx subject to Gx ≤ h, Ax = b and lb ≤ x ≤ ub.

    The arguments are those of qpsolvers. The conditions of optimality are an ICP with a positive semidefinite matrix,
    which Newton's method for the modulus equation solves; where there is no solution that is proved.

    Parameters: `P` symmetric and positive semidefinite, shape (n, n), `G` (m, n) and `A` (k, n), dense or sparse; `q`
    (n,), `h` (m,), +inf where a row says nothing, `b` (k,), `lb` and `ub` (n,) or numbers, −inf and +inf where there is
    no bound; None leaves constraints out. `initvals` an x, shape (n,), near the solution: the constraints that are
    tight there are tried first. `tolerance` of the residual of the ICP in units in which its data are about 1; in the
    units of the program nothing is wrong by more than ten times that (`QpSolution.violation`). `time_limit` in
    seconds. Returns a `QpSolution`. Raises InputError where an argument is wrong, or P is not symmetric or certainly
    not semidefinite; NotSolved, which carries what was found, where that is not optimal, unless `raise_on_failure` is
    False; OutOfMemory before the work begins.
    Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (2009), section 1.2.

    >>> solution = icp.solve_qp([[2, 0], [0, 2]], [-2, -6], G=[[1, 1]], h=[2], lb=0)
    >>> solution.x, solution.z, round(solution.objective, 9)
    (array([0., 2.]), array([2.]), -8.0)
    >>> icp.solve_qp([[1.0]], [0.0], lb=1, ub=0, raise_on_failure=False).status
    'infeasible'
    """
    begin = time.perf_counter()
    as_truth(raise_on_failure, "raise_on_failure")
    as_number(tolerance, "tolerance", above=0)
    limit = np.inf if time_limit is None else as_number(time_limit, "time_limit", above=0)
    P = as_csr(P, "P")
    n = P.shape[0]
    _check_form(P)
    q = as_vector(q, n, "q", number=False)
    (G, h), (A, b) = _rows(G, h, n, ("G", "h")), _rows(A, b, n, ("A", "b"))
    low, high = _bound(lb, n, "lb", -np.inf), _bound(ub, n, "ub", np.inf)
    start = None if initvals is None else as_vector(initvals, n, "initvals")
    below, above, one = np.isfinite(low), np.isfinite(high), sp.eye_array(n, format="csr")
    F = sp.csr_array(sp.vstack([G, -one[below], one[above]]))
    program = Program.of(P, q, A, b, F, np.concatenate([h, -low[below], high[above]]))
    left = max(limit - (time.perf_counter() - begin), 0.0)
    found = solve_program(program, tolerance=tolerance, time_limit=left, start=start)
    x, y, multipliers = found.values or tuple(np.full(size, np.nan) for size in (n, b.size, program.g.size))
    z, of_low, of_high = np.split(multipliers, [h.size, h.size + np.count_nonzero(below)])
    z_box = np.zeros(n) if found.values else np.full(n, np.nan)
    z_box[below] -= of_low
    z_box[above] += of_high
    violation = program.violation(x, y, multipliers) if found.values else np.nan
    report = found.objective, found.status, found.message, violation, found.steps, found.seconds
    solution = QpSolution(x, y, z, z_box, *report)
    if raise_on_failure and not solution.found:
        raise NotSolved(solution)
    return solution


def _bound(value: Any, n: int, name: str, none: float) -> Vector:
    """The bounds, `none` where there are none."""
    bound = np.full(n, none) if value is None else as_vector(value, n, name, infinite=none)
    if (bound == -none).any():
        raise InputError(f"{name}[{np.argmax(bound == -none)}] is {-none}; a finite number or {none} was expected")
    return bound


def _rows(M: Any, right: Any, n: int, names: tuple[str, str]) -> tuple[sp.csr_array, Vector]:
    """The matrix and the right-hand side of constraints, none where both are None."""
    name, of_right = names
    if (M is None) != (right is None):
        given, other = (of_right, name) if M is None else names
        raise InputError(f"{given} is given without {other}: give both, or leave both out")
    if M is None:
        return sp.csr_array((0, n)), np.zeros(0)
    if axes(M, name) == 1:
        M = as_array(M, name)[None]
    if axes(M, name) != 2 or np.shape(M)[1] != n:
        raise InputError(f"{name} has shape {np.shape(M)}; shape (m, {n}) was expected")
    check_indices(M, name)
    M = sp.csr_array(as_real(M if sp.issparse(M) else as_array(M, name), name), dtype=np.float64)
    if not np.isfinite(M.data).all():
        k = int(np.argmin(np.isfinite(M.data)))
        raise InputError(f"{name}[{row_of(M)[k]}, {M.indices[k]}] is {M.data[k]}; a finite number was expected")
    if M.shape[0] == 0:
        return M, np.zeros(0)
    return M, as_vector(right, M.shape[0], of_right, infinite=np.inf if name == "G" else None)


def _check_form(P: sp.csr_array) -> None:
    """Raises InputError where P is not symmetric, or is proved not to be semidefinite."""
    from scipy.linalg.lapack import dpotrf

    skew = sp.coo_array(P - P.T)
    size = np.abs(P.data).max(initial=0.0)
    if np.abs(skew.data).max(initial=0.0) > P.shape[0] * UNIT_ROUNDOFF * size:
        k = int(np.argmax(np.abs(skew.data)))
        i, j = int(skew.coords[0][k]), int(skew.coords[1][k])
        raise InputError(
            f"P[{i}, {j}] = {P[i, j]:.6g}, but P[{j}, {i}] differs by {P[j, i] - P[i, j]:.3g}; a symmetric matrix "
            "was expected: (P + P.T)/2 has the same objective"
        )
    if P.shape[0] <= _DENSE:
        diagonal = P.diagonal()
        unit = 1.0 / np.sqrt(np.where(diagonal > 0, diagonal, 1.0))
        scaled = P.toarray() * unit * unit[:, None]
        scaled[np.diag_indices_from(scaled)] += 8.0 * (P.shape[0] + 1) * UNIT_ROUNDOFF
        with one_blas_thread():
            if dpotrf(scaled, lower=1, overwrite_a=1)[1] == 0:
                return
    answer = definiteness(P)[1]
    if answer.holds is False:
        raise InputError(f"P is not positive semidefinite, so that the program is not convex: {answer.reason}")
