"""What θ₁ = "auto" and acceleration are worth against the best θ that a search over a grid finds."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..errors import NotApplicable
from ..icp import ICP
from ..methods.accelerated import Accelerated
from ..methods.contract import Method, named
from ..methods.modulus import MNMAOR, MNMMOD, MNMSOR
from ..numerics.arrays import as_list, as_number
from ..present.table import Table
from ..scenes import Scene, names, parameters, scene
from ..solve.choice import overrelaxed
from ..study.cases import fresh, unbroken
from ..study.timing import clocked, machine, timed

#: a run that needs more is given up
_MOST = 20_000


def tuned_and_automatic(
    n: int = 900,
    repeats: int = 5,
    methods: Sequence[str] = ("mnmaor", "mnmsor", "mnmmod"),
    scenes: Sequence[str] = (),
) -> Table:
    """The best theta of a grid against theta1="auto", its acceleration and `Accelerated`, on SCENES, by default on all.

    Steps and time of a hand-tuned θ, of the best θ and Ω of a search, and of what needs no θ. Tuned by hand, with Ω as
    it is: `mnmaor` 10 × 6 pairs θ₁, θ₂, `mnmsor` 0.5 ≤ θ₁ ≤ 3 in steps of 0.1, `mnmmod` θ₁ = 2^(k/2), |k| ≤ 20. The
    search adds, for `mnmaor`, θ₁ = 1/(2/ω − s), θ₂ = 2θ₁, Ω = sD, s = 2 − ω for 0.8 ≤ ω < 2 in steps of 0.02. Nothing
    is charged for either, all set-up (estimates, factorisations) to "auto". Runs end at Res ≤ 1e-8·Res(0); those that
    have not after 20 000 steps are shown as "-". All are timed in turn.
    Parameters: `n` wanted unknowns of the scenes with a grid in the plane, 4√n of those on a line; `repeats` timings
    of each run, ≥ 1; `methods` by name; `scenes` by name, by default all. Returns a `Table` (milliseconds).

    >>> table = icp.benchmarks.tuned_and_automatic(n=16, repeats=1, methods=("mnmmod",), scenes=("ball",))
    >>> table.heads[3:10]
    ('theta', 'and Omega', 'by hand', 'search', 'auto', 'auto, acc.', 'accelerated')
    """
    repeats = int(as_number(repeats, "repeats", least=1, whole=True))
    methods = as_list(methods, "methods")
    rows: list[tuple[Any, ...]] = []
    for one in (_sized(name, n) for name in as_list(scenes, "scenes") or names()):
        for name in methods:
            automatic = named(name, theta1="auto")
            if automatic.why_not(one.problem) is None and one.why_no_solution is None:
                by_hand = _best(one, _thetas(name))
                best = _best(one, _omegas(one.problem, name), by_hand)
                untuned = (automatic, Accelerated(of=automatic), Accelerated())
                steps, seconds = _timed(one, (by_hand.method, best.method, *untuned), repeats)
                rows.append((one.name, one.problem.n, name, by_hand.label, best.label, *steps, *seconds))
    kinds = ("by hand", "search", "auto", "auto, acc.", "accelerated")
    heads = ("scene", "n", "method", "theta", "and Omega", *kinds, *(f"{kind}, ms" for kind in kinds))
    return Table(f"Steps and time with the best theta of a grid and without one ({machine()})", heads, tuple(rows))


def _sized(name: str, n: int) -> Scene:
    one = scene(name)
    if "n" not in parameters(name):
        return one
    flat = one.points is not None and one.points.ndim == 1
    return scene(name, max(16, round(4 * np.sqrt(n))) if flat else n)


class _Tuned(NamedTuple):
    label: str = "-"
    method: Method | None = None
    steps: int = _MOST + 1


def _thetas(name: str) -> Iterator[tuple[str, Method]]:
    if name == "mnmmod":
        for k in range(-20, 21):
            yield f"{2 ** (k / 2):.4g}", MNMMOD(theta1=2 ** (k / 2))
    elif name == "mnmsor":
        for theta1 in np.arange(5, 31) / 10:
            yield f"{theta1:.4g}", MNMSOR(theta1=float(theta1))
    else:
        for theta1, times in product(
            (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 3.0, 5.0, 8.0), (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)
        ):
            yield f"{theta1:g}, {times * theta1:g}", MNMAOR(theta1=theta1, theta2=times * theta1)


def _omegas(problem: ICP, name: str) -> Iterator[tuple[str, Method]]:
    for omega in np.arange(40, 100) / 50 if name == "mnmaor" else ():
        yield f"omega={omega:.4g}", overrelaxed(problem, float(omega))


def _best(one: Scene, grid: Iterator[tuple[str, Method]], best: _Tuned | None = None) -> _Tuned:
    """What needs the fewest steps, the first of several, `best` or of the grid; it gives up on the others in time."""
    best = best or _Tuned()
    for label, method in grid:
        if best.steps == 0:
            break
        steps = _steps(one, method, best.steps - 1)
        if steps is not None:
            best = _Tuned(label, method, steps)
    return best


def _steps(one: Scene, method: Method | None, most: int = _MOST) -> int | None:
    try:
        solution = unbroken(fresh(one.problem).solve(method, z0=one.z0, max_iter=most, raise_on_failure=False))
    except NotApplicable:  # A + Omega is singular
        return None
    return solution.iterations if solution.solved else None


def _timed(one: Scene, methods: Sequence[Method | None], repeats: int) -> tuple[list[int | None], list[float | None]]:
    steps = [None if method is None else _steps(one, method) for method in methods]  # compiles
    calls = {k: clocked(partial(_steps, one, methods[k])) for k, count in enumerate(steps) if count is not None}
    taken = timed(calls, repeats, warm=False)
    return steps, [taken.median(k, 1e-3) if k in calls else None for k in range(len(methods))]
