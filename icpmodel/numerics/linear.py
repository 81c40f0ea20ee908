"""The linear systems of Newton's method: the solver that fits the matrix, or None where it has no solution."""

from __future__ import annotations

from collections.abc import Callable
from functools import cache
from typing import Any, Protocol

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from .arrays import Vector, bandwidths, is_symmetric, norm, row_of
from .equilibration import Exponents, in_units, row_exponents
from .factorisation import factorise, largest_of_columns, of_array, of_dense
from .fill import SymbolicAnalysis
from .krylov import INEXACT, conjugate_residuals, gcr_step_cost
from .multigrid import KrylovMultigrid, krylov_cost
from .work import check_budget, count, factor_cost, product


class Solver(Protocol):
    """(f, relative tolerance) ↦ x with Mx = f, or with Mᵀx = f where `transposed`; None where none was found."""

    def __call__(self, f: Vector, tolerance: float, transposed: bool = False) -> Vector | None: ...


#: more diagonals than this are no band
_WIDEST_BAND = 16
#: the relative error up to which systems count as solved
_BACKWARD = 1e-12
#: the share of the diagonal that is added so that a singular matrix is seen in time, the least that did it in every
#: case; and the share of the solution, or of the step before, up to which a step of refinement takes it back
_NUDGE = 2.0**-36
_SMALL = 0.5
#: what is added to smaller entries of the diagonal, in units of the largest one of the column: enough for a pivot
_SHIFT = 2.0**-25
#: so many Krylov steps multigrid needs as a rule
STEPS = 10
#: and so many GCR without a preconditioner
MANY_STEPS = 100


def solver_of(M: sp.csr_array, by_multigrid: bool | None = None, analysis: SymbolicAnalysis | None = None) -> Solver:
    """A solver of Mx = f and Mᵀx = f for many f.

    Parameters
    ----------
    M : CSR array of shape (n, n)
        The matrix.
    by_multigrid : bool, optional
        Whether multigrid is taken; by default where a factorisation is predicted to cost more.
    analysis : SymbolicAnalysis, optional
        Symbolic analysis of M, where one was begun.

    Returns
    -------
    callable
        The solver; it returns None where M is singular.

    Raises
    ------
    OutOfTime, OutOfMemory
        Where a factorisation takes more than is left.

    Notes
    -----
    Multigrid is for matrices with a positive diagonal and nothing positive off it. Krylov's method
    is for others with a positive diagonal that fill up. Where these do not converge M is factorised
    as well: as a band, as a dense or as a sparse matrix. Rows are brought to one size first.
    """
    if M.shape[0] == 0:
        return lambda f, tolerance, transposed=False: f
    if not np.isfinite(M.data).all():
        return lambda f, tolerance, transposed=False: None
    analysis = analysis or SymbolicAnalysis(M)
    exponents = cache(lambda: row_exponents(M))
    scaled = cache(lambda: in_units(M, exponents()))
    if by_multigrid is None:
        by_multigrid = multigrid_pays(M, analysis, krylov_cost(M.nnz, STEPS))
    else:
        by_multigrid = by_multigrid and is_for_multigrid(M)
    iterative = _multigrid(M, scaled(), exponents()) if by_multigrid else _by_steps(M, analysis)

    @cache
    def direct() -> tuple[Solver, Exponents | int, Exponents | int]:
        """By factors, and in which units of the rows and columns."""
        if analysis.is_dense or analysis.is_band:
            # Cholesky's factor is as good in all units, and others would take the symmetry
            if analysis.is_symmetric and (factors := factorise(M, definite=True, analysis=analysis)):
                return _by(factors), 0, 0
            # what fills up in one unit does in the other
            return _by(of_dense(scaled()) if analysis.is_dense else factorise(scaled())), exponents(), 0
        if analysis.signs is None:
            return _nudged(scaled(), analysis), exponents(), 0
        both = exponents() // 2  # as large as before at the most, and as symmetric as it was
        return _nudged(in_units(M, both, both), analysis), both, both

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        check_budget()
        x = None if iterative is None else iterative(f, tolerance, transposed)
        if x is None:
            by_factors, rows, columns = direct()
            if transposed:
                rows, columns = columns, rows
            x = by_factors(np.ldexp(f, rows), tolerance, transposed)
            x = x if x is None else np.ldexp(x, columns)
        return x if x is not None and np.isfinite(x).all() else None

    return solve


def multigrid_pays(M: sp.csr_array, analysis: SymbolicAnalysis, cost: float) -> bool:
    """Whether multigrid is for M, CSR, n × n, and its `cost`, in nanoseconds, less than that of a factorisation."""
    return analysis.band_costs_more(cost) and is_for_multigrid(M) and analysis.costs_more(cost)


def _multigrid(M: sp.csr_array, scaled: sp.csr_array, exponents: Exponents) -> Solver:
    if is_symmetric(M):
        either = KrylovMultigrid(M)
        return lambda f, tolerance, transposed=False: either.solve(f, tolerance)
    forward = KrylovMultigrid(scaled)

    @cache
    def backward() -> tuple[KrylovMultigrid, Exponents]:
        turned = sp.csr_array(scaled.T)
        units = row_exponents(turned)
        return KrylovMultigrid(in_units(turned, units)), units

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        if not transposed:
            return forward.solve(np.ldexp(f, exponents), tolerance)
        multigrid, units = backward()
        x = multigrid.solve(np.ldexp(f, units), tolerance)
        return None if x is None else np.ldexp(x, exponents)

    return solve


def _by_steps(M: sp.csr_array, analysis: SymbolicAnalysis) -> Solver | None:
    """The solver by GCR, with as many steps as cost no more than a factorisation.

    None where a factorisation is predicted to cost less than `MANY_STEPS`, or where the diagonal is
    not positive.
    """
    a_step = gcr_step_cost(M.shape[0], M.nnz)
    cost = MANY_STEPS * a_step
    if not (analysis.band_costs_more(cost) and (M.diagonal() > 0.0).all() and analysis.costs_more(cost)):
        return None
    turned = cache(lambda: sp.csr_array(M.T))
    failed = False

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        nonlocal failed
        most = min(int(factor_cost(analysis.fill) / a_step), M.shape[0])
        x = None if failed else conjugate_residuals(turned() if transposed else M, f, most, tolerance)
        failed = x is None
        return x

    return solve


def dense_solver(M: NDArray[np.float64]) -> Solver:
    """The same of a dense matrix."""
    if not np.isfinite(M).all():
        return lambda f, tolerance, transposed=False: None
    exponents = row_exponents(M)
    scaled = _by(of_array(np.array(in_units(M, exponents), order="F")))

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        before, after = (0, exponents) if transposed else (exponents, 0)
        x = scaled(np.ldexp(f, before), tolerance, transposed)
        return np.ldexp(x, after) if x is not None and np.isfinite(x).all() else None

    return solve


def _by(factors: Any) -> Solver:
    """The solver that has the `factors`, None where M is singular."""

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        return None if factors is None else factors.solve(f, "T" if transposed else "N")

    return solve


def _nudged(M: sp.csr_array, analysis: SymbolicAnalysis) -> Solver:
    """The solver by the factors of M + εD, with few or no exchanges of rows.

    Entries of the diagonal that are nearly 0 are first raised to √ε of the column, and no rows are
    exchanged: exchanges can fill up many times as much as predicted. Where these factors are bad,
    they are made again with exchanges.

    SuperLU goes on behind a pivot that is exactly 0, with its rows in another order, and says only
    at the end that M is singular. On traffic equilibria that took 80 times as long as predicted. M
    counts as singular where refinement fails.
    """
    diagonal = M.diagonal()
    units = largest_of_columns(M)

    def by(more: Vector, definite: bool) -> tuple[sp.csr_array, Solver]:
        near = sp.csr_array(M + sp.diags_array(more))
        return near, _by(factorise(near, definite=definite, analysis=analysis))

    @cache
    def exchanged() -> Solver:
        return _refined(M, units, by(_NUDGE * diagonal, False)[1])

    shift = _SHIFT * units
    small = np.abs(diagonal) < shift
    # columns of different sizes hide the small entries
    if (analysis.signs is None and not small.any()) or units.min() < _SHIFT * units.max():
        return exchanged()
    near, by_near = by(np.where(small, np.copysign(shift, diagonal), _NUDGE * diagonal), True)
    refined = _refined(M, units, by_near)

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        x = refined(f, tolerance, transposed)
        if x is None and (y := by_near(f, tolerance, transposed)) is not None:
            whole = near.T if transposed else near
            if norm(f - whole @ y) <= INEXACT * norm(y):  # good factors: it is M that is nearly singular
                return None
        return exchanged()(f, tolerance, transposed) if x is None else x

    return solve


def _refined(M: sp.csr_array, units: Vector, by_factors: Solver) -> Solver:
    """The solver by the factors of a matrix near M, and refinement.

    Refinement removes the effect of what is added to M and of small pivots. Returns None where its
    first step is not small. Columns have these `units`, shape (n,).
    """

    def solve(f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        whole, unit = (M.T, 1.0) if transposed else (M, units)
        x = by_factors(f, tolerance, transposed)
        if x is None:
            return None
        refined = None
        before = norm(unit * x)
        while True:
            count(product(f.size, M.nnz))
            step = by_factors(f - whole @ x, tolerance, transposed)
            if step is None or not (size := norm(unit * step)) <= _SMALL * before:
                return refined  # the best that rounding leaves, if any
            refined = x = x + step
            if before == 0.0 or size / before * size <= _BACKWARD * norm(unit * x):  # what the next step would be
                return x
            before = size

    return solve


def by_refinement(
    solve: Callable[[Vector], Vector], f: Vector, rest_of: Callable[[Vector], Vector], enough: float, solves: int
) -> tuple[Vector, float]:
    """x, near where the rest f − Mx, `rest_of`(x), is 0, and the norm of that, by what solves nearly: so many times at
    the most, as long as that helps and more than `enough` is left."""
    best = np.zeros(f.size)
    least = np.inf
    x = np.zeros(f.size)
    rest = f
    for _ in range(solves):
        x = x + solve(rest)
        rest = rest_of(x)
        left = norm(rest)
        if not left < least:
            break
        best = x
        least = left
        if left <= enough:
            break
    return best, least


def is_for_multigrid(M: sp.csr_array) -> bool:
    """Whether M has the signs of an M-matrix and is no band."""
    return bool(
        sum(bandwidths(M)) >= _WIDEST_BAND
        and (M.diagonal() > 0).all()
        and not (M.data[row_of(M) != M.indices] > 0).any()
    )
