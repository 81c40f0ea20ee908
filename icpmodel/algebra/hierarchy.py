"""Algebraic multigrid for a principal submatrix of A: PyAMG's levels of A, truncated by masks."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property
from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..numerics import work
from ..numerics.arrays import Mask, Vector, with_entries
from ..numerics.multigrid import HIERARCHY_BYTES, MAX_COARSEST_IF_STALLED, cycle_cost, hierarchy_cost, ruge_stuben
from ..numerics.rounding import UNIT_ROUNDOFF
from ..numerics.threads import one_blas_thread
from ..problem.data import ProblemData
from ..problem.matrix import MAX_DENSE_ROWS, Matrix

#: matrices with a larger condition number get the pseudoinverse, as their inverse has no correct digits
_MAX_CONDITION = 1e-2 / UNIT_ROUNDOFF
#: a level with more than this multiple of the entries of A costs more than it helps
_MAX_FILL = 4


class NoHierarchy(Exception):
    """Multigrid does not apply: see `Hierarchy`, which raises this."""


class Level:
    """One level: the matrix A of `problem`, CSR, shape (m, m), and its diagonal. Hierarchies share coarser levels.

    Where there is a coarser level, `P`, CSR, shape (m, m_coarse), interpolates from it. Its unknowns
    are the `coarse_points`, shape (m_coarse,), of this level, where P is the identity. Raises
    NoHierarchy unless the diagonal is positive.
    """

    def __init__(self, problem: ProblemData) -> None:
        rows = problem.matrix.rows
        self.problem = problem
        self.A = problem.A
        self.diag = rows.diag
        self.diagonal = rows.diagonal
        if not (self.diagonal > 0).all():
            raise NoHierarchy
        self.inverse = 1.0 / self.diagonal
        self.P: Any = None
        self.coarse_points: Any = None
        #: coarsest level only: the free rows of the last inverse, and that inverse
        self.last_inverse: tuple[Any, Any] = (None, None)

    @cached_property
    def R(self) -> Any:
        """Pᵀ."""
        return self.P.T

    def transposed(self) -> Level:
        """The level of Aᵀ, with the same interpolation."""
        A = self.A.T.tocsr()
        level = Level(ProblemData.of_checked(A, np.zeros(A.shape[0]), 0.0))
        level.P = self.P
        level.coarse_points = self.coarse_points
        return level


class Hierarchy:
    """The levels of A, and V-cycles for A_FF x = f_F where the free rows F change often and A does not.

    Parameters
    ----------
    problem : ProblemData
        The problem with the matrix A.

    Raises
    ------
    NoHierarchy
        Where the diagonal of A or of a coarser level is not positive, or coarsening stalls at
        more than 512 rows. Also where a coarser level overflows or has more than four times the
        entries of A, so that it would cost more than it helps.
    OutOfTime, OutOfMemory
        Where the setup needs more than is left.

    Notes
    -----
    The levels of A = `origin` + D, with a diagonal D, are made from those of `origin`. The rows of P
    are scaled so that each solves its own equation. PᵀDP is lumped: the diagonal matrix of Pᵀd, d
    the diagonal of D, replaces it. Both have the same product with a constant vector where the rows
    of P have the sum 1.

    On every level the points that are not free keep the value 0. This truncates the interpolation
    without another Galerkin product. The neglected terms are next to the border of F.

    References
    ----------
    Ruge and Stüben, Algebraic multigrid (1987). Kornhuber, Numer. Math. 69 (1994), for the
    truncation.
    """

    def __init__(self, problem: ProblemData) -> None:
        self.levels = _levels_by_origin(problem) or _levels(problem)
        self._dense = self.levels[-1].A.toarray()
        self.restrict(np.ones(problem.n, dtype=np.bool_))

    def restrict(self, free: Mask, top: int = 0) -> None:
        """Restrict all later cycles to the `free` rows, a mask of shape (m,), of level `top`."""
        vars(self).pop("transposed", None)
        self._free = [free] * (top + 1)
        for level in self.levels[top:-1]:
            free = free[level.coarse_points]
            self._free.append(free)
        self._coarsest_rows = np.flatnonzero(free)
        vars(self).pop("_inverse", None)

    @cached_property
    def _inverse(self) -> NDArray[np.float64]:
        """The inverse of the free rows of the coarsest level, cached in that level as these rows seldom change."""
        level = self.levels[-1]
        rows, inverse = level.last_inverse
        if not np.array_equal(rows, self._coarsest_rows):
            inverse = _inverse_of(self._dense[np.ix_(self._coarsest_rows, self._coarsest_rows)])
            level.last_inverse = self._coarsest_rows, inverse
        return inverse

    def cycle(self, f: Vector, top: int = 0) -> Vector:
        """Approximate, by one V(1, 1)-cycle, the x with (Ax)_i = f_i in the free rows and x_i = 0 in the others.

        Parameters
        ----------
        f : array of shape (m,)
            The right-hand side, m the rows of level `top`.
        top : int, default 0
            The level.

        Returns
        -------
        array of shape (m,)
            The approximation.
        """
        A = self.levels[top].A
        work.charge(cycle_cost(A.shape[0], A.nnz))
        return self._cycle(f, top)

    @cached_property
    def transposed(self) -> Hierarchy:
        """The levels of Aᵀ with the same interpolation and the same free rows: its cycle is the adjoint of this one.

        Where A is symmetric, and so every level, it is this hierarchy itself.
        """
        if self.levels[0].problem.matrix.is_symmetric:
            return self
        new = object.__new__(Hierarchy)
        new.levels = [level.transposed() for level in self.levels]
        new._dense = self._dense.T
        new._free = self._free
        new._coarsest_rows = self._coarsest_rows
        new._inverse = self._inverse.T
        return new

    def _cycle(self, f: Vector, top: int) -> Vector:
        """`cycle`, without a check of the budget."""
        from ..numerics.kernels.vcycle import ascend, descend

        level = self.levels[top]
        if level.P is None:
            x = np.zeros(f.size)
            x[self._coarsest_rows] = self._inverse @ f[self._coarsest_rows]
            return x
        x = np.empty(f.size)  # the first sweep writes all of it
        A = level.A
        P = level.P
        matrix = (A.indptr, A.indices, A.data)
        transfer = (P.indptr, P.indices, P.data)
        free = self._free[top]
        coarse = np.zeros(P.shape[1])
        descend(*matrix, level.diag, level.inverse, free, f, *transfer, x, coarse)
        ascend(*matrix, level.inverse, free, f, *transfer, x, self._cycle(coarse, top + 1))
        return x


def _inverse_of(A: NDArray[np.float64]) -> NDArray[np.float64]:
    """A⁻¹, or the pseudoinverse where A⁻¹ has no correct digits."""
    with one_blas_thread():
        with suppress(np.linalg.LinAlgError):
            inverse = np.asarray(np.linalg.inv(A), np.float64)  # a tenth of the cost of pinv
            size, inverse_size = (np.abs(B).sum(axis=0).max(initial=0.0) for B in (A, inverse))
            if size * inverse_size < _MAX_CONDITION:
                return inverse
        return np.asarray(np.linalg.pinv(A), np.float64)


#: of the last matrix only: P and `coarse_points` of the finest level and the coarser levels, or NoHierarchy. Those of
#: all matrices would need three times as much memory as the matrices themselves
_CACHE: WeakKeyDictionary[Matrix, tuple[Any, Any, list[Level]] | NoHierarchy] = WeakKeyDictionary()


def _levels(problem: ProblemData) -> list[Level]:
    """The levels of A, from the cache if A was the last matrix. Raises NoHierarchy."""
    # the work that is counted does not depend on the cache
    setup_cost = hierarchy_cost(problem.n, problem.nnz)
    finest = Level(problem)
    cached = _CACHE.get(problem.matrix)
    if cached is None:
        work.check_budget(setup_cost, HIERARCHY_BYTES * problem.nnz)
        _CACHE.clear()
        counted = work.counter()
        cached = _CACHE[problem.matrix] = _coarser(finest)
        work.count(counted - work.counter())
    if isinstance(cached, NoHierarchy):
        raise NoHierarchy
    finest.P, finest.coarse_points, coarser = cached
    work.count(setup_cost)
    return [finest, *coarser]


def _levels_by_origin(problem: ProblemData) -> list[Level] | None:
    """The levels of A made from those of its `origin`; None without an `origin`, or where either has no levels."""
    origin = problem.matrix.origin
    if origin is None:
        return None
    d = problem.matrix.rows.diagonal - origin.rows.diagonal
    with suppress(NoHierarchy):
        finer, *coarser = _levels(problem.with_matrix(origin, problem.q))
        levels = [_with_interpolation(finer, problem)]
        for level in coarser:
            d = levels[-1].R @ d
            matrix = level.problem.matrix.plus_diagonal(d)
            levels.append(_with_interpolation(level, level.problem.with_matrix(matrix, level.problem.q)))
        return levels if np.isfinite(d).all() else None
    return None


def _with_interpolation(level: Level, problem: ProblemData) -> Level:
    """The level of `problem` with the interpolation of `level`, scaled so that each row solves its own equation."""
    new = Level(problem)
    if level.P is not None:
        share = level.diagonal * new.inverse
        share[level.coarse_points] = 1.0
        P = level.P
        data = P.data * np.repeat(share, np.diff(P.indptr))
        new.P = with_entries(P, data)
        new.coarse_points = level.coarse_points
    return new


def _coarser(finest: Level) -> tuple[Any, Any, list[Level]] | NoHierarchy:
    """Set P and `coarse_points` of `finest`; return both and the coarser levels, without `finest`, or a NoHierarchy."""
    levels = [finest]  # the coarsest one has a dense inverse
    try:
        while levels[-1].A.shape[0] > MAX_DENSE_ROWS and (level := _coarsen(levels[-1])) is not None:
            levels.append(level)
            if level.A.nnz > _MAX_FILL * finest.A.nnz:
                raise NoHierarchy
        if levels[-1].A.shape[0] > MAX_COARSEST_IF_STALLED:
            raise NoHierarchy
    except NoHierarchy as error:
        return error.with_traceback(None)  # the frames of its traceback hold the levels
    return finest.P, finest.coarse_points, levels[1:]


def _coarsen(last: Level) -> Level | None:
    """Set P and `coarse_points` of `last`; return the next coarser level, or None if coarsening stalls."""
    work.check_budget(hierarchy_cost(last.A.shape[0], last.A.nnz))
    levels = ruge_stuben(last.A, max_coarse=MAX_DENSE_ROWS, max_levels=2, keep=True).levels
    if len(levels) == 1:
        return None
    if not np.isfinite(levels[1].A.data).all():
        raise NoHierarchy
    last.P = sp.csr_array(levels[0].P)
    last.coarse_points = np.flatnonzero(levels[0].splitting)
    last.P.sort_indices()  # `row_sum` needs this; PyAMG sorts them, but does not document it
    return Level(ProblemData(sp.csr_array(levels[1].A), np.zeros(levels[1].A.shape[0])))
