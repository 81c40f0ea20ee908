"""Algebraic multigrid: PyAMG, and Krylov steps with it as preconditioner."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
import scipy.sparse as sp

from .arrays import Vector

#: coarsening has stalled where so many rows are left
_STALLED = 500


def ruge_stuben(A: sp.csr_array, **options: Any) -> Any:
    """PyAMG's algebraic multigrid hierarchy of `A` (CSR, shape (n, n)), with the `options` of its Ruge–Stüben solver.

    A coarsest level that is still large, as coarsening stalled, is left to SuperLU, which raises RuntimeError in the
    first cycle where it is singular: PyAMG's default, a dense pseudoinverse, would take all memory.
    Reference: Ruge and Stüben, Algebraic multigrid (1987).
    """
    import pyamg

    with quiet():
        made = pyamg.ruge_stuben_solver(sp.csr_matrix(A), **options)  # PyAMG takes the older class only
        if made.levels[-1].A.shape[0] > _STALLED:
            made.coarse_solver = pyamg.coarse_grid_solver("splu")
        return made


@contextmanager
def quiet() -> Iterator[None]:
    """What PyAMG warns of, matrices that are nothing for it above all, its callers see by the result."""
    # recorded, and dropped: PyAMG switches some of its warnings on again while it runs
    with np.errstate(all="ignore"), warnings.catch_warnings(record=True):
        warnings.simplefilter("ignore")
        yield


def linear_solve(A: sp.csr_array, b: Vector, tolerance: float = 1e-8) -> Vector:
    """x with ‖Ax − b‖ ≤ `tolerance`‖b‖ by PyAMG's Ruge–Stüben hierarchy with CG, or BiCGSTAB where A is not symmetric.

    Parameters: `A` CSR, shape (n, n); `b` shape (n,). Returns x, shape (n,).

    >>> linear_solve(sp.csr_array([[2.0, 0.0], [0.0, 4.0]]), np.array([2.0, 4.0])).round(6)
    array([1., 1.])
    """
    accelerate = "cg" if (A != A.T).nnz == 0 else "bicgstab"
    with quiet():
        return np.asarray(ruge_stuben(A).solve(b, tol=tolerance, accel=accelerate))
