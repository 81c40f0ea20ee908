"""Proofs that a quadratic program has no solution, from directions that show it up to rounding.

With λ ≥ 0 and w = Eᵀλ + Aᵀν every x with Ex ≤ g, Ax = b has wᵀx ≤ gᵀλ + bᵀν; if even the least wᵀx for l ≤ x ≤ u is
larger, there is none (Farkas). Where x_j has no bound on one side, w_j must be 0 there or have one sign, and floats
seldom are 0. That there is a λ, ν *near* the given ones with w_j = 0 for all these j can be proved in floats, though:
with as many of their entries as there are such j the equations for the change have a regular matrix N if some R has
‖I − RN‖ ≤ α < 1, and then it is at most ‖R‖‖w‖/(1 − α). What rounding does to each number is bounded from above.
Reference: Rump, Acta Numerica 19 (2010), section 10, for verified linear systems.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...icp import ICP
from ...numerics import work
from ...numerics.arrays import Mask, Vector
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...theory.certificates.infeasible import Known, infeasible
from .reduction import ProgramLcp

EXACTLY, VERIFIED, NUMERICALLY = "in exact arithmetic", "with every rounding error bounded", "up to rounding"
#: how far a numerical proof of infeasibility may be off, and what it must show, for entries of about 1
_ZERO, _NEGATIVE = 1e-10, -1e-7
#: nanoseconds that an entry takes in rational arithmetic, by cProfile for 600 x 1000 entries in floats that are no
#: simple fractions, and how many are too many for a proof that may fail
_FRACTION, _LONG = 15_000.0, 4e8
#: entries of a direction that count as 0
_NOTHING = 1e-9
#: shares of their terms up to which columns may count as 0, and entries beside 1; from which on they never do
_NOISE, _MUCH = 1e-4, 1e-2
#: reciprocal condition numbers that count as those of regular matrices
_REGULAR = 1e-13
#: so often what has become wrong is set to 0
_CORRECTIONS = 5
#: so often what is left of a combination is taken out of it
_PRODUCTS = 1000


def contradiction(lcp: ProgramLcp, direction: Vector) -> tuple[str, str] | None:
    """What `direction` proves, and how: "primal", that the constraints contradict each other; "dual", that the
    objective falls for ever along x, if there is a feasible x. None: not even numerically."""
    of_x = np.arange(direction.size) < lcp.frame.n
    kinds = ("primal", np.where(of_x, 0.0, direction), _primal), ("dual", np.where(of_x, direction, 0.0), _dual)
    for kind, along, refined in kinds:
        size = np.abs(along).max()
        if not 0.0 < size < np.inf:
            continue
        for noise in (0.0, _NOISE):
            y = refined(lcp, along / size, noise)
            if proves(lcp.below, y, lcp.known):
                if kind == "primal" and _verified(lcp, y):
                    return kind, VERIFIED
                return kind, EXACTLY if _exactly(lcp, y) else NUMERICALLY
    return None


def _exactly(lcp: ProgramLcp, y: Vector) -> bool:
    """Whether y, or a simple one next to it, is a proof in rational arithmetic, where that does not take long."""
    cost = _FRACTION * float(np.diff(lcp.below.A.indptr)[y != 0].sum())
    return cost <= min(_LONG, work.nanoseconds_left()) and infeasible(lcp.below, y, lcp.known).holds is True


def _primal(lcp: ProgramLcp, y: Vector, noise: float) -> Vector:
    """`y` with λ ≥ 0, and without what it makes of columns that must be 0, or have one sign and nearly are 0."""
    frame, n = lcp.frame, lcp.frame.n
    signed = np.arange(y.size) < n + frame.m
    y = np.where((np.abs(y) <= max(_NOTHING, noise)) | (signed & (y < 0)), 0.0, y)
    used = np.flatnonzero(y[n:])
    K, part = _stacked(frame.E, frame.A)[used], y[n:][used]
    rises, falls = lcp.low > -np.inf, lcp.high < np.inf
    part = _without(K.T, part, lambda w: (w != 0) & ~((w > 0) & rises | (w < 0) & falls), noise)
    y[n:][used] = np.where(signed[n:][used], np.maximum(part, 0.0), part)
    return y


def _dual(lcp: ProgramLcp, y: Vector, noise: float) -> Vector:
    """`y` = (x, 0, 0), x in the directions of its bounds, without what P and A make of it, and where E rises."""
    frame, n = lcp.frame, lcp.frame.n
    below = lcp.low > -np.inf
    x = np.where(frame.both | (np.abs(y[:n]) <= max(_NOTHING, noise)) | (below & (y[:n] < 0)), 0.0, y[:n])
    used = np.flatnonzero(x)
    K = _stacked(frame.P, frame.A, frame.E)[:, used]
    signed = np.arange(K.shape[0]) >= n + frame.k
    x[used] = _without(K, x[used], lambda w: (w > 0) | (w < 0) & ~signed, noise)
    x = np.where(below, np.maximum(x, 0.0), x)
    return np.concatenate([x, np.zeros(y.size - n)])


def _stacked(*blocks: Any) -> Any:
    if any(map(sp.issparse, blocks)):
        return sp.csr_array(sp.vstack([sp.csr_array(M) for M in blocks]))
    return np.concatenate(blocks)


def _without(K: Any, y: Vector, wrong: Callable[[Vector], Mask], noise: float) -> Vector:
    """The y next to `y` for which nothing is `wrong` with Ky, by setting to 0 what is, and what is `noise`."""
    from scipy.linalg import lstsq
    from scipy.sparse.linalg import lsmr

    given, zero, size = y, np.zeros(K.shape[0], bool), abs(K)
    for _ in range(_CORRECTIONS):
        left, terms = K @ y, size @ np.abs(y)
        more = (wrong(left) & (np.abs(left) > _ZERO * terms) | (left != 0) & (np.abs(left) <= noise * terms)) & ~zero
        if not more.any() or not y.any() or (np.abs(left) > _MUCH * terms)[more].any():
            break
        zero |= more
        rows = K[zero]
        if sp.issparse(rows):
            y = given - lsmr(rows, rows @ given, atol=1e-15, btol=1e-15, conlim=0.0, maxiter=_PRODUCTS)[0]
        else:
            y = given - lstsq(rows, rows @ given, cond=_REGULAR, check_finite=False, lapack_driver="gelsy")[0]
    return y


def proves(problem: ICP, y: Vector, known: Known | None) -> bool:
    """Whether y shows, up to rounding, that no z has p ≥ 0 and r ≥ 0: see `infeasible`."""
    c = problem.psi.value(y)
    free = np.isneginf(c)
    size = np.abs(y).max()
    if not 0.0 < size < np.inf:
        return False
    y = np.where(np.abs(y) > _ZERO * size, y / size, 0.0)
    if (y[~free] < 0).any():
        return False
    columns, offset = problem.A.T @ y, np.where(free, 0.0, c)
    wrong = np.where(free, np.abs(columns), columns)
    if known is not None:
        at_upper = np.isfinite(known.high) & (columns > 0)
        offset, wrong = np.where(at_upper, known.high, offset), np.where(at_upper, 0.0, wrong)
    number, terms = problem.q @ y + columns @ offset, np.abs(problem.q) @ np.abs(y) + np.abs(columns) @ np.abs(offset)
    small = (wrong <= _ZERO * np.minimum(problem.matrix.absolute.T @ np.abs(y), 1.0)).all()
    return bool(small and number < _NEGATIVE * max(terms, 1.0))


@np.errstate(all="ignore")
def _verified(lcp: ProgramLcp, y: Vector) -> bool:
    """Whether some λ, ν near those of `y` prove that there is no feasible x, every rounding error being bounded."""
    frame, n = lcp.frame, lcp.frame.n
    used = np.flatnonzero(y[n:])
    y, right, K = y[n:][used], lcp.q[n:][used], _stacked(frame.E, frame.A)[used]
    signed = used < frame.m
    size = abs(K)
    # two more than the operations of a sum, twice, as for all sums here
    loss = 2.0 * (K.shape[0] + n + 4) * UNIT_ROUNDOFF
    columns = K.T @ y
    off = loss * (size.T @ np.abs(y)) + (K.shape[0] + n) * SMALLEST
    below, above, empty = lcp.low > -np.inf, lcp.high < np.inf, size.sum(axis=0) == 0

    def sure() -> Any:
        return ((columns - off >= 0) & below) | ((columns + off <= 0) & above) | (below & above) | empty

    open_ = np.flatnonzero(~sure())
    moved = np.zeros(y.size)
    if open_.size:
        moved_by = _moved(K, y, signed, open_, np.abs(columns[open_]) + off[open_], loss)
        if moved_by is None:
            return False
        basis, by = moved_by
        moved[basis] = by
        if (signed[basis] & (y[basis] < by)).any():
            return False
        off += 1.01 * (size.T @ moved)
        if not np.delete(sure(), open_).all():
            return False
        columns[open_] = off[open_] = 0.0
    # the least that wᵀx can be, w anywhere within `off` of the columns, and the most that gᵀλ + bᵀν can be
    ends = [np.where(np.isfinite(end), end, 0.0) for end in (lcp.low, lcp.high)]
    reach = np.maximum(*map(np.abs, ends))
    least = np.where(columns > 0, columns * ends[0], columns * ends[1]) - off * reach
    most = right @ y + np.abs(right) @ moved
    terms = np.abs(least).sum() + np.abs(right) @ (np.abs(y) + moved) + (np.abs(columns) + off) @ reach
    return bool(least.sum() - most > 4.0 * loss * terms + (K.shape[0] + n) * SMALLEST)


def _moved(
    K: Any, y: Vector, signed: Mask, open_: NDArray[np.intp], wrong: Vector, loss: float
) -> tuple[NDArray[np.intp], float] | None:
    """Which entries of y may be moved, and by how much at the most, so that these columns of Kᵀy are exactly 0."""
    from scipy.linalg import qr

    k = open_.size
    if k > y.size or work.dense_cost(k) * 8 > work.nanoseconds_left():
        return None
    N = K[:, open_]
    N = np.asarray(N.toarray() if sp.issparse(N) else N).T
    weights = np.where(signed, np.abs(y), np.abs(y).max())
    basis = qr(N * weights, mode="r", pivoting=True)[1][:k]
    N = N[:, basis]
    try:
        R = np.linalg.inv(N)
    except np.linalg.LinAlgError:
        return None
    rounded = loss * (np.abs(R) @ np.abs(N)).sum(axis=1).max()
    alpha = 1.01 * (np.abs(np.eye(k) - R @ N).sum(axis=1).max() + rounded)
    if not alpha < 0.5:
        return None
    return basis, float(1.01 * np.abs(R).sum(axis=1).max() * wrong.max() / (1.0 - alpha))
