"""How sharp the error bounds are, and what a certificate costs."""

from __future__ import annotations

from functools import partial
from typing import Any

import numpy as np

from ..errors import InputError
from ..icp import ICP
from ..numerics.arrays import Vector
from ..numerics.multigrid import linear_solve
from ..present.table import Table
from ..scenes import names, scene
from ..study.cases import built, fresh
from ..study.timing import as_repeats, clocked, machine, timed
from ..theory import active_set, error_bound

#: how far z is from z*, in units of the largest entry of z*
_DISTANCES = (1e-10, 1e-6, 1e-2, 1.0)


def bound_ratios(n: int = 900, trials: int = 10) -> Table:
    """Error bound over true error, max-norm, on every scene with an exact answer.

    z is z* plus uniform noise of the sizes 1e-10, 1e-6, 1e-2 and 1 times max|z*|, `trials` of each, and the answers of
    `solve` with rtol = 1e-2, 1e-4, …, 1e-10 as far as they are not exact to rounding themselves. "plain" is the bound
    of z itself, "sharp" the one that looks for a better point.
    Parameters: `n` wanted unknowns of the scenes that have a size; `trials` points at each distance, ≥ 1.
    Returns a `Table`.

    >>> icp.benchmarks.bound_ratios(n=16, trials=1).heads
    ('scene', 'n', 'z', 'plain, median', 'sharp, median', 'lowest', 'highest sharp')
    """
    if trials < 1:
        raise InputError(f"trials is {trials}; at least 1 was expected")
    random = np.random.default_rng(0)
    rows: list[tuple[Any, ...]] = []
    for name in names():
        if scene(name).z_exact is None:
            continue
        one = built(name, n)
        problem, exact = one.problem, np.asarray(one.z_exact)
        size = float(np.abs(exact).max())
        noisy = [exact + d * size * random.uniform(-1, 1, exact.size) for d in _DISTANCES for _ in range(trials)]
        solved = [problem.solve(rtol=10.0**-k, raise_on_failure=False).z for k in (2, 4, 6, 8, 10)]
        solved = [z for z in solved if np.abs(z - exact).max() > 1e-12 * size]
        for kind, points in (("noise", noisy), ("solve", solved)):
            if points:
                rows.append((name, problem.n, kind, *_ratios(problem, exact, points)))
    heads = ("scene", "n", "z", "plain, median", "sharp, median", "lowest", "highest sharp")
    title = 'Error bound / true error where z* is known (no row "solve": all answers were exact to rounding)'
    return Table(title, heads, tuple(rows))


def _ratios(problem: ICP, exact: Vector, points: list[Vector]) -> tuple[float | None, ...]:
    found = []  # (plain, sharp) of each point
    for z in points:
        bounds = [error_bound(problem, z, sharp=sharp).value for sharp in (False, True)]
        if None in bounds:
            return (None,) * 4
        found.append(np.array(bounds, dtype=np.float64) / np.abs(z - exact).max())
    plain, sharp = np.median(found, axis=0)
    return float(plain), float(sharp), float(np.min(found)), float(np.max(found, axis=0)[1])


def certificate_cost(n: int = 1_000_000, repeats: int = 5) -> Table:
    """The certificate of an answer of `solve()` against one linear solve with A, on the membrane, timed in turn.

    "of z itself" is `error_bound(problem, z, sharp=False)` of a problem of which nothing is known yet, "from scratch"
    the default there, "after solve" the default of a problem that multigrid has just solved;
    the linear solve is PyAMG's Ruge–Stüben hierarchy with conjugate gradients to 1e-8, set-up included.
    Parameters: `n` unknowns (the nearest square); `repeats` rounds of timings, ≥ 3. Returns a `Table` (seconds; bound
    over error in the largest entry, where a solve to rounding stands for z*; rows that the bound decides).

    >>> icp.benchmarks.certificate_cost(n=400, repeats=3).heads
    ('n', 'bound', 's', 'linear solve, s', 'ratio', 'lowest', 'highest', 'bound / error', 'rows decided')
    """
    repeats = as_repeats(repeats)
    problem = scene("membrane", n).problem
    z, b = problem.solve("multilevel").z, np.ones(problem.n)
    error = np.abs(z - problem.solve("multilevel", z0=z, rtol=1e-14, raise_on_failure=False).z).max()
    plain, full = partial(error_bound, z=z, sharp=False), partial(error_bound, z=z)
    calls = {
        "of z itself": clocked(plain, partial(fresh, problem)),
        "after solve": clocked(full, partial(_solved, problem)),
        "from scratch": clocked(full, partial(fresh, problem)),
        "": clocked(partial(linear_solve, problem.A, b)),
    }
    taken = timed(calls, repeats)
    rows = []
    for name in list(calls)[:-1]:
        bound = plain(problem) if name == "of z itself" else full(problem)
        decided = 1.0 - active_set(problem, z, bound).undecided.mean()
        times = taken.median(name), taken.median(""), *taken.ratio(name, "")
        rows.append((problem.n, name, *times, (bound.value or np.nan) / error, f"{100 * decided:.4g} %"))
    heads = ("n", "bound", "s", "linear solve, s", "ratio", "lowest", "highest", "bound / error", "rows decided")
    return Table(f"A certificate against one linear solve ({machine()})", heads, tuple(rows))


def _solved(problem: ICP) -> ICP:
    """The problem as a solve leaves it, with the levels of its hierarchy."""
    (new := fresh(problem)).solve("multilevel")
    return new
