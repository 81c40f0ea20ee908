"""The equations that a choice of rows leaves: z = ψ(z) in the active ones, Az + q = 0 in the others."""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...arrays import Vector
from ...errors import SingularOperator
from ...operators import FactorisedOperator
from ...problem import ICP

#: steps of iterative refinement, or of Newton's method with the first derivative kept
_REFINEMENTS = 4


def weights(problem: ICP) -> Vector:
    """Ω with p/Ω in the units of z: |a_ii|, the largest |a_ij| of the row where that is 0, 1 in a zero row; shape (n,).

    >>> weights(ICP([[-2.0, 1.0], [3.0, 0.0]], [0.0, 0.0]))
    array([2., 3.])
    """
    diagonal = np.abs(problem.A.diagonal())
    if diagonal.all():
        return diagonal
    largest = np.asarray(problem.absolute_A().max(axis=1).toarray()).reshape(-1)
    return np.where(diagonal > 0, diagonal, np.where(largest > 0, largest, 1.0))


def equations_on(problem: ICP, active: NDArray[np.bool_], jacobian: sp.csr_array) -> sp.csr_array:
    """The matrix with the rows of I − ψ′ where `active` and those of A elsewhere; CSR, shape (n, n).

    Parameters: `active` a mask of shape (n,); `jacobian` = ψ′(z), CSR, shape (n, n).

    >>> problem = ICP([[2.0, -1.0], [-1.0, 2.0]], [0.0, 0.0])
    >>> equations_on(problem, np.array([False, True]), problem.psi.jacobian(np.zeros(2))).toarray()
    array([[ 2., -1.],
           [ 0.,  1.]])
    """
    keep, follow = (sp.diags_array(mask.astype(np.float64)) for mask in (~active, active))
    return sp.csr_array(keep @ problem.A + follow @ (sp.eye_array(problem.n) - jacobian))


def nearer_to_obstacle(problem: ICP, z: Vector) -> NDArray[np.bool_]:
    """The rows with r_i < p_i/Ω_i, Ω = `weights`: there the modulus takes the side of the obstacle; a mask, shape (n,).

    >>> nearer_to_obstacle(ICP([[2.0]], [-1.0]), np.array([3.0]))
    array([False])
    """
    with np.errstate(over="ignore", invalid="ignore"):
        return problem.r(z) < problem.p(z) / weights(problem)


def solve_on(problem: ICP, z: Vector, active: NDArray[np.bool_]) -> Vector:
    """The solution of z_i = ψ_i(z) in the `active` rows, (Az + q)_i = 0 in the others, near `z`.

    One factorisation, of the other rows alone where ψ has no derivative, then refinement while the residual falls.
    Parameters: `z` shape (n,), `active` a mask of shape (n,). Returns a vector of shape (n,). It is a candidate, no
    more: `error_bound` says what it is worth. Raises SingularOperator where the equations are singular, MapError where
    ψ or its Jacobian fails.

    >>> solve_on(ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 3.0]), np.zeros(2), np.array([False, True]))
    array([0.5, 0. ])
    """
    jacobian = problem.psi.jacobian(z)
    with np.errstate(over="ignore", invalid="ignore"):
        return _refined(problem, z, active, jacobian if jacobian is not None and jacobian.nnz else None)


def _refined(problem: ICP, z: Vector, active: NDArray[np.bool_], jacobian: sp.csr_array | None) -> Vector:
    free = np.flatnonzero(~active)
    try:
        if jacobian is not None:
            operator = FactorisedOperator(equations_on(problem, active, jacobian))
        elif free.size:
            operator = FactorisedOperator(sp.csr_array(problem.A[free][:, free]))
    except SingularOperator as error:
        row = int(error.row if jacobian is not None else free[error.row])
        told = "the equations that the active set leaves are singular to working precision: row"
        raise SingularOperator(f"{told} {row} depends on the others", row) from None
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
