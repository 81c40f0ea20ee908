"""The equations that a choice of rows leaves: z = ψ(z) in the active ones, Az + q = 0 in the others."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import MapError, SingularOperator
from ..numerics import work
from ..numerics.arrays import Vector, row_of
from ..numerics.linear import solver_of
from ..problem.between import chosen
from ..problem.data import ProblemData
from ..problem.map import Map
from .operators import FactorisedOperator

#: steps of iterative refinement, or of Newton's method with the first derivative kept
_REFINEMENTS = 4


def equations_on(problem: ProblemData, active: NDArray[np.bool_], jacobian: sp.csr_array) -> sp.csr_array:
    """The matrix with the rows of I − ψ′ where `active` and those of A elsewhere; CSR, shape (n, n).

    Parameters: `active` a mask of shape (n,); `jacobian` = ψ′(z), CSR, shape (n, n).
    """
    keep, follow = (sp.diags_array(mask.astype(np.float64)) for mask in (~active, active))
    return sp.csr_array(keep @ problem.A + follow @ (sp.eye_array(problem.n) - jacobian))


class Pattern(NamedTuple):
    """Where the modulus takes an obstacle's side, `active`, a mask of shape (n,), and of these rows those that take the
    one `above`, None where there is none; `r`, shape (n,), is z less the obstacle that each row is nearer to.
    """

    r: Vector
    active: NDArray[np.bool_]
    above: NDArray[np.bool_] | None = None

    @classmethod
    def at(cls, problem: ProblemData, z: Vector, p: Vector, omega: Vector) -> Pattern:
        """At `z`, where Az + q = `p`: rows with r_i < p_i/Ω_i, and those with z_i − ψ̄_i > p_i/Ω_i."""
        r, above = problem.r(z), problem.r_upper(z)
        return cls.of(r, above, p / omega)

    @classmethod
    def of(cls, r: Vector, above: Vector | None, a: Vector) -> Pattern:
        """From r = z − ψ, `above` = z − ψ̄ and a = p/Ω."""
        if above is None:
            return cls(r, r < a)
        taken = above > a
        return cls(np.where(taken, above, r), (r < a) | taken, taken)

    def sides(self) -> tuple[NDArray[np.bool_], ...]:
        """The rows that take the obstacle below, and where there is one above, those that take that one."""
        return (self.active,) if self.above is None else (self.active & ~self.above, self.above)

    def is_that_of(self, other: Pattern) -> bool:
        """Whether every row takes the same side."""
        same = np.array_equal(self.active, other.active)
        return same and (self.above is None or other.above is None or np.array_equal(self.above, other.above))


def pattern_at(problem: ProblemData, z: Vector) -> Pattern:
    """The rows that take an obstacle's side at `z`, with Ω = `weights`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return Pattern.at(problem, z, problem.p(z), problem.matrix.weights)


def solve_on(
    problem: ProblemData, z: Vector, active: NDArray[np.bool_], above: NDArray[np.bool_] | None = None
) -> Vector:
    """The solution of z_i = ψ_i(z) in the `active` rows, (Az + q)_i = 0 in the others, near `z`.

    One factorisation, of the other rows alone where ψ has no derivative, then refinement while the residual falls.
    Parameters: `z` shape (n,), `active` a mask of shape (n,), `above` one of the rows with ψ̄ in place of ψ, or None.
    Returns a vector of shape (n,). It is a candidate, no more: `error_bound` says what it is worth. Raises
    SingularOperator where the equations are singular, MapError where ψ or its Jacobian fails.
    """
    psi = chosen(problem.psi, above)
    jacobian = psi.jacobian(z)
    with np.errstate(over="ignore", invalid="ignore"):
        return _refined(problem, psi, z, active, jacobian if jacobian is not None and jacobian.nnz else None)


def _refined(
    problem: ProblemData, psi: Map, z: Vector, active: NDArray[np.bool_], jacobian: sp.csr_array | None
) -> Vector:
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
            z = z - operator.solve(np.where(active, z - psi.value(z), problem.p(z)))
        else:
            z = np.where(active, psi.value(z), z)
            if free.size:
                z[free] -= operator.solve(problem.p(z)[free])
        equations = np.abs(np.where(active, z - psi.value(z), problem.p(z)))
        size = float(equations.max())
        if not size < smallest:
            break
        best, smallest = z, size
        if size == 0.0:
            break
    return best


#: (p, r, relative tolerance) ↦ the step of Newton's method, or None where there is none
Stepper = Callable[[Vector, Vector, float], Vector | None]


def step_of(problem: ProblemData, active: NDArray[np.bool_], jacobian: sp.csr_array) -> Stepper:
    """The solver of (I − ψ′)d = −r in the `active` rows, I, and Ad = −p in the others, F, for many p and r.

    Where the chains of ψ′ through the active rows end, as those of jumps do, the active unknowns are eliminated,
    d_I = Td_F + s, and A_FF + A_FI T is left: with few rows at the border of I, little more than A_FF.
    Parameters: `active` a mask of shape (n,); `jacobian` = ψ′(z), CSR, shape (n, n). Returns the solver.
    """
    rows, free = np.flatnonzero(active), np.flatnonzero(~active)
    try:
        slope, links, T = _chains(jacobian, rows, free)
        A_F = problem.A[free]
        M = sp.csr_array(A_F[:, free])
        if T.nnz:
            M = sp.csr_array(M + _product(sp.csr_array(A_F[:, rows]), T))
    except _NotWorth:
        solve_all = solver_of(equations_on(problem, active, jacobian))
        return lambda p, r, tolerance: solve_all(-np.where(active, r, p), tolerance)
    solve = solver_of(M)

    def step(p: Vector, r: Vector, tolerance: float) -> Vector | None:
        s = -r[rows] / slope
        for link in links:
            s = s + link @ s
        d = np.zeros(p.size)
        d[rows] = s
        part = solve(-(p[free] + A_F @ d), tolerance)
        if part is None or not np.isfinite(s).all():
            return None
        d[free] = part
        d[rows] += T @ part
        return d

    return step


class _NotWorth(Exception):
    """The active unknowns cannot be eliminated, or that costs more than a dense factorisation of the whole."""


def _chains(
    J: sp.csr_array, rows: NDArray[np.intp], free: NDArray[np.intp]
) -> tuple[Vector, list[sp.csr_array], sp.csr_array]:
    """(1 − own slope, N, N², N⁴, …, and T) with (I − N)⁻¹ = … (I + N²)(I + N), where N has a power that is 0."""
    from scipy.sparse.csgraph import connected_components

    if not J.nnz:
        return np.ones(rows.size), [], sp.csr_array((rows.size, free.size))
    own = J.diagonal()[rows]
    slope, J_I = 1.0 - own, J[rows]
    if not slope.all():
        raise _NotWorth
    if own.any():
        J_I = sp.diags_array(1.0 / slope) @ J_I
    T, N = sp.csr_array(J_I[:, free]), sp.csr_array(J_I[:, rows])
    if own.any():
        N.data[row_of(N) == N.indices] = 0.0
        N.eliminate_zeros()
    if N.nnz and connected_components(N, connection="strong")[0] < rows.size:
        raise _NotWorth
    links: list[sp.csr_array] = []
    while N.nnz:
        links.append(N)
        T, N = sp.csr_array(T + _product(N, T)), _product(N, N)
    return slope, links, T


def _product(A: sp.csr_array, B: sp.csr_array) -> sp.csr_array:
    """AB. Raises _NotWorth where it costs more than a dense factorisation with as many rows as B has in all."""
    cost = work.COSTS.sparse_flop * float(np.diff(B.indptr)[A.indices].sum())
    if cost > work.dense_cost(sum(B.shape)):
        raise _NotWorth
    work.afford(cost)
    work.add(cost)
    return sp.csr_array(A @ B)


def derivative(psi: Map, z: Vector, above: NDArray[np.bool_] | None = None) -> sp.csr_array:
    """ψ′(z), in the rows `above`, a mask, ψ̄′(z), CSR, shape (n, n), where `Newton.why_not` is None. Raises MapError
    where it is not finite."""
    J = chosen(psi, above).jacobian(z)
    assert J is not None
    if not np.isfinite(J.data).all():
        raise MapError("psi's derivative is not finite")
    return J
