"""The equations that a choice of rows leaves: z = ψ(z) in the active ones, Az + q = 0 in the others."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...arrays import Vector
from ...errors import IcpError
from ...operators import FactorisedOperator
from ...problem import ICP

#: steps of iterative refinement, or of Newton's method with the first derivative kept
_REFINEMENTS = 4


def nearer_to_obstacle(problem: ICP, z: Vector) -> NDArray[np.bool_]:
    """The rows with r_i < p_i/|a_ii|, in which the modulus takes the side of the obstacle; a mask of shape (n,).

    >>> nearer_to_obstacle(ICP([[2.0]], [-1.0]), np.array([3.0]))
    array([False])
    """
    diagonal = np.abs(problem.A.diagonal())
    with np.errstate(over="ignore", invalid="ignore"):
        return problem.r(z) < problem.p(z) / np.where(diagonal > 0, diagonal, 1.0)


def solve_on(problem: ICP, z: Vector, active: NDArray[np.bool_]) -> Vector | None:
    """The solution of z_i = ψ_i(z) in the `active` rows, (Az + q)_i = 0 in the others, near `z`.

    One factorisation, of the other rows alone where ψ has no derivative, then refinement while the residual falls.
    Parameters: `z` shape (n,), `active` a mask of shape (n,). Returns a vector of shape (n,), or None where the
    equations are singular or ψ or its Jacobian fails. It is a candidate, no more: `error_bound` says what it is worth.

    >>> solve_on(ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0]), np.zeros(2), np.array([False, True]))
    array([0.5, 0. ])
    """
    try:
        jacobian = problem.psi.jacobian(z)
        with np.errstate(over="ignore", invalid="ignore"):
            return _refined(problem, z, active, jacobian if jacobian is not None and jacobian.nnz else None)
    except IcpError:
        return None


def _refined(problem: ICP, z: Vector, active: NDArray[np.bool_], jacobian: sp.csr_array | None) -> Vector:
    free = np.flatnonzero(~active)
    if jacobian is not None:
        keep, follow = (sp.diags_array(mask.astype(np.float64)) for mask in (~active, active))
        whole = sp.csr_array(keep @ problem.A + follow @ (sp.eye_array(problem.n) - jacobian))
        operator = FactorisedOperator(whole)
    elif free.size:
        operator = FactorisedOperator(sp.csr_array(problem.A[free][:, free]))
    best, smallest = z, np.inf
    for _ in range(_REFINEMENTS):
        if jacobian is not None:
            z = z - operator.solve(np.where(active, problem.r(z), problem.p(z)))
        else:
            z = np.where(active, problem.psi.value(z), z)
            if free.size:
                z[free] -= operator.solve(problem.p(z)[free])
        equations = np.abs(np.where(active, problem.r(z), problem.p(z)))
        size = float(equations.max())
        if not size < smallest:
            break
        best, smallest = z, size
        if size == 0.0:
            break
    return best
