"""The equations that a choice of rows leaves: z = ψ(z) in the active ones, Az + q = 0 in the others."""

from __future__ import annotations

from functools import cached_property
from typing import NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import MapError, SingularOperator
from ..numerics import work
from ..numerics.arrays import Mask, Vector, norm
from ..numerics.factorisation import factorise
from ..numerics.fill import SymbolicAnalysis
from ..numerics.krylov import cg_step_cost, conjugate_gradients, conjugate_residuals, gcr_step_cost
from ..numerics.linear import MANY_STEPS, solver_of
from ..numerics.sparse_structure import diagonal_positions
from ..numerics.symmetric_factors import Symmetric
from ..problem.data import ProblemData
from ..problem.map import Map
from ..problem.matrix import Matrix
from ..problem.two_sided import chosen
from .factor_costs import factor_costs
from .operators import FactorisedOperator

#: steps of iterative refinement, or of Newton's method with the first derivative kept
_REFINEMENTS = 4


def equations_on(problem: ProblemData, active: Mask, jacobian: sp.csr_array) -> sp.csr_array:
    """The matrix with the rows of I − ψ′ where `active` and those of A elsewhere; CSR, shape (n, n).

    Parameters
    ----------
    problem : ProblemData
        The problem.
    active : mask of shape (n,)
        The active rows.
    jacobian : CSR array of shape (n, n)
        ψ′(z).
    """
    keep, follow = (sp.diags_array(mask.astype(np.float64)) for mask in (~active, active))
    return sp.csr_array(keep @ problem.A + follow @ (sp.eye_array(problem.n) - jacobian))


def submatrix(problem: ProblemData, rows: NDArray[np.intp]) -> sp.csr_array:
    """A in these `rows`, ascending, and the same columns."""
    from ..numerics.kernels.graph import cut  # loads numba

    A = problem.A
    starts, columns, values, _ = cut(A.indptr, A.indices, A.data, problem.q, rows, problem.q)
    return sp.csr_array((values, columns, starts), shape=(rows.size, rows.size))


class Pattern(NamedTuple):
    """The active set: the rows on the obstacle's side of the modulus.

    Parameters
    ----------
    r : array of shape (n,)
        z minus the obstacle that each row is nearer to.
    active : mask of shape (n,)
        The active rows.
    above : mask of shape (n,), optional
        The active rows that take the upper obstacle, None where there is none.
    """

    r: Vector
    active: Mask
    above: Mask | None = None

    @classmethod
    def at(cls, problem: ProblemData, z: Vector, p: Vector, omega: Vector) -> Pattern:
        """At `z`, where Az + q = `p`: rows with r_i < p_i/Ω_i, and those with z_i − ψ̄_i > p_i/Ω_i."""
        r = problem.r(z)
        above = problem.r_upper(z)
        return cls.of(r, above, p / omega)

    @classmethod
    def of(cls, r: Vector, above: Vector | None, a: Vector) -> Pattern:
        """From r = z − ψ, `above` = z − ψ̄ and a = p/Ω."""
        if above is None:
            return cls(r, r < a)
        at_upper = above > a
        return cls(np.where(at_upper, above, r), (r < a) | at_upper, at_upper)

    def sides(self) -> tuple[Mask, ...]:
        """The rows that take the lower obstacle, and if there is an upper one, those that take it."""
        return (self.active,) if self.above is None else (self.active & ~self.above, self.above)

    def same_sides(self, other: Pattern) -> bool:
        """Whether every row takes the same side."""
        same = np.array_equal(self.active, other.active)
        return same and (self.above is None or other.above is None or np.array_equal(self.above, other.above))


def pattern_at(problem: ProblemData, z: Vector) -> Pattern:
    """The rows that take an obstacle's side at `z`, with Ω = `weights`."""
    with np.errstate(over="ignore", invalid="ignore"):
        return Pattern.at(problem, z, problem.p(z), problem.matrix.weights)


def solve_on(problem: ProblemData, z: Vector, active: Mask, above: Mask | None = None) -> Vector:
    """The solution of z_i = ψ_i(z) in the `active` rows, (Az + q)_i = 0 in the others, near `z`.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    z : array of shape (n,)
        Start.
    active : mask of shape (n,)
        The active rows.
    above : mask of shape (n,), optional
        The rows with ψ̄ in place of ψ.

    Returns
    -------
    array of shape (n,)
        A candidate only: `error_bound` bounds its error.

    Raises
    ------
    SingularOperator
        Where the equations are singular.
    MapError
        Where ψ or its Jacobian fails.

    Notes
    -----
    One factorisation, of the other rows alone where ψ has no derivative, then refinement while the
    residual falls.
    """
    psi = chosen(problem.psi, above)
    jacobian = psi.jacobian(z)
    with np.errstate(over="ignore", invalid="ignore"):
        return _refined(problem, psi, z, active, jacobian if jacobian is not None and jacobian.nnz else None)


def _refined(problem: ProblemData, psi: Map, z: Vector, active: Mask, jacobian: sp.csr_array | None) -> Vector:
    free = np.flatnonzero(~active)
    try:
        if jacobian is not None:
            operator = FactorisedOperator(equations_on(problem, active, jacobian))
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
    """ψ′(z), in the rows `above`, a mask, ψ̄′(z), CSR, shape (n, n), where both have one (`Map.no_derivative`). Raises
    MapError where it is not finite."""
    J = chosen(psi, above).jacobian(z)
    assert J is not None
    if not np.isfinite(J.data).all():
        raise MapError("psi's derivative is not finite")
    return J


#: steps of Krylov's methods for a system: 1e-4 where μ is .01, ½√100·log(2e4); and 70 to 1000 for games without a
#: diagonal where μ is .1
_KRYLOV_STEPS = 50
_KRYLOV_STEPS_WITHOUT_DIAGONAL = 1000
#: bytes of an entry, and vectors that steps hold
_ENTRY_BYTES = 12.0
_WORK_VECTORS = 24


def krylov_step_cost(matrix: Matrix, share: float = 1.0) -> float:
    """The cost of a step of CG on a `share` of the rows of A, or of GCR if A is not symmetric."""
    cost = cg_step_cost if matrix.is_nearly_symmetric else gcr_step_cost
    return cost(int(share * matrix.n), int(share * matrix.nnz))


def system_cost(matrix: Matrix, factors: float, memory: float) -> tuple[float, float]:
    """(nanoseconds, bytes) that `solver_of` is expected to take for a system with the pattern of A, where factors take
    so many."""
    steps = MANY_STEPS * gcr_step_cost(matrix.n, matrix.nnz) if matrix.has_positive_diagonal else np.inf
    return _least(matrix, steps, factors, memory)


def shifted_cost(matrix: Matrix) -> tuple[float, float]:
    """The expected (nanoseconds, bytes) of `ShiftedEquations`."""
    steps: float = _KRYLOV_STEPS if _few_steps_may_do(matrix) else _KRYLOV_STEPS_WITHOUT_DIAGONAL
    if (matrix.rows.diagonal < 0.0).any():
        steps = np.inf
    costs = factor_costs(matrix)
    return _least(matrix, steps * krylov_step_cost(matrix), costs.again, _ENTRY_BYTES * costs.fill.entries)


def _few_steps_may_do(matrix: Matrix) -> bool:
    return matrix.is_nearly_symmetric or matrix.has_positive_diagonal


def _least(matrix: Matrix, by_steps: float, factors: float, memory: float) -> tuple[float, float]:
    if by_steps < factors or (by_steps < np.inf and not work.fits(memory)):
        return by_steps, _ENTRY_BYTES * matrix.nnz + _WORK_VECTORS * 8.0 * matrix.n
    return factors, memory


class ShiftedEquations:
    """((A + D)x)_i = f_i in the free rows and x_i = 0 in the others, for one set of rows and one D ≥ 0 after another.

    By steps of Krylov's methods as long as these promise to cost less; by factors of matrices with the pattern of A,
    or by those of the free rows.
    """

    def __init__(self, problem: ProblemData) -> None:
        self.problem = problem
        self.costs = factor_costs(problem.matrix)
        self.iterative = True

    @cached_property
    def repeated(self) -> Symmetric | None:
        """The factorisation of all rows that keeps its order, if that costs less than a new order each time."""
        costs = self.costs
        signs = costs.analysis.signs
        if not costs.repeats or signs is None:
            return None
        return Symmetric(self.problem.A, costs.fill, signs)

    @cached_property
    def analysis(self) -> SymbolicAnalysis:
        """The complete symbolic analysis of all rows."""
        return self.costs.analysis.to_the_end()

    def solve(self, free: Mask, D: Vector, f: Vector, tolerance: float, briefly: bool) -> Vector | None:
        """x with an error of f of at most the relative `tolerance`, or None; `D`, `f` and x of shape (n,).

        Steps are `INEXACT` in the units of the diagonal. With `briefly` the free rows are not
        factorised where all have been.
        """
        matrix = self.problem.matrix
        rows = np.flatnonzero(free)
        share = rows.size / free.size
        whole = self.costs.fill
        part = whole._replace(rows=rows.size, entries=share**2 * whole.entries, flops=share**2 * whole.flops)
        direct = min(work.factor_cost(part), work.dense_cost(rows.size, matrix.is_symmetric))
        x_free = None
        if self.iterative:
            most = int(min(rows.size, min(direct, self.costs.again) / krylov_step_cost(matrix, share)))
            self.iterative = _few_steps_may_do(matrix) or shifted_cost(matrix)[0] < self.costs.again
            if self.iterative and most > 0:
                by_steps = conjugate_gradients if matrix.is_nearly_symmetric else conjugate_residuals
                x_free = by_steps(self._shifted(rows, D), f[rows], most)
                self.iterative = x_free is not None or briefly  # with a smaller D they will not do better
        if x_free is None and self.costs.again < direct:
            x_of_all = self._by_all_rows(free, D, f, tolerance)
            if x_of_all is not None or briefly:
                return x_of_all
        if x_free is None and (x_free := self._by_free_rows(rows, D, f[rows], tolerance)) is None:
            return None
        x = np.zeros(free.size)
        x[rows] = x_free
        return x

    def _shifted(self, rows: NDArray[np.intp], D: Vector) -> sp.csr_array:
        M = submatrix(self.problem, rows)
        M.data[diagonal_positions(M)] += D[rows]
        return M

    def _by_free_rows(self, rows: NDArray[np.intp], D: Vector, f: Vector, tolerance: float) -> Vector | None:
        M = self._shifted(rows, D)
        analysis = SymbolicAnalysis(M)
        lu = factorise(M, definite=True, analysis=analysis)
        x = None if lu is None else np.asarray(lu.solve(f))
        if x is None or not norm(M @ x - f) <= tolerance * norm(f):
            return solver_of(M, analysis=analysis)(f, tolerance)
        return x

    def _by_all_rows(self, free: Mask, D: Vector, f: Vector, tolerance: float) -> Vector | None:
        problem = self.problem
        data = problem.A.data.copy()
        data[problem.matrix.rows.diag] += D
        factors = self.repeated.factors(data, free) if self.repeated else None
        if factors is None:
            return None
        f = np.where(free, f, 0.0)
        x = np.zeros(f.size)
        rest = f
        for _ in range(2):  # without exchanges of rows digits may be lost
            x = x + factors.solve(rest)
            rest = np.where(free, f - D * x - problem.product(x), 0.0)
            if norm(rest) <= tolerance * norm(f):
                return x
        return None
