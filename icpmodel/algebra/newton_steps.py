"""Inexact Newton steps on the modulus equation by multigrid; the active set is updated between them.

1. Sweeps of projected Gauss–Seidel move the border of the active set.
2. The active rows take z = ψ(z), linearised.
3. A few steps of a Krylov method (GCR), preconditioned by V-cycles on the free rows, reduce Az + q there.

References
----------
Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), for the active sets. Eisenstat, Elman and Schultz, SIAM J.
Numer. Anal. 20 (1983), for GCR.
"""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..numerics import work
from ..numerics.arrays import Vector, norm
from ..numerics.krylov import GCR, MAX_DIRECTIONS
from ..problem.data import ProblemData
from .equations import Pattern, derivative
from .hierarchy import Hierarchy
from .multigrid_equations import LEAST_SLOPE, MultigridEquations
from .steps import INNER_REDUCTION, SWEEPS, Step, projected_sweep, repeated_steps

#: the largest number of Krylov steps between two updates of the active set: GCR keeps all their directions
MAX_KRYLOV_STEPS = MAX_DIRECTIONS
#: sweeps go backwards where the sum of |entries| above the diagonal is more than this multiple of that below
_MIN_UPWARD_FLOW = 1.1


def newton_steps(hierarchy: Hierarchy, problem: ProblemData, z: Vector, top: int) -> Iterator[tuple[Vector, float]]:
    """Yield (z, residual) after each Newton step on level `top` of `hierarchy`, whose problem is `problem`.

    Ends where a step changes neither z nor the active set.
    """
    level = hierarchy.levels[top]
    has_moving_obstacle = not problem.psi.is_constant
    omega = level.diagonal
    sweep = sweep_with_flow(problem)
    krylov: GCR | None = None
    last_pattern: Pattern | None = None
    # where the active set has moved, and at first, sweeps move its border further
    z = after_sweeps(sweep, z)
    while True:
        p = problem.p(z)
        if has_moving_obstacle:
            # the sign of p tells which obstacle may be active in a row
            slopes = derivative(problem.psi, z, None if problem.upper is None else p < 0).diagonal()
            # with this Ω, p and Ωr change alike with z_i
            omega = level.diagonal / np.maximum(1.0 - slopes, LEAST_SLOPE)
        pattern = Pattern.at(problem, z, p, omega)
        work.count(0.5 * work.COSTS.newton)
        if last_pattern is not None and not pattern.same_sides(last_pattern):
            z = after_sweeps(sweep, z)
            krylov = None  # its residual is that of the z before the sweeps
            p = problem.p(z)
            pattern = Pattern.at(problem, z, p, omega)
        yield z, problem.residual_of(p, problem.r(z), problem.r_upper(z))
        is_new = krylov is None or last_pattern is None or has_moving_obstacle or not pattern.same_sides(last_pattern)
        if krylov is None or is_new:
            last_pattern = pattern
            J = derivative(problem.psi, z, pattern.above) if has_moving_obstacle else None
            equations = MultigridEquations(hierarchy, top, pattern.active, J)
            step, krylov = equations.steps(-np.where(pattern.active, pattern.r, p), equations.preconditioned)
            z = z + step
        z, moved = krylov.iterate(z, INNER_REDUCTION * norm(krylov.residual), MAX_KRYLOV_STEPS)
        if not (moved or is_new):
            return


def sweep_with_flow(problem: ProblemData) -> Step:
    """Projected Gauss–Seidel in the direction of the flow in A: backwards if the upper triangle is heavier."""
    rows = problem.matrix.rows
    return projected_sweep(problem, forward=rows.upper <= _MIN_UPWARD_FLOW * rows.lower)


def after_sweeps(sweep: Step, z: Vector, count: int = SWEEPS) -> Vector:
    """`z` after `count` sweeps."""
    while count > 0:
        sweeps = repeated_steps(sweep, z, count)
        z = sweeps[-1][0]
        count -= len(sweeps)
    return z
