"""What θ₁ = "auto" and acceleration are worth against the best θ that a search over a grid finds."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence
from itertools import product
from typing import Any

import numpy as np

from ..arrays import as_list, as_number
from ..errors import NotApplicable
from ..methods import Method, named
from ..methods.accelerated import Accelerated
from ..methods.choose import overrelaxed
from ..methods.modulus import MNMAOR, MNMMOD, MNMSOR
from ..problem import ICP
from ..scenes import Scene, names, parameters, scene
from .tables import Table, machine

#: a run that needs more is given up
_MOST = 20_000


def tuned_and_automatic(
    n: int = 900,
    repeats: int = 5,
    methods: Sequence[str] = ("mnmaor", "mnmsor", "mnmmod"),
    on: Sequence[str] = (),
) -> Table:
    """Steps and time of the best θ of a grid, of theta1="auto", and of its acceleration, on the scenes.

    The grids: `mnmaor` 10 × 6 pairs θ₁, θ₂ with Ω = D, and θ₁ = 1/(2/ω − s), θ₂ = 2θ₁, Ω = sD, s = 2 − ω for
    0.8 ≤ ω < 2 in steps of 0.02; `mnmsor` 0.5 ≤ θ₁ ≤ 3 in steps of 0.1 with Ω = D; `mnmmod` θ₁ = 2^(k/2), |k| ≤ 20.
    Nothing is charged for the search, all set-up (estimates, factorisations) to "auto". Runs end at
    Res ≤ 1e-8·Res(0); those that have not after 20 000 steps are shown as "-". The three are timed in turn.
    Parameters: `n` wanted unknowns of the scenes with a grid in the plane, 4√n of those on a line; `repeats` ≥ 1;
    `methods` by name; `on`, the names of the scenes, by default all. Returns a `Table` (milliseconds).

    >>> table = tuned_and_automatic(n=16, repeats=1, methods=("mnmmod",), on=("ball",))
    >>> table.heads[3:8]
    ('best theta', 'tuned', 'auto', 'accelerated', 'tuned, ms')
    """
    repeats = int(as_number(repeats, "repeats", least=1, whole=True))
    scenes, methods = as_list(on, "on") or names(), as_list(methods, "methods")
    rows: list[tuple[Any, ...]] = []
    for one in (_sized(name, n) for name in scenes):
        for name in methods:
            automatic = named(name, theta1="auto")
            if automatic.why_not(one.problem) is None and one.why_no_solution is None:
                label, tuned = _best(one, name)
                steps, seconds = _timed(one, (tuned, automatic, Accelerated(of=automatic)), repeats)
                rows.append((one.name, one.problem.n, name, label, *steps, *seconds))
    kinds = ("tuned", "auto", "accelerated")
    heads = ("scene", "n", "method", "best theta", *kinds, *(f"{kind}, ms" for kind in kinds))
    return Table(f"Steps and time with the best theta of a grid and without one ({machine()})", heads, tuple(rows))


def _sized(name: str, n: int) -> Scene:
    one = scene(name)
    if "n" not in parameters(name):
        return one
    flat = one.points is not None and one.points.ndim == 1
    return scene(name, max(16, round(4 * np.sqrt(n))) if flat else n)


def _grid(problem: ICP, name: str) -> Iterator[tuple[str, Method]]:
    if name == "mnmmod":
        for k in range(-20, 21):
            yield f"theta1={2 ** (k / 2):.4g}", MNMMOD(theta1=2 ** (k / 2))
    elif name == "mnmsor":
        for theta1 in np.arange(5, 31) / 10:
            yield f"theta1={theta1:.4g}", MNMSOR(theta1=float(theta1))
    else:
        for theta1, times in product(
            (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 3.0, 5.0, 8.0), (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)
        ):
            method = MNMAOR(theta1=theta1, theta2=times * theta1)
            yield f"theta1={theta1:g}, theta2={times * theta1:g}", method
        for omega in np.arange(40, 100) / 50:
            yield f"omega={omega:.4g}", overrelaxed(problem, float(omega))


def _best(one: Scene, name: str) -> tuple[str, Method | None]:
    """The θ of the grid that needs the fewest steps, the first of several; it gives up on the others in time."""
    fewest, best, label = _MOST + 1, None, "-"
    for words, method in _grid(one.problem, name):
        steps = _steps(one, method, fewest - 1)
        if steps is not None:
            fewest, best, label = steps, method, words
        if fewest == 0:
            break
    return label, best


def _steps(one: Scene, method: Method, most: int = _MOST) -> int | None:
    problem = ICP(one.problem.A, one.problem.q, one.problem.psi)  # of which nothing is remembered
    try:
        solution = problem.solve(method, z0=one.z0, max_iter=most, raise_on_failure=False)
    except NotApplicable:  # A + Omega is singular
        return None
    return solution.iterations if solution.solved else None


def _timed(one: Scene, methods: Sequence[Method | None], repeats: int) -> tuple[list[int | None], list[float | None]]:
    steps = [None if method is None else _steps(one, method) for method in methods]  # compiles
    times: list[list[float]] = [[] for _ in methods]
    for _ in range(repeats):
        for method, taken, count in zip(methods, times, steps, strict=True):
            if method is not None and count is not None:
                begin = time.perf_counter()
                _steps(one, method)
                taken.append(1e3 * (time.perf_counter() - begin))
    return steps, [float(np.median(taken)) if taken else None for taken in times]
