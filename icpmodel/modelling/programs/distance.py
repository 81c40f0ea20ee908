"""How far x can be from the solution of a strongly monotone variational inequality, rounding included.

Let μ > 0 be at most the least eigenvalue of (H + Hᵀ)/2. If x̂ is in C, λ ≥ 0, the forces of the bounds have their signs,
and every row and bound with a multiplier is tight at x̂, then (Hx̂ + g)ᵀ(x̂ − x*) ≤ ρᵀ(x̂ − x*) with the stationarity
ρ = Hx̂ + g + Gᵀλ + Eᵀν + box, and (Hx* + g)ᵀ(x* − x̂) ≤ 0. The sum of both is μ‖x̂ − x*‖² ≤ ‖ρ‖‖x̂ − x*‖.

Such an x̂ is near x: with the tight rows C as equations, those of G and of E, x̂ = x − Cᵀ(CCᵀ)⁻¹(Cx − d) is at most
η = ‖Cx − d‖/√θ away, where CCᵀ has no eigenvalue below θ > 0. Other rows and bounds have to have so much room.
Reference: Facchinei and Pang, Finite-Dimensional Variational Inequalities (2003), sections 2.3 and 6.2.
"""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ...errors import OutOfTime
from ...numerics.arrays import Vector, norm
from ...numerics.equilibration import in_units, symmetric_exponents
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...theory.certificates.bounds import ErrorBound
from ...theory.matrices.eigenvalue import smallest_below
from .program import Program, Values

#: rows and bounds count as tight where their slack is no more than this share of their terms
_TIGHT = 1e-9
_STRONG = "H is strongly monotone"


@np.errstate(all="ignore")
def distance(program: Program, values: Values) -> ErrorBound:
    """|x − x*| ≤ δ in every entry, if H is proved to be strongly monotone, and x to be next to a point of C."""
    if not np.isfinite(values.x).all():
        return ErrorBound.none("there is no x")
    unit = symmetric_exponents(program.H.diagonal())
    H = in_units(program.H, unit, unit)
    try:
        mu = smallest_below(H)
    except (OutOfTime, MemoryError) as error:
        return ErrorBound.none(str(error))
    if not mu > 0.0:
        return ErrorBound.none("H is not proved to be strongly monotone")
    x, nu, multiplier, box = values
    at_low = (x == program.low) & (box <= 0)
    at_high = (x == program.high) & (box >= 0)
    free = ~(at_low | at_high)
    slack, slack_error = _product(program.G, -x, program.h)
    size = np.abs(program.h) + abs(program.G) @ np.abs(x)
    tight = (multiplier > 0) | (np.abs(slack) <= _TIGHT * size)
    left, left_error = _product(program.E, -x, program.b)
    C = sp.csr_array(sp.vstack([program.E, program.G[tight]]))
    C = sp.csr_array(in_units(C, np.zeros(C.shape[0], np.int64), unit)[:, free])
    wrong = np.abs(np.concatenate([left, slack[tight]])) + np.concatenate([left_error, slack_error[tight]])
    moved = 0.0
    if wrong.any():
        row_norm = np.sqrt(np.asarray((C * C).sum(axis=1)).ravel())
        scale = symmetric_exponents(row_norm**2)
        C = in_units(C, scale, np.zeros(C.shape[1], np.int64))
        T = sp.csr_array(C @ C.T)
        rounding = 2.0 * (int(np.diff(C.indptr).max(initial=0)) + 2) * UNIT_ROUNDOFF
        theta = smallest_below(T, rounding * float((abs(C) @ (abs(C).T @ np.ones(C.shape[0]))).max(initial=0.0)))
        if not theta > 0.0:
            return ErrorBound.none("the rows that are tight are not proved to be independent", "")
        moved = 1.01 * norm(np.ldexp(wrong, scale)) / np.sqrt(theta)
    others = ~tight
    reach = np.sqrt(np.asarray(in_units(program.G * program.G, np.zeros(tight.size, np.int64), 2 * unit).sum(axis=1)))
    room = slack - slack_error - 1.01 * moved * reach.ravel()
    gaps = np.minimum(x - program.low, program.high - x) - np.ldexp(1.01 * moved, unit)
    if (room[others] < 0).any() or (gaps[free] < 0).any() or (multiplier < 0).any():
        return ErrorBound.none("x is not proved to be next to a feasible point with the same tight rows")
    rest, rest_error = _stationarity(program, x, nu, multiplier)
    rest = np.where(at_low, np.minimum(rest, 0.0), np.where(at_high, np.maximum(rest, 0.0), rest))
    rest = np.ldexp(np.abs(rest) + rest_error, unit)
    of_H = np.sqrt(float(abs(H).sum(axis=0).max()) * float(abs(H).sum(axis=1).max()))
    far = 1.01 * ((norm(rest) + of_H * moved) / mu + moved) + SMALLEST
    delta = np.nextafter(np.ldexp(np.full(x.size, far), unit), np.inf)
    proof = f"{_STRONG}, its eigenvalues being at least {mu:.3g} in units in which its diagonal is about 1"
    return ErrorBound(float(delta.max()), delta, float(delta.max()), proof, "")


def _product(M: sp.csr_array, x: Vector, right: Vector) -> tuple[Vector, Vector]:
    """Mx + right, and a bound on its rounding error."""
    size = abs(M) @ np.abs(x) + np.abs(right)
    terms = np.diff(M.indptr) + 3
    return M @ x + right, terms * (2.0 * UNIT_ROUNDOFF * size + SMALLEST)


def _stationarity(program: Program, x: Vector, nu: Vector, multiplier: Vector) -> Any:
    """Hx + g + Gᵀλ + Eᵀν and a bound on its rounding error."""
    K = sp.csr_array(sp.hstack([program.H, program.G.T, program.E.T]))
    return _product(K, np.concatenate([x, multiplier, nu]), program.g)
