"""The equations of an active set: z = ψ(z) in the active rows, Az + q = 0 in the others."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import MapError, SingularOperator
from ..numerics.arrays import Mask, Vector
from ..numerics.equilibration import times_rows
from ..problem.data import ProblemData
from ..problem.map import Map
from ..problem.two_sided import select_obstacle
from .operators import FactorisedOperator

#: the number of steps of iterative refinement, or of Newton's method with the derivative at its start
_REFINEMENTS = 4


def newton_matrix(problem: ProblemData, active: Mask, jacobian: sp.csr_array) -> sp.csr_array:
    """The matrix of Newton's method, the rows of I − ψ′ where `active` and those of A elsewhere; CSR, shape (n, n).

    Parameters
    ----------
    problem : ProblemData
        The problem.
    active : mask of shape (n,)
        The active rows.
    jacobian : CSR array of shape (n, n)
        ψ′(z).
    """
    share = active.astype(np.float64)
    slopes = sp.csr_array(sp.eye_array(problem.n) - jacobian)
    return sp.csr_array(times_rows(1.0 - share, problem.A) + times_rows(share, slopes))


def submatrix(problem: ProblemData, rows: NDArray[np.intp]) -> sp.csr_array:
    """A in these `rows`, ascending, and the same columns."""
    return restricted_data(problem, rows, problem.q)[0]


def restricted_data(problem: ProblemData, rows: NDArray[np.intp], z: Vector) -> tuple[sp.csr_array, Vector]:
    """A in these `rows`, ascending, and the same columns; and q in them, with all other unknowns fixed at `z`."""
    from ..numerics.kernels.graph import restricted_arrays  # loads numba

    A = problem.A
    starts, columns, values, q = restricted_arrays(A.indptr, A.indices, A.data, problem.q, rows, z)
    return sp.csr_array((values, columns, starts), shape=(rows.size, rows.size)), q


class Pattern(NamedTuple):
    """The active set: the rows in which the modulus selects an obstacle.

    Parameters
    ----------
    r : array of shape (n,)
        z minus the upper obstacle in the rows `above`, else minus the lower one.
    active : mask of shape (n,)
        The active rows.
    above : mask of shape (n,), optional
        The active rows that take the upper obstacle, None where there is none.
    """

    r: Vector
    active: Mask
    above: Mask | None = None

    @classmethod
    def at(cls, problem: ProblemData, z: Vector, p: Vector | None = None, omega: Vector | None = None) -> Pattern:
        """The active set at `z`: rows with r_i < p_i/Ω_i or z_i − ψ̄_i > p_i/Ω_i; by default p = p(z), Ω = weights."""
        with np.errstate(over="ignore", invalid="ignore"):
            p = problem.p(z) if p is None else p
            omega = problem.matrix.weights if omega is None else omega
            return cls.of(problem.r(z), problem.r_upper(z), p / omega)

    @classmethod
    def of(cls, r: Vector, r_upper: Vector | None, a: Vector) -> Pattern:
        """The active set from r = z − ψ, `r_upper` = z − ψ̄ and a = p/Ω; rows with ψ ≥ ψ̄ are active."""
        if r_upper is None:
            return cls(r, r < a)
        at_upper = r_upper > a
        return cls(np.where(at_upper, r_upper, r), (r < a) | at_upper | (r <= r_upper), at_upper)

    def sides(self) -> tuple[Mask, ...]:
        """The rows that take the lower obstacle, and if there is an upper one, those that take it."""
        return (self.active,) if self.above is None else (self.active & ~self.above, self.above)

    def same_sides(self, other: Pattern) -> bool:
        """Whether every row takes the same side."""
        same = np.array_equal(self.active, other.active)
        return same and (self.above is None or other.above is None or np.array_equal(self.above, other.above))


def solve_on(problem: ProblemData, z: Vector, active: Mask, above: Mask | None = None) -> Vector:
    """Solve z_i = ψ_i(z) in the `active` rows and (Az + q)_i = 0 in the others, starting at `z`.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    z : array of shape (n,)
        Start.
    active : mask of shape (n,)
        The active rows.
    above : mask of shape (n,), optional
        The rows that take ψ̄ in place of ψ.

    Returns
    -------
    array of shape (n,)
        A candidate, whose error `error_bound` bounds.

    Raises
    ------
    SingularOperator
        Where the equations are singular.
    MapError
        Where ψ or its Jacobian fails.

    Notes
    -----
    One factorisation, of the free rows alone where ψ is constant or its derivative is not known.
    Then refinement while the residual falls.
    """
    psi = select_obstacle(problem.psi, above)
    jacobian = psi.jacobian(z)
    with np.errstate(over="ignore", invalid="ignore"):
        return _refine(problem, psi, z, active, jacobian if jacobian is not None and jacobian.nnz else None)


def _refine(problem: ProblemData, psi: Map, z: Vector, active: Mask, jacobian: sp.csr_array | None) -> Vector:
    """`solve_on` for one obstacle `psi`, whose `jacobian` is None where it is constant or has none."""
    free = np.flatnonzero(~active)
    try:
        if jacobian is not None:
            operator = FactorisedOperator(newton_matrix(problem, active, jacobian))
        elif free.size:
            operator = FactorisedOperator(submatrix(problem, free))
    except SingularOperator as error:
        row = int(error.row if jacobian is not None else free[error.row])
        message = "the equations that the active set leaves are singular to working precision: row"
        raise SingularOperator(f"{message} {row} depends on the others", row) from None
    best = z
    smallest = np.inf
    for _ in range(_REFINEMENTS):
        if jacobian is not None:
            z = z - operator.solve(np.where(active, z - psi.value(z), problem.p(z)))
        else:
            z = np.where(active, psi.value(z), z)
            if free.size:
                z[free] -= operator.solve(problem.p(z)[free])
        equations = np.abs(np.where(active, z - psi.value(z), problem.p(z)))
        size = float(equations.max())
        if not size < smallest:
            break
        best = z
        smallest = size
        if size == 0.0:
            break
    return best


def derivative(psi: Map, z: Vector, above: Mask | None = None) -> sp.csr_array:
    """ψ′(z), and ψ̄′(z) in the rows of the mask `above`; CSR, shape (n, n). Raises MapError where it is not finite.

    Both must have a derivative, see `Map.no_derivative`.
    """
    J = select_obstacle(psi, above).jacobian(z)
    assert J is not None
    if not np.isfinite(J.data).all():
        raise MapError("psi's derivative is not finite")
    return J


def linearised(psi: Map, z: Vector) -> tuple[sp.csr_array, Vector]:
    """(G, c) with ψ(x) = Gx + c, or its linearisation at `z`. Raises MapError where that is not finite."""
    if psi.linear is not None:
        return psi.linear
    J = derivative(psi, z)
    return J, psi.value(z) - J @ z
