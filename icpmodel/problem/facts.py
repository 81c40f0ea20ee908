"""The facts about A and ψ together, each computed once, on request."""

from __future__ import annotations

from contextlib import suppress
from functools import cached_property

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Vector
from ..numerics.rounding import UNIT_ROUNDOFF
from ..numerics.sparse_structure import is_diagonal
from .map import Map
from .matrix import Matrix
from .two_sided import sides_of
from .user_code import map_violation

#: the largest number of evaluations of ψ; with a derivative five are typical
_MAX_EVALUATIONS = 100
#: the largest relative rounding error of a fixed obstacle
_MAX_CROSSING = 1e-12


class Facts:
    """The facts about A and ψ, shared by the problems that share the two; those about A alone are in `matrix`."""

    def __init__(self, matrix: Matrix, psi: Map) -> None:
        self.matrix = matrix
        self.psi = psi

    @cached_property
    def has_fixed_obstacle(self) -> bool:
        """Whether each ψ_i is known to depend on z_i alone, with a Lipschitz constant below 1: then `obstacle` exists.

        False where the values of ψ at 0 and at the obstacle contradict a user's Lipschitz constants.
        """
        G = self.psi.lipschitz
        if self.psi.is_constant or G is None:
            return self.psi.is_constant
        if not is_diagonal(G) or (G.diagonal() >= 1).any():
            return False
        with suppress(MapError):
            obstacles = [c for c in (self.obstacle, self.upper_obstacle) if c is not None]
            points = [np.where(np.isfinite(c), c, 0.0) for c in obstacles]
            return not any(map(map_violation, sides_of(self.psi), points, ("psi", "upper")))
        return True

    @cached_property
    def bounded(self) -> int:
        """The number of rows with an obstacle; n where it moves."""
        return self.bounded_rows.size if self.psi.is_constant else self.matrix.n

    @cached_property
    def bounded_rows(self) -> NDArray[np.intp]:
        """The rows that have an obstacle, where it is constant."""
        sides = [np.isfinite(c) for c in (self.obstacle, self.upper_obstacle) if c is not None]
        return np.flatnonzero(np.any(sides, axis=0))

    @cached_property
    def entries(self) -> int:
        """The number of entries that a sweep or a Newton step reads: those of A and of `psi.links`."""
        return self.matrix.nnz + (0 if self.psi.links is None else self.psi.links.nnz)

    @cached_property
    def equations(self) -> Matrix:
        """A matrix with the pattern of Newton's equations: that of A, and of ψ where it couples rows."""
        links = self.psi.links
        if links is None or self.has_fixed_obstacle:
            return self.matrix
        work.charge_matrices(self.entries)
        return Matrix(sp.csr_array(0.5 * self.matrix.absolute + 0.5 * abs(links)))  # their sum may overflow

    @cached_property
    def coupling(self) -> float:
        """How strongly ψ couples rows, comparable to A's Jacobi radius: the largest row sum of G; 0 if not known."""
        G = self.psi.lipschitz
        if G is None or self.has_fixed_obstacle or not G.nnz:
            return 0.0
        return float((G @ np.ones(G.shape[0])).max())

    @cached_property
    def obstacle(self) -> Vector:
        """c such that the problem with the obstacle c has the same solutions, where `has_fixed_obstacle`.

        r_i(z) = z_i − ψ_i(z_i) then grows with z_i, so r_i ≥ 0 means z_i ≥ c_i with r_i(c_i) = 0.
        Newton's method solves the n equations at once. It is kept in the bracket that the Lipschitz
        constant ℓ_i < 1 gives, −r/(1 − ℓ) ≤ c − z ≤ −r/(1 + ℓ) for r > 0. Where ψ has no derivative
        the bracket is halved. The iteration ends at rounding accuracy, or where c stays the same. c_i
        = −inf where ψ_i is. Raises MapError where ψ fails.
        """
        return self._fixed_obstacle(self.psi, -np.inf)

    @cached_property
    def upper_obstacle(self) -> Vector | None:
        """The same of the upper obstacle, None where there is none."""
        return None if self.psi.upper is None else self._fixed_obstacle(self.psi.upper, np.inf)

    @cached_property
    def crossed(self) -> int | None:
        """A row in which fixed obstacles cross beyond rounding, so that there is no solution; None without one.

        Raises MapError where ψ fails.
        """
        above = self.upper_obstacle if self.psi.upper is not None and self.has_fixed_obstacle else None
        if above is None:
            return None
        with np.errstate(invalid="ignore"):
            gap = self.obstacle - above - _MAX_CROSSING * (np.abs(self.obstacle) + np.abs(above))
        return int(np.nanargmax(gap)) if (gap > 0.0).any() else None

    def _fixed_obstacle(self, psi: Map, none: float) -> Vector:
        n = self.matrix.n
        if psi.is_constant or (psi.linear is not None and not psi.linear[0].nnz):
            return psi.value(np.zeros(n))
        assert psi.lipschitz is not None, "ask has_fixed_obstacle first"
        slope = psi.lipschitz.diagonal()
        c = np.zeros(n)
        low = np.full(n, -np.inf)
        high = np.full(n, np.inf)
        for _ in range(_MAX_EVALUATIONS):
            value = psi.value(c)
            with np.errstate(all="ignore"):
                r = np.where(np.isinf(value), 0.0, c - value)
                if (np.abs(r) <= 2 * UNIT_ROUNDOFF * np.abs(c)).all():
                    break
                near = c - r / (1.0 + slope)
                far = c - r / (1.0 - slope)
                low = np.maximum(low, np.minimum(near, far))
                high = np.minimum(high, np.maximum(near, far))
                J = psi.jacobian(c)
                newton = np.full(n, np.nan) if J is None else c - r / (1.0 - J.diagonal())
                following = np.where((low <= newton) & (newton <= high), newton, 0.5 * (low + high))
            if np.array_equal(following, c):
                break
            c = following
        c = np.where(value == none, none, c)
        good = (np.abs(c) < np.inf) | (c == none)
        if not good.all():  # NaN fails as well
            i = int(np.argmin(good))
            name = "psi" if none < 0 else "upper"
            raise MapError(
                f"{name}_{i} gives {c[i]} for the z_{i} with z_{i} = psi_{i}(z_{i}); a finite number was expected"
            )
        c.flags.writeable = False
        return c
