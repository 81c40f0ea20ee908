"""What the page says in words: of the choice of a method and its parameters, and where nothing is proved."""

from __future__ import annotations

from collections.abc import Iterator

from ..methods.contract import Method
from ..methods.newton import Newton
from ..numerics.rounding import at_most
from ..problem.data import ProblemData
from ..theory.matrices.classes import MatrixClasses
from .forecasts import Forecast, factorises, tie

#: titles of members that differ in one parameter alone, the simplest first
_OMEGA = {label: f"MNMGS(), Omega = {label}" for label in ("D", "0.9 D", "1.5 D")}
_THETA = {
    "theta1=1, theta2=0 (mnmj)": "MNMJ(), Omega = D",
    "theta1=theta2=1 (mnmgs)": "MNMGS(), Omega = D",
    "theta1=theta2=0.9 (mnmsor)": "MNMSOR(theta1=0.9), Omega = D",
    "theta1=theta2=1.1 (mnmsor)": "MNMSOR(theta1=1.1), Omega = D",
    "theta1=1, theta2=2 (mnmaor)": "MNMAOR(theta2=2), Omega = D",
}


def recommendation(best: Forecast, factor: float) -> str:
    """Why `best`, with the proved `factor` per step, is the one to take."""
    solve = "one solve with X = M1 + phi + Omega each, which is factorised once"
    cost = solve if factorises(best.method) else "one sweep over A each"
    enough = "" if best.steps is None else f", so that {best.steps} will do"
    return f"take {best.title}: each step leaves at most {shown(factor)} of the error{enough}; {cost}"


def theorems(forecast: Forecast) -> str:
    """The theorems that prove it, in short."""
    return ", ".join(forecast.proved_by).replace("4.1, 4.2, 4.3, 4.4", "4.1 to 4.4") or "none"


def shown(factor: float) -> str:
    """A proved factor per step as text, rounded upwards, but below 1."""
    return at_most(factor, 6, below=1.0)


def parameters(factors: dict[str, float | None]) -> Iterator[str]:
    """Which Ω, and which θ₁ and θ₂, by the proved factors on this problem; nothing where there are none to compare.

    Parameters: `factors` title → factor per step or None, the titles being those of `members`.
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
    psi = problem.psi
    if psi.lipschitz is None and not psi.takes_best:
        yield "give psi's Lipschitz matrix (lipschitz=...): without it no theorem can be applied"
    elif classes.h_plus.holds and not (psi.is_constant or psi.takes_best):
        yield "A is an H+-matrix, but psi moves too much for it: a smaller G, or a larger diagonal of A, is needed"
    if psi.takes_best:
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
