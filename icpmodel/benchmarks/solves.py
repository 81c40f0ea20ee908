"""What whole solves cost: against one linear solve with A, and in units of what they are made of."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from functools import partial

import numpy as np
import scipy.sparse as sp

from ..icp import ICP
from ..numerics.multigrid import linear_solve
from ..present.table import Table
from ..problem.affine import Affine
from ..problem.elementwise import Elementwise
from ..scenes import scene
from ..solve.solution import Solution
from ..study.cases import fresh
from ..study.timing import Timed, Timings, as_repeats, clocked, machine, middle, timed


def solve_cost(sizes: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 5) -> Table:
    """solve() to Res ≤ 1e-8·Res(0) against its limit, one linear solve with A to 1e-8, timed in turn.

    Set-up is included on both sides. On the membrane with μ = 0 and its variants: ψ elementwise, ½ sin(z) + c, and
    affine, a quarter of each of two neighbours; A nonsymmetric (skew ½); A strongly dominant (μ = 4); and the ball. The
    ratio is the median of the ratios pair by pair. The last column has the time of `solve()` in products A @ z, each
    time the median of five: it says how the work grows, where the time of a product grows faster than n beyond the
    cache. Parameters: `sizes` unknowns (the nearest squares); `repeats` pairs of timings, ≥ 3.
    Returns a `Table` (seconds).

    >>> icp.benchmarks.solve_cost([400], repeats=3).heads[:6]
    ('problem', 'n', 'method', 'solve, s', 'linear solve, s', 'ratio')
    """
    repeats = as_repeats(repeats)
    rows = []
    for n in sizes:
        for name, problem in _variants(n):
            b = np.ones(problem.n)
            linear = clocked(partial(linear_solve, problem.A, b))
            solution, taken = _costs(problem, repeats, solve=linear, product=middle(partial(problem.A.dot, b)))
            medians = (taken.median("ours"), taken.median("solve"))
            products = taken.ratio("ours", "product")[0]
            ratio = taken.ratio("ours", "solve")
            rows.append((name, problem.n, solution.method.name, *medians, *ratio, products))
    heads = ("problem", "n", "method", "solve, s", "linear solve, s", "ratio", "lowest", "highest", "solve / (A @ z)")
    return Table(f"solve() against one linear solve ({machine()})", heads, tuple(rows))


def dominant_cost(sizes: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 9, mu: float = 4.0) -> Table:
    """solve() on the membrane with a strongly dominant A against sweeps times one SciPy A @ z, timed in turn.

    The problem is a new one in every pair, so that nothing is known of A; making it does not count. The time of a
    product is the median of five; the ratio is the median of the ratios pair by pair.
    Parameters: `sizes` unknowns (the nearest squares); `repeats` pairs of timings, ≥ 3; `mu` what is added to the
    diagonal. Returns a `Table` (milliseconds).

    >>> icp.benchmarks.dominant_cost([400], repeats=3).heads[:6]
    ('n', 'method', 'sweeps', 'A @ z, ms', 'solve, ms', 'solve / (sweeps * A @ z)')
    """
    repeats = as_repeats(repeats)
    rows = []
    for n in sizes:
        problem = scene("membrane", n, mu=mu).problem
        solution, taken = _costs(problem, repeats, product=middle(partial(problem.A.dot, np.ones(problem.n))))
        ratio = taken.ratio("ours", "product", per=max(solution.iterations, 1))
        medians = (taken.median("product", 1e-3), taken.median("ours", 1e-3))
        rows.append((problem.n, solution.method.name, solution.iterations, *medians, *ratio))
    heads = ("n", "method", "sweeps", "A @ z, ms", "solve, ms", "solve / (sweeps * A @ z)", "lowest", "highest")
    return Table(f"A strongly dominant (mu = {mu:g}), to Res <= 1e-8 Res(0) ({machine()})", heads, tuple(rows))


def impulse_cost(sizes: Sequence[int] = (961, 6001, 25_601, 100_001), repeats: int = 9) -> Table:
    """solve() on the dividend scene against one sparse factorisation of its A and a solve with it, timed in turn.

    That is SciPy's `splu` of the tridiagonal A at its defaults; pairs and ratios are as in `dominant_cost`. The error
    is that of V(1) against the closed form.
    Parameters: `sizes` unknowns; `repeats` pairs of timings, ≥ 3. Returns a `Table` (milliseconds).

    >>> icp.benchmarks.impulse_cost([61], repeats=3).heads[:5]
    ('n', 'method', 'steps', 'error', 'factorisation, ms')
    """
    repeats = as_repeats(repeats)
    rows = []
    for n in sizes:
        built = scene("dividend", n)
        solution, taken = _costs(built.problem, repeats, splu=clocked(partial(_splu, sp.csc_array(built.problem.A))))
        medians = (taken.median("splu", 1e-3), taken.median("ours", 1e-3))
        told = (solution.method.name, solution.iterations, float(built.errors(solution.z)["V(1)"]))
        rows.append((built.problem.n, *told, *medians, *taken.ratio("ours", "splu")))
    heads = ("n", "method", "steps", "error", "factorisation, ms", "solve, ms", "solve / factorisation")
    return Table(f"Impulse control ({machine()})", (*heads, "lowest", "highest"), tuple(rows))


def _costs(problem: ICP, repeats: int, **units: Callable[[], Timed]) -> tuple[Solution, Timings[str]]:
    """`solve()` of a new problem, "ours", in turn with the `units`, and its solution."""
    solution = problem.solve()  # compiles
    for unit in units.values():
        unit()
    return solution, timed({"ours": clocked(ICP.solve, partial(fresh, problem)), **units}, repeats, warm=False)


def _splu(A: sp.csc_array) -> None:
    from scipy.sparse.linalg import splu

    splu(A).solve(np.ones(A.shape[0]))


def _variants(n: int) -> Iterator[tuple[str, ICP]]:
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
