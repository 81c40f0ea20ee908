"""What a sweep costs, how many are needed, and how fast the error falls with the grid spacing."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import InputError
from ..methods.contract import named, names
from ..present.table import Table
from ..scenes import scene as scene_named
from ..study.timing import as_repeats, clocked, machine, timed

#: so many sweeps a method makes at most in one pass over A
_TOGETHER = 4


def sweep_cost(n: int = 1_000_000, repeats: int = 15, methods: Sequence[str] = ("mnmgs", "mnmj", "psor")) -> Table:
    """One sweep with its residual against one SciPy A @ z, on the 5-point matrix of the membrane, timed in turn.

    A sweep is what `Method.iterates` does between two iterates, the new array included. Four products and four sweeps,
    which two threads may make in one pass over A, are timed in turn; the ratio is the median of those of the pairs.
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


def sweep_counts(sides: Sequence[int] = (10, 20, 30), methods: Sequence[str] = ("mms", "mnmgs", "mnmj")) -> Table:
    """Sweeps to Res ≤ 1e-5 on Bai's LCP, against the grid side m.

    From z⁰ = (1, 0, 1, 0, …), A symmetric and not, with μ = 0 and 4.
    Parameters: `sides` m of the grids, n = m²; `methods` by name. Returns a `Table`; "-" where a run failed.
    Reference: Bai, Numer. Linear Algebra Appl. 17 (2010).

    >>> icp.benchmarks.sweep_counts(sides=(10,), methods=("mms",)).rows[0]
    ('bai-symmetric', 0, 'mms', 142)
    """
    rows = []
    for name in ("bai-symmetric", "bai-nonsymmetric"):
        for mu in (0, 4):
            problems = [scene_named(name, m * m, mu=mu) for m in sides]
            for method in methods:
                runs = [
                    bai.problem.solve(method, z0=bai.z0, atol=1e-5, rtol=0.0, raise_on_failure=False)
                    for bai in problems
                ]
                rows.append((name, mu, method, *(run.iterations if run.solved else None for run in runs)))
    heads = ("scene", "mu", "method", *(f"m = {m}" for m in sides))
    return Table("Sweeps to Res <= 1e-5 from z0 = (1, 0, 1, 0, ...)", heads, tuple(rows))


def grid_order(scene: str = "dividend", sizes: Sequence[int] = (61, 241, 961), method: str | None = None) -> Table:
    """The error of each quantity that SCENE knows in closed form, on finer and finer grids, and the observed order.

    Parameters: `scene` the name of one with quantities; `sizes` numbers of unknowns; `method` by name, without it one
    is picked. Returns a `Table`. Raises InputError where the scene has no grid or no quantity.

    >>> icp.benchmarks.grid_order("bearing", (50, 100)).heads
    ('quantity', 'n', 'h', 'error', 'order')
    """
    if method is not None and method not in names():
        raise InputError(f"method is {method!r}; one of {', '.join(names())} was expected")
    built = [scene_named(scene, n) for n in sizes]
    if len({one.problem.n for one in built}) < max(len(built), 2):
        raise InputError(f"sizes are {[one.problem.n for one in built]}; at least two different ones were expected")
    if built[0].h is None or not built[0].quantities:
        raise InputError(f"{scene} has no grid or no quantity with a known value")
    errors = []
    for one in built:
        solution = one.problem.solve(method, z0=one.z0, rtol=1e-10, max_iter=1_000_000)
        errors.append(one.errors(solution.z))
    rows: list[tuple[Any, ...]] = []
    for quantity in built[0].quantities:
        rows.append((quantity, built[0].problem.n, built[0].h, errors[0][quantity], None))
        for (coarse, fine), (before, after) in zip(pairwise(built), pairwise(errors), strict=True):
            assert coarse.h is not None
            assert fine.h is not None
            order = float(np.log(before[quantity] / after[quantity]) / np.log(coarse.h / fine.h))
            rows.append((quantity, fine.problem.n, fine.h, after[quantity], order))
    return Table(f"Error against the closed form: {scene}", ("quantity", "n", "h", "error", "order"), tuple(rows))
