"""A proof that no z has p(z) ≥ 0 and r(z) ≥ 0, for constant and affine ψ: a combination of the rows that says 0 < 0.

With y ≥ 0, Aᵀy ≤ 0 and (q + Ac)ᵀy < 0, every z ≥ c has (Az + q)ᵀy ≤ (Ac + q)ᵀy < 0 (Farkas). In
rows without an obstacle p = 0 is required, and c counts as 0. There y may have either sign and
(Aᵀy)_i must be 0.

If an interval is known that contains z_j at every solution, (Aᵀy)_j z_j is at most its largest value
there, whatever the sign of (Aᵀy)_j. That proves that no z solves the problem, though one may have
p ≥ 0 and r ≥ 0. An upper obstacle ψ̄ = c̄ gives such an interval: z ≤ c̄. A row with an upper obstacle
only has p_i ≤ 0 at every solution, so y_i ≤ 0. In a row with both obstacles p_i may have either sign,
so y_i = 0. Then (Az + q)ᵀy ≥ 0 at every solution as before.

For ψ(z) = Gz + c the rows of r get weights as well: x, y ≥ 0, Aᵀy + (I − G)ᵀx = 0 and qᵀy − cᵀx <
0. If an upper obstacle depends on z, its rows z − ψ̄ ≤ 0 get weights ≤ 0. No entry of I − G is
rounded.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (1992), sections 2.7 and 4.4.
"""

from __future__ import annotations

from collections.abc import Callable
from fractions import Fraction
from typing import Any

import numpy as np

from ...algebra.subproblems import redundant_values, with_fixed_obstacle
from ...numerics.arrays import Vector
from ...numerics.rational import as_witness, nearest
from ...numerics.rounding import rounded_up
from ...problem.data import ProblemData
from ..answers import Answer
from .combination_rows import ZERO, CombinationRows, ProvedBounds
from .exact_combination import Combination, candidates_near, highest_value
from .rounded_combination import rounded_combination

#: rows that fit in a sentence
_MAX_SHOWN = 4


@np.errstate(all="ignore")  # what overflows proves nothing
def infeasible(problem: ProblemData, y: Vector, known: ProvedBounds | None = None, *, accurate: bool = True) -> Answer:
    """Whether `y`, or a combination near it, proves infeasibility, given the bounds `known`; its scale is irrelevant.

    Often Aᵀy has to be 0 in many rows, which floats seldom satisfy. So simple fractions near `y` are tried, and `y`
    itself. If `y` is `accurate` up to rounding and has at most 60 nonzero entries, the exact solution of these
    equations is tried too. All are checked in rational arithmetic. If none is a proof and `y` is accurate, floats
    with a bound on every rounding error are used. The answer is True or None. Its witness is y, in floats or fractions,
    and `number` is an upper bound of (Az + q)ᵀy; without an upper obstacle it is (q + Ac)ᵀy. If obstacles depend on z,
    `y` and the witness are (y, x), shape (2n,), with an upper obstacle (y, x, x̄).
    """
    unknown = Answer(None, "no combination of the rows was found that contradicts itself")
    rows = CombinationRows.of(problem, known)
    if rows is None or y.size != rows.offset.size or not np.isfinite(y).all():
        return unknown
    y = rows.with_known_signs(y)
    largest = abs(rows.matrix).max(axis=1).toarray().reshape(-1)
    size = np.where(largest > 0.0, largest, np.where(rows.offset != 0.0, np.abs(rows.offset), 1.0))
    # row i times 2^exponent_i has entries of about 1, and the weight share_i in these units
    exponents = -np.frexp(size)[1].astype(np.int64)
    shares = np.ldexp(y, -exponents)
    if not shares.any() or not np.isfinite(shares).all():
        return unknown
    shares = shares / np.abs(shares).max()
    shares[np.abs(shares) <= ZERO] = 0.0
    top = int(exponents[shares != 0.0].max())
    for exact in candidates_near(rows, shares, exponents - top, solves=accurate):
        if (highest := highest_value(rows, exact)) is not None:
            return answer_of(rows, exact, highest[0], known)
    value = rounded_combination(rows, shares, exponents) if accurate else None
    if value is None:
        return unknown
    number = float(np.ldexp(value, -top))
    y = np.ldexp(shares, exponents - top)
    nearby = f"{combination_text(y, rows.name)}, or a combination next to that, is at most {rounded_up(number)}"
    return Answer(True, f"no z is a solution: {nearby}, every rounding error being bounded", y, number)


def infeasible_as_given(problem: ProblemData, answer: Answer) -> Answer:
    """Turn an `answer` for `problem` without its redundant rows into one for `problem` itself, if its y proves that.

    If the proof needs the values of the redundant unknowns, its reason says so. Else `answer` is returned as it is.
    """
    fixed = with_fixed_obstacle(problem)
    c = redundant_values(fixed)
    known = np.isfinite(c)
    y = np.where(known, 0.0, [float(weight) for weight in answer.witness])
    bounds = ProvedBounds(np.where(known, c, -np.inf), np.where(known, c, np.inf), "their p has one sign anywhere")
    for whole in (infeasible(fixed, y), infeasible(fixed, y, bounds)):
        if whole.holds:
            return whole
    return answer


def answer_of(rows: CombinationRows, exact: Combination, value: Fraction, known: ProvedBounds | None = None) -> Answer:
    """The answer True, from an `exact` combination of the value `value` < 0."""
    weights = [exact.get(i, Fraction(0)) for i in range(rows.offset.size)]
    witness = as_witness(weights, lambda x: highest_value(rows, dict(enumerate(x))) is not None)
    number = nearest(value)
    return Answer(True, _reason(rows, known, weights, number), witness, number)


def _reason(rows: CombinationRows, known: ProvedBounds | None, y: Any, number: float) -> str:
    """The contradiction that the combination `y` proves, in words."""
    sums = f"{combination_text(y, rows.name)} is at most {rounded_up(number)}"
    if known is not None:
        return (
            f"no z is a solution: with the proved values of other unknowns ({known.proof}) {sums}, which p >= 0 forbids"
        )
    if rows.nonpositive.any():
        signs = "p >= 0 where nothing is above and p <= 0 where nothing is below"
        return f"no z with psi <= z <= upper has {signs}: {sums}, and with these signs it is >= 0"
    return f"no z has Az + q >= 0 and z >= psi(z): wherever z >= psi(z), {sums}, and with Az + q >= 0 it is >= 0"


def combination_text(y: Any, name: Callable[[int], str]) -> str:
    """The weights of a combination and the names of its rows, by `name`: as many as fit in a sentence."""
    used = [i for i, weight in enumerate(y) if weight]
    first = " and ".join(f"{_weight_text(y[i])} times {name(i)}" for i in used[:_MAX_SHOWN])
    return first + (f" and {len(used) - _MAX_SHOWN} rows more" if len(used) > _MAX_SHOWN else "")


def _weight_text(weight: Any) -> str:
    """A weight as a fraction or as a rounded decimal, whichever is shorter."""
    return min(str(Fraction(weight)), f"about {nearest(weight):.4g}", key=len)
