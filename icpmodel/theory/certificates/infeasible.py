"""A proof that no z has p(z) ≥ 0 and r(z) ≥ 0, for constant ψ = c: a combination of the rows that says 0 < 0.

With y ≥ 0, Aᵀy ≤ 0 and (q + Ac)ᵀy < 0 every z ≥ c has (Az + q)ᵀy ≤ (Ac + q)ᵀy < 0 (Farkas). In rows without an
obstacle, where p = 0 is asked for and c counts as 0, y may have either sign and (Aᵀy)_i must be 0. Where it is known of
some unknowns in which interval every solution has them, (Aᵀy)_j z_j is at most its largest value there, whatever the
sign of (Aᵀy)_j. That no z solves the problem is then proved, though one may have p ≥ 0 and r ≥ 0.

Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (1992), sections 2.7 and 4.4.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from fractions import Fraction

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Vector
from ...numerics.rational import as_witness, nearest, rationals
from ...problem.data import ProblemData
from ..answers import Answer

Combination = dict[int, Fraction]

_RATIONAL = 30  #: rows up to which a system is solved in rational arithmetic
_ZERO = 1e-9  #: what is smaller than this share of the largest entry of a computed y counts as zero
_DENOMINATOR = 1000  #: denominators that are tried first: the rays of problems in small whole numbers have them
_SECONDS = 1.0  #: for a linear program


@dataclass(frozen=True, eq=False)
class Known:
    """Every solution has `low` ≤ z ≤ `high`, shape (n,), infinite where nothing is known; `proof` says why."""

    low: Vector
    high: Vector
    proof: str


def infeasible(problem: ProblemData, y: Vector, known: Known | None = None) -> Answer:
    """Whether `y`, or an exact y next to it, is such a combination, given what is `known`; its scale says nothing.

    Often Aᵀy is 0 in many rows, which floats seldom hold: tried are the simple fractions next to `y`, `y` itself, and
    where up to 30 of its entries are not 0 the exact solution of these equations. All is checked in rational
    arithmetic. Returns True with the witness y, floats or fractions, and `number` = (q + Ac)ᵀy; else None.
    """
    unknown = Answer(None, "no combination of the rows was found that contradicts itself")
    if not problem.is_lcp or not np.isfinite(y).all() or not y.any():
        return unknown
    sure = known or Known(np.full(problem.n, -np.inf), np.full(problem.n, np.inf), "")
    free = np.isneginf(problem.facts.obstacle)
    y = y / np.abs(y).max()
    y = np.where((y > _ZERO) | (free & (y < -_ZERO)), y, 0.0)
    for found in _tried(problem, y, np.flatnonzero((y != 0) | free), sure):
        exact = _contradiction(problem, free, found, sure)
        if exact is not None:
            break
    else:
        return unknown
    witness, number = [found.get(i, Fraction(0)) for i in range(problem.n)], nearest(exact)
    rows = [i for i in range(problem.n) if witness[i]]
    named = ", ".join(map(str, rows[:5])) + (f" and {len(rows) - 5} more" if len(rows) > 5 else "")
    sign = "y >= 0 where there is an obstacle" if free.any() else "y >= 0"
    where = f"for a y that is not 0 in row{'s' if len(rows) > 1 else ''} {named}"
    if known is None:
        reason = f"no z has Az + q >= 0 and z >= psi(z): {sign}, A'y <= 0 and (q + Ac)'y = {number:.3g} {where}"
    else:
        proved = f"{np.count_nonzero(np.isfinite(known.high))} unknowns are proved to be what they are ({known.proof})"
        then = f"{proved}, and then (Az + q)'y <= {number:.3g}, {sign}, {where}"
        reason = f"no z has Az + q >= 0, z >= psi(z) and p'r = 0: {then}"
    y = as_witness(witness, lambda x: _contradiction(problem, free, dict(enumerate(x)), sure) is not None)
    return Answer(True, reason, y, number)


def _tried(problem: ProblemData, y: Vector, support: np.ndarray, known: Known) -> Iterator[Combination]:
    yield {int(i): Fraction(float(y[i])).limit_denominator(_DENOMINATOR) for i in support}
    yield {int(i): Fraction(float(y[i])) for i in support}
    if support.size <= _RATIONAL:
        yield _exact(problem, support, y, known)


def multipliers(problem: ProblemData) -> Vector | None:
    """A candidate y for `infeasible`: (q + Ac)ᵀy < 0, Aᵀy ≤ 0 and 0 ≤ y ≤ 1 in floats, for constant ψ = c.

    In rows without an obstacle −1 ≤ y ≤ 1 and (Aᵀy)_i = 0. Of several the one with the most room for rounding, by
    linear programming (HiGHS); None where there is none, as where some z has p, r ≥ 0, or none is found in a second.
    """
    if not problem.is_lcp:
        return None
    from scipy.optimize import linprog

    c, A, n = problem.facts.obstacle, problem.A.tocsc(), problem.n
    free = np.isneginf(c)
    load = problem.p(np.where(free, 0.0, c))
    with np.errstate(over="ignore"):
        size, sums = np.abs(load).sum(), abs(A).sum(axis=0)
    if not (np.isfinite(10.0 * size) and np.isfinite(sums).all()):
        return None
    found = linprog(
        np.append(load, -10.0 * size),  # the last unknown is the room, in shares of what the rows could be
        A_ub=sp.vstack([sp.hstack([A[:, ~free].T, sums[~free, None]]), np.append(load, size)[None]]),
        b_ub=np.zeros(n - free.sum() + 1),
        A_eq=sp.hstack([A[:, free].T, np.zeros((free.sum(), 1))]),
        b_eq=np.zeros(free.sum()),
        bounds=np.column_stack([np.append(np.where(free, -1.0, 0.0), 0.0), np.ones(n + 1)]),
        options={"time_limit": _SECONDS},
    )
    return np.asarray(found.x[:-1]) if found.status == 0 and load @ found.x[:-1] < 0 else None


def _contradiction(problem: ProblemData, free: np.ndarray, y: Combination, known: Known) -> Fraction | None:
    """(q + Ac)ᵀy where it is negative and y has the right signs, in exact arithmetic; else None."""
    A, c = problem.A, problem.facts.obstacle
    columns: dict[int, Fraction] = {}
    total = Fraction(0)
    for i, weight in y.items():
        if weight < 0 and not free[i]:
            return None
        if weight:
            total += weight * Fraction(float(problem.q[i]))
            for k in range(A.indptr[i], A.indptr[i + 1]):
                j = int(A.indices[k])
                columns[j] = columns.get(j, Fraction(0)) + weight * Fraction(float(A.data[k]))
    for j, entry in columns.items():
        end = float(known.high[j] if entry > 0 else known.low[j])
        if not np.isfinite(end) and (entry > 0 or (entry and free[j])):
            return None
        if entry:
            total += entry * Fraction(end if np.isfinite(end) else float(c[j]))
    return total if total < 0 else None


def _exact(problem: ProblemData, support: np.ndarray, y: Vector, known: Known) -> Combination:
    """x on the support of y with (Aᵀx)_i = 0 exactly where (Aᵀy)_i is about 0, or must be; x_i left open is y_i."""
    with np.errstate(over="ignore", invalid="ignore"):
        tight = np.abs(problem.A.T @ y) <= _ZERO * (problem.matrix.absolute.T @ np.abs(y))
    tight[support] = True
    tight &= ~np.isfinite(known.high)
    rows = [row for row in rationals(problem.A[support][:, tight].T) if any(row)]
    x = [Fraction(float(y[i])) for i in support]
    done: list[int] = []
    for column in range(len(x)):
        top = len(done)
        k = next((k for k in range(top, len(rows)) if rows[k][column]), None)
        if k is None:
            continue
        rows[top], rows[k] = rows[k], rows[top]
        done.append(column)
        for i in range(len(rows)):
            if i != top and rows[i][column]:
                factor = rows[i][column] / rows[top][column]
                rows[i] = [a - factor * b for a, b in zip(rows[i], rows[top], strict=True)]
    left = [j for j in range(len(x)) if j not in done]
    for top, column in enumerate(done):
        x[column] = -sum((rows[top][j] * x[j] for j in left), Fraction(0)) / rows[top][column]
    return dict(zip(map(int, support), x, strict=True))
