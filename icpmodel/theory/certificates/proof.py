"""What a proof of uniqueness is: made of A and ψ once, it turns every z into a bound on its error."""

from __future__ import annotations

from abc import ABC, abstractmethod
from typing import ClassVar

import numpy as np

from ...arrays import Vector
from ...errors import IcpError
from ...problem import ICP, SMALLEST, UNIT_ROUNDOFF
from .equations import nearer_to_obstacle, solve_on


class Proof(ABC):
    """A proof that an ICP has exactly one solution z*, which also bounds |z − z*| for every z.

    `sentence` says what was proved, for the user. Each proof is one file of this room, with a function
    `prove(problem)` that returns a `Proof` or the reason, one sentence, why there is none.

    >>> from icpmodel.theory.certificates.h_plus import prove
    >>> prove(ICP([[2.0]], [-2.0])).sentence
    'A is an H+-matrix (v = 1)'
    """

    sentence: str
    #: whether the bound of z itself is mostly too wide to be of use, so that `nearer` is worth its factorisations
    wide: ClassVar[bool] = False

    def nearer(self, problem: ICP, z: Vector) -> Vector | None:
        """A point that is probably nearer to z* than `z`, shape (n,): one step of the active-set Newton iteration.

        None where there is none. |z − z*| is at most the distance to it plus the bound there.

        >>> from icpmodel.theory.certificates.h_plus import prove
        >>> problem = ICP([[2.0]], [-2.0])
        >>> prove(problem).nearer(problem, np.array([1.5]))
        array([1.])
        """
        try:
            return solve_on(problem, z, nearer_to_obstacle(problem, z))
        except IcpError:  # the equations are singular, or ψ or its Jacobian fails
            return None

    @abstractmethod
    def bound(self, problem: ICP, z: Vector, for_p: Vector, for_r: Vector) -> tuple[Vector, float]:
        """(δ, ε) with |z − z*| ≤ δ entry by entry and ‖z − z*‖₂ ≤ ε.

        Parameters: `z` shape (n,), finite; `for_p` and `for_r` bounds on the rounding errors of p(z) and r(z), as
        `ICP.rounding` gives them. Returns δ of shape (n,), not finite where the proof says nothing about this z.

        >>> from icpmodel.theory.certificates.h_plus import prove
        >>> problem, z = ICP([[2.0]], [-2.0]), np.array([1.5])
        >>> delta, euclidean = prove(problem).bound(problem, z, *problem.rounding(z))
        >>> bool(delta[0] >= 0.5), euclidean >= 0.5
        (True, True)
        """


def norm_up(x: Vector) -> float:
    """An upper bound of ‖x‖₂, safe against over- and underflow.

    >>> norm_up(np.array([3.0, 4.0])) >= 5.0
    True
    """
    largest = float(np.abs(x).max())
    if largest == 0.0 or not np.isfinite(largest):
        return largest
    size = largest * float(np.linalg.norm(x / largest)) * (1 + (x.size + 8) * UNIT_ROUNDOFF)
    return size + x.size * SMALLEST
