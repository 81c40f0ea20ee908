"""A direction of change in the data A, q and ψ of a problem."""

from __future__ import annotations

from typing import Any

import numpy as np
import scipy.sparse as sp

from ..algebra.equations import Pattern
from ..errors import InputError
from ..numerics.arrays import Vector, as_csr, not_finite
from ..numerics.labels import check_labels, parts_of
from ..numerics.rounding import gamma
from ..problem.data import ProblemData
from ..problem.map import Map
from ..problem.two_sided import sides_of


class Direction:
    """The changes of A, of q, shape (n,), and of both obstacles, in the form of their own data; None for no change.

    Raises InputError.
    """

    def __init__(self, problem: ProblemData, dA: Any, dq: Any, dpsi: Any, dupper: Any) -> None:
        check_labels({"A": problem.matrix, "dA": dA, **parts_of("dpsi", dpsi), **parts_of("dupper", dupper)})
        if dupper is not None and problem.upper is None:
            raise InputError("dupper was given, but the problem has no upper obstacle")
        self.problem = problem
        self.matrix = None if dA is None else as_csr(dA, "dA", problem.n)
        self.q = None if dq is None else problem.vector(dq, "dq", finite=True)
        self.below = dpsi
        self.above = dupper

    def sides(self) -> list[tuple[str, Map, Any]]:
        """(name of the argument, map, its change or None) of each obstacle, the lower one first."""
        columns = ("dpsi", "dupper"), sides_of(self.problem.psi), (self.below, self.above)
        return list(zip(*columns, strict=False))

    def p_change(self, z: Vector) -> Vector:
        """dA z + dq."""
        return linear_value(self.matrix, self.q, z)

    def right_side(self, z: Vector, pattern: Pattern) -> Vector:
        """f of the equations Jdz = f.

        Raises InputError where it overflows, where fixed obstacles that touch would cross, and for a change that does
        not fit ψ's data.
        """
        with np.errstate(over="ignore", invalid="ignore"):
            f = -self.p_change(z)
            changes = [linear_value(*psi, z) for psi in self._map_changes(z)]
            for change, rows in zip(changes, pattern.sides(), strict=True):
                f = np.where(rows, change, f)
        if self.problem.upper is not None and self.problem.psi.is_constant:  # else crossing depends on dz
            crosses = (self.problem.psi.value(z) == self.problem.upper.value(z)) & (changes[0] > changes[1])
            if crosses.any():
                i = np.argmax(crosses)
                raise InputError(
                    f"dpsi[{i}] is above dupper[{i}] where the obstacles touch, which would cross: a direction along "
                    "which they do not was expected"
                )
        if fault := not_finite(f, "dA z + dq, or the change of psi(z),"):
            raise InputError(f"{fault}; a direction that does not overflow was expected")
        return f

    def error(self, z: Vector, delta: Vector, pattern: Pattern) -> Vector:
        """A bound, shape (n,), on the error of f if z is wrong by up to `delta`, rounding included."""
        error = _error(self.matrix, self.q, z, delta)
        for psi, rows in zip(self._map_changes(z), pattern.sides(), strict=True):
            error = np.where(rows, _error(*psi, z, delta), error)
        return error

    def _map_changes(self, z: Vector) -> list[Linear]:
        """The change of each map as (H, d): ψ changes by Hz + d to first order."""
        sides = self.sides()
        return [(None, None) if change is None else psi.data_change(z, change, name) for name, psi, change in sides]

    def opposite(self) -> Direction:
        """The direction times −1."""
        return Direction(self.problem, *map(_negative, (self.matrix, self.q, self.below, self.above)))


#: H and d of Hz + d, None for 0
Linear = tuple[sp.csr_array | None, Vector | None]


def linear_value(H: sp.csr_array | None, d: Vector | None, z: Vector) -> Vector:
    """Hz + d."""
    d = np.zeros(z.size) if d is None else d
    return d if H is None else H @ z + d


def _error(H: sp.csr_array | None, d: Vector | None, z: Vector, delta: Vector) -> Vector:
    """A bound on |H|δ and the rounding error of Hz + d."""
    if H is None:
        return np.zeros(z.size)
    terms = np.diff(H.indptr) + 3
    size = abs(H)
    return (size @ delta) * (1 + gamma(terms)) + gamma(terms) * (size @ np.abs(z) + (0.0 if d is None else np.abs(d)))


def _negative(change: Any) -> Any:
    """−`change` in its own form; None stays None."""
    if isinstance(change, tuple):
        return tuple(map(_negative, change))
    return change if change is None else -1.0 * (change if sp.issparse(change) else np.asarray(change))
