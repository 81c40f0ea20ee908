"""The linear systems of Newton's method on the modulus equation, and of the derivative of a solution.

Active rows of J are rows of I − ψ′. All others are free, and are rows of A.
"""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..numerics import work
from ..numerics.arrays import Mask, Vector, row_of
from ..numerics.fill import SymbolicAnalysis, band_fill, factor_cost, least_factor_cost
from ..numerics.krylov import NotConverged
from ..numerics.linear import Solver, solver_of
from ..problem.data import ProblemData
from .equations import newton_matrix, submatrix
from .hierarchy import Hierarchy, NoHierarchy
from .multigrid_equations import MultigridEquations, cycles_cost


class ActiveEquations:
    """Solver of Jx = f and Jᵀx = f for many f, by V-cycles of A's hierarchy where these cost less, else by elimination.

    Parameters
    ----------
    problem : ProblemData
        The problem.
    active : mask of shape (n,)
        The active rows.
    jacobian : CSR array of shape (n, n)
        ψ′(z).
    by_cycles : bool, optional
        Whether V-cycles are used. By default they are where A has the signs of an M-matrix, and ten
        Krylov steps cost less than a band factorisation and than two sparse ones without fill.

    Raises
    ------
    OutOfTime, OutOfMemory
        Where the hierarchy, a cycle or a factorisation needs more than is left.

    Notes
    -----
    The hierarchy of A serves every active set, a factorisation only one. So the cost of the
    hierarchy is not counted for the cycles. Cycles cost the same again for every f. So by default
    elimination replaces them once they have cost as much as it would. It also does where A has no
    hierarchy, or where the cycles do not converge.
    """

    def __init__(
        self, problem: ProblemData, active: Mask, jacobian: sp.csr_array, by_cycles: bool | None = None
    ) -> None:
        self._arguments = (problem, active, jacobian)
        self._multigrid: MultigridEquations | None = None
        # whether elimination may replace the cycles once these have cost as much; their cost so far, in nanoseconds
        self._may_end = by_cycles is None
        self._spent = 0.0
        if by_cycles or (self._may_end and cycles_pay(problem, ~active)):
            with suppress(NoHierarchy):
                self._multigrid = MultigridEquations(Hierarchy(problem), 0, active, jacobian if jacobian.nnz else None)

    @cached_property
    def _elimination(self) -> Elimination:
        return Elimination(*self._arguments)

    def solve(self, f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        """x with Jx = f, or Jᵀx = f, shape (n,); None where J is singular.

        Iterative solvers stop at the relative residual `tolerance`. Cycles may be replaced for good, see the class.
        """
        with np.errstate(all="ignore"):
            # before the first system there is no cost to compare, so no symbolic analysis is made
            if self._multigrid is not None and self._may_end and self._spent and self._spent >= self._elimination.cost:
                self._multigrid = None
            if self._multigrid is not None:
                before = work.counter()
                try:
                    return self._multigrid.solve(f, tolerance, transposed)
                except NotConverged:
                    self._multigrid = None
                finally:
                    self._spent += work.counter() - before
            return self._elimination.solve(f, tolerance, transposed)


def cycles_pay(problem: ProblemData, free: Mask) -> bool:
    """Whether V-cycles suit A, and are predicted to cost less than factorising its `free` rows and columns."""
    matrix = problem.matrix
    rows = matrix.rows
    cost = cycles_cost(problem)
    count = int(np.count_nonzero(free))
    if matrix.dense is not None:
        return False
    if factor_cost(band_fill(count, rows.below, rows.above, rows.below == rows.above)) <= cost:
        return False
    entries = int(np.count_nonzero(free[row_of(problem.A)] & free[problem.A.indices]))
    if 2.0 * least_factor_cost(count, entries) <= cost or not matrix.has_positive_diagonal:
        return False
    return np.count_nonzero(problem.A.data > 0) == problem.n


class Elimination:
    """Factorisation of J, or of its free rows and columns where ψ is constant: then the active unknowns are known.

    Parameters
    ----------
    problem, active, jacobian
        As for `ActiveEquations`.
    shift : array of shape (n,), optional
        Added to the diagonal of A in the free rows.
    """

    def __init__(self, problem: ProblemData, active: Mask, jacobian: sp.csr_array, shift: Vector | None = None) -> None:
        self._problem = problem
        self._active = active
        self._free = np.flatnonzero(~active)
        self._whole = jacobian.nnz > 0
        M = newton_matrix(problem, active, jacobian) if self._whole else submatrix(problem, self._free)
        if shift is not None:
            shift = np.where(active, 0.0, shift)
            M = sp.csr_array(M + sp.diags_array(shift if self._whole else shift[self._free]))
        self._M = M

    @cached_property
    def _analysis(self) -> SymbolicAnalysis:
        matrix = self._problem.matrix
        return SymbolicAnalysis(self._M, None if self._whole else lambda: matrix.is_symmetric)

    @property
    def cost(self) -> float:
        """The predicted cost of a factorisation, in nanoseconds."""
        return factor_cost(self._analysis.fill)

    @cached_property
    def _solver(self) -> Solver:
        if self._problem.matrix.dense is not None:
            return solver_of(self._M.toarray())
        return solver_of(self._M, self._analysis)

    def solve(self, f: Vector, tolerance: float, transposed: bool = False) -> Vector | None:
        """x with Jx = f, or Jᵀx = f, shape (n,); None where J is singular or x overflows."""
        if self._whole:
            return self._solver(f, tolerance, transposed)
        matrix = self._problem.matrix
        free = self._free
        x_active = np.where(self._active, f, 0.0)
        x_free = self._solver(f[free] if transposed else (f - matrix.product(x_active))[free], tolerance, transposed)
        if x_free is None:
            return None
        x = x_active
        x[free] = x_free
        if transposed:
            y = np.where(self._active, 0.0, x)
            x -= np.where(self._active, matrix.product(y) if matrix.is_symmetric else matrix.sparse.T @ y, 0.0)
        return x if np.isfinite(x).all() else None
