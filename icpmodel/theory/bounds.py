"""A posteriori: how wrong can z be?"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ..arrays import Vector
from ..problem import ICP
from . import h_plus

#: the proofs in the order in which they are tried, cheapest and sharpest first
_PROOFS = (h_plus.prove,)


@dataclass(frozen=True)
class ErrorBound:
    """How far z can be from the solution.

    `componentwise` δ with |z − z*| ≤ δ, shape (n,), its largest entry `value`, and `euclidean` ≥ ‖z − z*‖₂, all in the
    units of z; None where nothing is proved, and then `reason` says why. `proof` is the sentence of the proof, empty
    where there is none: it says that the solution exists and is the only one, whatever z is.

    >>> bound = error_bound(ICP([[2.0]], [-2.0]), [1.25])
    >>> bound.value >= 0.25, bound.proof
    (True, 'A is an H+-matrix (v = 1)')
    """

    value: float | None
    componentwise: Vector | None
    euclidean: float | None
    proof: str
    reason: str

    @classmethod
    def none(cls, reason: str, proof: str = "") -> ErrorBound:
        """No bound, and why; `proof` where uniqueness is proved all the same.

        >>> ErrorBound.none("nobody asked").value is None
        True
        """
        return cls(None, None, None, proof, reason)

    @property
    def unique(self) -> bool:
        """Whether it is proved that the solution exists and is the only one.

        >>> error_bound(ICP([[0.0]], [1.0]), [0.0]).unique
        False
        """
        return bool(self.proof)


def error_bound(problem: ICP, z: Any) -> ErrorBound:
    """A bound on |z − z*| from one evaluation of p and r, or the reason why there is none.

    Bounds on the rounding errors of p(z) and r(z) are included (`ICP.rounding`); ψ and its Lipschitz matrix are taken
    at the user's word. Parameters: `z` shape (n,). Returns an `ErrorBound`.
    Reference: the proofs of this room, one file each.

    >>> problem = ICP([[2, -1], [-1, 2]], [-1, -1])
    >>> bound = error_bound(problem, [1.0, 1.001])
    >>> 0.001 <= bound.value <= 0.0031
    True
    """
    z = problem.vector(z)
    reasons = []
    for prove in _PROOFS:
        proof = prove(problem)
        if isinstance(proof, str):
            reasons.append(proof)
            continue
        delta, euclidean = proof.bound(problem, z, *problem.rounding(z))
        if np.isfinite(delta).all():
            return ErrorBound(float(delta.max()), delta, euclidean, proof.sentence, "")
        return ErrorBound.none("F(z) is not finite at this z", proof.sentence)
    return ErrorBound.none("; ".join(reasons))
