"""What a proof of uniqueness is: made of A and ψ once, it turns every z into a bound on its error."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from ..arrays import Vector
from ..problem import ICP, SMALLEST, UNIT_ROUNDOFF


class Proof(ABC):
    """A proof that an ICP has exactly one solution z*, which also bounds |z − z*| for every z.

    `sentence` says what was proved, for the user. Each proof is one file of this room, with a function
    `prove(problem)` that returns a `Proof` or the reason, one sentence, why there is none.

    >>> from icpmodel.theory.h_plus import prove
    >>> prove(ICP([[2.0]], [-2.0])).sentence
    'A is an H+-matrix (v = 1)'
    """

    sentence: str

    @abstractmethod
    def bound(self, problem: ICP, z: Vector, for_p: Vector, for_r: Vector) -> tuple[Vector, float]:
        """(δ, ε) with |z − z*| ≤ δ entry by entry and ‖z − z*‖₂ ≤ ε.

        Parameters: `z` shape (n,), finite; `for_p` and `for_r` bounds on the rounding errors of p(z) and r(z), as
        `ICP.rounding` gives them. Returns δ of shape (n,), not finite where the proof says nothing about this z.

        >>> from icpmodel.theory.h_plus import prove
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
