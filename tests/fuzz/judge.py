"""What is false of an answer: a list of (kind, what was claimed and what is true)."""

import math
from collections import Counter
from fractions import Fraction

import numpy as np
from exact import LEAST, dot, fractions, objective, optimum, rational, root

import icpmodel as icp

#: of each law by its name: how many examples there were, how many were solved, and what was false
COUNTS = Counter()
#: the most unknowns for which all solutions are found, and for which one is looked for near the answer
_ALL, _ONE = 4, 16
#: what the computed tolerance may lose to rounding, and what a front end may leave of a row
_ROUNDING, _FRONT = Fraction(1, 10**9), Fraction(1, 10**5)
_LOST = 1e-12
#: the share of its terms that a side of a model may be
_MODEL = Fraction(11, 10**7)


def near(x):
    try:
        return float(x)
    except OverflowError:
        return math.inf


def false_claims(drawn, exact, problem, answer, options):
    """What is false of a `Solution`: of "solved", "infeasible", "crossed", uniqueness, bounds and iterations."""
    yield from false_status(drawn, exact, problem, answer.status, answer.z, options)
    if not np.isfinite(answer.z).all():
        yield "lost iterate", f"z = {answer.z}"
        return
    if answer.iterations > options.get("max_iter", math.inf):
        yield "late", f"{answer.iterations} iterations, max_iter = {options['max_iter']}"
    if answer.solved and "accuracy" in options:
        yield from false_bound(exact, answer.z, answer.certificate.bound, options["accuracy"])


def false_status(drawn, exact, problem, status, z, options):
    """What is false of "solved", of "infeasible" and of "obstacles cross"."""
    if status is icp.Status.SOLVED and "accuracy" not in options:
        residual, tolerance = exact.residual(z), stop_at(exact, options, z)
        paper, atol = exact.paper_residual(z), Fraction(options.get("atol", 0.0))
        small = residual is not None and residual <= max(tolerance * (1 + _ROUNDING), exact.n * LEAST) ** 2
        if not small and not (paper is not None and paper <= atol**2):
            true = "none" if residual is None else f"{near(root(residual)):.3g}"
            yield "false solved", f"the exact residual is {true}, the tolerance {near(tolerance):.3g}"
    if status is icp.Status.CROSSED and not exact.crosses(z):
        yield "false crossing", f"psi <= upper at z = {list(z)}"
    if status is icp.Status.INFEASIBLE:
        if drawn.known is not None and exact.residual(drawn.known) == 0:
            yield "false infeasible", f"z = {drawn.known} is a solution"
        elif exact.is_affine and exact.n <= _ALL and (found := exact.zeros().solutions):
            yield "false infeasible", f"z = {list(map(near, found[0]))} is a solution"


def stop_at(exact, options, z):
    """What Res_D(z) may be."""
    return Fraction(options.get("rtol", 1e-8)) * exact.scale(z, options.get("z0"))


def false_bound(exact, z, bound, limit=math.inf):
    """What is false of uniqueness, and of an error bound or an accuracy `limit` that is said to be reached."""
    if not bound.unique or not exact.is_affine or exact.n > _ONE:
        return
    found, complete = exact.nearby(z), False
    if exact.n <= _ALL:
        found, _, complete = exact.zeros()
    if len(found) > 1 or (complete and not found):
        yield "false unique", f"there are {len(found)} solutions; {bound.proof}"
    elif found and bound.value is not None:
        claimed = np.minimum(bound.componentwise, limit)
        for x, true, most in zip(fractions(z), found[0], claimed.tolist(), strict=True):
            if most < math.inf and abs(x - true) > Fraction(most):
                yield "false bound", f"{near(abs(x - true)):.17g} is bounded by {most:.17g}; {bound.proof}"
                return


def worse_than_seen(exact, problem, z, path):
    """Whether an iterate that the callback saw was better than the answer."""
    seen = [(residual, x) for x in path if (residual := exact.residual(x)) is not None]
    if not seen:
        return
    last, (least, best) = exact.residual(z), min(seen, key=lambda pair: pair[0])
    with np.errstate(all="ignore"):
        lost = 0.0
        for x in (z, best):
            weights = problem.weights_at(x, problem.p(x))
            of_p = abs(problem.A) @ abs(x)
            terms = np.where(of_p > 0.0, weights * (of_p + abs(problem.q)), 0.0) + abs(x)
            lost += _LOST * math.sqrt(exact.n) * float(terms.max())
        underflow = exact.n * math.ulp(0.0) * max(1.0, float(weights.max()))
    allowed = 1.000001 * near(root(least)) + lost + underflow
    if last is None or near(root(last)) > allowed:
        yield "lost iterate", f"an iterate with the residual {near(root(least)):.3g} was shown, the answer has {last}"


def false_model(A, q, of_r, c, x):
    """What is false of "optimal" at `x` of Ax + q ⟂ of_r·(x − c), each side beside the sum of its terms.

    No x_j counts as smaller than the rounding of the largest: x = (6e-24, −1) answers −3x₀ = 0, x₁ = −1.
    """
    x, tiny, false = fractions(x), Fraction(1, 10**300), []
    size = [max(abs(one), max(map(abs, x)) / 2**53) for one in x]
    for i, (row, load) in enumerate(zip(rational(A), fractions(q), strict=True)):
        p = (dot(row, x) + load) / (dot(map(abs, row), size) + abs(load) + tiny)
        least = p
        if math.isfinite(c[i]):
            least = min(p, (x[i] - Fraction(c[i])) / (size[i] + abs(Fraction(c[i])) + tiny))
        if abs(least) > _MODEL:
            false.append(
                ("false solved", f'"optimal", and in row {i} the smaller side is {near(least):.3g} of its terms')
            )
    return false


def false_program(program, status, x):
    """What is false of "optimal", "infeasible" or "unbounded" at `x` of a quadratic program."""
    least = optimum(program.P, program.q, program.G, program.h, program.equal)
    if status in ("infeasible", "unbounded") and least.value is not None:
        yield "false infeasible", f'"{status}", and the optimum is {near(least.value):.6g}'
    if status != "optimal":
        return
    if least.value is None and least.complete:
        yield "false solved", '"optimal", and there is no optimum'
        return
    x = fractions(x)
    for i, (row, right) in enumerate(zip(rational(program.G), fractions(program.h), strict=True)):
        size = abs(right) + sum(abs(a * b) for a, b in zip(row, x, strict=True)) + sum(map(abs, row))
        gap = dot(row, x) - right
        if (abs(gap) if i < program.equal else gap) > _FRONT * size:
            yield "false solved", f'"optimal", and row {i} is violated by {near(gap):.3g}'
            return
    if least.value is not None:
        P, q = rational(program.P), fractions(program.q)
        # an entry of x may be off by the rounding of the largest
        of_x = [abs(a) + max(map(abs, x)) / 10**8 for a in x]
        terms = objective([[abs(a) for a in row] for row in P], [Fraction(0)] * len(x), of_x)
        size = abs(least.value) + sum(abs(a * b) for a, b in zip(q, x, strict=True)) + max(map(abs, q)) / 1000
        value = objective(P, q, x)
        if value - least.value > 10 * _FRONT * size + Fraction(1, 10**15) * terms:
            yield "false solved", f'"optimal" at {near(value):.6g}, the optimum is {near(least.value):.6g}'
