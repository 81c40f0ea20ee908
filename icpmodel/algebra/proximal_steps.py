"""Newton steps of the proximal subproblems p(z) + D(z − centre) ⟂ z − ψ(z), D a positive diagonal."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from .active_equations import Elimination
from .equations import Pattern, ShiftedEquations, derivative

#: the relative residual up to which a solve counts as one
_MAX_RELATIVE_RESIDUAL = 1e-6


class ProximalSteps:
    """Newton steps of the proximal method: z = ψ(z) in the active rows of a `Pattern`, p + D(z − centre) = 0 elsewhere.

    Parameters
    ----------
    problem
        The problem; where its obstacles move, their derivatives are used.
    start
        Where the values of fixed obstacles are read, shape (n,).
    """

    def __init__(self, problem: ProblemData, start: Vector) -> None:
        self.problem = problem
        self.start = start
        self.moves = not problem.facts.has_fixed_obstacle
        self.equations = ShiftedEquations(problem)

    @cached_property
    def obstacles(self) -> tuple[Vector, Vector | None]:
        """ψ and ψ̄ at the start, None where there is no upper obstacle."""
        upper = self.problem.upper
        return self.problem.psi.value(self.start), None if upper is None else upper.value(self.start)

    def step(
        self, z: Vector, p: Vector, pattern: Pattern, centre: Vector, D: Vector, *, briefly: bool = False
    ) -> tuple[Vector, Vector] | None:
        """z and p after a step from `z`, where p is `p`; None where the equations are not solved.

        With `briefly` the free rows alone are not factorised where all rows have been. Raises MapError where ψ fails.
        """
        if self.moves:
            return self._newton(z, p, pattern, centre, D)
        return self._resting(z, pattern, centre, D, briefly)

    def _newton(
        self, z: Vector, p: Vector, pattern: Pattern, centre: Vector, D: Vector
    ) -> tuple[Vector, Vector] | None:
        """A step that follows the obstacle by its derivative."""
        J = derivative(self.problem.psi, z, pattern.above)
        equations = Elimination(self.problem, pattern.active, J, D)
        pull = p + D * (z - centre)
        step = equations.solve(-np.where(pattern.active, pattern.r, pull), _MAX_RELATIVE_RESIDUAL, transposed=False)
        return None if step is None else (z + step, self.problem.p(z + step))

    def _resting(
        self, z: Vector, pattern: Pattern, centre: Vector, D: Vector, briefly: bool
    ) -> tuple[Vector, Vector] | None:
        """A step with a fixed obstacle."""
        active = pattern.active
        c, top = self.obstacles
        z = np.where(active, c, z)
        if pattern.above is not None and top is not None:
            z = np.where(pattern.above, top, z)
        if not active.all():
            f = D * (centre - z) - self.problem.p(z)
            x = self.equations.solve(~active, D, f, _MAX_RELATIVE_RESIDUAL, briefly=briefly)
            if x is None:
                return None
            z += x
        return z, self.problem.p(z)
