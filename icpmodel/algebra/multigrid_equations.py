"""The linear systems of an active set by a Krylov method, preconditioned by V-cycles on the free rows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np
import scipy.sparse as sp

from ..numerics.arrays import Mask, Vector, norm
from ..numerics.krylov import GCR, gcr_step_cost
from ..numerics.multigrid import KRYLOV_STEPS, cycle_cost
from ..numerics.sparse_structure import is_diagonal
from ..problem.data import ProblemData
from .hierarchy import Hierarchy, Level

#: the typical number of Krylov steps for a system
_TYPICAL_STEPS = 10
#: smaller values of 1 − ∂ψ_i/∂z_i are replaced by this one
LEAST_SLOPE = 0.1


def cycles_cost(problem: ProblemData) -> float:
    """The cost of solving one system by `MultigridEquations`, with a typical number of Krylov steps."""
    return _TYPICAL_STEPS * (cycle_cost(problem.n, problem.nnz) + gcr_step_cost(problem.n, problem.nnz))


class MultigridEquations:
    """J on level `top` of a hierarchy of A, not assembled: products, V-cycles on the free rows, and solves.

    Parameters
    ----------
    hierarchy : Hierarchy
        The levels; they are restricted to the rows that are not `active`.
    top : int
        The level.
    active : mask of shape (m,)
        The active rows of that level.
    jacobian : CSR array of shape (m, m) or None
        ψ′(z), None where ψ is constant.
    """

    def __init__(self, hierarchy: Hierarchy, top: int, active: Mask, jacobian: sp.csr_array | None) -> None:
        self._hierarchy = hierarchy
        self._top = top
        self._active = active
        self._psi_jacobian = jacobian
        hierarchy.restrict(~active, top)
        psi_diagonal = 0.0 if jacobian is None else jacobian.diagonal()
        self._slope = np.maximum(1.0 - psi_diagonal, LEAST_SLOPE)
        self._psi_couples_rows = jacobian is not None and not is_diagonal(jacobian)
        #: whether each active row alone determines its own entry of x
        self._has_diagonal_rows = not self._psi_couples_rows and bool(
            np.all((self._slope == 1.0 - psi_diagonal) | ~active)
        )

    def start(self, f: Vector) -> Vector:
        """x_I = S⁻¹f_I in the active rows I, S the diagonal of I − ψ′, at least `LEAST_SLOPE`; x_F = 0 elsewhere."""
        return np.where(self._active, f / self._slope, 0.0)

    def product(self, y: Vector, transposed: bool = False) -> Vector:
        """Jy, or Jᵀy."""
        if transposed:
            y_active = np.where(self._active, y, 0.0)
            image = self._level(True).problem.product(y - y_active) + y_active
            return image if self._psi_jacobian is None else image - self._psi_jacobian.T @ y_active
        image = self._level(False).problem.product(y)
        np.copyto(image, y if self._psi_jacobian is None else y - self._psi_jacobian @ y, where=self._active)
        return image

    def preconditioned(self, f: Vector) -> Vector:
        """An approximation of J⁻¹f. If ψ′ is diagonal, f_I must be 0."""
        return self._block_solve(f, self._cycle, False) if self._psi_couples_rows else self._cycle(f)

    def solve(self, f: Vector, tolerance: float, transposed: bool = False) -> Vector:
        """x with Jx = f, or Jᵀx = f, to the relative residual `tolerance`. Raises NotConverged."""
        if self._has_diagonal_rows:
            return self._block_solve(
                f, partial(self._solve_free, tolerance=tolerance, transposed=transposed), transposed
            )
        cycle = partial(self._cycle, transposed=transposed)
        x, steps = self.steps(f, lambda residual: self._block_solve(residual, cycle, transposed), transposed)
        return steps.solve(x, tolerance * norm(self._units(transposed) * f), KRYLOV_STEPS)

    def steps(
        self, f: Vector, preconditioned: Callable[[Vector], Vector], transposed: bool = False
    ) -> tuple[Vector, GCR]:
        """`start(f)`, and a `GCR` that continues from there to the x of `solve`, its residual in the units of z."""
        units = self._units(transposed)
        x = self.start(f)
        residual = units * (f - self.product(x, transposed))
        return x, GCR(
            lambda y: units * self.product(y, transposed), lambda residual: preconditioned(residual / units), residual
        )

    def _units(self, transposed: bool) -> Vector:
        return np.ones(self._active.size) if transposed else np.where(self._active, 1.0, self._level(False).inverse)

    def _solve_free(self, f: Vector, tolerance: float, transposed: bool) -> Vector:
        """x with A_FF x_F = f_F, or with its transpose, and x_I = 0."""
        level = self._level(transposed)
        cycle = partial(self._cycle, transposed=transposed)
        f = np.where(self._active, 0.0, f)

        def product(y: Vector) -> Vector:
            return np.where(self._active, 0.0, level.problem.product(y))

        units = np.ones(f.size) if transposed else level.inverse
        steps = GCR(lambda y: units * product(y), lambda residual: cycle(residual / units), units * f)
        return steps.solve(np.zeros(f.size), tolerance * norm(steps.residual), KRYLOV_STEPS)

    def _block_solve(self, f: Vector, solve_free: Callable[[Vector], Vector], transposed: bool) -> Vector:
        """J⁻¹f or J⁻ᵀf, with `solve_free` in place of A_FF⁻¹; an approximation if ψ′ is not diagonal."""
        if transposed:
            y = solve_free(f)
            return y + self.start(f - self._level(True).problem.product(y))
        step = self.start(f)
        return step + solve_free(f - self._level(False).problem.product(step))

    def _cycle(self, f: Vector, transposed: bool = False) -> Vector:
        return self._hierarchy_for(transposed).cycle(f, self._top)

    def _level(self, transposed: bool) -> Level:
        return self._hierarchy_for(transposed).levels[self._top]

    def _hierarchy_for(self, transposed: bool) -> Hierarchy:
        return self._hierarchy.transposed if transposed else self._hierarchy
