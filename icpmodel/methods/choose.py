"""Which method `solve()` takes when none is named: a simple rule with its reason, and what to fall back on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..intervention import Intervention
from ..operators import factorise, rows_of
from ..problem import ICP
from ..theory.spectral import SMALL_RADIUS, jacobi_radius
from . import Method
from .lemke import Lemke
from .linear import FACTORISE_UP_TO, has_band, is_factorised
from .modulus import MNMAOR, MNMGS, MNMJ, MNMMOD
from .multilevel import Multilevel
from .newton import Newton

#: below this relaxation the sweeps gain nothing by it, and Gauss–Seidel has the theorems
_WORTH_RELAXING = 1.2
#: a row is hardly dominant where its other entries weigh more than this share of its diagonal
_HARDLY = 0.97
#: from these sizes on multilevel is the quicker one where most rows are hardly dominant: bands, and all others
_MULTILEVEL_FROM_ON_A_BAND, _MULTILEVEL_FROM = 100, 5000
#: from these sizes on the best jumps are sought on coarser levels first: bands, and all others
_JUMPS_FROM_ON_A_BAND, _JUMPS_FROM = 500, 2000
#: up to this size an LCP costs less to pivot than to look at
_PIVOT_UP_TO = 64


@dataclass(frozen=True)
class Choice:
    """A method and the sentence on why it was picked; `hurry` where another one waits that is more certain.

    >>> Choice(MNMGS(), "because").why
    'because'
    """

    method: Method
    why: str
    hurry: bool = False


def choose(problem: ICP) -> Iterator[Choice]:
    """The methods to try on `problem`, best first; each is made only when the one before it has failed.

    Lemke comes first for an LCP that is small, and up to n = 500 it follows on Newton.
    Multilevel comes first where A is large and most of its rows are hardly dominant, so that sweeps would be slow.
    Where ψ is an intervention operator Newton comes first and Multilevel second, for large A the other way round.
    Newton comes before the sweeps where D is not positive or the estimated Jacobi radius not below 1. Else it follows
    on sweeps, which are overrelaxed first where the radius promises a gain.
    The last are MNMJ, which is proved whenever there is an error bound, and MNMMOD with three θ₁, which needs no
    dominance. Newton and MNMMOD are left out where A is too large to be factorised, and where ψ has no derivative
    Newton, and Multilevel unless every ψ_i moves with its own z_i alone.

    >>> [choice.method for choice in choose(ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 1.0]))][0]
    Lemke()
    """
    if is_small(problem):
        yield Choice(Lemke(), f"with n = {problem.n} pivoting solves an LCP at once")
    positive = bool((rows_of(problem).diagonal > 0).all())
    if isinstance(problem.psi, Intervention):
        large = problem.n >= (_JUMPS_FROM_ON_A_BAND if has_band(problem) else _JUMPS_FROM)
        if large:
            yield from _coarser_jumps(problem)
        yield from _newton(problem, "policy iteration: the best jumps settle in a few steps")
        if not large:
            yield from _coarser_jumps(problem)
        yield from _factorised(problem, "one factorisation moves the answer across the whole grid in every step")
        if positive:
            yield Choice(MNMJ(), "Jacobi with Omega = D is monotone where A is a Z-matrix and psi isotone")
        return
    if positive:
        yield from _sweeps_and_newton(problem)
        yield Choice(MNMJ(), "projected Jacobi is proved wherever one v > 0 gives <A>v > 0 and (I - G)v > 0")
    else:
        yield from _newton(problem, "Newton's method needs no positive diagonal")
    yield from _factorised(problem, "M1 = A needs no diagonal dominance")


def is_small(problem: ICP) -> bool:
    """Whether it is an LCP so small that pivoting comes first.

    >>> is_small(ICP([[2.0]], [1.0]))
    True
    """
    return problem.n <= _PIVOT_UP_TO and problem.is_lcp


def _sweeps_and_newton(problem: ICP) -> Iterator[Choice]:
    """What there is for D > 0: sweeps, and before them what is quicker where they would be slow, Newton else after."""
    yield from _multilevel(problem)
    rows = rows_of(problem)
    # from the row sums alone where they already show that relaxation gains nothing
    with np.errstate(over="ignore"):
        radius = float((rows.rest / rows.diagonal).max())
    if radius > SMALL_RADIUS:
        radius = problem.remembered("jacobi radius", lambda: jacobi_radius(problem.A))
    omega = 2.0 / (1.0 + np.sqrt(1.0 - min(radius, 1.0 - 1e-6) ** 2))
    relax = omega >= _WORTH_RELAXING
    slow = ""
    if radius >= 1.0:
        slow = f"sweeps need a Jacobi radius below 1, the estimate is {radius:.4g}"
    if slow:
        yield from _newton(problem, slow)
    if relax:
        why = f"relaxed for the estimated Jacobi radius {radius:.4f}"
        yield Choice(overrelaxed(problem, 0.98 * omega), why, hurry=True)
        why = "Gauss-Seidel sweeps are proved for H+-matrices and psi of small slope"
    else:
        why = f"sweeps need no relaxation here (estimated Jacobi radius {radius:.4f})"
    yield Choice(MNMGS(), why, hurry=True)
    if not slow:
        yield from _newton(problem, "Newton's method does not depend on a splitting")


def _multilevel(problem: ICP) -> Iterator[Choice]:
    """Multilevel where sweeps would be slow: information that crosses rows which are hardly dominant does not fade."""
    rows = rows_of(problem)
    least = _MULTILEVEL_FROM_ON_A_BAND if has_band(problem) else _MULTILEVEL_FROM
    if problem.n < least:
        return
    share = np.mean(rows.rest > _HARDLY * rows.diagonal)
    multilevel = Multilevel()
    if share > 0.5 and multilevel.why_not(problem) is None:
        yield Choice(multilevel, f"{share:.0%} of the rows are hardly dominant: sweeps would be slow")


def _coarser_jumps(problem: ICP) -> Iterator[Choice]:
    """Policy iteration that begins on coarser levels, where its systems can be solved."""
    multilevel = Multilevel()
    if multilevel.why_not(problem) is None and is_factorised(problem):
        yield Choice(multilevel, "policy iteration, whose best jumps the coarser levels find first")


def _newton(problem: ICP, why: str) -> Iterator[Choice]:
    """Newton where its systems can be solved and ψ has a derivative, and pivots where it fails."""
    newton, lemke = Newton(), Lemke()
    if newton.why_not(problem) is None and is_factorised(problem):
        yield Choice(newton, why)
    if not is_small(problem) and lemke.why_not(problem) is None:
        yield Choice(lemke, "pivoting ends for every P-matrix and every semidefinite A")


def why_none(problem: ICP) -> str:
    """Why `choose` found no method that could start.

    >>> why_none(ICP([[0.0]], [1.0]))
    'A[0, 0] = 0 is not positive, and A + Omega could not be factorised'
    """
    diagonal = problem.A.diagonal()
    i = int(np.argmin(diagonal))
    big = "" if is_factorised(problem) else f"A with n > {FACTORISE_UP_TO} is not factorised"
    return f"A[{i}, {i}] = {diagonal[i]:g} is not positive, and {big or 'A + Omega could not be factorised'}"


def _factorised(problem: ICP, why: str) -> Iterator[Choice]:
    """MNMMOD with θ₁ = √(‖A‖_∞/‖A⁻¹1‖_∞), for an M-matrix the mean of its largest and smallest scale."""
    if not is_factorised(problem):
        return
    rows = rows_of(problem)
    size = float((rows.rest + np.abs(rows.diagonal)).max())
    lu = factorise(problem.A)
    inverse = np.inf if lu is None else float(np.abs(lu.solve(np.ones(problem.n))).max())
    theta1 = float(np.sqrt(size / inverse)) if 0 < inverse < np.inf else size
    if not 0 < theta1 < np.inf:
        theta1 = 1.0
    yield Choice(MNMMOD(theta1=theta1), f"{why}; theta1 from the norms of A and its inverse")
    for factor in (0.5, 2.0):
        yield Choice(MNMMOD(theta1=factor * theta1), f"{why}; theta1 changed by a factor of {factor:g}")


def overrelaxed(problem: ICP, omega: float) -> MNMAOR:
    """MNMAOR with X = 2(D/ω − L) and Ω = (2 − ω)D: on the rows where p < Ωr it is successive overrelaxation.

    Parameters: `omega` in (0, 2). The small Ω keeps overrelaxed rows near the contact set from flipping sides.

    >>> overrelaxed(ICP([[2.0]], [-1.0]), 1.0)
    MNMAOR(phi2=<1 values>, theta2=2)
    """
    share = 2.0 - omega
    theta1 = 1.0 / (2.0 / omega - share)
    return MNMAOR(theta1=theta1, theta2=2.0 * theta1, phi2=share * problem.A.diagonal())
