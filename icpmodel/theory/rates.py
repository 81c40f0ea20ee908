"""Predicted rates: how many steps a method of the modulus family can need, before it is run."""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ..arrays import Vector, as_number
from ..errors import InputError
from ..problem import ICP, SMALLEST, UNIT_ROUNDOFF
from . import conditions
from .absolute import slack
from .answers import Answer
from .parts import Member, Parts
from .theorems import check


@dataclass(frozen=True, eq=False)
class Rate:
    """Every step of the method, in exact arithmetic, reduces ‖z − z*‖_v = max_i |z_i − z*_i|/v_i to `factor` times it.

    `factor` < 1 and `v` > 0, shape (n,), are proved; `sentence` is the theorem behind them. It does not depend on q.

    >>> from icpmodel import MNMJ
    >>> rate = predicted_rate(ICP([[2, -1], [-1, 2]], [0, 0]), MNMJ())
    >>> round(rate.factor, 6), rate.v
    (0.5, array([1., 1.]))
    """

    factor: float
    v: Vector
    sentence: str
    _parts: Parts = field(repr=False)

    def distance(self, problem: ICP, z0: Any) -> float:
        """A bound on ‖z⁰ − z*‖_v: ‖z¹ − z⁰‖_v/(1 − factor), z¹ by one step of the method, rounding included.

        With d about z⁰ − z¹ = 2X⁻¹F_Ω(z⁰) it is |z⁰ − z¹| ≤ |d| + |X⁻¹||Xd − 2F_Ω(z⁰)|. Parameters: `problem` with the
        A and ψ of the rate; `z0` shape (n,), finite. Infinite where ψ(z⁰) is not finite enough to tell.

        >>> from icpmodel import MNMJ
        >>> problem = ICP([[2, -1], [-1, 2]], [-2, -2])
        >>> round(predicted_rate(problem, MNMJ()).distance(problem, [0.0, 0.0]), 6)
        2.0
        """
        z0, parts = problem.vector(z0, "z0"), self._parts
        if problem.A is not parts.A or problem.psi is not parts.problem.psi:
            raise InputError("problem has another A or psi than the rate; make the rate of this problem")
        with np.errstate(all="ignore"):
            r, omega = problem.r(z0), parts.omega
            F = np.minimum(problem.p(z0), omega * r)
            for_p, for_r = problem.rounding(z0)
            # the smaller side decides; either side may, within its error
            for_F = np.maximum(for_p, np.where(np.isposinf(r), 0.0, omega * for_r)) + 4 * UNIT_ROUNDOFF * np.abs(F)
            d = parts.splitting.operator(parts.A, parts.phi + omega).solve(2.0 * F)
            defect = np.abs(parts.X @ d - 2.0 * F) + 2.0 * for_F + slack(parts.size, d)
            defect = defect * (1 + 8 * UNIT_ROUNDOFF) + np.finfo(np.float64).tiny
            step = np.abs(d) + conditions.sharper(parts).inverse.upper(defect)
            bound = float((step / self.v).max()) / (1.0 - self.factor) * (1 + 16 * UNIT_ROUNDOFF)
        return bound if bound == bound else math.inf

    def error_after(self, k: int, distance: float) -> Vector:
        """A bound on |zᵏ − z*| entry by entry, shape (n,): factorᵏ·distance·v, `distance` ≥ ‖z⁰ − z*‖_v.

        >>> from icpmodel import MNMJ
        >>> predicted_rate(ICP([[2, -1], [-1, 2]], [0, 0]), MNMJ()).error_after(2, 4.0).round(6)
        array([1., 1.])
        """
        k = int(as_number(k, "k", least=0, whole=True))
        with np.errstate(over="ignore"):
            size = max(self.factor**k, SMALLEST) * distance * (1 + 16 * UNIT_ROUNDOFF)
            return np.nextafter(size * self.v, np.inf)

    def steps(self, problem: ICP, z0: Any, accuracy: Any) -> int | None:
        """After so many steps |zᵏ − z*| ≤ `accuracy` in every entry, whatever z* is; None where no number is known.

        Parameters: `problem` and `z0` as in `distance`; `accuracy` a positive number or vector of shape (n,), in the
        units of z. Rounding in the run itself limits what accuracy can be had at all.
        Raises InputError where the accuracy is not positive.

        >>> from icpmodel import MNMJ
        >>> problem = ICP([[2, -1], [-1, 2]], [-2, -2])
        >>> predicted_rate(problem, MNMJ()).steps(problem, [0.0, 0.0], 1e-3)
        11
        """
        accuracy = np.asarray(accuracy, dtype=np.float64)
        if not (accuracy > 0).all():
            raise InputError(f"accuracy has the entry {accuracy.min():g}; positive numbers were expected")
        distance = self.distance(problem, z0)
        with np.errstate(over="ignore"):
            wanted = float((accuracy / self.v).min())
        if not math.isfinite(distance) or wanted == 0.0:
            return None
        if distance <= wanted:
            return 0
        k = (math.log(wanted) - math.log(distance)) / math.log(self.factor)
        return math.ceil(k * (1 + 64 * UNIT_ROUNDOFF) + 1e-9)


def predicted_rate(problem: ICP, member: Member) -> Rate | Answer:
    """The contraction factor of `member` on `problem`, or an `Answer` (unknown or no) that says why there is none.

    It is that of the theorem "sharper", which holds with the same v wherever 4.1 to 4.4 do, with a factor that is no
    larger. Parameters: `member` a method of the modulus family.
    Reference: `conditions`; Banach's fixed point theorem in the norm max_i |z_i|/v_i.

    >>> from icpmodel import MNMGS, Affine
    >>> print(predicted_rate(ICP([[1.0]], [0.0], Affine([[2.0]])), MNMGS()))
    no: the contraction factor is not below 1 (found: at most 2)
    """
    found = check("sharper", problem, member)
    if not found.holds or found.number is None or found.vector is None:
        return Answer(found.holds, found.reason, found.witness, found.number)
    return Rate(found.number, found.vector, f"theorem sharper: {found.sentence}", Parts(problem, member))
