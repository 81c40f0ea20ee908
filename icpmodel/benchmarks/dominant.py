"""What whole solves cost where A is strongly dominant, and for impulse control, in units of what they are made of."""

from __future__ import annotations

import time
from collections.abc import Callable, Sequence
from functools import partial

import numpy as np
import scipy.sparse as sp

from ..icp import ICP
from ..numerics.arrays import Vector
from ..present.table import Table
from ..scenes import scene
from ..study.timing import as_repeats, machine, spread


def dominant_cost(sizes: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 9, mu: float = 4.0) -> Table:
    """Time of `solve()` without a method on the membrane with μ = `mu`, in units of sweeps times one SciPy `A @ z`.

    The problem is a new one in every pair, so that nothing is known of A; making it does not count. The two are timed
    in turn; the ratio is the median of the ratios pair by pair.
    Parameters: `sizes` in unknowns (the nearest squares), `repeats` ≥ 3. Returns a `Table` (milliseconds).

    >>> dominant_cost([400], repeats=3).heads
    ('n', 'method', 'sweeps', 'A @ z, ms', 'solve, ms', 'solve / (sweeps * A @ z)', 'lowest', 'highest')
    """
    repeats = as_repeats(repeats)
    rows = []
    for n in sizes:
        problem = scene("membrane", n, mu=mu).problem
        z = np.ones(problem.n)
        solution = problem.solve()  # compiles
        products, solves = _in_turn(problem, partial(problem.A.dot, z), repeats)
        ratios = solves / products / max(solution.iterations, 1)
        medians = [1e3 * float(np.median(x)) for x in (products, solves)]
        rows.append((problem.n, solution.method.name, solution.iterations, *medians, *spread(ratios)))
    heads = ("n", "method", "sweeps", "A @ z, ms", "solve, ms", "solve / (sweeps * A @ z)", "lowest", "highest")
    return Table(f"A strongly dominant (mu = {mu:g}), to Res <= 1e-8 Res(0) ({machine()})", heads, tuple(rows))


def impulse_cost(sizes: Sequence[int] = (961, 6001, 25_601, 100_001), repeats: int = 9) -> Table:
    """Time of `solve()` without a method on the dividend scene, in units of one sparse factorisation and solve with A.

    That is SciPy's `splu` of the tridiagonal A at its defaults; pairs and ratios are as in `dominant_cost`. The error
    is that of V(1) against the closed form.
    Parameters: `sizes` in unknowns, `repeats` ≥ 3. Returns a `Table` (milliseconds).

    >>> impulse_cost([61], repeats=3).heads
    ('n', 'method', 'steps', 'error', 'factorisation, ms', 'solve, ms', 'solve / factorisation', 'lowest', 'highest')
    """
    repeats = as_repeats(repeats)
    rows = []
    for n in sizes:
        built = scene("dividend", n)
        A, b = sp.csc_array(built.problem.A), np.ones(built.problem.n)
        solution = built.problem.solve()  # compiles
        units, solves = _in_turn(built.problem, partial(_factorised_solve, A, b), repeats)
        ratios = solves / units
        medians = [1e3 * float(np.median(x)) for x in (units, solves)]
        error = float(built.errors(solution.z)["V(1)"])
        rows.append((built.problem.n, solution.method.name, solution.iterations, error, *medians, *spread(ratios)))
    heads = ("n", "method", "steps", "error", "factorisation, ms", "solve, ms", "solve / factorisation")
    return Table(f"Impulse control ({machine()})", (*heads, "lowest", "highest"), tuple(rows))


def _in_turn(problem: ICP, unit: Callable[[], object], repeats: int) -> tuple[np.ndarray, np.ndarray]:
    """Seconds of `unit`, the mean of one before and one after, and of solving a new problem between the two."""
    units, solves = [], []
    for _ in range(repeats):
        fresh = ICP(problem.A, problem.q, problem.psi)
        marks = [time.perf_counter()]
        for call in (unit, fresh.solve, unit):
            call()
            marks.append(time.perf_counter())
        before, between, after = np.diff(marks)
        units.append(0.5 * (before + after))
        solves.append(between)
    return np.array(units), np.array(solves)


def _factorised_solve(A: sp.csc_array, b: Vector) -> Vector:
    from scipy.sparse.linalg import splu

    return np.asarray(splu(A).solve(b))
