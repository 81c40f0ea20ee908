"""What a proof of uniqueness is: made of A and ψ once, it turns every z into a bound on its error."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from ...algebra.equations import nearer_to_obstacle, solve_on
from ...errors import IcpError
from ...numerics.arrays import Vector
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData


class Proof(ABC):
    """A proof that an ICP has exactly one solution z*, which also bounds |z − z*| for every z.

    `sentence` says what was proved, for the user. Each proof is one file of this room, with a function `prove` that
    returns a `Proof` or the reason, one sentence, why there is none.
    """

    sentence: str
    #: whether the bound of z itself is mostly too wide to be of use, so that `nearer` is worth its factorisations
    wide: ClassVar[bool] = False

    def nearer(self, problem: ProblemData, z: Vector) -> Vector | None:
        """A point that is probably nearer to z* than `z`, shape (n,): one step of the active-set Newton iteration.

        None where there is none. |z − z*| is at most the distance to it plus the bound there.
        """
        try:
            return solve_on(problem, z, nearer_to_obstacle(problem, z))
        except IcpError:  # the equations are singular, or ψ or its Jacobian fails
            return None

    @abstractmethod
    def bound(self, problem: ProblemData, z: Vector, for_p: Vector, for_r: Vector) -> tuple[Vector, float]:
        """(δ, ε) with |z − z*| ≤ δ entry by entry and ‖z − z*‖₂ ≤ ε.

        Parameters: `z` shape (n,), finite; `for_p` and `for_r` bounds on the rounding errors of p(z) and r(z), as
        `ICP.rounding` gives them. Returns δ of shape (n,), not finite where the proof says nothing about this z.
        """


def norm_up(x: Vector) -> float:
    """An upper bound of ‖x‖₂, safe against over- and underflow."""
    largest = float(np.abs(x).max())
    if largest == 0.0 or not np.isfinite(largest):
        return largest
    size = largest * float(np.linalg.norm(x / largest)) * (1 + (x.size + 8) * UNIT_ROUNDOFF)
    return size + x.size * SMALLEST
