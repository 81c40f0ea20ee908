"""The linear systems of Newton's method: the solver that fits the matrix, or None where it has no solution."""

from __future__ import annotations

import warnings
from collections.abc import Callable
from contextlib import suppress
from functools import cache

import numpy as np
import scipy.sparse as sp

from .arrays import Vector, bandwidths, is_symmetric, row_of
from .equilibration import in_units, row_exponents
from .factorisation import factorise
from .multigrid import KrylovMultigrid

#: (right-hand side, relative tolerance) ↦ solution, or None where none was found
Solver = Callable[[Vector, float], Vector | None]

#: beyond this size a sparse matrix that is no band is not factorised unless the user asks for it
FACTORISE_UP_TO = 200_000
#: more diagonals than this are no band, and more rows that reach beyond it no border
_WIDEST_BAND, _WIDEST_BORDER = 16, 16
#: the relative backward error up to which a bordered band counts as solved
_BACKWARD = 1e-12
#: a matrix that is fuller than this is treated as dense
_DENSE = 0.1
#: from this size on multigrid costs less than a factorisation
_MULTIGRID_FROM = 50_000


def solver_of(M: sp.csr_array, multigrid_from: int = _MULTIGRID_FROM) -> Solver:
    """A solver of Mx = f for many f: for a band, one with a few full rows, dense or sparse matrices, or multigrid.

    Multigrid is for large matrices with a positive diagonal and nothing positive off it, and where it does not converge
    they are factorised as well. Rows are brought to one size first. The solver returns None where M is singular.
    """
    n = M.shape[0]
    if n == 0:
        return lambda f, tolerance: f
    if not np.isfinite(M.data).all():
        return lambda f, tolerance: None
    exponents = row_exponents(M)
    scaled, symmetric = in_units(M, exponents), n >= multigrid_from and is_symmetric(M)
    multigrid = _multigrid(M if symmetric else scaled) if n >= multigrid_from else None

    @cache
    def direct() -> Solver:
        if sum(bandwidths(M)) < _WIDEST_BAND:
            return _banded(scaled)
        return _dense(scaled) if M.nnz > _DENSE * n**2 else _bordered(scaled) or _sparse(scaled)

    def solve(f: Vector, tolerance: float) -> Vector | None:
        right = np.ldexp(f, exponents)
        x = None if multigrid is None else multigrid.solve(f if symmetric else right, tolerance)
        if x is None:
            x = direct()(right, tolerance)
        return x if x is not None and np.isfinite(x).all() else None

    return solve


def _banded(M: sp.csr_array) -> Solver:
    from scipy.linalg import LinAlgError, solve_banded

    rows, (lower, upper) = row_of(M), bandwidths(M)
    band = np.zeros((lower + upper + 1, M.shape[0]))
    np.add.at(band, (upper + rows - M.indices, M.indices), M.data)

    def solve(f: Vector, tolerance: float) -> Vector | None:
        try:
            return np.asarray(solve_banded((lower, upper), band, f, check_finite=False))
        except LinAlgError:
            return None

    return solve


def _bordered(M: sp.csr_array) -> Solver | None:
    """The solver of a band but for a few rows that reach far beyond it, by Woodbury's formula; None for others."""
    rows = row_of(M)
    far = 2 * np.abs(rows - M.indices) >= _WIDEST_BAND
    border = np.unique(rows[far])
    if border.size > _WIDEST_BORDER:
        return None
    n, k = M.shape[0], border.size
    band = sp.csr_array(sp.coo_array((M.data[~far], (rows[~far], M.indices[~far])), shape=M.shape))
    W = sp.csr_array((M.data[far], (np.searchsorted(border, rows[far]), M.indices[far])), shape=(k, n))
    units = np.zeros((n, k))
    units[border, np.arange(k)] = 1.0
    solve_band = _banded(band)
    sparse = cache(lambda: _sparse(M))

    def solve(f: Vector, tolerance: float) -> Vector | None:
        X = solve_band(np.column_stack([f, units]), tolerance)
        if X is not None:
            x, Y = X[:, 0], X[:, 1:]
            with suppress(np.linalg.LinAlgError):
                x = x - Y @ np.linalg.solve(np.eye(k) + W @ Y, W @ x)
            if np.abs(M @ x - f).max() <= _BACKWARD * max(np.abs(x).max(), np.abs(f).max()):
                return np.asarray(x)
        return sparse()(f, tolerance)

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


def _multigrid(M: sp.csr_array) -> KrylovMultigrid | None:
    """None where M is nothing for multigrid."""
    of_m_matrix = (M.diagonal() > 0).all() and not (M.data[row_of(M) != M.indices] > 0).any()
    return KrylovMultigrid(M) if of_m_matrix and sum(bandwidths(M)) >= _WIDEST_BAND else None
