"""Rows that need no iteration, made equations of their own: fixed unknowns and empty rows."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import Mask, Vector, row_of, with_entries
from ..numerics.rounding import UNIT_ROUNDOFF
from ..problem.affine import Constant
from ..problem.data import ProblemData
from ..problem.two_sided import TwoSidedObstacle

#: the share of their sizes by which rounded obstacles may cross
MAX_CROSSING = 4.0 * UNIT_ROUNDOFF


def without_redundant_rows(problem: ProblemData) -> ProblemData:
    """A problem of the same size with constant obstacles. Each of its solutions is one of `problem`.

    It has a solution if and only if `problem` has one.

    Notes
    -----
    It is the problem itself where nothing is redundant. Otherwise z_i = c_i stands in the redundant
    rows:

    - ψ_i = ψ̄_i, or crossed by rounding: c_i = ψ_i, whatever p_i is.
    - Row i of A is empty: c_i = ψ_i where q_i > 0, ψ̄_i where q_i < 0. Where q_i = 0 and column i
      is empty as well, c_i is the number between them nearest to 0.
    """
    c = redundant_values(problem)
    known = np.isfinite(c)
    return _substitute(problem, known, np.where(known, c, 0.0)) if known.any() else problem


def redundant_values(problem: ProblemData) -> Vector:
    """c_i in the rows that `without_redundant_rows` makes equations z_i = c_i, and NaN in the others; shape (n,)."""
    c = np.full(problem.n, np.nan)
    if problem.psi.is_constant:
        low, high = _obstacles(problem)
        _fix_empty_rows(problem, low, high, c)
        with np.errstate(invalid="ignore"):
            fixed = (low >= high) & (low - high <= MAX_CROSSING * (np.abs(low) + np.abs(high)))
        c[fixed] = low[fixed]
    return c


def _obstacles(problem: ProblemData) -> tuple[Vector, Vector]:
    """The constant ψ and ψ̄, each of shape (n,); ψ̄ is ∞ where there is no upper obstacle."""
    high = problem.facts.upper_obstacle
    return problem.facts.obstacle, np.full(problem.n, np.inf) if high is None else high


def _fix_empty_rows(problem: ProblemData, low: Vector, high: Vector, c: Vector) -> None:
    """Set c_i in the redundant rows among the empty ones."""
    empty = problem.matrix.empty_rows
    if not empty.any():
        return
    A = problem.A
    q = problem.q
    value = np.where(q > 0, low, np.where(q < 0, high, np.minimum(np.maximum(0.0, low), high)))
    empty_columns = np.bincount(A.indices[A.data != 0], minlength=problem.n) == 0
    redundant = empty & np.isfinite(value) & ((q != 0) | empty_columns)
    c[redundant] = value[redundant]


def _substitute(problem: ProblemData, known: Mask, c: Vector) -> ProblemData:
    """The problem with the equation z_i = c_i in the `known` rows, and these values in the others."""
    low, high = _obstacles(problem)
    A = problem.A
    unknown = ~known
    row = row_of(A)
    data = np.where(unknown[row] & unknown[A.indices], A.data, 0.0)
    reduced = with_entries(A, data) + sp.diags_array(known.astype(np.float64))
    with np.errstate(over="ignore", invalid="ignore"):
        q = np.where(known, -c, problem.q + problem.product(c))
    if not np.isfinite(q).all():
        return problem
    psi: Any = Constant(np.where(known, -np.inf, low)).bind(problem.n)
    if np.isfinite(high[unknown]).any():
        psi = TwoSidedObstacle(psi, Constant(np.where(known, np.inf, high)).bind(problem.n))
    return ProblemData(sp.csr_array(reduced), q, psi)
