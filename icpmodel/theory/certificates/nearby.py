"""Better points ẑ near z where A is large, by Newton steps with multigrid: |z − z*| ≤ |z − ẑ| + δ(ẑ).

The proof for H₊-matrices multiplies the largest residual by v, as if it had one sign everywhere.
The residual of a computed z has both signs, so on a fine grid δ(z) is thousands of times the
error. A point ẑ that is nearer to z* avoids this, and it needs no factorisation. However good the
steps are, δ(ẑ) is a proved bound. Where δ(ẑ) ≤ θ|z − ẑ|, the sum is at most (1 + θ)/(1 − θ) times
the error.

No step is made where it would gain little. The error has a lower bound, as |F_i(z)| ≤ Σ_j|V_ij||z_j
− z*_j| for a V between A and I − Γ, and no ẑ has less rounding than z. If δ(z) is at most ten times
the larger of that lower bound and the effect of rounding, it is kept.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice

import numpy as np

from ...algebra.hierarchy import Hierarchy, NoHierarchy
from ...algebra.newton_steps import after_sweeps, newton_steps, sweep_with_flow
from ...algebra.subproblems import with_fixed_obstacle
from ...numerics.arrays import Vector
from ...problem.data import ProblemData
from .h_plus import HPlusProof
from .proof import natural_map

#: sweeps between two points where there is no hierarchy
_SWEEPS_PER_POINT = 20
#: a bound of at most this multiple of a lower bound of the error, or of rounding, is not improved
_GOOD_RATIO = 10.0


def points_near(problem: ProblemData, z: Vector, proof: HPlusProof, bound: float) -> Iterator[Vector]:
    """Yield points that are probably nearer to z* than `z`, whose own bound is `bound`; none if that is good.

    Without a multigrid hierarchy they come from sweeps, without end. Raises MapError where ψ fails, OutOfTime and
    OutOfMemory.
    """
    rounding_p, rounding_r = problem.rounding(z)
    floor = float(proof.v.max() * np.maximum(rounding_p / proof.alpha, rounding_r / proof.beta).max())
    if not (np.isfinite(z).all() and bound > _GOOD_RATIO * max(_least_error(problem, z), floor)):
        return
    fixed = with_fixed_obstacle(problem)
    sweep = sweep_with_flow(fixed)
    hierarchy = None
    if not fixed.psi.no_derivative():
        with suppress(NoHierarchy):
            hierarchy = Hierarchy(fixed)
    while hierarchy is None:  # no derivative of ψ, or no coarse levels: mostly A is so dominant that sweeps suffice
        z = after_sweeps(sweep, z, _SWEEPS_PER_POINT)
        yield z
    residuals = [np.inf, np.inf]
    for better, residual in islice(newton_steps(hierarchy, fixed, z, 0), 1, None):
        # sweeps make the largest residual, which decides, several times smaller
        yield after_sweeps(sweep, better)
        if not 2.0 * residual <= residuals[-2]:  # a change of the active set may leave the residual as large as before
            return
        residuals.append(residual)


def _least_error(problem: ProblemData, z: Vector) -> float:
    """A lower bound of max|z − z*|, up to rounding: the largest |F_i(z)| with p_i/Σ_j|a_ij| and r_i/(1 + Σ_j g_ij)."""
    rows = problem.matrix.rows
    G = problem.psi.lipschitz
    assert G is not None  # there would be no proof
    F = natural_map(problem, z, rows.off_diagonal_sums + rows.diagonal, 1.0 + G @ np.ones(problem.n))
    return float(np.abs(F).max())
