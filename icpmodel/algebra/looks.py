"""Inexact Newton steps on the modulus equation by multigrid, and a look at the active set between them.

1. Sweeps of projected Gauss–Seidel move the border of the active set,
2. the active rows take z = ψ(z), linearised,
3. a few steps of a Krylov method (GCR), preconditioned by V-cycles on the free rows, reduce Az + q there.

Reference: Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), for the active sets; Eisenstat, Elman and Schultz,
SIAM J. Numer. Anal. 20 (1983), for GCR.
"""

from __future__ import annotations

from collections.abc import Generator

import numpy as np

from ..numerics import work
from ..numerics.arrays import Vector, inner, norm
from ..problem.between import mid
from ..problem.data import ProblemData
from .equations import Pattern, derivative
from .hierarchy import Hierarchy, Level
from .steps import Step, compiled_step, in_a_row

#: sweeps where the active set has moved
SWEEPS = 4
#: Krylov steps between two looks at the active set: until the rest has fallen to a share, and at the most
_SHARE, _KRYLOV = 0.1, 8
#: entries above the diagonal that weigh so much more than those below make the sweeps go backwards
_FLOW = 1.1
#: ψ_i is not followed where 1 − ∂ψ_i/∂z_i is smaller
_LEAST_SLOPE = 0.1


def newton_looks(
    hierarchy: Hierarchy, problem: ProblemData, z: Vector, top: int
) -> Generator[tuple[Vector, float], float | None, None]:
    """Newton's steps on level `top` of `hierarchy`, whose problem is `problem`: (z, residual) after each look.

    What is sent is the share of Az + q that the next steps are to leave in the free rows, 0.1 where nothing is.
    """
    level, moves = hierarchy.levels[top], not problem.psi.is_constant
    omega, sweep = level.diagonal, projected_sweep(problem, level)
    newton: _NewtonStep | None = None
    while True:
        p = problem.p(z)
        if moves:
            # which obstacle a row is held by is told by the sign of p
            own = derivative(problem.psi, z, None if problem.upper is None else p < 0).diagonal()
            # p and r then change alike with z_i
            omega = level.diagonal / np.maximum(1.0 - own, _LEAST_SLOPE)
        pattern = Pattern.at(problem, z, p, omega)
        work.add(0.5 * work.COSTS.newton)
        if newton is None or not pattern.is_that_of(newton.pattern):
            z = swept(sweep, z, SWEEPS)
            p = problem.p(z)
            pattern = Pattern.at(problem, z, p, omega)
        share = (yield z, norm(mid(p, problem.r(z), problem.r_upper(z)))) or _SHARE
        if newton is None or moves or not pattern.is_that_of(newton.pattern):
            newton = _NewtonStep(hierarchy, problem, top, pattern, z, p)
            z, _ = newton.further(newton.start, share)
        else:
            z, moved = newton.further(z, share)
            if not moved:
                return


def projected_sweep(problem: ProblemData, level: Level) -> Step:
    """Projected Gauss–Seidel, from the last row to the first where what flows through A flows that way."""
    A, rows = level.A, level.rows
    downwards = rows.upper <= _FLOW * rows.lower
    matrix = (A.indptr, A.indices, A.data, rows.diag, problem.q)
    reach = rows.above if downwards else None
    return compiled_step(problem, "in_order", matrix, ((1.0,), downwards), reach=reach)


def swept(sweep: Step, z: Vector, count: int) -> Vector:
    """`z` after `count` sweeps."""
    while count > 0:
        sweeps = in_a_row(sweep, z, count)
        z, count = sweeps[-1][0], count - len(sweeps)
    return z


class _NewtonStep:
    """One linear system: (I − ψ′)z = … in the active rows, Az + q = 0 in the others. It may be gone on with."""

    def __init__(
        self, hierarchy: Hierarchy, problem: ProblemData, top: int, pattern: Pattern, z: Vector, p: Vector
    ) -> None:
        self.hierarchy, self.problem, self.top, self.pattern = hierarchy, problem, top, pattern
        r, self.active, above = pattern
        active = self.active
        hierarchy.restrict(~active, top)
        self.J = None if problem.psi.is_constant else derivative(problem.psi, z, above)
        own = 0.0 if self.J is None else self.J.diagonal()
        self.slope = np.maximum(1.0 - own, _LEAST_SLOPE)
        self.coupled = self.J is not None and self.J.nnz > np.count_nonzero(own)
        step = np.where(active, -r / self.slope, 0.0)
        self.start = z + step
        self.rest = np.where(active, -r, -p) - self._product(step)
        self.directions: list[tuple[Vector, Vector]] = []

    def further(self, z: Vector, share: float) -> tuple[Vector, bool]:
        """`z` after some steps of GCR, and whether any was made: each reduces ‖rest‖₂ as the last directions allow."""
        wanted, moved = share * norm(self.rest), False
        for _ in range(_KRYLOV):
            y = self._preconditioned(self.rest)
            w = self._product(y)
            for direction, image in self.directions:
                share = inner(w, image)
                w -= share * image
                y -= share * direction
            size = norm(w)
            if not 0 < size < np.inf:
                break
            y /= size
            w /= size
            self.directions = [*self.directions[1 - _KRYLOV :], (y, w)]
            share = inner(self.rest, w)
            z, moved = z + share * y, True
            self.rest = self.rest - share * w
            if norm(self.rest) <= wanted:
                break
        return z, moved

    def _preconditioned(self, f: Vector) -> Vector:
        if not self.coupled:
            return self.hierarchy.cycle(f, self.top)
        step = np.where(self.active, f / self.slope, 0.0)
        return step + self.hierarchy.cycle(f - self.problem.product(step), self.top)

    def _product(self, y: Vector) -> Vector:
        """The matrix of the system times `y`."""
        image = self.problem.product(y)
        if self.J is None:
            return np.where(self.active, y, image)
        return np.where(self.active, y - self.J @ y, image)
