"""What the page says in words: of ψ, of the choice of a method and its parameters, and where nothing is proved."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..algebra.splittings import Given, Whole
from ..methods.aor import MNMAOR, MNMGS, MNMJ, MNMSOR
from ..methods.contract import Method
from ..methods.factorised import MNMMOD, MNMOD
from ..methods.modulus import ModulusMember
from ..methods.newton import Newton
from ..numerics.arrays import Vector
from ..numerics.rounding import at_most
from ..problem.affine import Constant
from ..problem.data import ProblemData
from ..problem.intervention import Intervention
from ..theory.matrices.classes import MatrixClasses

#: beyond this size only the members that need no factorisation are looked at
_FACTORISE_UP_TO = 20_000
#: factors that differ by less, or are all rounding, are the same
_TIE, _NOTHING = 1e-6, 1e-12
#: titles of members that differ in one parameter alone, the simplest first
_OMEGA = {
    "D": "MNMGS(), Omega = D",
    "0.9 D": "MNMGS(), Omega = 0.9 D",
    "1.5 D": "MNMGS(), Omega = 1.5 D",
}
_THETA = {
    "theta1=1, theta2=0 (mnmj)": "MNMJ(), Omega = D",
    "theta1=theta2=1 (mnmgs)": "MNMGS(), Omega = D",
    "theta1=theta2=0.9 (mnmsor)": "MNMSOR(theta1=0.9), Omega = D",
    "theta1=theta2=1.1 (mnmsor)": "MNMSOR(theta1=1.1), Omega = D",
    "theta1=1, theta2=2 (mnmaor)": "MNMAOR(theta2=2), Omega = D",
}


def members(problem: ProblemData) -> dict[str, Method]:
    """Title → the members to look at; few where A is large."""
    diagonal: Vector = problem.A.diagonal()
    members: dict[str, Method] = {
        "MNMJ(), Omega = D": MNMJ(),
        "MNMGS(), Omega = D": MNMGS(),
    }
    if np.abs(problem.A.data).max() > np.finfo(np.float64).max / 4:  # M1 and Omega of the others would overflow
        return members
    members["MNMAOR(theta2=2), Omega = D"] = MNMAOR(theta2=2.0)
    if problem.n > _FACTORISE_UP_TO:
        return members
    members["MNMSOR(theta1=0.9), Omega = D"] = MNMSOR(theta1=0.9)
    members["MNMSOR(theta1=1.1), Omega = D"] = MNMSOR(theta1=1.1)
    if (diagonal > 0).all():
        members["MNMGS(), Omega = 0.9 D"] = MNMGS(phi2=0.9 * diagonal)
        members["MNMGS(), Omega = 1.5 D"] = MNMGS(phi2=1.5 * diagonal)
    members["MNMOD(), Omega = I"] = MNMOD()
    theta1 = float(np.abs(diagonal).max()) or 1.0
    members[f"MNMMOD(theta1={theta1:g}), Omega = theta1 I"] = MNMMOD(theta1=theta1)
    return members


def about_psi(problem: ProblemData) -> str:
    """What is known of ψ, in one sentence."""
    psi, G = problem.psi, problem.psi.lipschitz
    if isinstance(psi, Constant):
        free = int(np.isneginf(psi.c).sum())
        rows = "row" if free == 1 else "rows"
        return "constant: G = 0, a linear complementarity problem" + (
            f"; {free} {rows} without obstacle" if free else ""
        )
    if isinstance(psi, Intervention):
        return f"{psi!r}: isotone; where jumps form a cycle rho(G) >= 1, and no proof by contraction can exist"
    if G is None:
        return f"{psi!r}: no Lipschitz matrix is known"
    slope = float((G @ np.ones(problem.n)).max())
    own = "; each row depends on its own unknown only" if G.nnz == np.count_nonzero(G.diagonal()) else ""
    word = " (at the user's word)" if psi.at_users_word else ""
    return f"{psi!r}: Lipschitz matrix G with {G.nnz} entries, largest row sum {slope:.6g}{word}{own}"


def factorises(method: Method) -> bool:
    """Whether a step of `method` solves with a factorisation of X = M₁ + φ + Ω instead of sweeping over A."""
    if not isinstance(method, ModulusMember):
        return False
    splitting = method.splitting_of()
    if isinstance(splitting, Given):
        return not MatrixClasses(splitting.M1).triangular.holds
    return isinstance(splitting, Whole)


def tie(one: float, other: float) -> bool:
    """Whether two factors per step differ by rounding only."""
    return abs(one - other) <= _TIE * max(one, other) or max(one, other) < _NOTHING


def recommendation(title: str, method: Method, factor: float, steps: int | None) -> Iterator[str]:
    """Why the method called `title`, with the proved `factor` per step and bound on the `steps`, is the one to take."""
    solve = "one solve with X = M1 + phi + Omega each, which is factorised once"
    cost = solve if factorises(method) else "one sweep over A each"
    enough = "" if steps is None else f", so that {steps} will do"
    yield f"take {title}: each step leaves at most {shown(factor)} of the error{enough}; {cost}"


def shown(factor: float) -> str:
    """A proved factor per step as text, rounded upwards, but below 1."""
    return at_most(factor, 6, below=1.0)


def parameters(factors: dict[str, float | None]) -> Iterator[str]:
    """Which Ω, and which θ₁ and θ₂, by the proved factors on this problem; nothing where there are none to compare.

    Parameters: `factors` title → factor per step or None, the titles being those of `members`.

    >>> next(parameters({"MNMGS(), Omega = D": 0.5, "MNMGS(), Omega = 1.5 D": None})).split("; ")[0]
    'Omega = D: the proved factor of mnmgs is 0.5 with D, for 1.5 D nothing is proved'
    """
    best, text = _compared(factors, _OMEGA)
    if best:
        why = "; else the share |D-Omega|/(D+Omega) of a row's own error stays"
        yield f"Omega = {best}: the proved factor of mnmgs is {text}{why if best == 'D' else ''}"
    best, text = _compared(factors, _THETA)
    if best:
        yield f"{best}: with Omega = D the proved factor is {text}"


def _compared(factors: dict[str, float | None], titles: dict[str, str]) -> tuple[str, str]:
    """The label with the smallest factor, and the sentence that holds it against the others; empty for one alone."""
    known = {label: factors[title] for label, title in titles.items() if title in factors}
    proved = {label: factor for label, factor in known.items() if factor is not None}
    if len(known) < 2 or not proved:
        return "", ""
    least = min(proved.values())
    best = next(label for label, factor in proved.items() if tie(factor, least))
    rest = sorted((factor, label) for label, factor in proved.items() if label != best)
    others = [f"{label} gives {shown(factor)}" for factor, label in rest]
    others += [f"for {label} nothing is proved" for label, factor in known.items() if factor is None]
    first = shown(proved[best])
    return best, ", ".join([f"{first} with {best}" if len(best) < 6 else first, *others])


def what_to_do(problem: ProblemData, classes: MatrixClasses, picked: Method | None = None) -> Iterator[str]:
    """What helps where no member of the family is proved to converge; `picked` is what `solve()` begins with."""
    yield "nothing above proves that a method converges; solve() tries several and calls nothing solved that is not"
    if problem.psi.lipschitz is None and not isinstance(problem.psi, Intervention):
        yield "give psi's Lipschitz matrix (lipschitz=...): without it no theorem can be applied"
    elif classes.h_plus.holds and not isinstance(problem.psi, Constant | Intervention):
        yield "A is an H+-matrix, but psi moves too much for it: a smaller G, or a larger diagonal of A, is needed"
    if isinstance(problem.psi, Intervention):
        if classes.z.holds:
            yield "for an intervention: mnmj (phi >= |D - Omega|) converges monotonically from super- and subsolutions"
        else:
            yield "A is no Z-matrix, which the theorem on interventions needs; check the signs of its discretisation"
    elif classes.definite.holds and not problem.is_lcp:
        yield "A is positive definite: with the obstacle frozen at an iterate, mnmod and mnmmod are proved"
    elif classes.p.holds:
        later = "" if isinstance(picked, Newton) else ", on which solve() falls back"
        yield f"A is a P-matrix, so with constant psi the solution is unique, but sweeps may cycle: try newton{later}"
    elif classes.semidefinite.holds and problem.is_lcp:
        yield "A is positive semidefinite: where p >= 0, r >= 0 can be met there is a solution, perhaps one of many"
    elif classes.p.holds is False:
        yield "A is no P-matrix: there may be no solution, or many; check signs and units of the model"
