"""How sharp the error bounds are, what a certificate costs, and whether "solved" is ever said of what is not."""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence
from functools import partial
from typing import Any

import numpy as np

from ..algebra.hierarchy import Hierarchy
from ..errors import IcpError, InputError, MapError, NotApplicable
from ..icp import ICP
from ..methods.contract import names as method_names
from ..numerics.arrays import Vector, as_list, as_number, row_of
from ..numerics.multigrid import linear_solve
from ..present.table import Table
from ..problem.data import ProblemData
from ..scenes import Scene, names, parameters, scene
from ..solve.progress import status_line
from ..solve.solution import Solution, Status
from ..study.cases import built, fresh, unbroken
from ..study.timing import as_repeats, clocked, machine, timed
from ..theory import active_set, error_bound

#: how far z is from z*, in units of the largest entry of z*
_DISTANCES = (1e-10, 1e-6, 1e-2, 1.0)
#: the statuses as columns, in this order; a method that refuses a problem is "not applicable"
_ENDS = (*(status.value for status in Status), "not applicable")
#: what rounding may add to a residual that is computed in another order of summation
_ROUNDING = 1e-12


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
    the default there, "after solve" the default where the multigrid levels are there, as a solve by them leaves them;
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
        "after solve": clocked(full, partial(_with_levels, problem)),
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


def _with_levels(problem: ICP) -> ICP:
    """The problem, of which nothing is known but the levels of its hierarchy."""
    Hierarchy(new := fresh(problem))
    return new


def false_success(seeds: int = 10, n: int = 100, scenes: Sequence[str] = (), progress: bool = False) -> Table:
    """How runs end, and what of it is false: all methods on SCENES, default all, from random starts.

    Every method with its default options, and `solve()` without one, runs on every scene from `seeds` random starts, of
    the size of the known solution; scenes with a `seed` are also built anew. An answer called SOLVED is false where
    the problem is known to have no solution, or where ‖min(r, p)‖₂, computed anew in extended precision and not by the
    package's judge, is above the tolerance; a bound is false where it is below the true error.
    Parameters: `seeds` random starts, and random data; `n` wanted unknowns of the scenes that have a size; `scenes`
    by name, default all; `progress` shows a line where standard error is a terminal.
    Returns a `Table`: one row per scene and the sum.

    >>> table = icp.benchmarks.false_success(seeds=1, scenes=["hand-lcp", "hard-jump"])
    >>> [row[-2:] for row in table.rows]
    [(0, 0), (0, 0), (0, 0)]
    """
    seeds = int(as_number(seeds, "seeds", least=1, whole=True))
    found: list[tuple[str, Counter[str]]] = []
    with status_line(progress) as say:
        for name in as_list(scenes, "scenes") or names():
            say(f"scene {name}")
            count: Counter[str] = Counter()
            for seed in range(seeds):
                text = f"{name},seed={seed}" if "seed" in parameters(name) else name
                for method in (None, *method_names()):
                    count.update(_run(built(text, n), method, seed))
            found.append((name, count))
    ends = [end for end in _ENDS if any(count[end] for _, count in found)]
    heads = ("scene", "runs", *ends, "false solved", "false bound")
    found.append(("all", sum((count for _, count in found), Counter())))
    rows = tuple((name, *(count[head] for head in heads[1:])) for name, count in found)
    return Table(f"How {seeds} runs of each method end, and what of it is false", heads, rows)


def _run(one: Scene, method: str | None, seed: int) -> list[str]:
    size = 0.0 if seed == 0 else 1.0 if one.z_exact is None else np.abs(one.z_exact)  # the first start is the default
    z0 = size * np.random.default_rng(seed).standard_normal(one.problem.n)
    try:
        solution = unbroken(one.problem.solve(method, z0=z0, max_iter=5000, raise_on_failure=False))
    except NotApplicable:
        return ["runs", "not applicable"]
    except MapError:
        return ["runs", Status.MAP_FAILED.value]  # ψ has no value at the start
    return told_of(one, solution, z0)


def told_of(one: Scene, solution: Solution, z0: Vector) -> list[str]:
    """How the run from `z0` ended, and what of it is false, as keys to count."""
    keys = ["runs", solution.status.value]
    if solution.solved and (one.why_no_solution or _residual(solution.problem, solution.z) > _tolerance(solution, z0)):
        keys.append("false solved")
    bound = solution.error_bound if solution.solved else None
    if bound is not None and one.z_exact is not None and bound < np.abs(solution.z - one.z_exact).max():
        keys.append("false bound")
    return keys


def _tolerance(solution: Solution, z0: Vector) -> np.longdouble:
    """1e-8·Res(0), Res(z0) where ψ has no value at 0 or 0 is a solution: what `solve` promises by default."""
    start = _residual(solution.problem, np.zeros(z0.size))
    if not 0 < start < np.inf:
        start = _residual(solution.problem, z0)
    return np.longdouble(1e-8) * start * (1 + _ROUNDING)


def _residual(problem: ProblemData, z: Vector) -> np.longdouble:
    """‖min(r, p)‖₂ in extended precision, row by row from the entries of A; NaN where ψ has no value."""
    A, wide = problem.A, np.longdouble
    try:
        psi = problem.psi.value(z)
    except IcpError:
        return wide(np.nan)
    p = problem.q.astype(wide)
    np.add.at(p, row_of(A), A.data.astype(wide) * z.astype(wide)[A.indices])
    least = np.minimum(z.astype(wide) - psi.astype(wide), p)
    return wide(np.sqrt(np.sum(least * least)))
