"""What a sweep costs, how many are needed, and how fast the error falls with the grid spacing."""

from __future__ import annotations

import time
from collections.abc import Sequence
from itertools import pairwise
from typing import Any

import numpy as np

from ..errors import InputError
from ..methods.contract import named, names
from ..present.table import Table
from ..scenes import scene
from ..study.timing import as_repeats, machine, spread

#: so many sweeps a method makes at most in one pass over A
_TOGETHER = 4


def sweep_cost(n: int = 1_000_000, repeats: int = 15, methods: Sequence[str] = ("mnmgs", "mnmj", "psor")) -> Table:
    """Time of one sweep with its residual against one SciPy `A @ z`, on the 5-point matrix of the membrane.

    A sweep is what `Method.iterates` does between two iterates, the new array included. Four products and four sweeps,
    which two threads may make in one pass over A, are timed in turn; the ratio is the median of those of the pairs.
    Parameters: `n` unknowns (the nearest square), `repeats` ≥ 3, `methods` by name. Returns a `Table` (milliseconds).

    >>> sweep_cost(n=100, repeats=3, methods=("mnmgs",)).heads
    ('method', 'n', 'A @ z, ms', 'sweep, ms', 'sweep / (A @ z)', 'lowest', 'highest')
    """
    repeats = as_repeats(repeats)
    problem = scene("membrane", n).problem
    start = np.maximum(problem.psi.value(np.zeros(problem.n)), 0.0)
    rows = []
    for name in methods:
        path = named(name).iterates(problem, start)
        z, _ = next(path)
        for _ in range(2):  # the first sweep compiles
            z, _ = next(path)
        products, sweeps = [], []
        for _ in range(repeats):
            begin = time.perf_counter()
            for _ in range(_TOGETHER):
                problem.A @ z
            between = time.perf_counter()
            for _ in range(_TOGETHER):
                next(path)
            products.append((between - begin) / _TOGETHER)
            sweeps.append((time.perf_counter() - between) / _TOGETHER)
        ratios = np.array(sweeps) / np.array(products)
        rows.append((name, problem.n, *(1e3 * float(np.median(x)) for x in (products, sweeps)), *spread(ratios)))
    heads = ("method", "n", "A @ z, ms", "sweep, ms", "sweep / (A @ z)", "lowest", "highest")
    return Table(f"One sweep with its residual against one product ({machine()})", heads, tuple(rows))


def sweep_counts(sides: Sequence[int] = (10, 20, 30), methods: Sequence[str] = ("mms", "mnmgs", "mnmj")) -> Table:
    """Sweeps to Res ≤ 1e-5 on Bai's LCP from z⁰ = (1, 0, 1, 0, …), symmetric and not, with μ = 0 and 4.

    Parameters: `sides` m of the grids, n = m²; `methods` by name. Returns a `Table`; "-" where a run failed.
    Reference: Bai, Numer. Linear Algebra Appl. 17 (2010).

    >>> sweep_counts(sides=(10,), methods=("mms",)).rows[0]
    ('bai-symmetric', 0, 'mms', 142)
    """
    rows = []
    for name in ("bai-symmetric", "bai-nonsymmetric"):
        for mu in (0, 4):
            problems = [scene(name, m * m, mu=mu) for m in sides]
            for method in methods:
                runs = [
                    bai.problem.solve(method, z0=bai.z0, atol=1e-5, rtol=0.0, raise_on_failure=False)
                    for bai in problems
                ]
                rows.append((name, mu, method, *(run.iterations if run.solved else None for run in runs)))
    heads = ("scene", "mu", "method", *(f"m = {m}" for m in sides))
    return Table("Sweeps to Res <= 1e-5 from z0 = (1, 0, 1, 0, ...)", heads, tuple(rows))


def grid_order(name: str = "dividend", sizes: Sequence[int] = (61, 241, 961), method: str | None = None) -> Table:
    """The error of each quantity a scene knows, on finer and finer grids, and the observed order between them.

    Parameters: `name` of a scene with quantities; `sizes` the numbers of unknowns; `method` by name, or None.
    Returns a `Table`. Raises InputError where the scene has no grid or no quantity.

    >>> grid_order("bearing", (50, 100)).heads
    ('quantity', 'n', 'h', 'error', 'order')
    """
    if method is not None and method not in names():
        raise InputError(f"method is {method!r}; one of {', '.join(names())} was expected")
    built = [scene(name, n) for n in sizes]
    if len({one.problem.n for one in built}) < max(len(built), 2):
        raise InputError(f"sizes are {[one.problem.n for one in built]}; at least two different ones were expected")
    if built[0].h is None or not built[0].quantities:
        raise InputError(f"{name} has no grid or no quantity with a known value")
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
    return Table(f"Error against the closed form: {name}", ("quantity", "n", "h", "error", "order"), tuple(rows))
