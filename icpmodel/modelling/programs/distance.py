"""Bound the distance from x to the solution of a strongly monotone variational inequality, rounding included.

Let μ > 0 be at most the least eigenvalue of (H + Hᵀ)/2. Let x̂ be in C, λ ≥ 0, the multipliers of bounds have their
signs, and all rows and bounds with a multiplier be tight at x̂. Then (Hx̂ + g)ᵀ(x̂ − x*) ≤ ρᵀ(x̂ − x*) with the residual
of stationarity ρ = Hx̂ + g + Gᵀλ + Eᵀν + box. Moreover (Hx* + g)ᵀ(x* − x̂) ≤ 0. The sum gives μ‖x̂ − x*‖² ≤ ‖ρ‖‖x̂ − x*‖.

Such an x̂ is near x. Let Cx̂ = d be the rows of E and the tight rows of G, and let CCᵀ have no eigenvalue below θ > 0.
Then x̂ = x − Cᵀ(CCᵀ)⁻¹(Cx − d) is at most η = ‖Cx − d‖/√θ away. Other rows and bounds must leave room for this move.
Reference: Facchinei and Pang, Finite-Dimensional Variational Inequalities (2003), sections 2.3 and 6.2.
"""

from __future__ import annotations

import numpy as np
import scipy.sparse as sp

from ...numerics.arrays import Mask, Vector, norm
from ...numerics.equilibration import Exponents, in_units, symmetric_exponents
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...theory.certificates.bounds import ErrorBound
from ...theory.certificates.combination_rows import ZERO
from ...theory.matrices.eigenvalue import smallest_below
from .program import Program, conditions_of


@np.errstate(all="ignore")
def distance(program: Program, x: Vector, multiplier: Vector) -> ErrorBound:
    """Bound |x − x*| in every entry, if H is proved to be strongly monotone, and x to be near a point of C.

    Otherwise the result has no bound, but a reason. Raises OutOfTime and MemoryError.
    """
    n = x.size
    if not np.isfinite(x).all():
        return ErrorBound.none("there is no x")
    unit = symmetric_exponents(program.H.diagonal())
    H = in_units(program.H, unit, unit)
    mu = smallest_below(H)
    if not mu > 0.0:
        return ErrorBound.none("H is not proved to be strongly monotone")
    conditions = conditions_of(program)
    z = np.concatenate([x, multiplier])
    p = conditions.p(z)
    error = conditions.rounding(z)[0]
    at_low = x == program.low
    at_high = x == program.high
    moved = _to_feasible(program, x, multiplier, p[n:], error[n:], ~(at_low | at_high), unit)
    if moved is None:
        return ErrorBound.none("x is not proved to be next to a feasible point where the tight rows are independent")
    p = np.where(at_low, np.minimum(p[:n], 0.0), p[:n])
    p = np.where(at_high, np.maximum(p, 0.0), p)
    misfit = norm(np.ldexp(np.abs(p) + error[:n], unit)) + norm(H.data) * moved
    far = 1.01 * (misfit / mu + moved) + SMALLEST
    delta = np.nextafter(np.ldexp(np.full(n, far), unit), np.inf)
    proof = f"H is strongly monotone, its eigenvalues being at least {mu:.3g} in units in which its diagonal is about 1"
    largest = float(delta.max())
    return ErrorBound(largest, delta, largest, proof, "")


def _to_feasible(
    program: Program, x: Vector, multiplier: Vector, slack: Vector, error: Vector, free: Mask, unit: Exponents
) -> float | None:
    """A bound on the distance, in units 2^`unit`, to a feasible point with the same tight rows and bounds, or None.

    `slack` is d − Cx up to `error`.
    """
    size = np.abs(program.d) + abs(program.C) @ np.abs(x)
    tight = (multiplier > 0) | (np.abs(slack) <= ZERO * size)
    tight[: program.equations] = True
    C = in_units(program.C, np.zeros(slack.size, np.int64), unit)
    part = sp.csr_array(C[tight][:, free])
    misfit = (np.abs(slack) + error)[tight]
    moved = 0.0
    if misfit.any():
        scale = symmetric_exponents((part * part).sum(axis=1))
        part = in_units(part, scale)
        # the rows have norms of √2 at most
        terms = 2.0 * misfit.size * (int(np.diff(part.indptr).max()) + 2)
        theta = smallest_below(sp.csr_array(part @ part.T), 2.0 * UNIT_ROUNDOFF * terms)
        if not theta > 0.0:
            return None
        moved = 1.01 * float(norm(np.ldexp(misfit, scale)) / np.sqrt(theta))
    room = slack - error - moved * np.sqrt((C * C).sum(axis=1))
    gaps = np.minimum(x - program.low, program.high - x) - np.ldexp(moved, unit)
    return moved if (room[~tight] >= 0).all() and (gaps[free] >= 0).all() else None
