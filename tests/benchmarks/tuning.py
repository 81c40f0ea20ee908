"""Steps and time with the best theta of a grid and without one."""

from functools import partial
from itertools import product

import numpy as np

import icpmodel as icp

from .harness import relaxed, run, scene, time_calls

#: a run that needs more is given up
MOST = 20_000
THETAS = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 3.0, 5.0, 8.0)
FACTORS = (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)
OMEGAS = tuple(k / 50 for k in range(40, 100))


def table(scenes=(), n=900, repeats=5):
    """The best θ of a grid for MNMAOR against theta1="auto", its acceleration and `Accelerated`.

    By hand: 10 × 6 pairs θ₁, θ₂ with Ω = D. The search adds θ₁ = 1/(2/ω − s), θ₂ = 2θ₁, Ω = sD, s = 2 − ω for 0.8 ≤ ω
    < 2 in steps of 0.02. Neither is charged, all set-up is to "auto". "-" is a run of more than 20 000 steps.

    Parameters
    ----------
    scenes : names, by default all
    n : wanted unknowns of the scenes with a grid in the plane; those on a line have 4√n
    repeats : timings of each run
    """
    kinds = ("by hand", "search", "auto", "auto, acc.", "accelerated")
    yield "scene", "n", "theta", "and Omega", *kinds, *(f"{kind}, ms" for kind in kinds)
    automatic = icp.MNMAOR(theta1="auto")
    for name in scenes or icp.scenes.names():
        points = icp.scenes.scene(name).points
        on_line = points is not None and points.ndim == 1
        one = scene(name, max(16, round(4 * np.sqrt(n))) if on_line else n)
        if automatic.why_not(one.problem) is not None or one.why_no_solution is not None:
            continue
        by_hand, theta = best(one, pairs())
        searched, omega = best(one, with_omega(one.problem), by_hand, theta)
        compared = (by_hand, searched, automatic, icp.Accelerated(of=automatic), icp.Accelerated())
        steps = [None if method is None else solved_in(one, method)[1] for method in compared]
        calls = {k: partial(seconds_of, one, compared[k]) for k in range(5) if steps[k] is not None}
        taken = time_calls(calls, repeats, warm=False)
        seconds = [1e3 * float(np.median(taken[k])) if k in calls else None for k in range(5)]
        yield name, one.problem.n, theta, omega, *steps, *seconds


def pairs():
    for theta1, factor in product(THETAS, FACTORS):
        yield icp.MNMAOR(theta1=theta1, theta2=factor * theta1), f"{theta1:g}, {factor * theta1:g}"


def with_omega(problem):
    for omega in OMEGAS:
        yield relaxed(problem, omega), f"omega={omega:.4g}"


def best(one, grid, method=None, label="-"):
    """What needs the fewest steps, `method` or one of the grid, the first of several."""
    fewest = MOST + 1 if method is None else solved_in(one, method)[1]
    for other, words in grid:
        steps = solved_in(one, other, fewest - 1)[1] if fewest else None
        if steps is not None:
            method, label, fewest = other, words, steps
    return method, label


def solved_in(one, method, most=MOST):
    """Seconds, and steps if it is solved."""
    seconds, solution = run(one.problem, method, z0=one.z0, max_iter=most)
    return seconds, solution.iterations if solution.solved else None


def seconds_of(one, method):
    return solved_in(one, method)[0]
