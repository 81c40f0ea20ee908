"""What a sweep costs, how many steps are needed, with the best relaxation and without, and how the error falls."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial
from itertools import product
from typing import Any, NamedTuple

import numpy as np

from ..errors import InputError, NotApplicable
from ..methods.accelerated import Accelerated
from ..methods.aor import MNMAOR, MNMSOR, overrelaxed
from ..methods.contract import Method, named
from ..methods.contract import names as method_names
from ..methods.factorised import MNMMOD
from ..numerics.arrays import as_list, as_number
from ..present.table import Table
from ..scenes import Scene, names
from ..scenes import scene as scene_named
from ..study.cases import built, fresh, unbroken
from ..study.timing import as_repeats, clocked, machine, timed

#: so many sweeps a method makes at most in one pass over A
_TOGETHER = 4
#: a run that needs more is given up
_MOST = 20_000


def sweep_cost(n: int = 1_000_000, repeats: int = 15, methods: Sequence[str] = ("mnmgs", "mnmj", "psor")) -> Table:
    """One sweep with its residual against one SciPy A @ z, on the 5-point matrix of the membrane, timed in turn.

    A sweep is what `Method.iterates` does between two iterates, the new array included. Four of each, which two threads
    may make in one pass over A, are timed in turn; the ratio is the median of those of the pairs.
    Parameters: `n` unknowns (the nearest square); `repeats` pairs of timings, ≥ 3; `methods` by name.
    Returns a `Table` (milliseconds).

    >>> icp.benchmarks.sweep_cost(n=100, repeats=3, methods=("mnmgs",)).heads[:5]
    ('method', 'n', 'A @ z, ms', 'sweep, ms', 'sweep / (A @ z)')
    """
    repeats = as_repeats(repeats)
    problem = scene_named("membrane", n).problem
    start = np.maximum(problem.psi.value(np.zeros(problem.n)), 0.0)
    rows = []
    for name in methods:
        path = named(name).iterates(problem, start)
        for _ in range(2):  # the first sweep compiles
            z, _ = next(path)
        calls = {"product": partial(problem.A.dot, z), "sweep": partial(next, path)}
        taken = timed({kind: clocked(partial(_together, call)) for kind, call in calls.items()}, repeats)
        medians = (taken.median(kind, 1e-3 * _TOGETHER) for kind in calls)
        rows.append((name, problem.n, *medians, *taken.ratio("sweep", "product")))
    heads = ("method", "n", "A @ z, ms", "sweep, ms", "sweep / (A @ z)", "lowest", "highest")
    return Table(f"One sweep with its residual against one product ({machine()})", heads, tuple(rows))


def _together(call: Callable[[], object]) -> None:
    for _ in range(_TOGETHER):
        call()


def grid_order(scene: str = "dividend", sizes: Sequence[int] = (61, 241, 961), method: str | None = None) -> Table:
    """The error of each quantity that SCENE knows in closed form, on finer and finer grids, and the observed order.

    Parameters: `scene` the name of one with quantities; `sizes` numbers of unknowns; `method` by name, without it one
    is picked. Returns a `Table`. Raises InputError where the scene has no grid or no quantity.

    >>> icp.benchmarks.grid_order("bearing", (50, 100)).heads
    ('quantity', 'n', 'h', 'error', 'order')
    """
    if method is not None and method not in method_names():
        raise InputError(f"method is {method!r}; one of {', '.join(method_names())} was expected")
    grids = [scene_named(scene, n) for n in sizes]
    if len({one.problem.n for one in grids}) < max(len(grids), 2):
        raise InputError(f"sizes are {[one.problem.n for one in grids]}; at least two different ones were expected")
    if grids[0].h is None or not grids[0].quantities:
        raise InputError(f"{scene} has no grid or no quantity with a known value")
    errors = [one.errors(one.problem.solve(method, z0=one.z0, rtol=1e-10, max_iter=1_000_000).z) for one in grids]
    spacing, rows = np.log(np.array([one.h for one in grids], dtype=np.float64)), []
    for quantity in grids[0].quantities:
        off = [one[quantity] for one in errors]
        orders = [None, *(np.diff(np.log(off)) / np.diff(spacing)).tolist()]
        rows += [(quantity, one.problem.n, one.h, *pair) for one, *pair in zip(grids, off, orders, strict=True)]
    return Table(f"Error against the closed form: {scene}", ("quantity", "n", "h", "error", "order"), tuple(rows))


def tuned_and_automatic(
    n: int = 900, repeats: int = 5, methods: Sequence[str] = ("mnmaor", "mnmsor", "mnmmod"), scenes: Sequence[str] = ()
) -> Table:
    """The best theta of a grid against theta1="auto", its acceleration and `Accelerated`, on SCENES, by default on all.

    Steps and time of a hand-tuned θ, of the best θ and Ω of a search, and of what needs no θ. Tuned by hand, with Ω as
    it is: `mnmaor` 10 × 6 pairs θ₁, θ₂, `mnmsor` 0.5 ≤ θ₁ ≤ 3 in steps of 0.1, `mnmmod` θ₁ = 2^(k/2), |k| ≤ 20. The
    search adds, for `mnmaor`, θ₁ = 1/(2/ω − s), θ₂ = 2θ₁, Ω = sD, s = 2 − ω for 0.8 ≤ ω < 2 in steps of 0.02. Nothing
    is charged for either, all set-up to "auto". Runs end at Res ≤ 1e-8·Res(0), or after 20 000 steps, shown as "-".
    Parameters: `n` wanted unknowns of the scenes with a grid in the plane, 4√n of those on a line; `repeats` timings
    of each run, ≥ 1; `methods` by name; `scenes` by name, by default all. Returns a `Table` (milliseconds).

    >>> table = icp.benchmarks.tuned_and_automatic(n=16, repeats=1, methods=("mnmmod",), scenes=("ball",))
    >>> table.heads[3:10]
    ('theta', 'and Omega', 'by hand', 'search', 'auto', 'auto, acc.', 'accelerated')
    """
    repeats = int(as_number(repeats, "repeats", least=1, whole=True))
    methods = as_list(methods, "methods")
    rows: list[tuple[Any, ...]] = []
    for scene in as_list(scenes, "scenes") or names():
        places = scene_named(scene).points
        on_line = places is not None and places.ndim == 1
        one = built(scene, max(16, round(4 * np.sqrt(n))) if on_line else n)
        for name in methods:
            automatic = named(name, theta1="auto")
            if automatic.why_not(one.problem) is None and one.why_no_solution is None:
                by_hand = _best(one, _thetas(name), _Tuned())
                omegas = np.arange(40, 100) / 50 if name == "mnmaor" else ()
                adapted = ((f"omega={omega:.4g}", overrelaxed(one.problem, float(omega))) for omega in omegas)
                best = _best(one, adapted, by_hand)
                compared = (by_hand.method, best.method, automatic, Accelerated(of=automatic), Accelerated())
                steps = [None if method is None else _steps(one, method) for method in compared]  # compiles
                calls = {k: clocked(partial(_steps, one, compared[k])) for k in range(5) if steps[k] is not None}
                taken = timed(calls, repeats, warm=False)
                seconds = [taken.median(k, 1e-3) if k in calls else None for k in range(5)]
                rows.append((one.name, one.problem.n, name, by_hand.label, best.label, *steps, *seconds))
    kinds = ("by hand", "search", "auto", "auto, acc.", "accelerated")
    heads = ("scene", "n", "method", "theta", "and Omega", *kinds, *(f"{kind}, ms" for kind in kinds))
    return Table(f"Steps and time with the best theta of a grid and without one ({machine()})", heads, tuple(rows))


class _Tuned(NamedTuple):
    label: str = "-"
    method: Method | None = None
    steps: int = _MOST + 1


def _thetas(name: str) -> Iterator[tuple[str, Method]]:
    if name == "mnmmod":
        yield from ((f"{theta1:.4g}", MNMMOD(theta1=theta1)) for theta1 in (2 ** (k / 2) for k in range(-20, 21)))
    elif name == "mnmsor":
        yield from ((f"{k / 10:g}", MNMSOR(theta1=k / 10)) for k in range(5, 31))
    else:
        first, times = (0.5, 0.75, 1.0, 1.25, 1.5, 1.75, 2.0, 3.0, 5.0, 8.0), (0.0, 0.5, 1.0, 1.5, 2.0, 2.5)
        for theta1, theta2 in ((theta1, factor * theta1) for theta1, factor in product(first, times)):
            yield f"{theta1:g}, {theta2:g}", MNMAOR(theta1=theta1, theta2=theta2)


def _best(one: Scene, grid: Iterator[tuple[str, Method]], best: _Tuned) -> _Tuned:
    """What needs the fewest steps, the first of several, `best` or of the grid; it gives up on the others in time."""
    for label, method in grid:
        steps = _steps(one, method, best.steps - 1) if best.steps else None
        if steps is not None:
            best = _Tuned(label, method, steps)
    return best


def _steps(one: Scene, method: Method | None, most: int = _MOST) -> int | None:
    try:
        solution = unbroken(fresh(one.problem).solve(method, z0=one.z0, max_iter=most, raise_on_failure=False))
    except NotApplicable:  # A + Omega is singular
        return None
    return solution.iterations if solution.solved else None
