"""Which method `solve()` takes when none is named: a simple rule with its reason, and what to fall back on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ..intervention import Intervention
from ..operators import factorise
from ..problem import ICP
from ..theory.spectral import jacobi_radius
from . import Method
from .modulus import MNMAOR, MNMGS, MNMJ, MNMMOD

#: below this relaxation the sweeps gain nothing by it, and Gauss–Seidel has the theorems
_WORTH_RELAXING = 1.2
#: beyond this size a factorisation is not tried as a fallback
_FACTORISE_UP_TO = 200_000


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

    Where ψ is an intervention operator: MNMMOD, which carries a change across the whole grid in one step, then MNMJ.
    Else, with D > 0: overrelaxed sweeps where the estimated Jacobi radius promises a gain and MNMGS otherwise, then the
    other of the two; then MNMJ, which is proved whenever there is an error bound, and last MNMMOD with three θ₁,
    which needs no diagonal dominance. MNMMOD is left out where A is too large to be factorised.

    >>> [choice.method for choice in choose(ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 1.0]))][0]
    MNMGS()
    """
    if isinstance(problem.psi, Intervention):
        yield from _factorised(problem, "one factorisation moves the answer across the whole grid in every step")
        if (problem.A.diagonal() > 0).all():
            yield Choice(MNMJ(), "Jacobi with Omega = D is monotone where A is a Z-matrix and psi isotone")
        return
    if (problem.A.diagonal() > 0).all():
        if "jacobi radius" not in problem._memory:
            problem._memory["jacobi radius"] = jacobi_radius(problem.A)
        radius = problem._memory["jacobi radius"]
        omega = 2.0 / (1.0 + np.sqrt(1.0 - min(radius, 1.0 - 1e-6) ** 2))
        sweeps = Choice(MNMGS(), f"sweeps need no relaxation here (estimated Jacobi radius {radius:.4f})", True)
        if omega >= _WORTH_RELAXING:
            why = f"relaxed for the estimated Jacobi radius {radius:.4f}"
            yield Choice(overrelaxed(problem, 0.98 * omega), why, hurry=True)
            why = "Gauss-Seidel sweeps are proved for H+-matrices and psi of small slope"
            sweeps = Choice(MNMGS(), why, hurry=True)
        yield sweeps
        yield Choice(MNMJ(), "projected Jacobi is proved wherever one v > 0 gives <A>v > 0 and (I - G)v > 0")
    yield from _factorised(problem, "M1 = A needs no diagonal dominance")


def why_none(problem: ICP) -> str:
    """Why `choose` found no method that could start.

    >>> why_none(ICP([[0.0]], [1.0]))
    'A[0, 0] = 0 is not positive, and A + Omega could not be factorised'
    """
    diagonal = problem.A.diagonal()
    i = int(np.argmin(diagonal))
    big = f"A with n > {_FACTORISE_UP_TO} is not factorised" if problem.n > _FACTORISE_UP_TO else ""
    return f"A[{i}, {i}] = {diagonal[i]:g} is not positive, and {big or 'A + Omega could not be factorised'}"


def _factorised(problem: ICP, why: str) -> Iterator[Choice]:
    """MNMMOD with θ₁ = √(‖A‖_∞/‖A⁻¹1‖_∞), for an M-matrix the mean of its largest and smallest scale."""
    if problem.n > _FACTORISE_UP_TO:
        return
    with np.errstate(over="ignore"):
        size = float(problem.absolute_A().sum(axis=1).max())
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
