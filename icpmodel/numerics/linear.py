"""Linear systems of Newton's method, by the solver that fits the matrix.

1. Dense: LAPACK, by Cholesky or LU. For arrays, and where n³/3 multiplications cost less than 2, 3 and 4.
2. Band: LAPACK, by Cholesky or LU. At up to twice the cost of a sparse factorisation without fill, or up to that of 3
   and 4.
3. Sparse and symmetric up to the signs of rows: QDLDL. SuperLU follows where pivots fail.
4. Other sparse matrices: SuperLU. The fill of 3 and 4 is predicted by a symbolic analysis.
5. GCR. Where the diagonal is positive and 100 steps cost less than the factorisation.
6. Krylov steps with V-cycles, for M-matrices, where ten of them cost less: see `algebra.multigrid_equations`.

Except for Cholesky, rows are equilibrated first. Where GCR does not converge, M is factorised. The
costs and the fill are those of `numerics.fill`.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp

from .arrays import Vector, norm
from .equilibration import Exponents, in_units, row_exponents
from .factorisation import array_factors, dense_factors, factorise, largest_of_columns
from .fill import SymbolicAnalysis, dense_cost, factor_cost
from .krylov import conjugate_residuals, gcr_step_cost
from .rounding import SQRT_EPSILON
from .work import check_budget, count, product_cost


class Solver(Protocol):
    """(f, relative tolerance) ↦ x with Mx = f, or with Mᵀx = f where `transposed`; None where none was found."""

    def __call__(self, f: Vector, tolerance: float, transposed: bool = False) -> Vector | None: ...


#: the relative error up to which systems count as solved
MAX_BACKWARD_ERROR = 1e-12
#: the share of the diagonal that is added so that a singular matrix is noticed early, the least that did it in every
#: case; and the largest step of refinement, as a share of the solution or of the step before, that may correct for it
_PERTURBATION = 1.5e-11
_MAX_CORRECTION = 0.5
#: smaller entries of the diagonal are shifted by this share of the largest entry of their column: enough for a pivot
_PIVOT_SHIFT = 2.0 * SQRT_EPSILON
#: the largest relative residual of solves that are accurate enough to be used, ε^¼
ROUGH_SOLVE = math.sqrt(SQRT_EPSILON)
#: the typical number of steps of GCR without a preconditioner
_MANY_STEPS = 100


def solver_of(M: Any, analysis: SymbolicAnalysis | None = None) -> Solver:
    """A solver of Mx = f and Mᵀx = f for many f.

    Parameters
    ----------
    M : CSR or dense array of shape (n, n)
        The matrix.
    analysis : SymbolicAnalysis, optional
        Symbolic analysis of M, where one was begun.

    Returns
    -------
    callable
        The solver; it returns None where M is singular or not finite.

    Raises
    ------
    OutOfTime, OutOfMemory
        Here or in the solver, where a factorisation takes more than is left.
    """
    if M.shape[0] == 0:
        return lambda f, tolerance, transposed=False: f
    if not np.isfinite(M.data if sp.issparse(M) else M).all():
        return lambda f, tolerance, transposed=False: None
    analysis = analysis or (SymbolicAnalysis(M) if sp.issparse(M) else None)
    iterative = None if analysis is None else _by_steps(M, analysis)
    direct = cache(lambda: _by_factors(M, analysis))

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        check_budget()
        x = None if iterative is None else iterative(f, tolerance, transposed)
        if x is None:
            solved, rows, columns = direct()
            if transposed:
                rows, columns = columns, rows
            x = solved(np.ldexp(f, rows), tolerance, transposed)
            x = x if x is None else np.ldexp(x, columns)
        return x if x is not None and np.isfinite(x).all() else None

    return solve


def _by_factors(M: Any, analysis: SymbolicAnalysis | None) -> tuple[Solver, Exponents | int, Exponents | int]:
    """The solver by factors of the equilibrated M, and the exponents of the rows and columns."""
    exponents = row_exponents(M)
    if analysis is None:
        return _solver_with(array_factors(np.array(in_units(M, exponents), order="F"))), exponents, 0
    if analysis.is_dense or analysis.is_band:
        # Cholesky's factor is as accurate in all units, and scaled rows would not be symmetric
        if analysis.is_symmetric and (factors := factorise(M, definite=True, analysis=analysis)):
            return _solver_with(factors), 0, 0
        scaled = in_units(M, exponents)
        return _solver_with(dense_factors(scaled) if analysis.is_dense else factorise(scaled)), exponents, 0
    if analysis.signs is None:
        return _perturbed_factors(in_units(M, exponents), analysis), exponents, 0
    both = exponents // 2  # entries stay below 1, and M as symmetric as it was
    return _perturbed_factors(in_units(M, both, both), analysis), both, both


def steps_cost(n: int, nnz: int) -> float:
    """What GCR is expected to cost for a system of n rows."""
    return _MANY_STEPS * gcr_step_cost(n, nnz)


def _by_steps(M: sp.csr_array, analysis: SymbolicAnalysis) -> Solver | None:
    """The solver by GCR, with at most as many steps as cost no more than a factorisation.

    It gives up after its first failure. None where a factorisation is predicted to cost less than
    `_MANY_STEPS` steps, or where the diagonal is not positive.
    """
    a_step = gcr_step_cost(M.shape[0], M.nnz)
    cost = steps_cost(M.shape[0], M.nnz)
    if not (analysis.band_costs_more(cost) and (M.diagonal() > 0.0).all() and analysis.costs_more(cost)):
        return None
    dense = dense_cost(M.shape[0], analysis.is_symmetric)
    if dense <= cost:
        return None
    turned = cache(lambda: sp.csr_array(M.T))
    failed = False

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        nonlocal failed
        most = min(int(min(factor_cost(analysis.fill), dense) / a_step), M.shape[0])
        x = None if failed else conjugate_residuals(turned() if transposed else M, f, most, tolerance)
        failed = x is None
        return x

    return solve


def refine(
    solve: Callable[[Vector], Vector], multiply: Callable[[Vector], Vector], f: Vector, accuracy: float
) -> tuple[Vector, float, float]:
    """Solve Mx = f by refinement of inaccurate solves; return x and the relative residuals of the first and the last x.

    Refinement ends at a residual of `accuracy`, or where a step does not halve it.
    """
    size = norm(f) or 1.0
    x = solve(f)
    residual = f - multiply(x)
    first = error = norm(residual) / size
    while error > accuracy:
        better = x + solve(residual)
        residual = f - multiply(better)
        before = error
        error = norm(residual) / size
        if not error < 0.5 * before:
            return x, first, before
        x = better
    return x, first, error


def _solver_with(factors: Any) -> Solver:
    """The solver by these `factors`, which are None where M is singular."""

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        return None if factors is None else factors.solve(f, "T" if transposed else "N")

    return solve


def _perturbed_factors(M: sp.csr_array, analysis: SymbolicAnalysis) -> Solver:
    """The solver by the factors of M + εD, with few or no exchanges of rows.

    Entries of the diagonal below 2√ε of the largest one of their column are first shifted by that
    much, and no rows are exchanged: exchanges can fill up many times as much as predicted. Where
    these factors are inaccurate, M is factorised again with exchanges.

    After a pivot that is exactly 0 SuperLU takes its rows in another order, and reports only at the
    end that M is singular. On traffic equilibria that took 80 times as long as predicted. εD avoids
    it, and M counts as singular where refinement fails.
    """
    diagonal = M.diagonal()
    units = largest_of_columns(M)

    def perturbed(more: Vector, definite: bool) -> tuple[sp.csr_array, Solver]:
        near = sp.csr_array(M + sp.diags_array(more))
        return near, _solver_with(factorise(near, definite=definite, analysis=analysis))

    @cache
    def exchanged() -> Solver:
        return _with_refinement(M, units, perturbed(_PERTURBATION * diagonal, False)[1])

    shift = _PIVOT_SHIFT * units
    small = np.abs(diagonal) < shift
    # where columns have very different sizes, small entries cannot be recognised
    if (analysis.signs is None and not small.any()) or units.min() < _PIVOT_SHIFT * units.max():
        return exchanged()
    near, by_near = perturbed(np.where(small, np.copysign(shift, diagonal), _PERTURBATION * diagonal), True)
    refined = _with_refinement(M, units, by_near)

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        x = refined(f, tolerance, transposed)
        if x is None and (y := by_near(f, tolerance, transposed)) is not None:
            matrix = near.T if transposed else near
            if norm(f - matrix @ y) <= ROUGH_SOLVE * norm(y):  # good factors: it is M that is nearly singular
                return None
        return exchanged()(f, tolerance, transposed) if x is None else x

    return solve


def _with_refinement(M: sp.csr_array, units: Vector, by_factors: Solver) -> Solver:
    """The solver by the factors of a matrix near M, and refinement.

    Refinement removes the effect of what is added to M and of small pivots. The solver returns None
    where the first step is not small. `units`, shape (n,), are the sizes of the columns.
    """

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        matrix, unit = (M.T, 1.0) if transposed else (M, units)
        x = by_factors(f, tolerance, transposed)
        if x is None:
            return None
        refined = None
        before = norm(unit * x)
        while True:
            count(product_cost(f.size, M.nnz))
            step = by_factors(f - matrix @ x, tolerance, transposed)
            if step is None or not (size := norm(unit * step)) <= _MAX_CORRECTION * before:
                return refined  # the best x that rounding allows, if any
            refined = x = x + step
            limit = MAX_BACKWARD_ERROR * norm(unit * x)
            if before == 0.0 or size / before * size <= limit:  # what the next step would be
                return x
            before = size

    return solve
