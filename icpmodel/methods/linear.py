"""The linear systems of Newton's method: the solver that fits the matrix, or None where it has no solution."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from functools import cache

import numpy as np
import scipy.sparse as sp

from ..arrays import Vector, row_of
from ..operators import factorise, quiet, ruge_stuben

#: (right-hand side, relative tolerance) ↦ solution, or None where none was found
Solver = Callable[[Vector, float], Vector | None]

#: beyond this size a sparse matrix that is no band is not factorised unless the user asks for it
FACTORISE_UP_TO = 200_000
#: more diagonals than this are no band
_WIDEST_BAND = 16
#: a matrix that is fuller than this is treated as dense
_DENSE = 0.1
#: from this size on multigrid costs less than a factorisation
_MULTIGRID_FROM = 50_000
#: with multigrid as preconditioner a Krylov method that needs more steps will not get there
_KRYLOV_STEPS = 30


def solver_of(M: sp.csr_array) -> Solver:
    """A solver of Mx = f for many f: a band, dense or sparse factorisation, or multigrid.

    Large matrices with a positive diagonal and nothing positive off it get CG (where symmetric) or BiCGSTAB with
    algebraic multigrid, to the tolerance that is asked for, and SuperLU where those do not converge; the others are
    factorised. Rows are brought to one size first. The solver returns None where M is singular.

    Parameters: `M` CSR, shape (n, n), n ≥ 0. Returns the solver.
    Reference: Ruge and Stüben, Algebraic multigrid (1987), for the preconditioner.

    >>> solver_of(sp.csr_array([[2.0, -1.0], [-1.0, 2.0]]))(np.array([1.0, 1.0]), 1e-6)
    array([1., 1.])
    >>> solver_of(sp.csr_array([[1.0, 1.0], [1.0, 1.0]]))(np.array([1.0, 0.0]), 1e-6) is None
    True
    """
    n = M.shape[0]
    if n == 0:
        return lambda f, tolerance: f
    size = np.asarray(abs(M).max(axis=1).toarray(), dtype=np.float64).reshape(-1)
    if not (size.all() and np.isfinite(size).all()):
        return lambda f, tolerance: None
    # a power of two costs no digit
    scale = np.exp2(-np.floor(np.log2(np.maximum(size, np.finfo(np.float64).tiny))))
    scaled = sp.csr_array((M.data * scale[row_of(M)], M.indices, M.indptr), shape=M.shape)
    symmetric = n >= _MULTIGRID_FROM and (M != M.T).nnz == 0
    multigrid = _multigrid(M if symmetric else scaled, "cg" if symmetric else "bicgstab")

    @cache
    def direct() -> Solver:
        return _banded(scaled) if is_band(M) else _dense(scaled) if M.nnz > _DENSE * n**2 else _sparse(scaled)

    def solve(f: Vector, tolerance: float) -> Vector | None:
        x = None if multigrid is None else multigrid(f if symmetric else scale * f, tolerance)
        if x is None:
            x = direct()(scale * f, tolerance)
        return x if x is not None and np.isfinite(x).all() else None

    return solve


def is_band(M: sp.csr_array) -> bool:
    """Whether few diagonals next to the main one hold all entries of `M` (CSR, square).

    >>> is_band(sp.csr_array([[2.0, -1.0], [-1.0, 2.0]]))
    True
    """
    return sum(_widths(M)) < _WIDEST_BAND


def _widths(M: sp.csr_array) -> tuple[int, int]:
    """How far the entries reach below and above the diagonal."""
    reach = row_of(M) - M.indices
    return int(reach.max(initial=0)), int(-reach.min(initial=0))


def _banded(M: sp.csr_array) -> Solver:
    from scipy.linalg import LinAlgError, solve_banded

    rows, (lower, upper) = row_of(M), _widths(M)
    band = np.zeros((lower + upper + 1, M.shape[0]))
    np.add.at(band, (upper + rows - M.indices, M.indices), M.data)

    def solve(f: Vector, tolerance: float) -> Vector | None:
        try:
            return np.asarray(solve_banded((lower, upper), band, f, check_finite=False))
        except LinAlgError:
            return None

    return solve


def _dense(M: sp.csr_array) -> Solver:
    from scipy.linalg import lu_factor, lu_solve

    with warnings.catch_warnings():  # of a pivot that is zero
        warnings.simplefilter("ignore")
        lu = lu_factor(M.toarray(), check_finite=False)
    return lambda f, tolerance: np.asarray(lu_solve(lu, f, check_finite=False))


def _sparse(M: sp.csr_array) -> Solver:
    lu = factorise(M)
    return lambda f, tolerance: None if lu is None else np.asarray(lu.solve(f))


def _multigrid(M: sp.csr_array, accelerate: str) -> Solver | None:
    """Krylov steps with algebraic multigrid, None where M is too small, or nothing for it."""
    if M.shape[0] < _MULTIGRID_FROM or is_band(M):
        return None
    if not (M.diagonal() > 0).all() or (M.data[row_of(M) != M.indices] > 0).any():
        return None
    hierarchy = ruge_stuben(M)

    def solve(f: Vector, tolerance: float) -> Vector | None:
        with quiet():
            x = hierarchy.solve(f, tol=tolerance, maxiter=_KRYLOV_STEPS, accel=accelerate)
        return np.asarray(x) if np.linalg.norm(M @ x - f) <= 2 * tolerance * np.linalg.norm(f) else None

    return solve
