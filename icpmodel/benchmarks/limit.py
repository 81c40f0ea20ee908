"""What `solve()` costs against its limit, one plain linear solve with the same matrix."""

from __future__ import annotations

import time
from collections.abc import Iterator, Sequence

import numpy as np
import scipy.sparse as sp

from ..icp import ICP
from ..numerics.arrays import Vector
from ..numerics.multigrid import linear_solve
from ..present.table import Table
from ..problem.affine import Affine
from ..problem.elementwise import Elementwise
from ..scenes import scene
from ..study.timing import as_repeats, machine, spread


def solve_cost(sizes: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 5) -> Table:
    """Time of `solve()` to Res ≤ 1e-8·Res(0) against one linear solve with A to 1e-8, set-up included on both sides.

    On the membrane with μ = 0 and its variants: ψ elementwise, ½ sin(z) + c, and affine, a quarter of each of two
    neighbours; A nonsymmetric (skew ½); A strongly dominant (μ = 4); and the ball. The two are timed in turn; the ratio
    is the median of the ratios pair by pair. The last column has the time of `solve()` in products A @ z, each time the
    median of five: it says how the work grows, where the time of a product grows faster than n beyond the cache.
    Parameters: `sizes` in unknowns (the nearest squares), `repeats` ≥ 3. Returns a `Table` (seconds).

    >>> solve_cost([400], repeats=3).heads
    ('problem', 'n', 'method', 'solve, s', 'linear solve, s', 'ratio', 'lowest', 'highest', 'solve / (A @ z)')
    """
    repeats = as_repeats(repeats)
    for _, problem in _problems(900):
        problem.solve()  # compiles
    rows = []
    for n in sizes:
        for name, problem in _problems(n):
            b, times, method = np.ones(problem.n), [], ""
            for _ in range(1 + repeats):
                fresh, product = ICP(problem.A, problem.q, problem.psi), _product(problem.A, b)
                begin = time.perf_counter()
                method = fresh.solve().method.name
                between = time.perf_counter()
                linear_solve(problem.A, b)
                times.append((between - begin, time.perf_counter() - between, product))
            ours, limit, products = np.array(times[1:]).T  # at first the one that goes first pays for the pages
            medians = (float(np.median(x)) for x in (ours, limit))
            grown = float(np.median(ours / products))
            rows.append((name, problem.n, method, *medians, *spread(ours / limit), grown))
    heads = ("problem", "n", "method", "solve, s", "linear solve, s", "ratio", "lowest", "highest", "solve / (A @ z)")
    return Table(f"solve() against one linear solve ({machine()})", heads, tuple(rows))


def _product(A: sp.csr_array, z: Vector) -> float:
    """Seconds of one A @ z."""
    marks = [time.perf_counter()]
    for _ in range(5):
        A @ z
        marks.append(time.perf_counter())
    return float(np.median(np.diff(marks)))


def _problems(n: int) -> Iterator[tuple[str, ICP]]:
    problem = scene("membrane", n).problem
    m, c = int(np.sqrt(problem.n)), problem.psi.value(np.zeros(problem.n))
    yield "membrane", problem
    yield "ball", scene("ball", n).problem
    half_sine = Elementwise(lambda z: 0.5 * np.sin(z), lambda z: 0.5 * np.cos(z), lipschitz=0.5, c=c)
    yield "elementwise psi", problem.with_psi(half_sine)
    neighbours = sp.diags_array([0.25, 0.25], offsets=[-1, 1], shape=(m, m))
    yield "affine psi", problem.with_psi(Affine(sp.kron(sp.eye_array(m), neighbours), c))
    yield "skew = 0.5", scene("membrane", n, skew=0.5).problem
    yield "mu = 4", scene("membrane", n, mu=4.0).problem
