"""A proof that no z has p(z) ≥ 0 and r(z) ≥ 0, for constant and affine ψ: a combination of the rows that says 0 < 0.

With y ≥ 0, Aᵀy ≤ 0 and (q + Ac)ᵀy < 0 every z ≥ c has (Az + q)ᵀy ≤ (Ac + q)ᵀy < 0 (Farkas). In rows
without an obstacle p = 0 is required, and c counts as 0. There y may have either sign and (Aᵀy)_i
must be 0.

For some unknowns an interval may be known that contains every solution. Then (Aᵀy)_j z_j is at most
its largest value there, whatever the sign of (Aᵀy)_j. That proves that no z solves the problem,
though one may have p ≥ 0 and r ≥ 0. An obstacle above, ψ̄ = c̄, is such an interval: z ≤ c̄. In
rows that have it nothing is known of p ≥ 0, so y_i ≤ 0 there. y_i = 0 where there is one below as
well. Then (Az + q)ᵀy ≥ 0 at every solution as before.

For ψ(z) = Gz + c the rows of r get weights as well: x, y ≥ 0, Aᵀy + (I − G)ᵀx = 0 and qᵀy − cᵀx <
0. That is the same for the constant obstacle s ≥ 0 in the unknowns (z, u, s), with the equations u
= Gz + c and s = z − u. No entry of I − G is rounded.

References
----------
Cottle, Pang and Stone, The Linear Complementarity Problem (1992), sections 2.7 and 4.4.
"""

from __future__ import annotations

from dataclasses import replace
from fractions import Fraction
from typing import Any

import numpy as np

from ...numerics.arrays import Vector
from ...numerics.equilibration import Exponents, in_units_exactly
from ...numerics.rational import as_witness, nearest
from ...problem.data import ProblemData
from ..answers import Answer
from .combination_rows import ZERO, CombinationRows, Known, lifted
from .exact_combination import candidates_near, contradiction
from .rounded_combination import rounded_combination

_ONE_SIZE = 10  #: rows whose entries are within 2 to this number, one way or the other, have one size


def infeasible(problem: ProblemData, y: Vector, known: Known | None = None, *, bounded: bool = True) -> Answer:
    """Whether `y`, or an exact y next to it, is such a combination, given what is `known`; its scale says nothing.

    Often Aᵀy is 0 in many rows, which floats seldom hold: tried are the simple fractions next to `y`, `y` itself, and
    where up to 30 of its entries are not 0 the exact solution of these equations. All is checked in rational
    arithmetic, or, where that is not to be had and `bounded`, in floats with a bound on every rounding error. Returns
    True with the witness y, floats or fractions, and `number`, which (Az + q)ᵀy is at most, without an obstacle above
    (q + Ac)ᵀy; else None. For an affine ψ `y` and the witness are (y, x), shape (2n,).
    """
    given = problem
    unknown = Answer(None, "no combination of the rows was found that contradicts itself")
    if not problem.psi.is_constant:
        higher = lifted(problem)
        if higher is None or y.size != 2 * problem.n:
            return unknown
        return _lowered(infeasible(higher, np.concatenate([y[problem.n :], y[problem.n :], y[: problem.n]])))
    if not np.isfinite(y).all() or not y.any():
        return unknown
    problem, units = in_units_of_rows(problem)
    rows = CombinationRows.of(problem, known)
    y = np.ldexp(y / np.abs(y).max(), -units)
    if not y.any():
        return unknown
    free = rows.falls & rows.rises
    y = y / np.abs(y).max()
    y = np.where((rows.rises & (y > ZERO)) | (rows.falls & (y < -ZERO)), y, 0.0)
    for found in candidates_near(problem, y, np.flatnonzero((y != 0) | free), rows):
        exact = contradiction(problem, rows, found)
        if exact is not None:
            break
    else:
        number = rounded_combination(problem, rows, y) if bounded else None
        if number is None:
            return unknown
        top = int(units[y != 0].max())
        y = np.ldexp(y, units - top)
        number = float(np.ldexp(number, -top))
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
    y = as_witness(witness, lambda x: contradiction(given, rows, dict(enumerate(x))) is not None)
    return Answer(True, reason, y, number)


def in_units_of_rows(problem: ProblemData) -> tuple[ProblemData, Exponents]:
    """The problem with its rows times 2^e, so that the largest |entry| of each is about 1, and e.

    In a row without entries |q_i| becomes about as large as in the others. The result is the
    problem itself and zeros where that would round, or where all are within 2^±10 already.
    """
    empty = problem.matrix.empty_rows
    of_q = np.abs(problem.q)
    weights = problem.matrix.row_weights
    with np.errstate(over="ignore"):
        others = float((weights[~empty] * of_q[~empty]).max(initial=0.0)) or 1.0
    size = np.where(empty, of_q / others, 1.0 / weights)
    exponents = -np.frexp(size)[1].astype(np.int64)
    none = np.zeros(problem.n, dtype=np.int64)
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
