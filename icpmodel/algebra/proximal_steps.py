"""Newton steps of the proximal subproblems p(z) + D(z − centre) ⟂ z − ψ(z), D a positive diagonal."""

from __future__ import annotations

from functools import cached_property

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import Mask, Vector, norm
from ..numerics.factorisation import factorise
from ..numerics.fill import SymbolicAnalysis
from ..numerics.linear import refine, solver_of
from ..numerics.sparse_structure import diagonal_positions
from ..numerics.symmetric_factors import SymmetricFactors
from ..problem.data import ProblemData
from .active_equations import Elimination
from .equations import Pattern, derivative, submatrix
from .factor_costs import FactorCosts, factor_costs
from .regularised_system import FIRST_REGULARISATION_SKEW

#: the largest relative residual of a solve that counts as successful
_MAX_RELATIVE_RESIDUAL = 1e-6


class ProximalSteps:
    """Newton steps of the proximal method: z = ψ(z) in the active rows of a `Pattern`, p + D(z − centre) = 0 elsewhere.

    Parameters
    ----------
    problem
        The problem; where its obstacles move, their derivatives are used.
    start
        The point at which fixed obstacles are evaluated, shape (n,).
    reorders
        Whether the free rows are factorised alone, in a new order, where the factors of all rows are too inaccurate.
    """

    def __init__(self, problem: ProblemData, start: Vector, *, reorders: bool = True) -> None:
        self.problem = problem
        self.start = start
        self.reorders = reorders
        self.has_moving_obstacle = not problem.facts.has_fixed_obstacle

    @cached_property
    def costs(self) -> FactorCosts:
        """The costs of factors of A by a complete symbolic analysis of all rows."""
        return factor_costs(self.problem.matrix).complete

    @cached_property
    def obstacles(self) -> tuple[Vector, Vector | None]:
        """ψ and ψ̄ at the start; ψ̄ is None where there is no upper obstacle."""
        upper = self.problem.upper
        return self.problem.psi.value(self.start), None if upper is None else upper.value(self.start)

    @cached_property
    def fixed_order_factors(self) -> SymmetricFactors | None:
        """The factorisation of all rows that keeps its order; None if it does not apply or a dense one costs less."""
        costs = self.costs
        signs = costs.analysis.signs
        if not costs.reuses_order or signs is None:
            return None
        return SymmetricFactors(self.problem.A, costs.fill, signs)

    def step(self, z: Vector, p: Vector, pattern: Pattern, centre: Vector, D: Vector) -> tuple[Vector, Vector] | None:
        """z and p(z) after a step from `z`, whose p(z) is `p`; None where the equations are not solved.

        Raises MapError where ψ fails.
        """
        if self.has_moving_obstacle:
            return self._moving_obstacle_step(z, p, pattern, centre, D)
        return self._fixed_obstacle_step(z, pattern, centre, D)

    def _moving_obstacle_step(
        self, z: Vector, p: Vector, pattern: Pattern, centre: Vector, D: Vector
    ) -> tuple[Vector, Vector] | None:
        """A step with the obstacle linearised at `z`."""
        J = derivative(self.problem.psi, z, pattern.above)
        equations = Elimination(self.problem, pattern.active, J, D)
        shifted_p = p + D * (z - centre)
        step = equations.solve(-np.where(pattern.active, pattern.r, shifted_p), _MAX_RELATIVE_RESIDUAL)
        return None if step is None else (z + step, self.problem.p(z + step))

    def _fixed_obstacle_step(
        self, z: Vector, pattern: Pattern, centre: Vector, D: Vector
    ) -> tuple[Vector, Vector] | None:
        """A step with a fixed obstacle."""
        active = pattern.active
        lower, upper = self.obstacles
        z = np.where(active, lower, z)
        if pattern.above is not None and upper is not None:
            z = np.where(pattern.above, upper, z)
        if not active.all():
            f = D * (centre - z) - self.problem.p(z)
            x = self._on_free_rows(active, D, np.where(active, 0.0, f))
            if x is None:
                return None
            z += x
        return z, self.problem.p(z)

    def _on_free_rows(self, active: Mask, D: Vector, f: Vector) -> Vector | None:
        """x with ((A + D)x)_i = f_i in the free rows, x_i = 0 in the others; None where the solve fails."""
        direct = self.costs.part(int(np.count_nonzero(~active)))
        if self.costs.repeated < direct:
            x = self._by_all_rows(active, D, f)
            if x is not None or not self.reorders:
                return x
        rows = np.flatnonzero(~active)
        M = submatrix(self.problem, rows)
        M.data[diagonal_positions(M)] += D[rows]
        x_free = _solution(M, f[rows])
        if x_free is None:
            return None
        x = np.zeros(f.size)
        x[rows] = x_free
        return x

    def _by_all_rows(self, active: Mask, D: Vector, f: Vector) -> Vector | None:
        """`_on_free_rows` by the factors of all rows in their fixed order."""
        if self.fixed_order_factors is None:
            return None
        problem = self.problem
        weights = problem.matrix.proximal_weights

        def multiply(x: Vector) -> Vector:
            return np.where(active, 0.0, D * x + problem.product(x))

        for shift in (0.0, FIRST_REGULARISATION_SKEW):  # rows are not exchanged: accurate factors may need a shift
            data = problem.A.data.copy()
            data[problem.matrix.rows.diag] += D + shift * weights
            factors = self.fixed_order_factors.factors(data, ~active)
            if factors is None:
                continue
            x, _, error = refine(factors.solve, multiply, f, _MAX_RELATIVE_RESIDUAL)
            if error <= _MAX_RELATIVE_RESIDUAL:
                return x
        return None


def _solution(M: sp.csr_array, f: Vector) -> Vector | None:
    """x with Mx = f, or None; factors of a definite M are tried first."""
    analysis = SymbolicAnalysis(M)
    factors = factorise(M, definite=True, analysis=analysis)
    x = None if factors is None else np.asarray(factors.solve(f))
    if x is not None and norm(M @ x - f) <= _MAX_RELATIVE_RESIDUAL * norm(f):
        return x
    return solver_of(M, analysis)(f, _MAX_RELATIVE_RESIDUAL)
