"""A proof that no z has p(z) ≥ 0 and r(z) ≥ 0, for constant and affine ψ: a combination of the rows that says 0 < 0.

With y ≥ 0, Aᵀy ≤ 0 and (q + Ac)ᵀy < 0 every z ≥ c has (Az + q)ᵀy ≤ (Ac + q)ᵀy < 0 (Farkas). In rows without an
obstacle, where p = 0 is asked for and c counts as 0, y may have either sign and (Aᵀy)_i must be 0. Where it is known of
some unknowns in which interval every solution has them, (Aᵀy)_j z_j is at most its largest value there, whatever the
sign of (Aᵀy)_j. That no z solves the problem is then proved, though one may have p ≥ 0 and r ≥ 0.
An obstacle above, ψ̄ = c̄, is such an interval: z ≤ c̄. In rows that have it nothing is known of p ≥ 0, so y_i ≤ 0 there,
y_i = 0 where there is one below as well, and then (Az + q)ᵀy ≥ 0 at every solution as before.
For ψ(z) = Gz + c the rows of r get weights as well: x, y ≥ 0, Aᵀy + (I − G)ᵀx = 0 and qᵀy − cᵀx < 0. That is the same
for the constant obstacle s ≥ 0 in the unknowns (z, u, s), with the equations u = Gz + c and s = z − u, and no entry of
I − G is rounded.

Reference: Cottle, Pang and Stone, The Linear Complementarity Problem (1992), sections 2.7 and 4.4.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import Mask, Vector, inner
from ...numerics.equilibration import Exponents, in_units_exactly
from ...numerics.rational import as_witness, nearest, rationals
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData
from ..answers import Answer

Combination = dict[int, Fraction]

_RATIONAL = 30  #: rows up to which a system is solved in rational arithmetic
_ZERO = 1e-9  #: what is smaller than this share of the largest entry of a computed y counts as zero
_DENOMINATOR = 1000  #: denominators that are tried first: the rays of problems in small whole numbers have them
_SECONDS = 1.0  #: for a linear program
#: nanoseconds for an entry of A in fractions, by cProfile; how many are too many
_FRACTION, _LONG = 3000.0, 4e8
#: nanoseconds for k²m of a factorisation with pivoting of an m × k matrix, 7 s at m = 2600 and k = 1700 were measured;
#: and how many are too many
_PIVOTED, _LONGEST = 1.0, 2e9
#: a direction is tried as a proof if what is wrong with it is so small a share of what it shows, and a tenth each time
_SHOWN = 1e-5
_ONE_SIZE = 10  #: rows whose entries are within 2 to this number, one way or the other, have one size


@dataclass(frozen=True, eq=False)
class Known:
    """Every solution has `low` ≤ z ≤ `high`, shape (n,), infinite where nothing is known; `proof` says why."""

    low: Vector
    high: Vector
    proof: str


def infeasible(problem: ProblemData, y: Vector, known: Known | None = None, *, bounded: bool = True) -> Answer:
    """Whether `y`, or an exact y next to it, is such a combination, given what is `known`; its scale says nothing.

    Often Aᵀy is 0 in many rows, which floats seldom hold: tried are the simple fractions next to `y`, `y` itself, and
    where up to 30 of its entries are not 0 the exact solution of these equations. All is checked in rational
    arithmetic, or, where that is not to be had and `bounded`, in floats with a bound on every rounding error. Returns
    True with the witness y, floats or fractions, and `number`, which (Az + q)ᵀy is at most, without an obstacle above
    (q + Ac)ᵀy; else None. For an affine ψ `y` and the witness are (y, x), shape (2n,).
    """
    given, unknown = problem, Answer(None, "no combination of the rows was found that contradicts itself")
    if not problem.psi.is_constant:
        lifted = _lifted(problem)
        if lifted is None or y.size != 2 * problem.n:
            return unknown
        return _lowered(infeasible(lifted, np.concatenate([y[problem.n :], y[problem.n :], y[: problem.n]])))
    if not np.isfinite(y).all() or not y.any():
        return unknown
    problem, units = _in_units_of_rows(problem)
    rows, y = _Rows.of(problem, known), np.ldexp(y / np.abs(y).max(), -units)
    if not y.any():
        return unknown
    free = rows.falls & rows.rises
    y = y / np.abs(y).max()
    y = np.where((rows.rises & (y > _ZERO)) | (rows.falls & (y < -_ZERO)), y, 0.0)
    for found in _tried(problem, y, np.flatnonzero((y != 0) | free), rows):
        exact = _contradiction(problem, rows, found)
        if exact is not None:
            break
    else:
        number = _bounded(problem, rows, y) if bounded else None
        if number is None:
            return unknown
        top = int(units[y != 0].max())
        y, number = np.ldexp(y, units - top), float(np.ldexp(number, -top))
        said = f"{_weighted(y)} of Az + q, or a combination next to that, comes to {number:.3g} at most"
        return Answer(True, f"no z is a solution: {said}, every rounding error being bounded", y, number)
    top = max(int(units[i]) for i, weight in found.items() if weight)
    witness = [found.get(i, Fraction(0)) * Fraction(2) ** (int(unit) - top) for i, unit in enumerate(units)]
    number = nearest(exact / Fraction(2) ** top)
    sign = "y >= 0 where there is an obstacle" if free.any() else "y >= 0"
    sums = f"{_weighted(witness)} of Az + q comes to {number:.3g} at most"
    if known is None and problem.upper is not None:
        signs = "p >= 0 where nothing is above and p <= 0 where nothing is below"
        reason = f"no z with psi <= z <= upper has {signs}: there {sums}, and with these signs to 0 or more"
    elif known is None:
        said = f"{sign}, A'y <= 0 and (q + Ac)'y = {number:.3g}"
        sums += ", and wherever Az + q >= 0 to 0 or more"
        reason = f"no z has Az + q >= 0 and z >= psi(z): wherever z >= psi(z), {sums} ({said})"
    else:
        proved = f"{np.count_nonzero(np.isfinite(known.high))} unknowns are proved to be what they are ({known.proof})"
        sums += ", and wherever Az + q >= 0 to 0 or more"
        reason = f"no z has Az + q >= 0, z >= psi(z) and p'r = 0: {proved}, and then {sums} ({sign})"
    y = as_witness(witness, lambda x: _contradiction(given, rows, dict(enumerate(x))) is not None)
    return Answer(True, reason, y, number)


def _in_units_of_rows(problem: ProblemData) -> tuple[ProblemData, Exponents]:
    """The problem with its rows times 2^e, so that the largest |entry| of each is about 1, or |q_i| in a row without is
    that of the others, and e; the problem itself and zeros where that would round, or all are within 2^±10 as they are.
    """
    empty, of_q, weights = problem.matrix.empty_rows, np.abs(problem.q), problem.matrix.row_weights
    others = float((weights * of_q)[~empty].max(initial=0.0)) or 1.0
    size = np.where(empty, of_q / others, 1.0 / weights)
    exponents, none = -np.frexp(size)[1].astype(np.int64), np.zeros(problem.n, dtype=np.int64)
    if np.abs(exponents).max() <= _ONE_SIZE or (A := in_units_exactly(problem.A, exponents)) is None:
        return problem, none
    q = np.ldexp(problem.q, exponents)
    if not np.array_equal(np.ldexp(q, -exponents), problem.q):
        return problem, none
    return ProblemData.of_checked(A, q, problem.psi), exponents


def _weighted(y: Any, several: int = 4) -> str:
    """Which rows a combination takes, and how often: as many as fit in a sentence."""
    used = [i for i, weight in enumerate(y) if weight]
    first = " and ".join(f"{nearest(y[i]):.4g} times row {i}" for i in used[:several])
    return first + (f" and {len(used) - several} rows more" if len(used) > several else "")


def _lifted(problem: ProblemData) -> ProblemData | None:
    """The problem of an affine ψ in (z, u, s), where the obstacle is constant; None for another ψ, and with two."""
    if problem.psi.linear is None or problem.upper is not None:
        return None
    (G, c), unit = problem.psi.linear, sp.eye_array(problem.n)
    nothing, there = np.full(problem.n, -np.inf), np.isfinite(c)
    A = sp.block_array([[-G, unit, None], [unit, -unit, -unit], [problem.A, None, None]])
    q = np.concatenate([np.where(there, -c, 0.0), np.zeros(problem.n), problem.q])
    return ProblemData(A, q, np.concatenate([nothing, nothing, np.where(there, 0.0, -np.inf)]))


def _lowered(answer: Answer) -> Answer:
    """What is proved of the lifted problem, said of the rows of p and r."""
    if not answer.holds:
        return answer
    x, _, y = np.split(answer.witness, 3)
    sums = f"{_weighted(y)} of Az + q and {_weighted(x)} of z - psi(z)"
    said = f"y >= 0 where there is an obstacle, x >= 0, A'y + (I - G)'x = 0 and q'y - c'x = {answer.number:.3g}"
    sums += f" comes to {answer.number:.3g} for every z, and where all rows are >= 0 to 0 or more"
    reason = f"no z has Az + q >= 0 and z >= psi(z): {sums}"
    return replace(answer, reason=f"{reason} ({said})", witness=np.concatenate([y, x]))


class _Rows(NamedTuple):
    """Where z is known to be, from `low` to `high`, and where p ≤ 0 may be taken for granted, as y_i `falls` there, and
    p ≥ 0, as it `rises`: masks of shape (n,)."""

    low: Vector
    high: Vector
    falls: np.ndarray
    rises: np.ndarray

    @classmethod
    def of(cls, problem: ProblemData, known: Known | None = None) -> _Rows:
        low, high = problem.facts.obstacle, problem.facts.upper_obstacle
        high = np.full(problem.n, np.inf) if high is None else high
        falls, rises = np.isneginf(low), np.isposinf(high)
        if known is not None:
            low = np.where(np.isfinite(known.low), known.low, low)
            high = np.where(np.isfinite(known.high), known.high, high)
        return cls(low, high, falls, rises)


def _tried(problem: ProblemData, y: Vector, support: np.ndarray, rows: _Rows) -> Iterator[Combination]:
    cost = _FRACTION * float(np.diff(problem.A.indptr)[support].sum())
    if cost > min(_LONG, work.nanoseconds_left()):
        return
    yield {int(i): Fraction(float(y[i])).limit_denominator(_DENOMINATOR) for i in support}
    yield {int(i): Fraction(float(y[i])) for i in support}
    if support.size <= _RATIONAL:
        yield _exact(problem, support, y, rows, support)  # a ray has zeros there, a linear program need not
        yield _exact(problem, support, y, rows, np.flatnonzero(np.isneginf(rows.low) & np.isposinf(rows.high)))


class Recession:
    """Directions along which iterates run away, tried as proofs that there is no solution.

    Where A is monotone and no z has p ≥ 0 and r ≥ 0, the iterates z of a proximal or interior method grow, and their
    direction y tends to a combination as in `infeasible`. What is wrong with y is how far Aᵀy is from the signs that it
    needs, in the units of W; what it shows is −(q + Ac)ᵀy. Each y whose quotient is a tenth of the last one is tried.

    Parameters
    ----------
    problem
        The problem; where its obstacles are not constant no proof is tried.
    """

    def __init__(self, problem: ProblemData) -> None:
        self.problem = problem
        self.share = _SHOWN

    def proof(self, y: Vector) -> Answer:
        """What is proved by the direction `y`, shape (n,)."""
        unknown = Answer(None, "the iterates do not run away")
        problem = self.problem
        if not problem.psi.is_constant:
            return unknown
        share = _share(problem, y)
        if not share < self.share:
            return unknown
        self.share = 0.1 * share
        return infeasible(problem, y, bounded=share < _ZERO)


def contradicts(problem: ProblemData, y: Vector) -> bool:
    """Whether `y`, shape (n,), is a combination as in `infeasible` up to rounding; constant obstacles."""
    return _share(problem, y) < _ZERO


@np.errstate(all="ignore")
def _share(problem: ProblemData, y: Vector) -> float:
    """What is wrong with `y` as a share of what it shows."""
    rows = _Rows.of(problem)
    root = np.sqrt(problem.matrix.proximal_weights)
    y = np.where((rows.rises & (y > 0.0)) | (rows.falls & (y < 0.0)), y, 0.0)
    columns = (problem.A.T @ y) / root
    ends = root * np.where(columns > 0.0, rows.high, rows.low)
    open_ = np.isinf(ends)
    ends = np.where(open_, 0.0, ends)
    shown = -(inner(problem.q, y) + inner(columns, ends))
    if not shown > _ZERO * (inner(np.abs(problem.q), np.abs(y)) + inner(np.abs(columns), np.abs(ends))):
        return np.inf
    return float(np.abs(columns[open_]).max(initial=0.0)) / shown if shown > 0.0 else np.inf


def least_violation(problem: ProblemData) -> tuple[ProblemData, Mask]:
    """The ICP whose solution shows whether there is a z with p ≥ 0 and r ≥ 0, and which rows of p are asked for.

    min ½‖(p)⁻‖² over ψ ≤ z ≤ ψ̄, constant obstacles, always has a solution, whether A is monotone or not. Its conditions
    of optimality are an ICP in (z, y), y = (p)⁻ being what p ≥ 0 is violated by: −Aᵀy ⟂ ψ ≤ z ≤ ψ̄ and
    y + Az + q ⟂ y ≥ 0, where p = 0 is asked for y of any sign, where p ≤ 0 is y ≤ 0. Where y is not 0 it is the y of
    `infeasible`.
    """
    rows = _Rows.of(problem)
    asked = rows.rises | rows.falls
    K = problem.A[asked]
    A = sp.block_array([[None, -K.T], [K, sp.eye_array(K.shape[0])]], format="csr")
    low = np.where(rows.falls, -np.inf, 0.0)[asked]
    high = np.where(rows.rises, np.inf, 0.0)[asked]
    q = np.concatenate([np.zeros(problem.n), problem.q[asked]])
    return ProblemData(A, q, np.concatenate([rows.low, low]), np.concatenate([rows.high, high])), asked


def multipliers(problem: ProblemData) -> Vector | None:
    """A candidate y for `infeasible`: (q + Ac)ᵀy < 0, Aᵀy ≤ 0 and 0 ≤ y ≤ 1 in floats, for constant ψ = c.

    In rows without an obstacle −1 ≤ y ≤ 1 and (Aᵀy)_i = 0, in those with one above alone −1 ≤ y ≤ 0 and (Aᵀy)_i ≥ 0,
    with both y_i = 0 and t_i ≥ 0, (Aᵀy)_i(c̄_i − c_i) is added to the sum. Of several the one with the most room for
    rounding, by linear programming (HiGHS); None where there is none, as where some z has p, r ≥ 0, or none is found in
    a second. For an affine ψ (y, x), shape (2n,).
    """
    if not problem.psi.is_constant:
        lifted = _lifted(problem)
        found = None if lifted is None else multipliers(lifted)
        return None if found is None else np.concatenate([found[2 * problem.n :], found[: problem.n]])
    from scipy.optimize import linprog

    problem, units = _in_units_of_rows(problem)
    A, n, (low, high, falls, rises) = problem.A.tocsc(), problem.n, _Rows.of(problem)
    free, both, sign = falls & rises, ~(falls | rises), np.where(falls, -1.0, 1.0)
    with np.errstate(over="ignore", invalid="ignore"):
        load = problem.p(np.where(free, 0.0, np.where(falls, high, low)))
        width = np.where(both, high - low, 1.0)[:, None]
        unit = float(np.abs(load).max()) or 1.0  # a solver takes 1e20 for infinite
        load, width = load / unit, np.where(both[:, None], width / unit, 1.0)
        size, sums = np.abs(load).sum(), abs(A).sum(axis=0) * width[:, 0]
    if not (np.isfinite(10.0 * size) and np.isfinite(sums).all() and np.isfinite(width).all()):
        return None
    # the unknowns are y, t, and the room, in shares of what the rows could be
    k, columns = int(both.sum()), sp.csr_array(A.T) * (sign[:, None] * width)
    more = -sp.eye_array(n).tocsc()[:, both]
    total = np.concatenate([load, np.ones(k), [size]])
    least = np.concatenate([np.where(falls, -1.0, 0.0), np.zeros(k + 1)])
    most = np.concatenate([np.where(rises, 1.0, 0.0), np.full(k, np.inf), [1.0]])
    found = linprog(
        np.append(total[:-1], -10.0 * size),
        A_ub=sp.vstack([sp.hstack([columns, more, sums[:, None]]).tocsr()[~free], total[None]]),
        b_ub=np.zeros(n - free.sum() + 1),
        A_eq=sp.hstack([A[:, free].T, np.zeros((free.sum(), k + 1))]),
        b_eq=np.zeros(free.sum()),
        bounds=np.column_stack([least, most]),
        options={"time_limit": _SECONDS},
    )
    return np.ldexp(found.x[:n], units) if found.status == 0 and total[:-1] @ found.x[:-1] < 0 else None


def _contradiction(problem: ProblemData, rows: _Rows, y: Combination) -> Fraction | None:
    """What (Az + q)ᵀy is at most, where it is negative and y has the right signs, in exact arithmetic; else None."""
    y = {i: weight for i, weight in y.items() if weight}
    if any(not (rows.falls if weight < 0 else rows.rises)[i] for i, weight in y.items()):
        return None
    if _is_hopeless(problem, rows, y):
        return None
    weights, A = list(y.values()), sp.csc_array(problem.A[list(y)])
    total = sum((weight * Fraction(float(problem.q[i])) for i, weight in y.items()), Fraction(0))
    for j in np.flatnonzero(np.diff(A.indptr)):  # by columns, as one that is not 0 may end it
        part = range(A.indptr[j], A.indptr[j + 1])
        entry = sum((weights[A.indices[k]] * Fraction(float(A.data[k])) for k in part), Fraction(0))
        if entry:
            end = float(rows.high[j] if entry > 0 else rows.low[j])
            if not np.isfinite(end):
                return None
            total += entry * Fraction(end)
    return total if total < 0 else None


@np.errstate(all="ignore")
def _is_hopeless(problem: ProblemData, rows: _Rows, y: Combination) -> bool:
    """Whether floats say already, beyond their rounding, that an entry of Aᵀy is on the side where z has no bound."""
    x = np.zeros(problem.n)
    x[list(y)] = [nearest(weight) for weight in y.values()]
    columns = problem.A.T @ x
    off = 4.0 * (problem.n + 4) * UNIT_ROUNDOFF * (problem.matrix.absolute.T @ np.abs(x))
    return bool(((columns > off) & np.isposinf(rows.high) | (columns < -off) & np.isneginf(rows.low)).any())


def _exact(problem: ProblemData, support: np.ndarray, y: Vector, bounds: _Rows, zero: np.ndarray) -> Combination:
    """x on the support of y with (Aᵀx)_i = 0 exactly where (Aᵀy)_i is about 0, or is to be; x_i left open is y_i."""
    with np.errstate(over="ignore", invalid="ignore"):
        tight = np.abs(problem.A.T @ y) <= _ZERO * (problem.matrix.absolute.T @ np.abs(y))
    tight[zero] = True
    tight &= ~(np.isfinite(bounds.low) & np.isfinite(bounds.high))
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


@np.errstate(all="ignore")
def _bounded(problem: ProblemData, rows: _Rows, y: Vector) -> float | None:
    """What (Az + q)ᵀx is at most, for some x next to `y`, where that is negative, all rounding being bounded."""
    used = np.flatnonzero(y)
    y, right, K = y[used], problem.q[used], problem.A[used]
    signed = ~(rows.rises & rows.falls)[used]
    size = abs(K)
    # two more than the operations of a sum, twice, as for all sums here
    loss = 2.0 * (K.shape[0] + problem.n + 4) * UNIT_ROUNDOFF
    tiny = (K.shape[0] + problem.n) * SMALLEST
    columns = K.T @ y
    off = loss * (size.T @ np.abs(y)) + tiny
    has_low, has_high, empty = np.isfinite(rows.low), np.isfinite(rows.high), size.sum(axis=0) == 0

    def sure() -> Any:
        return ((columns - off >= 0) & has_high) | ((columns + off <= 0) & has_low) | (has_low & has_high) | empty

    open_ = np.flatnonzero(~sure())
    moved = np.zeros(y.size)
    if open_.size:
        found = _moved(K, y, signed, open_, np.abs(columns[open_]) + off[open_], loss)
        if found is None:
            return None
        basis, by = found
        moved[basis] = by
        if (signed[basis] & (np.abs(y[basis]) < by)).any():
            return None
        off += 1.01 * (size.T @ moved)
        if not np.delete(sure(), open_).all():
            return None
        columns[open_] = off[open_] = 0.0
    # the most that wᵀz can be, w anywhere within `off` of the columns, and that qᵀx can be
    low, high = (np.where(np.isfinite(end), end, 0.0) for end in (rows.low, rows.high))
    reach = np.maximum(np.abs(low), np.abs(high))
    ends = np.where(columns > 0, high, low)
    most = columns @ ends + off @ reach + right @ y + np.abs(right) @ moved
    terms = (np.abs(columns) + 2.0 * off) @ reach + np.abs(right) @ (np.abs(y) + moved)
    most += 4.0 * loss * terms + tiny
    return float(most) if most < 0.0 else None


def _moved(
    K: Any, y: Vector, signed: Mask, open_: NDArray[np.intp], wrong: Vector, loss: float
) -> tuple[NDArray[np.intp], float] | None:
    """Which entries of y are moved, and by how much at the most, so that these columns of Kᵀy are exactly 0."""
    from scipy.linalg import qr

    k = open_.size
    cost = _PIVOTED * float(k) * k * y.size
    if k > y.size or cost > min(_LONGEST, work.nanoseconds_left()) or not work.fits(24.0 * k * y.size):
        return None
    work.add(cost)
    N = K[:, open_].toarray().T
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
    by = float(1.01 * np.abs(R).sum(axis=1).max() * wrong.max() / (1.0 - alpha))
    return (basis, by) if by <= _SHOWN * np.abs(y).max() else None  # farther away y would not be a witness
