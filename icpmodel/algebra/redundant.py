"""Rows that need no iteration, made equations of their own: fixed unknowns, empty rows, and rows that repeat others."""

from __future__ import annotations

from typing import Any
from weakref import WeakKeyDictionary

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import Mask, Vector, row_of
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.affine import Constant
from ..problem.between import Between
from ..problem.data import ProblemData
from ..problem.matrix import Matrix

#: the share of their sizes by which obstacles may cross, and repeated rows differ, as data and quotients are rounded
_TOUCH = 4.0 * UNIT_ROUNDOFF
#: the rows and columns of a matrix without their factors, for problems that share it
_NORMAL: WeakKeyDictionary[Matrix, dict[bytes, Any]] = WeakKeyDictionary()


def without_redundant_rows(problem: ProblemData) -> ProblemData:
    """A problem of the same size with constant obstacles, each solution of which is one of `problem`.

    It has a solution if and only if `problem` has one.

    Notes
    -----
    It is the problem itself where nothing is redundant. Otherwise z_i = c_i stands in the redundant
    rows:

    - ψ_i = ψ̄_i, or crossed by rounding: c_i = ψ_i, whatever p_i is.
    - Row i of A is empty: c_i = ψ_i where q_i > 0, ψ̄_i where q_i < 0. Where q_i = 0 and column i
      is empty as well, c_i is the number between them nearest to 0.
    - Row and column i are t > 0 times row and column j, and row i has no obstacle above. Then p_i =
      t·p_j + (q_i − t·q_j) is at least 0 wherever p_j is, if q_i ≥ t·q_j, so c_i = ψ_i.
    - Row and column i are t times row and column j, and neither row has an obstacle. Then p_i = 0
      follows from p_j = 0, if q_i = t·q_j, for t < 0 as well, so c_i = 0.

    Rows that contradict each other stay as they are.
    """
    if not problem.psi.is_constant:
        return problem
    low = problem.facts.obstacle
    high = problem.facts.upper_obstacle
    if high is None:
        high = np.full(problem.n, np.inf)
    c = np.full(problem.n, np.nan)
    _of_empty_rows(problem, low, high, c)
    _of_repeated_rows(problem, low, high, c)
    with np.errstate(invalid="ignore"):
        fixed = (low >= high) & (low - high <= _TOUCH * (np.abs(low) + np.abs(high)))
    c[fixed] = low[fixed]
    rests = np.isfinite(c)
    return _resting(problem, rests, np.where(rests, c, 0.0), low, high) if rests.any() else problem


def _of_empty_rows(problem: ProblemData, low: Vector, high: Vector, c: Vector) -> None:
    empty = problem.matrix.empty_rows
    if not empty.any():
        return
    A = problem.A
    q = problem.q
    side = np.where(q > 0, low, np.where(q < 0, high, np.minimum(np.maximum(0.0, low), high)))
    unseen = np.bincount(A.indices[A.data != 0], minlength=problem.n) == 0
    taken = empty & np.isfinite(side) & ((q != 0) | unseen)
    c[taken] = side[taken]


def _of_repeated_rows(problem: ProblemData, low: Vector, high: Vector, c: Vector) -> None:
    """The rows of which another one says as much or more."""
    bare = np.isposinf(high) & np.isnan(c)
    free = np.isneginf(low)
    candidates = np.flatnonzero(bare & (problem.matrix.rows.diagonal == 0))
    if candidates.size < 2:
        return
    known = _NORMAL.setdefault(problem.matrix, {})
    if (place := candidates.tobytes()) not in known:
        known.clear()
        rows, of_row = _normal(sp.csr_array(problem.A[candidates]))
        columns, of_column = _normal(sp.csr_array(problem.A[:, candidates].T))
        known[place] = [row + column for row, column in zip(rows, columns, strict=True)], of_row, of_column
    keys, of_row, of_column = known[place]
    first: dict[bytes, int] = {}
    for k, i in enumerate(candidates):
        t = of_row[k]
        if not t or t != of_column[k]:
            continue
        key = keys[k]
        if (m := first.setdefault(key, k)) == k:
            continue
        j = candidates[m]
        t /= of_row[m]
        gap = problem.q[i] - t * problem.q[j]
        same = abs(gap) <= _TOUCH * (abs(problem.q[i]) + abs(t * problem.q[j]))
        if free[j]:
            if same or (gap > 0 and not free[i] and t > 0):
                c[i] = 0.0 if free[i] else low[i]
        elif free[i]:
            if same and t > 0:
                c[j] = low[j]
                first[key] = k
        elif t > 0:
            if same or gap > 0:
                c[i] = low[i]
            else:
                c[j] = low[j]
                first[key] = k


def _normal(M: sp.csr_array) -> tuple[list[bytes], Vector]:
    """Each row divided by its first entry, as bytes, and that entry, 0 in an empty row."""
    M.eliminate_zeros()
    M.sort_indices()
    first = np.zeros(M.shape[0])
    stored = np.flatnonzero(np.diff(M.indptr))
    first[stored] = M.data[M.indptr[stored]]
    # quotients of rows that are multiples of each other differ by rounding at most
    quotients = np.round(M.data / first[row_of(M)], 13)
    parts = zip(M.indptr[:-1], M.indptr[1:], strict=True)
    return [M.indices[a:b].tobytes() + quotients[a:b].tobytes() for a, b in parts], first


def _resting(problem: ProblemData, rests: Mask, c: Vector, low: Vector, high: Vector) -> ProblemData:
    """z_i = c_i in the rows that rest, which the others know."""
    A = problem.A
    goes_on = ~rests
    row = row_of(A)
    data = np.where(goes_on[row] & goes_on[A.indices], A.data, 0.0)
    reduced = sp.csr_array((data, A.indices, A.indptr), shape=A.shape) + sp.diags_array(rests.astype(np.float64))
    q = np.where(rests, -c, problem.q + problem.product(c))
    psi: Any = Constant(np.where(rests, -np.inf, low)).bind(problem.n)
    if np.isfinite(high[goes_on]).any():
        psi = Between(psi, Constant(np.where(rests, np.inf, high)).bind(problem.n))
    return ProblemData(sp.csr_array(reduced), q, psi)
