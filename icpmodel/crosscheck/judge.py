"""The one judge of foreign answers.

A foreign status is recorded and never believed: every residual and difference is recomputed from (A, q, ψ, z).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, Self

import numpy as np

from ..errors import MapError
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from ..solve.solution import Solution
from ..solvers.contract import Claim
from ..solvers.formulations import Target, in_handy_units, targets
from ..theory.certificates.bounds import error_bound

#: how small Res(z)/Res(0) must be for an answer under test, and for a foreign one, to count as a solution
OURS, THEIRS = 1e-8, 1e-7
#: a Solution may have been stopped at a looser tolerance, but at most at this one
LOOSEST = 1e-4
#: two answers agree within AGREE·max|z| + FLOOR·unit: the second counts where z is about zero
AGREE, FLOOR = 1e-6, 1e-9
#: how many times that a certified bound may be and still count; a wide bound proves nothing
WIDEST = 10.0


class Verdict(Enum):
    """What a foreign answer says of the answer under test, and what that means in a sentence.

    Only AGREES speaks for it, only DISAGREES against it.

    >>> icp.crosscheck(ICP([[2.0]], [-1.0]), [0.5], ["osqp"]).rows[0].verdict
    <Verdict.AGREES: 'agrees'>
    >>> from icpmodel.crosscheck import Verdict
    >>> Verdict("loose").meaning
    'it claims success, but its own residual is above tolerance'
    """

    meaning: str

    def __new__(cls, word: str, meaning: str) -> Self:
        verdict = object.__new__(cls)
        verdict._value_, verdict.meaning = word, meaning
        return verdict

    AGREES = "agrees", "both answers are the same, within tolerance or within their certified bounds"
    LOOSE = "loose", "it claims success, but its own residual is above tolerance"
    OTHER_SOLUTION = "other solution", "both answers are solutions, and nothing proves that there is only one"
    INCONCLUSIVE = "inconclusive", "both residuals are small and the answers differ, but not by more than is certified"
    DISAGREES = "disagrees", "its answer is a solution, the answer under test is not, or is provably another point"
    FAILED = "failed", "it raised, returned no finite z, or does not claim success"
    SKIPPED = "skipped", "it cannot take this problem"


@dataclass(frozen=True)
class Row:
    """One line of a report. `residual` = Res(z) of the foreign z on the problem it solved; `difference` = max|z_foreign
    − z|; both in the user's units, None where there is none. `claim` is the foreign status; `note` says why.
    """

    solver: str
    formulation: str
    verdict: Verdict
    residual: float | None
    difference: float | None
    seconds: float | None
    claim: str
    note: str

    @classmethod
    def skipped(cls, solver: str, reason: str) -> Row:
        """The row of a solver that cannot take the problem."""
        return cls(solver, "", Verdict.SKIPPED, None, None, None, "", reason)


@dataclass(frozen=True, eq=False)
class Checked:
    """An answer under test. `problem` and `z` as the user has them; `y` = z/`unit` the same in the handy units of
    `targets`; `holds` whether z is a solution; `tolerance` how far another answer may lie apart, in the units of z.
    """

    problem: ProblemData
    z: Vector
    unit: float
    y: Vector
    targets: list[Target]
    holds: bool
    tolerance: float

    @classmethod
    def of(cls, problem: ProblemData, solution: Any, atol: float | None = None) -> Checked:
        """Judge `solution`, a `Solution` or a vector of shape (n,); `atol` ≥ 0 replaces the default tolerance."""
        z = problem.vector(solution, "solution")
        handy, unit = in_handy_units(problem)
        y = z / unit
        rtol = OURS
        if isinstance(solution, Solution) and solution.solved and solution.problem is problem:
            start = problem.residual_at_0()
            if start > 0:
                rtol = min(max(OURS, solution.tolerance / start), LOOSEST)
        # the units of A and z may make Res blind to p or to r: in handy units it must be small as well, if less so
        holds = solves(problem, z, rtol) and solves(handy, y, min(100 * rtol, LOOSEST))
        # the unit may be far larger than z: it counts only for an answer that is known to be a solution
        default = AGREE * float(np.abs(z).max()) + (FLOOR * unit if holds else 0.0)
        tolerance = default if atol is None else float(atol)
        return cls(problem, z, unit, y, targets(handy, y), holds, tolerance)

    def judge(self, solver: str, form: str, target: Target, claim: Claim) -> Row:
        """The row of a foreign `claim`, which is about `target` in `form`."""
        formulation = ("frozen " if target.frozen else "") + _FORMS.get(form, form)

        def row(verdict: Verdict, note: str, residual: float | None = None, difference: float | None = None) -> Row:
            return Row(solver, formulation, verdict, residual, difference, claim.seconds, claim.words, note)

        x, fault = _readable(claim, self.problem.n)
        if x is None:
            return row(Verdict.FAILED, fault)
        z = x * self.unit
        difference = float(np.abs(z - self.z).max())
        residual = (self.problem.frozen(self.z) if target.frozen else self.problem).residual(z)
        verdict, note = self._compare(target, x, claim, difference)
        return row(verdict, note, finite(residual), finite(difference))

    def _compare(self, target: Target, x: Vector, claim: Claim, difference: float) -> tuple[Verdict, str]:
        """The verdict on a finite x, in the units of `target`. Every comparison is false for NaN."""
        theirs = solves(target.problem, x, THEIRS)
        if not claim.solved:
            right = "; its z solves the problem all the same" if theirs else ""
            return Verdict.FAILED, f"it ended with: {claim.words}{right}"
        if not theirs:
            return Verdict.LOOSE, f"claims {claim.words!r}, but its residual is above {THEIRS:g} Res(0)"
        if np.isfinite(self.z).all() and difference <= self.tolerance:
            return Verdict.AGREES, claim.words
        if not self.holds:
            return Verdict.DISAGREES, "the residual of the answer under test is above tolerance"
        return self.by_bound(difference, sum_of_bounds(target, self.y, x) * self.unit, target.unique)

    def by_bound(self, difference: float, bound: float, unique: bool) -> tuple[Verdict, str]:
        """The verdict on a solution that is `difference` away from this one, where both are together at most `bound`
        away from the one that is certified to exist, NaN where none is; `unique` whether there is at most one.
        """
        if difference <= bound <= WIDEST * (AGREE * float(np.abs(self.z).max()) + FLOOR * self.unit):
            return Verdict.AGREES, f"within the certified bound {bound:.1e}"
        if difference <= bound:
            wide = f"the certified bound {bound:.1e} is too wide to tell; solve with a smaller rtol"
            return Verdict.INCONCLUSIVE, wide
        if difference > bound:
            return Verdict.DISAGREES, f"both residuals are small, but they differ by more than the bound {bound:.1e}"
        if not unique:
            return Verdict.OTHER_SOLUTION, "both are solutions; uniqueness is not certified"
        return Verdict.INCONCLUSIVE, "there is only one solution, but no bound on the distance to it"


_FORMS = {"energy": "energy QP", "gap": "gap QP", "mpec": "MPEC"}


def solves(problem: ProblemData, y: Vector, rtol: float) -> bool:
    """Whether Res(y) ≤ max(rtol·Res(0), 4‖rounding of F(y)‖₂); false for NaN and infinities.

    Parameters: `y` shape (n,). Where Res(0) is zero or unknown 1 takes its place, which suits a problem in handy units.
    """
    try:
        start = problem.residual_at_0()
    except MapError:
        start = 1.0
    if not (np.isfinite(start) and start > 0):
        start = 1.0
    residual = problem.residual(y)
    floor = 4 * float(np.linalg.norm(np.maximum(*problem.rounding(y))))
    return bool(residual <= rtol * start or residual <= floor < np.inf)


def finite(value: float) -> float | None:
    """`value`, or None where it is NaN or infinite: a number that is not known."""
    return float(value) if np.isfinite(value) else None


def _readable(claim: Claim, n: int) -> tuple[Vector | None, str]:
    """The foreign z as float64 of shape (n,), all finite; or None and what is wrong with it."""
    if claim.z is None:
        return None, claim.words if not claim.solved else f"claims {claim.words!r}, but returned no z"
    try:
        x = np.array(claim.z, dtype=np.float64)
    except (TypeError, ValueError):
        return None, f"returned a {type(claim.z).__name__} that is not a real vector"
    if x.shape != (n,):
        return None, f"returned a z of shape {x.shape}; shape ({n},) was expected"
    if not np.isfinite(x).all():
        return None, f"claims {claim.words!r}, but its z is not finite"
    return x, ""


def sum_of_bounds(target: Target, y: Vector, x: Vector) -> float:
    """How far apart y and x can be if both are as near to the one solution as certified; NaN without certificate."""
    ours, theirs = error_bound(target.problem, y).value, error_bound(target.problem, x).value
    return np.nan if ours is None or theirs is None else ours + theirs
