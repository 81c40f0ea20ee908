"""Which methods a problem is given, best first: a simple rule with its reasons.

The numbers were found by trial on the gallery (`icpmodel measure dispatch`).
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from itertools import chain

import numpy as np

from ..algebra.affine_lcp import PIVOT_UP_TO
from ..algebra.equations import is_factorised
from ..algebra.relaxation import best_omega, relaxation, scale_of
from ..methods.accelerated import Accelerated
from ..methods.aor import MNMGS, MNMJ, overrelaxed
from ..methods.factorised import MNMMOD
from ..methods.josephy import Josephy
from ..methods.lemke import Lemke
from ..methods.multilevel import Multilevel
from ..methods.newton import Newton
from ..methods.psor import PSOR
from ..methods.tridiagonal import Tridiagonal
from ..problem.data import ProblemData
from ..problem.matrix import HARDLY
from .candidate import Candidate, Watch

#: a candidate that others wait behind is given up after so many steps without a better iterate
_IMPATIENT = 1000
#: below this relaxation the sweeps gain nothing by it, and Gauss–Seidel has the theorems; what of it is taken where
#: psi moves
_WORTH_RELAXING, _CAUTION = 1.05, 0.98
#: up to this size, if so many relaxed sweeps promise to do, they cost less than coarser levels; they stay where, once
#: they should be done, at most so many times as many are to come
_RELAXED_UP_TO, _MOST, _UNDERESTIMATED = 20_000, 220, 1.5
#: up to this size combining sweeps costs less than to find out how far they should be relaxed
_ACCELERATED_UP_TO = 1200
#: where psi moves acceleration gains from this size on, and where more plain sweeps than that are needed
_ACCELERATED_FROM, _PLAIN = 500, 25
#: beyond this size forty sweeps do not tell how slow the others will be
_RATES_TOLD_UP_TO = 150_000
#: a matrix whose couplings have this mean, at most 1 for every H-matrix, is nothing for multigrid
_FAR = 2.0
#: from these sizes on multilevel is the quicker one where most rows are hardly dominant: bands, and all others
_MULTILEVEL_FROM_ON_A_BAND, _MULTILEVEL_FROM = 100, 5000
#: from these sizes on the best jumps are sought on coarser levels first: bands, and all others
_JUMPS_FROM_ON_A_BAND, _JUMPS_FROM = 500, 2000
#: up to this size to pivot for the best jumps costs less than to factorise
_PIVOTED_JUMPS_UP_TO = 150
#: up to this size it costs less to pivot than what else there is where sweeps are slow
_PIVOT_BEFORE_NEWTON_UP_TO = 200
#: up to this size pivots cost less than to look at A; beyond it, up to `PIVOT_UP_TO`, less than to try some sweeps
#: where A has at least this share of entries, or more than the second share of rows, not all, are hardly dominant
_PIVOT_BEFORE_A_LOOK_UP_TO, _FULL, _MANY = 32, 0.25, 0.4
#: so many sweeps cost less than to begin with another method: at least, at the most, and divided by n in between;
#: where ψ moves so many more, as there the others cost more; n before pivots up to n = 64, and so many more before
#: Josephy's steps
_SWEEPS, _MOST_SWEEPS, _SMALL_SWEEPS = 50, 250, 5000
_SWEEPS_OF_A_MOVING_PSI, _SWEEPS_BEFORE_JOSEPHY = 100, 30
_LINEARISED = "with n = {} a few affine problems are pivoted at once"
_RELAXED = "relaxed for the estimated Jacobi radius {:.4f}"


def choose(problem: ProblemData, aim: float) -> Iterator[Candidate]:
    """The methods to try on `problem`, best first; each is made only when the one before it has failed.

    `aim` is the share of Res(0) that is asked for. Tridiagonal comes first wherever it applies; Lemke, where ψ is
    affine or amounts to a fixed obstacle, for n ≤ 32, and for n ≤ 64 where A is full or many of its rows are hardly
    dominant; and for n ≤ 64 Josephy where ψ is another elementwise map with a derivative. Else, for D > 0, a few plain
    sweeps of PSOR are watched, and where they show that many more would be needed the next method goes on: Josephy for
    n ≤ 64 where ψ has a derivative; Lemke for n ≤ 200 where ψ is affine or amounts to a fixed obstacle (up to n = 500
    it follows on Newton); Multilevel where A is large and most of its rows are hardly dominant, for an LCP with
    n ≤ 20 000 after overrelaxed sweeps where some two hundred of them promise to do; sweeps that are overrelaxed where
    the Jacobi radius is below 1 and promises a gain, by PSOR where every ψ_i moves with its own z_i alone (beyond
    n = 64 and up to 1200 accelerated, with a rough radius), else by MNMAOR; then Newton, and MNMGS. Newton comes before
    the sweeps where the radius is not below 1. Where ψ takes the best of several, Josephy comes first where n ≤ 150,
    then Newton and Multilevel, for large A the other way round.
    The last are MNMJ, which is proved whenever there is an error bound, and MNMMOD with three θ₁, which needs no
    dominance. Newton and MNMMOD are left out where A is too large to be factorised, and where ψ has no derivative
    Newton, and Multilevel unless every ψ_i moves with its own z_i alone.
    """
    yield from direct(problem)
    yield from on_trial(problem)
    yield from after_trial(problem, aim)


def direct(problem: ProblemData) -> Iterator[Candidate]:
    """The methods that cost less than to look at the problem: one for tridiagonal A, and pivots where n is small."""
    tiny, pivots = problem.n <= _PIVOT_BEFORE_A_LOOK_UP_TO, pivots_at_once(problem)
    lemke = Candidate(Lemke(), f"with n = {problem.n} and an obstacle that is fixed or affine pivoting is done at once")
    if tiny and pivots:
        yield lemke
    if Tridiagonal().why_not(problem) is None:
        yield Candidate(Tridiagonal(), "A is tridiagonal: a pass over its rows solves the problem")
    if not tiny and pivots:
        yield lemke
    if _moves_alone(problem) and _is_linearised(problem):
        yield Candidate(Josephy(), _LINEARISED.format(problem.n))


def _moves_alone(problem: ProblemData) -> bool:
    """Whether ψ is of a kind that Josephy's steps settle at once: of single entries, or of jumps."""
    return problem.psi.takes_best or problem.psi.is_elementwise


def pivots_at_once(problem: ProblemData) -> bool:
    """Whether Lemke comes before any sweeps: ψ is affine or amounts to a fixed obstacle, and n ≤ 32, or n ≤ 64 and A is
    full or its rows are such that sweeps would be slow. Where no row at all is dominant A is nearly singular, which is
    worse for pivots than for sweeps.
    """
    if problem.n > PIVOT_UP_TO or Lemke().why_not(problem) is not None:
        return False
    if problem.n <= _PIVOT_BEFORE_A_LOOK_UP_TO or problem.nnz >= _FULL * problem.n**2:
        return True
    return _MANY < problem.matrix.hardly_dominant < 1.0


def on_trial(problem: ProblemData) -> Iterator[Candidate]:
    """Plain sweeps where D > 0, as long as they are quick."""
    if problem.psi.takes_best or not problem.matrix.has_positive_diagonal:
        return
    rather = None
    if _ACCELERATED_FROM <= problem.n <= _RATES_TOLD_UP_TO and not problem.facts.has_fixed_obstacle:
        # in large problems the first rates are those of the roughest errors, which say little of the others
        first_look = 1 if problem.n < _MULTILEVEL_FROM else 3
        rather = (Candidate(Accelerated(), "psi moves, and acceleration gains there", goes_on=True), _PLAIN, first_look)
    watch = Watch(_worth(problem), "plain sweeps", rather=rather)
    yield Candidate(PSOR(), "plain sweeps are watched: they stay as long as they are quick", _IMPATIENT, watch)


def _worth(problem: ProblemData) -> float:
    """How many sweeps cost less than what comes after them."""
    if _is_linearised(problem):
        return problem.n + _SWEEPS_BEFORE_JOSEPHY
    if problem.n <= PIVOT_UP_TO and _pivots_first(problem):
        return problem.n
    more = 0 if problem.facts.has_fixed_obstacle else _SWEEPS_OF_A_MOVING_PSI
    return more + min(_SWEEPS + _SMALL_SWEEPS / problem.n, _MOST_SWEEPS)


def after_trial(problem: ProblemData, aim: float) -> Iterator[Candidate]:
    """What `choose` has after the first sweeps."""
    positive = problem.matrix.has_positive_diagonal
    if problem.psi.takes_best:
        yield from _best_jumps(problem)
        if positive:
            yield Candidate(MNMJ(), "Jacobi with Omega = D is monotone where A is a Z-matrix and psi isotone")
        return
    if not problem.psi.is_elementwise and _is_linearised(problem):
        yield Candidate(Josephy(), _LINEARISED.format(problem.n), goes_on=True)
    if _pivots_first(problem):
        if positive and problem.n > PIVOT_UP_TO:
            yield from _accelerated(problem)
        yield Candidate(Lemke(), f"with n = {problem.n} and an obstacle that is fixed or affine pivoting costs least")
    if positive:
        yield from _sweeps_and_newton(problem, aim)
        yield Candidate(MNMJ(), "projected Jacobi is proved wherever one v > 0 gives <A>v > 0 and (I - G)v > 0")
    else:
        yield from _newton(problem, "Newton's method needs no positive diagonal")
    yield from _factorised(problem, "M1 = A needs no diagonal dominance")


def _best_jumps(problem: ProblemData) -> Iterator[Candidate]:
    """Where ψ takes the best of several: policy iteration, for large A from coarser levels."""
    large = problem.n >= (_JUMPS_FROM_ON_A_BAND if problem.matrix.is_band else _JUMPS_FROM)
    if large:
        yield from _coarser_jumps(problem)
    yield from _newton(problem, "policy iteration: the best jumps settle in a few steps")
    if not large:
        yield from _coarser_jumps(problem)
    yield from _factorised(problem, "one factorisation moves the answer across the whole grid in every step")


def _pivots_first(problem: ProblemData) -> bool:
    """Whether pivoting comes before Newton, but not at once."""
    small = problem.n <= _PIVOT_BEFORE_NEWTON_UP_TO and not pivots_at_once(problem)
    return small and Lemke().why_not(problem) is None


def _is_linearised(problem: ProblemData) -> bool:
    """Whether n is so small, and ψ such, that a few affine problems are pivoted instead."""
    most = _PIVOTED_JUMPS_UP_TO if problem.psi.takes_best else PIVOT_UP_TO
    return problem.n <= most and Lemke().why_not(problem) is not None and Josephy().why_not(problem) is None


def _sweeps_and_newton(problem: ProblemData, aim: float) -> Iterator[Candidate]:
    """What there is for D > 0 where plain sweeps are slow."""
    yield from _relaxed_first(problem, _multilevel(problem), aim)
    if not _pivots_first(problem):
        yield from _accelerated(problem)
    radius = problem.matrix.jacobi_radius
    # on rows that do not touch the obstacle a smaller one is the best, which an estimate from below allows for
    omega = best_omega(radius)
    slow = radius >= 1.0
    if slow:
        yield from _newton(problem, f"sweeps need a Jacobi radius below 1, the estimate is {radius:.4g}")
    if omega >= _WORTH_RELAXING:
        fixed = problem.facts.has_fixed_obstacle
        relaxed = PSOR(omega=omega) if fixed else overrelaxed(problem, _CAUTION * omega)
        yield Candidate(relaxed, _RELAXED.format(radius), _IMPATIENT, goes_on=True)
    if not slow:
        yield from _newton(problem, "Newton's method does not depend on a splitting")
    yield Candidate(MNMGS(), "Gauss-Seidel sweeps are proved for H+-matrices and psi of small slope", _IMPATIENT)


def _relaxed_first(problem: ProblemData, others: Iterator[Candidate], aim: float) -> Iterator[Candidate]:
    """Relaxed sweeps where they promise to be quicker than the `others`, to which they give way where they are not."""
    first = next(others, None)
    if first is None:
        return
    if problem.is_lcp and _ACCELERATED_UP_TO < problem.n <= _RELAXED_UP_TO:
        radius = problem.matrix.jacobi_radius
        if 0.0 < radius < 1.0:
            omega = best_omega(radius)
            sweeps = math.log(aim) / math.log(omega - 1.0)  # the rate of the best ω is ω − 1
            if sweeps <= _MOST:
                watch = Watch(_UNDERESTIMATED * sweeps, "relaxed sweeps", math.ceil(sweeps))
                yield Candidate(PSOR(omega=omega), _RELAXED.format(radius), _IMPATIENT, watch, goes_on=True)
    yield from chain([first], others)


def _accelerated(problem: ProblemData) -> Iterator[Candidate]:
    """Accelerated sweeps, where n is small enough and the Jacobi radius promises a gain."""
    if problem.n <= _ACCELERATED_UP_TO and problem.facts.has_fixed_obstacle:
        omega = relaxation(problem)
        if omega >= _WORTH_RELAXING:
            why = "accelerated, and relaxed with caution: other methods cost more than some dozens of sweeps"
            yield Candidate(Accelerated(of=PSOR(omega=omega)), why, _IMPATIENT, goes_on=True)


def _multilevel(problem: ProblemData) -> Iterator[Candidate]:
    """Multilevel where sweeps would be slow: information that crosses rows which are hardly dominant does not fade."""
    least = _MULTILEVEL_FROM_ON_A_BAND if problem.matrix.is_band else _MULTILEVEL_FROM
    if problem.n < least:
        return
    share = problem.matrix.hardly_dominant
    if share > 0.5:  # what flows through A in one direction only does not slow sweeps down
        sums = problem.matrix.couplings @ np.ones(problem.n)
        share = float(np.mean(sums > HARDLY)) if sums.mean() <= _FAR else 0.0
    multilevel = Multilevel()
    if share > 0.5 and multilevel.why_not(problem) is None:
        yield Candidate(multilevel, f"{share:.0%} of the rows are hardly dominant: sweeps would be slow")


def _coarser_jumps(problem: ProblemData) -> Iterator[Candidate]:
    """Policy iteration that begins on coarser levels, where its systems can be solved."""
    multilevel = Multilevel()
    if multilevel.why_not(problem) is None and is_factorised(problem):
        yield Candidate(multilevel, "policy iteration, whose best jumps the coarser levels find first")


def _newton(problem: ProblemData, why: str) -> Iterator[Candidate]:
    """Newton where its systems can be solved and ψ has a derivative, and pivots where it fails."""
    newton, lemke = Newton(), Lemke()
    if newton.why_not(problem) is None and is_factorised(problem):
        yield Candidate(newton, why)
    if problem.n > _PIVOT_BEFORE_NEWTON_UP_TO and lemke.why_not(problem) is None:
        yield Candidate(lemke, "pivoting ends for every P-matrix and every semidefinite A")


def _factorised(problem: ProblemData, why: str) -> Iterator[Candidate]:
    """MNMMOD with θ₁ = √(‖A‖_∞/‖A⁻¹1‖_∞), for an M-matrix the mean of its largest and smallest scale."""
    if not is_factorised(problem):
        return
    theta1 = scale_of(problem)
    yield Candidate(MNMMOD(theta1=theta1), f"{why}; theta1 from the norms of A and its inverse")
    for factor in (0.5, 2.0):
        yield Candidate(MNMMOD(theta1=factor * theta1), f"{why}; theta1 changed by a factor of {factor:g}")


def why_none(problem: ProblemData) -> str:
    """Why `choose` found no method that could start."""
    diagonal = problem.A.diagonal()
    i = int(np.argmin(diagonal))
    big = "" if is_factorised(problem) else "factors of A are foreseen to be too large"
    return f"A[{i}, {i}] = {diagonal[i]:g} is not positive, and {big or 'A + Omega could not be factorised'}"
