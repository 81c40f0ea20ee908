"""How far x can be from the solution of a strongly monotone variational inequality, rounding included.

Let μ > 0 be at most the least eigenvalue of (H + Hᵀ)/2. Let x̂ be in C, λ ≥ 0, the multipliers of bounds have their
signs, and all rows and bounds with a multiplier be tight at x̂. Then (Hx̂ + g)ᵀ(x̂ − x*) ≤ ρᵀ(x̂ − x*) with the
stationarity ρ = Hx̂ + g + Gᵀλ + Eᵀν + box. Moreover (Hx* + g)ᵀ(x* − x̂) ≤ 0. The sum is μ‖x̂ − x*‖² ≤ ‖ρ‖‖x̂ − x*‖.

Such an x̂ is near x. Let Cx̂ = d be the rows of E and the tight rows of G, and let CCᵀ have no eigenvalue below θ > 0.
Then x̂ = x − Cᵀ(CCᵀ)⁻¹(Cx − d) is at most η = ‖Cx − d‖/√θ away. Other rows and bounds need that much room.
Reference: Facchinei and Pang, Finite-Dimensional Variational Inequalities (2003), sections 2.3 and 6.2.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Mask, Vector, norm
from ...numerics.equilibration import Exponents, in_units, symmetric_exponents
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...theory.certificates.bounds import ErrorBound
from ...theory.matrices.eigenvalue import smallest_below
from .program import Program, Values, conditions_of

#: rows and bounds count as tight where their slack is no more than this share of their terms
_TIGHT_SLACK = 1e-9
_STRONG = "H is strongly monotone"


@np.errstate(all="ignore")
def distance(program: Program, values: Values) -> ErrorBound:
    """|x − x*| ≤ δ in every entry, if H is proved to be strongly monotone, and x to be next to a point of C.

    Raises OutOfTime, MemoryError.
    """
    x = values.x
    if not np.isfinite(x).all():
        return ErrorBound.none("there is no x")
    unit = symmetric_exponents(program.H.diagonal())
    H = in_units(program.H, unit, unit)
    mu = smallest_below(H)
    if not mu > 0.0:
        return ErrorBound.none("H is not proved to be strongly monotone")
    at_low = (x == program.low) & (values.box <= 0)
    at_high = (x == program.high) & (values.box >= 0)
    conditions = conditions_of(program)
    z = np.concatenate([x, values.equality, values.inequality])
    p = conditions.p(z)
    error = conditions.rounding(z)[0]
    n = x.size
    p[n + program.b.size :][np.isposinf(program.h)] = np.inf
    moved = _to_feasible(program, values, p[n:], error[n:], ~(at_low | at_high), unit)
    if moved is None:
        return ErrorBound.none("x is not proved to be next to a feasible point where the tight rows are independent")
    p = np.where(at_low, np.minimum(p[:n], 0.0), p[:n])
    p = np.where(at_high, np.maximum(p, 0.0), p)
    misfit = norm(np.ldexp(np.abs(p) + error[:n], unit)) + _norm_bound(H) * moved
    far = 1.01 * (misfit / mu + moved) + SMALLEST
    delta = np.nextafter(np.ldexp(np.full(x.size, far), unit), np.inf)
    proof = f"{_STRONG}, its eigenvalues being at least {mu:.3g} in units in which its diagonal is about 1"
    largest = float(delta.max())
    return ErrorBound(largest, delta, largest, proof, "")


def _norm_bound(H: sp.csr_array) -> float:
    """√(‖H‖₁‖H‖_∞) ≥ ‖H‖₂."""
    size = abs(H)
    return float(np.sqrt(float(size.sum(axis=0).max()) * float(size.sum(axis=1).max())))


def _to_feasible(
    program: Program, values: Values, slack: Vector, error: Vector, free: Mask, unit: Exponents
) -> float | None:
    """The distance to a feasible point with the same tight rows and bounds in units 2^`unit`; None where not proved."""
    x = values.x
    equations = program.b.size
    C = in_units(sp.csr_array(sp.vstack([program.E, program.G])), np.zeros(slack.size, np.int64), unit)
    tight = np.arange(slack.size) < equations
    size = np.where(np.isposinf(program.h), 0.0, np.abs(program.h) + abs(program.G) @ np.abs(x))
    tight[equations:] = (values.inequality > 0) | (np.abs(slack[equations:]) <= _TIGHT_SLACK * size)
    moved = _distance_bound(sp.csr_array(C[tight][:, free]), (np.abs(slack) + error)[tight])
    if moved is None:
        return None
    room = slack - error - moved * np.sqrt((C * C).sum(axis=1))
    gaps = np.minimum(x - program.low, program.high - x) - np.ldexp(moved, unit)
    holds = (room[~tight] >= 0).all() and (gaps[free] >= 0).all() and (values.inequality >= 0).all()
    return moved if holds else None


def _distance_bound(C: sp.csr_array, misfit: Vector) -> float | None:
    """A bound on the distance to the points with Cx = d, if |Cx − d| ≤ `misfit`; None if there is none."""
    if not misfit.any():
        return 0.0
    scale = symmetric_exponents((C * C).sum(axis=1))
    C = in_units(C, scale)
    rounding = 2.0 * (int(np.diff(C.indptr).max(initial=0)) + 2) * UNIT_ROUNDOFF
    size = abs(C)
    theta = smallest_below(sp.csr_array(C @ C.T), rounding * float((size @ size.T).sum(axis=1).max(initial=0.0)))
    return 1.01 * float(norm(np.ldexp(misfit, scale)) / np.sqrt(theta)) if theta > 0.0 else None
