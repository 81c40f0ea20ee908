"""What a proof of uniqueness is: made of A and ψ once, it turns every z into a bound on its error."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...algebra.equations import pattern_at, solve_on
from ...errors import IcpError
from ...numerics.arrays import Vector, norm
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData
from ...problem.map import Map
from ...problem.two_sided import TwoSidedObstacle


@dataclass(frozen=True, eq=False)
class Proof(ABC):
    """A proof that an ICP has exactly one solution z*: `sentence`, for the user. It bounds |z − z*| for every z.

    Each is one file, whose function `prove` returns a `Proof`, or one sentence that says why there is none.
    """

    sentence: str
    #: whether the bound of z itself is mostly too wide to be of use, so that `nearer` is worth its factorisations
    wide: ClassVar[bool] = False

    def nearer(self, problem: ProblemData, z: Vector) -> Vector | None:
        """A point that is probably nearer to z* than `z`, by one step of the active-set Newton iteration, or None."""
        try:
            pattern = pattern_at(problem, z)
            return solve_on(problem, z, pattern.active, pattern.above)
        except IcpError:  # the equations are singular, or ψ or its Jacobian fails
            return None

    @abstractmethod
    def bound(self, problem: ProblemData, z: Vector, for_p: Vector, for_r: Vector) -> tuple[Vector, float]:
        """(δ, ε), |z − z*| ≤ δ and ‖z − z*‖₂ ≤ ε, p(z) and r(z) known to `for_p` and `for_r`; not finite if unknown."""


def no_lipschitz(psi: Map) -> str:
    """Why nothing is proved where ψ, or ψ̄, has no Lipschitz matrix."""
    lower = psi.lower if isinstance(psi, TwoSidedObstacle) else psi
    return f"no Lipschitz matrix of {'psi' if lower.lipschitz is None else 'upper'} is known: give `lipschitz`"


def norm_up(x: Vector) -> float:
    """An upper bound of ‖x‖₂, safe against over- and underflow."""
    size = norm(x)
    if size == 0.0 or not np.isfinite(size):
        return size
    return size * (1 + (x.size + 8) * UNIT_ROUNDOFF) + x.size * SMALLEST
