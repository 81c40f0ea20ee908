"""The one judge of foreign answers.

A foreign status is recorded but proves nothing: every residual and difference is recomputed from (A, q, ψ, z).
"""

from __future__ import annotations

from dataclasses import dataclass
from enum import Enum
from typing import Any, Self

import numpy as np

from ..errors import InputError
from ..numerics.arrays import Vector, norm
from ..numerics.rounding import rounded_down, rounded_share, rounded_up
from ..problem.data import ProblemData
from ..problem.verdict import certified_residual
from ..solve.goal import RTOL
from ..solve.solution import Solution
from ..solvers.foreign import Claim
from ..solvers.formulations import Target, targets
from ..solvers.typical_units import in_typical_units, in_units_of_z
from ..theory.certificates.bounds import error_bound

#: the largest Res_D(z) of a foreign solution, as a share of `residual_scale`; for the answer under test it is `RTOL`
FOREIGN_RTOL = 1e-7
#: a Solution that was stopped at a looser tolerance is judged by that, but by this one at most
MAX_RTOL = 1e-4
#: two answers agree within AGREE·max|z| + AGREE_NEAR_ZERO·unit: the second term matters where z is about zero
AGREE = 1e-6
AGREE_NEAR_ZERO = 1e-9
#: the largest certified bound by which answers agree, as a multiple of the tolerance; a wide bound proves nothing
MAX_BOUND_FACTOR = 10.0


class Verdict(Enum):
    """The verdict on a foreign answer, beside the answer under test, and its `meaning` in a sentence.

    Only AGREES supports the answer under test, and only DISAGREES contradicts it.

    Examples
    --------
    >>> icp.crosscheck(ICP([[2.0]], [-1.0]), [0.5], ["osqp"]).rows[0].verdict
    <Verdict.AGREES: 'agrees'>
    >>> from icpmodel.crosscheck import Verdict
    >>> Verdict("loose").meaning
    'it claims success by its own criterion, but its residual is above tolerance by ours'
    """

    meaning: str

    def __new__(cls, word: str, meaning: str) -> Self:
        verdict = object.__new__(cls)
        verdict._value_, verdict.meaning = word, meaning
        return verdict

    AGREES = "agrees", "both answers are the same, within tolerance or within their certified bounds"
    LOOSE = "loose", "it claims success by its own criterion, but its residual is above tolerance by ours"
    OTHER_SOLUTION = "other solution", "both answers are solutions, and nothing proves that there is only one"
    INCONCLUSIVE = "inconclusive", "both residuals are small and the answers differ, but not by more than is certified"
    DISAGREES = "disagrees", "its answer is a solution, the answer under test is not, or is provably another point"
    FAILED = "failed", "it raised, returned no finite z, or does not claim success"
    SKIPPED = "skipped", "it cannot take this problem, or was not asked"


@dataclass(frozen=True)
class Row:
    """One line of a report, in the user's units.

    `residual` is Res_D of the foreign z on the problem that the solver got, and `difference` max|z_foreign − z|; None
    if there is no number. `claim` is the foreign status, and `note` the reason of the verdict.
    """

    solver: str
    formulation: str
    verdict: Verdict
    residual: float | None = None
    difference: float | None = None
    seconds: float | None = None
    claim: str = ""
    note: str = ""

    @property
    def local(self) -> bool:
        """Whether the obstacle was frozen, or p replaced by its tangent, at the answer under test."""
        return self.formulation.startswith(("frozen", "tangent"))


class AnswerUnderTest:
    """An answer under test, `z`, and `y` = z/`unit`, the same in the typical units of its `targets`.

    `problem` is `original` with the tangent at z for a nonlinear p. `holds` says whether z is a solution. `tolerance`
    is the largest difference of an answer that agrees; `atol` replaces its default.
    """

    def __init__(self, original: ProblemData, solution: Any, atol: float | None = None) -> None:
        self.original = original
        self.z = original.vector(solution, "solution", finite=True)
        self.problem = problem = original.linearised(self.z)
        scaled, self.unit = in_typical_units(problem)
        rtol = RTOL
        scale = problem.residual_scale() or norm(self.z)
        self.y = self.z / self.unit
        is_own = isinstance(solution, Solution) and solution.problem is original
        if is_own and solution.solved and scale > 0:
            rtol = min(max(RTOL, solution.tolerance / scale, solution.residual / scale), MAX_RTOL)
        self.holds = solves(problem, self.z, rtol)
        # the unit may be far larger than z: it counts only for an answer that is known to be a solution
        default = AGREE * float(np.abs(self.z).max()) + (AGREE_NEAR_ZERO * self.unit if self.holds else 0.0)
        self.tolerance = default if atol is None else float(atol)
        nonlinear = self.original.f is not None
        self.targets = targets(scaled, self.y, tangent=nonlinear)
        if nonlinear:
            self.targets += targets(in_units_of_z(self.original, self.unit), self.y)

    def judge(self, solver: str, form: str, target: Target, claim: Claim) -> Row:
        """Judge the `claim` of a `solver` on `target`, stated in `form`: the row of the report."""
        verdict = Verdict.FAILED
        x = None
        residual = np.nan
        difference = np.nan
        note = f"claims {claim.words!r}, but returned no z" if claim.solved else self._ended(claim)
        try:
            x = None if claim.z is None else self.problem.vector(claim.z, "its z", finite=True)
        except InputError as error:
            note = f"claims {claim.words!r}, but {error}" if claim.solved else note
        if x is not None:
            z = x * self.unit
            difference = float(np.abs(z - self.z).max())
            stated = self.problem if target.tangent else self.original
            residual = (stated.frozen(self.z) if target.frozen else stated).residual(z)
            verdict, note = self._compare(target, x, claim, difference)
        words = ["frozen"] * target.frozen + ["tangent"] * target.tangent
        form_name = " ".join([*words, {"energy": "energy QP", "gap": "gap QP"}.get(form, form.upper())])
        return Row(solver, form_name, verdict, finite(residual), finite(difference), claim.seconds, claim.words, note)

    def _compare(self, target: Target, x: Vector, claim: Claim, difference: float) -> tuple[Verdict, str]:
        """The verdict on a finite x, in the units of `target`, and its reason. Every comparison is false for NaN."""
        theirs = solves(target.problem, x, FOREIGN_RTOL)
        if not claim.solved:
            right = f"it ended with: {claim.words}; its z solves the problem all the same"
            return Verdict.FAILED, right if theirs else self._ended(claim)
        if not theirs:
            return Verdict.LOOSE, self._loose(target.problem, x, claim)
        if np.isfinite(self.z).all() and difference <= self.tolerance:
            return Verdict.AGREES, claim.words
        if not self.holds:
            return Verdict.DISAGREES, "the residual of the answer under test is above tolerance"
        return self.by_bound(difference, sum_of_bounds(target, self.y, x) * self.unit, target.unique)

    @staticmethod
    def _loose(problem: ProblemData, x: Vector, claim: Claim) -> str:
        """The reason of LOOSE: the requested accuracy, by the solver's criterion, and that of its answer, by ours."""
        share = problem.residual(x) / (problem.residual_scale() or norm(x) or 1.0)
        request = "" if claim.tolerance is None else f"asked for {claim.tolerance:g} in its own measure, "
        return f"claims {claim.words!r}: {request}{share:.1e} in ours, where {FOREIGN_RTOL:g} was expected"

    def _ended(self, claim: Claim) -> str:
        """The reason of FAILED for a claim without success.

        "infeasible" and "unbounded" rest on rays that are not checked. They are false if the answer under test is a
        solution.
        """
        known = ", and the answer under test is a solution" if self.holds else ", which is not checked"
        return f"it ended with: {claim.words}{known}"

    def by_bound(self, difference: float, bound: float, unique: bool) -> tuple[Verdict, str]:
        """The verdict on a solution `difference` away, and its reason; `bound` on that is certified, or NaN."""
        if difference <= bound <= MAX_BOUND_FACTOR * self.tolerance:
            return Verdict.AGREES, f"within the certified bound {rounded_up(bound, 2)}"
        if difference <= bound:
            reason = f"the bound {rounded_up(bound, 2)} is too wide to decide; solve with a smaller rtol"
            return Verdict.INCONCLUSIVE, reason
        if difference > bound:
            return (
                Verdict.DISAGREES,
                f"both residuals are small, but they differ by more than the bound {rounded_down(bound, 2)}",
            )
        if not unique:
            return Verdict.OTHER_SOLUTION, "both are solutions; uniqueness is not certified"
        return Verdict.INCONCLUSIVE, "there is only one solution, but no bound on the distance to it"


def solves(problem: ProblemData, y: Vector, rtol: float) -> bool:
    """Whether the exact Res_D(y) is at most `rtol` times `residual_scale`, or as small as its rounding errors.

    These must be small as well: at most MAX_RTOL times the scale. False for NaN and infinities.
    """
    scale = problem.residual_scale() or norm(y)
    residual = problem.residual(y)
    tolerance = float(rounded_share(scale, rtol))
    if certified_residual(problem, y, residual, tolerance) <= tolerance:
        return True
    return residual <= 4 * problem.rounding_of_residual(y) <= MAX_RTOL * scale


def finite(value: float) -> float | None:
    """`value`, or None, for unknown, if it is NaN or infinite."""
    return float(value) if np.isfinite(value) else None


def sum_of_bounds(target: Target, y: Vector, x: Vector) -> float:
    """An upper bound of max|y − x|: the sum of their certified distances to the one solution; NaN if one is unknown."""
    ours = error_bound(target.problem, y).value
    theirs = error_bound(target.problem, x).value
    return np.nan if ours is None or theirs is None else ours + theirs
