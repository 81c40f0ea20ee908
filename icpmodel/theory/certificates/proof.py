"""`Proof`: a proof from A and ψ that the solution is unique, which bounds the error of every z."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ...algebra.equations import Pattern, solve_on
from ...errors import IcpError
from ...numerics.arrays import Vector, norm
from ...numerics.rounding import SMALLEST, UNIT_ROUNDOFF
from ...problem.data import ProblemData
from ...problem.map import Map
from ...problem.two_sided import mid, sides_of

MAX_POLICY_STEPS = 100  #: steps of a policy iteration, which mostly ends after ten


@dataclass(frozen=True, eq=False)
class Proof(ABC):
    """A proof that an ICP has exactly one solution z*; it bounds |z − z*| for every z.

    `sentence` states the proof for the user. Each kind of proof is one file, whose function `prove` returns a `Proof`
    or a sentence that says why there is none.
    """

    sentence: str
    #: whether the bound of z itself is usually so loose that a `newton_step` is worth its factorisation
    needs_sharpening: ClassVar[bool] = False

    def newton_step(self, problem: ProblemData, z: Vector) -> Vector | None:
        """One step of the active-set Newton iteration from `z`; None if its equations have no solution.

        A nonlinear p is replaced by its tangent at z.
        """
        try:
            problem = problem.linearised(z)
            pattern = Pattern.at(problem, z)
            return solve_on(problem, z, pattern.active, pattern.above)
        except IcpError:  # the equations are singular, or ψ or its Jacobian fails
            return None

    @abstractmethod
    def bound(self, problem: ProblemData, z: Vector, rounding_p: Vector, rounding_r: Vector) -> tuple[Vector, float]:
        """(δ, ε) with |z − z*| ≤ δ and ‖z − z*‖₂ ≤ ε, infinite or NaN if there is no bound at this z.

        Parameters
        ----------
        problem : ProblemData
        z : array of shape (n,)
        rounding_p, rounding_r : array of shape (n,)
            Bounds on the errors of the computed p(z) and r(z).
        """


def no_lipschitz(psi: Map) -> str:
    """The sentence for a ψ or ψ̄ without a Lipschitz matrix."""
    name = "psi" if sides_of(psi)[0].lipschitz is None else "upper"
    return f"no Lipschitz matrix of {name} is known: give `lipschitz`"


def natural_map(problem: ProblemData, z: Vector, a: Vector, b: Vector | float) -> Vector:
    """min(p/a, r/b) at `z`, with an upper obstacle the median of these and (z − ψ̄)/b."""
    r_upper = problem.r_upper(z)
    return mid(problem.p(z) / a, problem.r(z) / b, None if r_upper is None else r_upper / b)


def norm_up(x: Vector) -> float:
    """An upper bound of ‖x‖₂, safe against over- and underflow."""
    size = norm(x)
    if size == 0.0 or not np.isfinite(size):
        return size
    return size * (1 + (x.size + 8) * UNIT_ROUNDOFF) + x.size * SMALLEST
