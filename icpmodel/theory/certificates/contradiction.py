"""Which conditions of a problem contradict each other, by how much, and the nearest q for which they do not.

The conditions p ≥ 0 and r ≥ 0 of constant and affine obstacles are linear. Their violation is the least s ≥ 0 for
which some z meets p ≥ −s, in the units of Res_D, and r ≥ 0. A vertex of the dual of that linear program has a minimal
support: each proper subset of these conditions can be met. So no deletion filter is needed.

Reference: Gleeson and Ryan, ORSA J. Comput. 2 (1990), doi:10.1287/ijoc.2.1.61.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from fractions import Fraction
from typing import Any, NamedTuple

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ...numerics import work
from ...numerics.arrays import Mask, ReadOnly, Vector, largest_size
from ...numerics.equilibration import times_rows
from ...numerics.rational import nearest
from ...numerics.rounding import SQRT_EPSILON, public_entry
from ...present.display import Displayable, listed
from ...problem.data import ProblemData, ProblemLike, as_problem
from ..answers import Answer
from .combination_rows import MAX_COST, ZERO, CombinationRows
from .exact_combination import exact_combination, highest_value
from .infeasible import answer_of

#: linear programs with more entries are not tried: 10⁵ take about a second
_MAX_ENTRIES = 100_000
#: nanoseconds of an iteration of the simplex method, per entry and row (3 to 15 were measured with HiGHS, n = 100 to
#: 10 000)
_ITERATION_COST = 5.0


@dataclass(frozen=True, eq=False, repr=False)
class Contradiction(ReadOnly, Displayable):
    """Conditions that no z meets together, confirmed in rational arithmetic.

    Attributes
    ----------
    rows : ndarray of int, shape (k,)
        The rows of the conditions; any k − 1 of these can be met.
    conditions : tuple of str
        Each of them in words, in the same order.
    weights : ndarray, shape (k,)
        Positive weights; the weighted sum of the conditions says 0 ≥ `violation`.
    violation : float
        The least s such that |dq_i|/d_i ≤ s for some q + dq with p ≥ 0 and r ≥ 0 at some z. d is as in
        `ICP.residual`, and 1 where row i of A is 0. It is inf where the obstacles alone contradict each other.
    change : ndarray or None, shape (n,)
        Such a dq of the smallest Σ|dq_i|/d_i, up to rounding; None where there is none, and where Az overflows.
    proof : Answer
        The combination of the conditions, as in `Solution.infeasible`.

    Examples
    --------
    >>> print(icp.contradiction(ICP([[0, -1], [1, 0]], [1, -3], upper=[2, np.inf])))
    infeasible by 1: p[1] >= 0, z[0] <= upper[0]
    """

    rows: NDArray[np.intp]
    conditions: tuple[str, ...]
    weights: Vector
    violation: float
    change: Vector | None
    proof: Answer = field(repr=False)

    def __str__(self) -> str:
        how = "infeasible by its obstacles alone" if self.violation == np.inf else f"infeasible by {self.violation:.3g}"
        return f"{how}: {listed(self.conditions)}"

    def named(self, name: Callable[[int], str]) -> Contradiction:
        """The same contradiction with names of rows in place of their numbers.

        Parameters
        ----------
        name : callable
            Row → its name, such as the constraint of a model.

        Returns
        -------
        Contradiction
            A copy.

        Examples
        --------
        >>> conflict = icp.contradiction(ICP([[0]], [-2]))
        >>> print(conflict.named(["balance"].__getitem__))
        infeasible by 2: balance: p >= 0
        """
        pairs = zip(self.rows, self.conditions, strict=True)
        named = (f"{name(int(i))}: {one.replace(f'[{i}]', '')}" for i, one in pairs)
        return replace(self, conditions=tuple(named))


@public_entry
@np.errstate(all="ignore")  # what overflows proves nothing
def contradiction(problem: ProblemLike) -> Contradiction | None:
    """Find a minimal set of contradictory conditions among p ≥ 0 and r ≥ 0, and the nearest q without one.

    Parameters
    ----------
    problem : ICP, or what holds or makes one
        With constant or affine obstacles.

    Returns
    -------
    Contradiction or None
        None if there is no contradiction, or none is confirmed. None as well for other obstacles, for contradictions
        of more than 60 rows, and if the linear program has more than 10⁵ entries or takes too many iterations.

    Notes
    -----
    If A or q was made of pandas objects, the conditions have their row labels.

    Where p ≥ 0 and r ≥ 0 contradict each other there is no solution. Without a contradiction there is one where the
    obstacle is constant and A is monotone or copositive-plus; for other A there may be none.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), chapter 3.

    Examples
    --------
    >>> conflict = icp.contradiction(ICP([[0, -1], [1, 0]], [1, -1.5], upper=[1, np.inf]))
    >>> conflict.rows, conflict.violation, conflict.change
    (array([1, 0]), 0.5, array([0. , 0.5]))
    """
    problem = as_problem(problem)
    minimum = _least_violation(problem)
    if minimum is None:
        return None
    rows = minimum.rows
    exact = exact_combination(rows, minimum.y)
    highest = highest_value(rows, exact)
    if highest is None:
        return None
    total, columns = highest
    n = problem.n
    exact = {i: weight for i, weight in exact.items() if weight}
    conditions = {_condition(i // n, i % n, weight > 0): weight for i, weight in exact.items()}
    conditions |= {_condition(1, j, entry < 0): entry for j, entry in columns.items()}
    sizes = [abs(weight) / Fraction(float(minimum.units[i])) for i, weight in exact.items() if i < n]
    contradictory = Contradiction(
        rows=np.array([*(i % n for i in exact), *columns], dtype=np.intp),
        conditions=tuple(conditions),
        weights=np.array([nearest(abs(weight)) for weight in conditions.values()]),
        violation=nearest(-total / sum(sizes)) if sizes else np.inf,
        change=_change(problem, minimum) if sizes else None,
        proof=answer_of(rows, exact, total),
    )
    labels = problem.matrix.index
    return contradictory if labels is None else contradictory.named(lambda i: str(labels[i]))


def multipliers(problem: ProblemData) -> Vector | None:
    """A candidate y for `infeasible` by linear programming; None if there is none or it would cost too much.

    The columns of Mᵀy that need a sign are at least √ε from 0, if a y with Σ|y| = 1 can have that. This is far above
    rounding errors, which then cannot change a sign, and above the tolerance of HiGHS.
    """
    minimum = _least_violation(problem, SQRT_EPSILON) or _least_violation(problem)
    return None if minimum is None else minimum.y


def _condition(side: int, i: int, is_lower: bool) -> str:
    """A condition on row i of p, or of z − ψ and z − ψ̄, in words."""
    if side:
        return f"z[{i}] >= psi[{i}]" if is_lower else f"z[{i}] <= upper[{i}]"
    return f"p[{i}] >= 0" if is_lower else f"p[{i}] <= 0"


class _Minimum(NamedTuple):
    """A z that violates the conditions on `rows` by the least possible `value`, and the multipliers y of that minimum.

    Row i is taken in the units 1/`units`_i.
    """

    rows: CombinationRows
    units: Vector
    z: Vector
    y: Vector
    value: float


@np.errstate(all="ignore")
def _least_violation(problem: ProblemData, margin: float = 0.0) -> _Minimum | None:
    """The least violation of p ≥ 0 with which some z meets all conditions; of r ≥ 0 if no violation of p suffices.

    None if it is 0 and `margin` is 0, or if it was not found.
    """
    rows = CombinationRows.of(problem)
    if rows is None:
        return None
    n = problem.n
    empty = problem.matrix.empty_rows
    units = np.ones(rows.offset.size)
    units[:n] = np.where(empty, 1.0, problem.matrix.row_weights)
    of_p = np.arange(units.size) < n
    # beside the q_i of a zero row of A the bounds of z may be negligible, or q_i beside them: the linear program has no
    # zero rows
    selected = np.append(~empty, ~of_p[n:])
    minimum = _minimise(rows, units, selected, of_p, separate=margin > 0.0, margin=margin)
    if minimum is None and units.size > n:
        minimum = _minimise(rows, units, ~of_p, ~of_p)
    else:
        violation = rows.with_known_signs(np.where(empty, -problem.q, 0.0))
        i = int(np.argmax(np.abs(violation)))
        value = abs(float(violation[i]))
        if value and (margin or minimum is None or value > minimum.value):
            z = np.clip(np.zeros(n), rows.low, rows.high)
            minimum = _Minimum(rows, units, z, np.where(np.arange(units.size) == i, np.sign(violation[i]), 0.0), value)
    return minimum if minimum is not None and (margin or minimum.value > 0.0) else None


def _minimise(
    rows: CombinationRows,
    units: Vector,
    selected: Mask,
    relaxed: Mask,
    *,
    separate: bool = False,
    max_violation: float = np.inf,
    margin: float = 0,
) -> _Minimum | None:
    """Minimise Σs, 0 ≤ s ≤ `max_violation`, subject to the conditions on the `selected` rows, those `relaxed` by s.

    s is one number for all rows, or with `separate` one for each. An unknown with one bound is rewarded by `margin`
    per unit of distance from it. Then the columns of Mᵀy are at least `margin` from 0. None if it is not solved.
    """
    from scipy.optimize import linprog

    rising = np.flatnonzero(rows.nonnegative & selected)
    falling = np.flatnonzero(rows.nonpositive & selected)
    places = np.append(rising, falling)
    scale = np.append(units[rising], -units[falling])
    K = times_rows(scale, rows.matrix[places])
    right = -scale * rows.offset[places]
    E: Any = relaxed[places].astype(float)
    E = sp.diags_array(E) if separate else E[:, None]
    unit = largest_size(right, rows.low, rows.high)  # a solver takes 1e20 for infinite
    iterations = _iteration_limit(K, right)
    if iterations < 1:
        return None
    result = linprog(
        np.concatenate([margin * (np.isfinite(rows.high) * 1.0 - np.isfinite(rows.low)), np.ones(E.shape[1])]),
        A_ub=-sp.hstack([K, E]).tocsr(),
        b_ub=-right / unit,
        bounds=[*zip(rows.low / unit, rows.high / unit, strict=True), *[(0.0, max_violation / unit)] * E.shape[1]],
        method="highs-ds",
        options={"maxiter": iterations, "primal_feasibility_tolerance": 1e-10, "dual_feasibility_tolerance": 1e-10},
    )
    if result.status != 0:
        return None
    weights = -result.ineqlin.marginals
    weights[weights <= ZERO * weights.max(initial=0.0)] = 0.0
    y = np.zeros(units.size)
    np.add.at(y, places, scale * weights)
    return _Minimum(rows, units, unit * result.x[: rows.low.size], y, unit * float(result.fun))


def _change(problem: ProblemData, minimum: _Minimum) -> Vector | None:
    """The dq of least Σ|dq_i|/d_i at the least violation, or that of the z of `minimum`; None if it is not finite."""
    rows, units, z, _, value = minimum
    of_p = np.arange(units.size) < problem.n
    selected = np.append(~problem.matrix.empty_rows, ~of_p[problem.n :])
    sparse = _minimise(rows, units, selected, of_p, separate=True, max_violation=(1.0 + ZERO) * value)
    change = rows.with_known_signs(-problem.p(z if sparse is None else sparse.z))
    change[np.abs(change) * units[: problem.n] < ZERO * value] = 0.0
    return change if np.isfinite(change).all() else None


def _iteration_limit(K: sp.csr_array, right: Vector) -> int:
    """How many simplex iterations the work limit allows for Kz ≥ `right`; 0 if that is too large or not finite."""
    if K.nnz > _MAX_ENTRIES or not (np.isfinite(K.data).all() and np.isfinite(right).all()):
        return 0
    nanoseconds = work.COSTS.call + _ITERATION_COST * (K.nnz + sum(K.shape))
    return int(min(MAX_COST, work.nanoseconds_left()) / nanoseconds)
