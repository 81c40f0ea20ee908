"""Algebraic multigrid: PyAMG, and Krylov steps with it as preconditioner."""

from __future__ import annotations

import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from importlib.machinery import SourceFileLoader
from typing import Any

import numpy as np
import scipy.sparse as sp

from . import work
from .arrays import Vector
from .sparse_structure import is_symmetric

#: coarsening has stalled if the coarsest level has more rows than this
MAX_COARSEST_IF_STALLED = 512
#: a Krylov method with multigrid as preconditioner that needs more steps than this will not converge
KRYLOV_STEPS = 30
#: the errors of SciPy's direct solvers, on the coarsest level, for a matrix that is singular or not finite
_FAILURES = (RuntimeError, ValueError, ArithmeticError)
#: bytes of a hierarchy per entry of A: its levels and interpolations have about three times as many entries
HIERARCHY_BYTES = 3 * work.ENTRY_BYTES


def hierarchy_cost(n: int, nnz: int) -> float:
    """The cost of the hierarchy of an n × n matrix, in nanoseconds."""
    return work.COSTS.hierarchy + work.COSTS.hierarchy_entry * work.entries(n, nnz)


def cycle_cost(n: int, nnz: int) -> float:
    """The cost of a V-cycle with compiled loops, in nanoseconds."""
    return work.COSTS.cycle + work.COSTS.cycle_entry * work.entries(n, nnz)


def ruge_stuben(A: sp.csr_array, **options: Any) -> Any:
    """PyAMG's algebraic multigrid hierarchy of `A` by Ruge and Stüben (1987), with the `options` of its solver.

    Direct interpolation costs least, is made for M-matrices and prints nothing, unlike the classical one. A coarsest
    level that is still large is left to SuperLU, which raises RuntimeError in the first cycle where it is singular: a
    dense pseudoinverse would take all memory.
    """
    with _docstrings(), work.COMPILER.busy():
        import pyamg

    with _quiet():
        A = sp.csr_matrix(A)  # PyAMG takes the older class only
        solver = pyamg.ruge_stuben_solver(A, interpolation="direct", **options)
        if solver.levels[-1].A.shape[0] > MAX_COARSEST_IF_STALLED:
            solver.coarse_solver = pyamg.coarse_grid_solver("splu")
        return solver


def linear_solve(A: sp.csr_array, b: Vector, tolerance: float = 1e-8) -> Vector:
    """Solve Ax = b by PyAMG's multigrid with CG or, for nonsymmetric A, BiCGSTAB.

    Parameters
    ----------
    A : CSR array of shape (n, n)
        The matrix.
    b : array of shape (n,)
        Right-hand side.
    tolerance : float, default 1e-8
        Stop at ‖Ax − b‖ ≤ `tolerance`‖b‖, or after 100 steps.

    Returns
    -------
    array of shape (n,)
        x, which may miss the tolerance.

    Raises
    ------
    LinAlgError
        Where the coarsest level of the hierarchy is singular.

    Examples
    --------
    >>> linear_solve(sp.csr_array([[2.0, 0.0], [0.0, 4.0]]), np.array([2.0, 4.0])).round(6)
    array([1., 1.])
    """
    work.charge(hierarchy_cost(len(b), A.nnz), HIERARCHY_BYTES * A.nnz)
    hierarchy = ruge_stuben(A)
    step = work.COSTS.krylov + work.COSTS.krylov_entry * A.nnz
    accel = "cg" if is_symmetric(A) else "bicgstab"
    with _quiet():
        try:
            return np.asarray(hierarchy.solve(b, tol=tolerance, callback=lambda _: work.charge(step), accel=accel))
        except _FAILURES as error:
            raise np.linalg.LinAlgError("A is singular on the coarsest level of its hierarchy") from error


@contextmanager
def _docstrings() -> Iterator[None]:
    """Give PyAMG docstrings under `python -OO`: it edits them while it is imported."""
    plain = SourceFileLoader.get_code
    if sys.flags.optimize > 1:

        def with_docstrings(loader: SourceFileLoader, name: str) -> Any:
            path = loader.get_filename(name)
            return compile(loader.get_data(path), path, "exec", dont_inherit=True, optimize=0)

        SourceFileLoader.get_code = with_docstrings  # type: ignore[assignment, method-assign]
    try:
        yield
    finally:
        SourceFileLoader.get_code = plain  # type: ignore[method-assign]


@contextmanager
def _quiet() -> Iterator[None]:
    """Silence the warnings of PyAMG, mostly of unsuitable matrices: its callers check the result."""
    # recorded, and dropped: PyAMG switches some of its warnings on again while it runs
    with np.errstate(all="ignore"), warnings.catch_warnings(record=True):
        warnings.simplefilter("ignore")
        yield
