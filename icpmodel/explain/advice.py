"""The advice on a page of `explain`."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from ..methods.contract import Method, named, names
from ..methods.newton import Newton
from ..numerics.rounding import UNIT_ROUNDOFF, rounded_up
from ..problem.data import ProblemData
from ..theory.certificates.enumerated import Disproof, NoSolution
from ..theory.matrices.classes import MatrixClasses


def first_steps(first_method: Method | None, why: str, method_named: bool, disproof: Disproof | None) -> Iterator[str]:
    """Yield what to call, or what to change if there is proved to be no solution; parameters as in `Explanation`."""
    if isinstance(disproof, NoSolution):
        conflict = "`solve(raise_on_failure=False).contradiction` may name the conditions in conflict"
        yield f"no solution exists: change A, q or psi; {conflict}"
        return
    alone = "left to itself " if method_named else ""
    yield why if first_method is None else f"call solve(); {alone}it will run {first_method!r} first: {why}"
    if disproof:
        yield "there are several solutions: all_solutions() lists them, and other starts z0 may find other ones"


def convergence_advice(
    problem: ProblemData, classes: MatrixClasses, first_method: Method | None = None, is_decided: bool = False
) -> Iterator[str]:
    """Yield advice if no member of the family is proved to converge; `first_method` is the first method of `solve()`.

    `is_decided` says that the number of solutions is proved to be one, several or none.
    """
    yield "no member of the family is proved to converge; solve() tries several, and checks the residual of the result"
    psi = problem.psi
    both = problem.upper is not None
    if psi.lipschitz is None and not psi.has_policies:
        missing = "the Lipschitz matrices of psi and upper" if both else "psi's Lipschitz matrix"
        yield f"give {missing} (lipschitz=...): without it no theorem can be applied"
    elif classes.h_plus.holds and not (psi.is_constant or psi.has_policies):
        yield "A is an H+-matrix, but psi moves too much for it: a smaller G, or a larger diagonal of A, is needed"
    if psi.has_policies:
        if both and not psi.isotone():
            yield "for an intervention the theorem needs two isotone obstacles; these are not known to be isotone"
        elif classes.z.holds:
            yield "for an intervention: mnmj (phi >= |D - Omega|) converges monotonically from super- and subsolutions"
        else:
            yield "A is no Z-matrix, which the theorem on interventions needs; check the signs of its discretisation"
    elif classes.definite.holds and not psi.is_constant:
        obstacles = "the obstacles" if both else "the obstacle"
        yield f"A is positive definite: with {obstacles} frozen at an iterate, mnmod and mnmmod are proved"
    elif classes.p.holds:
        later = "" if isinstance(first_method, Newton) else ", on which solve() falls back"
        obstacles = "obstacles that do not move" if both else "constant psi"
        yield f"A is a P-matrix, so with {obstacles} the solution is unique, but sweeps may cycle: try newton{later}"
    elif is_decided:
        return
    elif is_boxed(problem):
        yield "z has a fixed obstacle on both sides in every row, so that there is a solution, perhaps one of many"
    elif classes.semidefinite.holds and problem.is_lcp:
        yield "A is positive semidefinite: if some z has p >= 0 and r >= 0 there is a solution, perhaps one of many"
    elif classes.p.holds is False:
        yield "A is no P-matrix: there may be no solution, or many; check signs and units of the model"


def nonlinear_advice(problem: ProblemData, unique: bool) -> Iterator[str]:
    """Yield advice for a nonlinear p; `unique`: whether the solution is proved to be unique."""
    assert problem.f is not None
    if unique:
        return
    if problem.f.slope_range is not None:
        yield "a proof needs A + diag(m) to be an H+-matrix, or positive definite, with m the least slopes of f"
    elif problem.f.is_elementwise:
        yield "give slope_range=(m, M) to Elementwise: without it no theorem can be applied"
    else:
        yield "f may couple rows, which no theorem here covers: other starts z0 may find other solutions"


def accuracy_advice(accuracy: float, largest: float | None) -> Iterator[str]:
    """Yield a remark if rounding may prevent the `accuracy`; `largest`: a bound on the entries of z, or None."""
    if largest is not None and accuracy < UNIT_ROUNDOFF * largest:
        yield (
            f"the accuracy {accuracy:g} may be out of reach: entries of z can be as large as {rounded_up(largest)}, "
            f"and float64 rounds such numbers by up to {rounded_up(UNIT_ROUNDOFF * largest)}"
        )


def methods_for_f(problem: ProblemData) -> Iterator[str]:
    """Yield which methods take a nonlinear p, and why the others do not."""
    reasons: dict[str | None, list[str]] = {}
    for name in names():
        reasons.setdefault(named(name).why_not(problem), []).append(name)
    yield f"taken by {', '.join(reasons.pop(None, []))}"
    for reason, refusing in reasons.items():
        yield f"not by {', '.join(refusing)}: {reason}"


def is_boxed(problem: ProblemData) -> bool:
    """Whether every row has finite constant obstacles on both sides.

    A continuous p, such as Az + q, then has a solution in this compact box (Hartman and Stampacchia, Acta Math. 115,
    1966).
    """
    if problem.upper is None or not problem.psi.is_constant:
        return False
    zero = np.zeros(problem.n)
    return bool(np.isfinite(problem.psi.value(zero)).all() and np.isfinite(problem.upper.value(zero)).all())
