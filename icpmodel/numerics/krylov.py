"""Krylov methods for linear systems, and the couplings of rows, whose spectral radius says how hard these are."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy.sparse as sp

from . import work
from .arrays import Vector, inner, norm, with_entries
from .rounding import UNIT_ROUNDOFF

#: nanoseconds to find a_ji, in rows of thousands of entries
_COUPLING_COST = 40.0
#: directions that GCR keeps, and its steps before the rate is first checked
MAX_DIRECTIONS = 8
_TRIAL_STEPS = 32


class NotConverged(Exception):
    """The Krylov steps did not reach their tolerance."""


def couplings(A: sp.csr_array) -> sp.csr_array:
    """√|a_ij a_ji|/√|a_ii a_jj|, i ≠ j, with the pattern of A, whose rows are sorted.

    For symmetric M-matrices, and those that a diagonal similarity makes symmetric, their spectral
    radius is that of the Jacobi matrix I − D⁻¹A. A coupling in one direction only counts as 0, as
    it does for Gauss–Seidel.

    References
    ----------
    Young, Iterative Solution of Large Linear Systems (1971), chapter 6.
    """
    from .kernels.products import coupling_entries  # loads numba

    work.check_budget(_COUPLING_COST * A.nnz)
    weight = 1.0 / np.sqrt(np.abs(A.diagonal()))
    return with_entries(A, coupling_entries(A.indptr, A.indices, A.data, weight))


def conjugate_residuals(M: sp.csr_array, f: Vector, max_steps: int, tolerance: float) -> Vector | None:
    """Solve Mx = f to the relative `tolerance` by `GCR`, for M with a positive diagonal.

    M need not be symmetric. Returns None where `max_steps` steps do not suffice, by the observed
    rate or in fact.
    """
    unit = 1.0 / np.sqrt(M.diagonal())
    step_cost = gcr_step_cost(M.shape[0], M.nnz)

    def product(y: Vector) -> Vector:
        work.charge(step_cost)
        return unit * (M @ (unit * y))

    steps = GCR(product, np.copy, unit * f)
    x = np.zeros(f.size)
    count = 0
    first = norm(steps.residual)
    while count < max_steps and first < np.inf:
        iterate = min(max(count, _TRIAL_STEPS), max_steps - count)
        x, _ = steps.iterate(x, tolerance * first, iterate)
        count += iterate
        left = norm(steps.residual)
        if left <= tolerance * first:
            return unit * x
        if not count * np.log(1.0 / max(tolerance, UNIT_ROUNDOFF)) <= max_steps * np.log(first / left):
            break
    return None


def gcr_step_cost(n: int, nnz: int) -> float:
    """The cost of a step of `GCR` without a preconditioner: a product, eight calls, and 48 passes over vectors."""
    return work.product_cost(n, nnz) + 8 * work.COSTS.call + 48.0 * work.COSTS.vector * n


class GCR:
    """Generalised conjugate residuals: each step minimises the 2-norm of the residual over the last directions.

    Parameters: the product with M, a preconditioner for M, and `residual` = f − Mx at the start, which is overwritten.
    """

    def __init__(
        self, product: Callable[[Vector], Vector], preconditioned: Callable[[Vector], Vector], residual: Vector
    ) -> None:
        self._product = product
        self._preconditioned = preconditioned
        self.residual = residual
        self._directions: list[tuple[Vector, Vector]] = []
        #: the least |y|/|My| so far
        self._min_length = np.inf

    def iterate(self, x: Vector, tolerance: float, max_steps: int) -> tuple[Vector, bool]:
        """Return `x` after at most `max_steps` steps, and whether any was made; `residual` is updated.

        The steps end where ‖residual‖₂ ≤ `tolerance`, or where M maps a direction to rounding errors.
        """
        from .kernels.vcycle import add_both  # loads numba

        # in place: touching new memory costs more than these sums
        x = x.copy()
        moved = False
        for _ in range(max_steps):
            y = self._preconditioned(self.residual)
            w = self._product(y)
            largest = 0.0
            for direction, image in self._directions:
                share = inner(w, image)
                add_both(w, image, -share, y, direction, -share)
                largest = max(largest, abs(share))
            size = norm(w)
            length = norm(y)
            if not (0 < size < np.inf and length / size > 0):  # the quotient may underflow
                break
            self._min_length = min(self._min_length, length / size)
            # where M is singular, w may be rounding errors only, of My or of the projections subtracted from it
            if not MAX_DIRECTIONS * UNIT_ROUNDOFF * max(largest, length / self._min_length) <= size:
                break
            y /= size
            w /= size
            self._directions = [*self._directions[1 - MAX_DIRECTIONS :], (y, w)]
            share = inner(self.residual, w)
            add_both(x, y, share, self.residual, w, -share)
            moved = True
            if norm(self.residual) <= tolerance:
                break
        return x, moved

    def solve(self, x: Vector, tolerance: float, max_steps: int) -> Vector:
        """Return `x` after at most `max_steps` steps; raise NotConverged if its residual is above `tolerance`."""
        if norm(self.residual) > tolerance:
            x, _ = self.iterate(x, tolerance, max_steps)
        if not norm(self.residual) <= tolerance < np.inf:
            raise NotConverged
        return x
