"""Patience by theorem: whether a method that seems to stand still is proved to converge, and in how many steps."""

from __future__ import annotations

import math
from collections.abc import Callable
from functools import cached_property

import numpy as np

from ..errors import IcpError
from ..methods.contract import Method
from ..methods.modulus import ModulusMember
from ..numerics.arrays import Vector, norm
from ..problem.data import ProblemData
from ..theory.answers import Allowance
from ..theory.convergence.rates import Rate, predicted_rate
from ..theory.convergence.theorems import Check, check_all


class ProvedConvergence:
    """What the theorems say of `method` on `problem`; to ask them may cost so many products with A as `spent` says.

    A residual may stay flat for any number of steps where an error shrinks: where a theorem gives a factor below 1, or
    the step is isotone and the iterates fall or rise in every entry, nothing is concluded from that.
    """

    def __init__(self, problem: ProblemData, method: Method, spent: Callable[[], float]) -> None:
        self.problem, self.spent = problem, spent
        #: members of the family whose steps are all alike are what theorems are about
        is_affine = problem.f is None
        self.member = method if isinstance(method, ModulusMember) and method.memoryless and is_affine else None
        self.was_followed = False

    @cached_property
    def checks(self) -> dict[str, Check]:
        """The theorems by their names; none where there is no member."""
        if self.member is None:
            return {}
        try:
            return check_all(self.problem, self.member, Allowance(self.spent(), self.problem.matrix.product_cost))
        except IcpError:  # ψ may fail
            return {}

    @cached_property
    def rate(self) -> Rate | None:
        """The factor by which every step reduces the error, None where none is proved."""
        if self.member is None or not self.checks:
            return None
        found = predicted_rate(self.problem, self.member, self.checks)
        return found if isinstance(found, Rate) else None

    def further(self, before: Vector, z: Vector, tolerance: float) -> int:
        """How many steps the run follows a theorem, the last step having led from `before` to `z`.

        With a factor these are, once, the steps that it takes at the most to Res_D ≤ `tolerance`; beyond them rounding
        is the reason. With iterates that fall or rise it is one step, after which they are compared again.
        """
        if not self.was_followed:
            self.was_followed = True
            if steps := self.steps(z, tolerance):
                return steps
        return int(self.is_monotone(before, z))

    def is_monotone(self, before: Vector, z: Vector) -> bool:
        """Whether all later iterates are proved to move as the last step did, down in every entry, or up."""
        if not self.checks or not self.checks["monotone"].holds:
            return False
        moved = z - before
        return bool(moved.any() and ((moved <= 0.0).all() or (moved >= 0.0).all()))

    def steps(self, z: Vector, tolerance: float) -> int | None:
        """After so many steps from `z` it is Res_D ≤ `tolerance`, but for rounding; None where that is not known.

        |mid(D⁻¹p, r)| ≤ max(D⁻¹|A|, I + G)|z − z*|, where |ψ(x) − ψ(y)| ≤ G|x − y|.
        """
        if self.rate is None:
            return None
        G = self.problem.psi.lipschitz
        matrix = self.problem.matrix
        growth = matrix.row_weights * (abs(self.problem.A) @ np.ones(self.problem.n))
        most = norm(np.maximum(growth, 1.0 if G is None else 1.0 + G @ np.ones(self.problem.n)))
        accuracy = tolerance / most
        return self.rate.steps(self.problem, z, accuracy) if 0.0 < accuracy < math.inf else None

    def in_words(self, z: Vector, tolerance: float) -> str:
        """That the method converges, and how many more steps from `z` it needs at the most; empty where nobody had to
        ask, or nothing is proved."""
        if "checks" not in vars(self) or self.rate is None:
            return ""
        steps = self.steps(z, tolerance)
        most = "" if steps is None else f": after at most {steps} more steps the residual is {tolerance:.3g} at most"
        return f"; it converges by theorem, each step leaves {self.rate.factor:.6g} of the error{most}"
