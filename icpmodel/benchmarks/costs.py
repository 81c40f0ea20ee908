"""What whole solves cost, against one linear solve with A, their parts, and OSQP; and what it costs to read a model."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterable, Iterator, Sequence
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from .. import modelling
from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..numerics.multigrid import linear_solve
from ..present.table import Table
from ..problem.affine import Affine
from ..problem.elementwise import Elementwise
from ..scenes import scene
from ..solve.many import solve_many
from ..solve.solution import Solution
from ..study.cases import fresh
from ..study.timing import Timings, as_repeats, clocked, machine, middle, timed

_Lcps = list[tuple[np.ndarray, Vector]]
#: language, model, n, what reads the model from scratch, and what writes the same expressions for another solver
_Pair = tuple[str, str, int, Callable[[], object], Callable[[], object]]

#: what OSQP is asked for: its defaults, and what it takes to come near to a pivoting method's residual
_SETTINGS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "eps = 1e-8": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 100_000},
    "eps = 1e-8, polishing": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 100_000, "polishing": True},
}


def solve_cost(sizes: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 5) -> Table:
    """solve() to Res ≤ 1e-8·Res(0) against its limit, one linear solve with A to 1e-8, timed in turn.

    Set-up is included on both sides. On the membrane with μ = 0 and its variants: ψ elementwise, ½ sin(z) + c, and
    affine, a quarter of each of two neighbours; a lid above, which a quarter of the rows touch; A nonsymmetric (skew
    ½); A strongly dominant (μ = 4); and the ball. The ratio is the median of the ratios pair by pair; the last column
    has the time of `solve()` in products A @ z, the median of those that fill a fifth of a second, and says
    how the work grows.
    Parameters: `sizes` unknowns (the nearest squares); `repeats` pairs of timings, ≥ 3. Returns a `Table` (seconds).

    >>> icp.benchmarks.solve_cost([400], repeats=3).heads[:6]
    ('problem', 'n', 'method', 'solve, s', 'linear solve, s', 'ratio')
    """
    repeats = as_repeats(repeats)
    rows = []
    for n in sizes:
        for name, problem in _variants(n):
            b = np.ones(problem.n)
            units = {
                "solve": clocked(partial(linear_solve, problem.A, b)),
                "product": middle(partial(problem.A.dot, b)),
            }
            solution, taken = _costs(problem, repeats, **units)
            medians = (taken.median("ours"), taken.median("solve"))
            ratios = (*taken.ratio("ours", "solve"), taken.ratio("ours", "product")[0])
            rows.append((name, problem.n, solution.method.name, *medians, *ratios))
    heads = ("problem", "n", "method", "solve, s", "linear solve, s", "ratio", "lowest", "highest", "solve / (A @ z)")
    return Table(f"solve() against one linear solve ({machine()})", heads, tuple(rows))


def dominant_cost(sizes: Sequence[int] = (10_000, 100_000, 1_000_000), repeats: int = 9, mu: float = 4.0) -> Table:
    """solve() on the membrane with a strongly dominant A against sweeps times one SciPy A @ z, timed in turn.

    The problem is a new one in every pair, so that nothing is known of A; a product's time is the median of those
    that fill a fifth of a second.
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

    That is SciPy's `splu` of the tridiagonal A; the error is that of V(1) against the closed form.
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


def _costs(problem: ICP, repeats: int, **units: Callable[[], float]) -> tuple[Solution, Timings[str]]:
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
    yield "membrane", problem
    yield "ball", scene("ball", n).problem
    c = problem.psi.value(np.zeros(problem.n))
    half_sine = Elementwise(lambda z: 0.5 * np.sin(z), lambda z: 0.5 * np.cos(z), lipschitz=0.5, c=c)
    yield "elementwise psi", problem.with_psi(half_sine)
    yield "affine psi", _affine(problem)
    yield "two obstacles", problem.with_upper(np.maximum(c, _LID))
    yield "skew = 0.5", scene("membrane", n, skew=0.5).problem
    yield "mu = 4", scene("membrane", n, mu=4.0).problem


#: the height above which nothing of the membrane goes where it has a lid: a quarter of its rows touch it
_LID = 0.2


def _affine(problem: ICP) -> ICP:
    """The problem on a square grid with a quarter of each of two neighbours added to its fixed obstacle."""
    m = int(np.sqrt(problem.n))
    G = sp.kron(sp.eye_array(m), sp.diags_array([0.25, 0.25], offsets=[-1, 1], shape=(m, m)))
    return problem.with_psi(Affine(G, problem.psi.value(np.zeros(problem.n))))


def small_cost(n: int = 16, k: int = 10_000, repeats: int = 15) -> Table:
    """Small LCPs against OSQP, one at a time and many with one A, timed in turn.

    A = BBᵀ + I, B and q normal; OSQP solves min ½zᵀAz + qᵀz, z ≥ 0. "one": `ICP(A, q).solve()` against set-up and
    solve by OSQP, for 20 problems, both from the dense A; "one, arrays ready": without the time that it takes to make
    the sparse arrays for OSQP. The others: `solve_many` on `k` right-hand sides that share A against a loop over one
    OSQP object with update(q=…). The ratio is the median of the ratios pair by pair, the residuals the largest over all
    problems, recomputed from A and q.
    Parameters: `n` unknowns; `k` right-hand sides of one A; `repeats` pairs of timings, ≥ 3.
    Returns a `Table` (microseconds per problem).

    >>> icp.benchmarks.small_cost(n=8, k=3, repeats=3).heads[:6]
    ('problems', 'n', 'OSQP with', 'ours, us', 'OSQP, us', 'ratio')
    """
    repeats = as_repeats(repeats)
    n, k = (int(as_number(value, name, least=1, whole=True)) for name, value in (("n", n), ("k", k)))
    random = np.random.default_rng(0)
    factors = [(random.normal(size=(n, n)), random.normal(size=n)) for _ in range(20)]
    problems = [(B @ B.T + np.eye(n), q) for B, q in factors]
    Q = random.normal(size=(k, n))
    rows = []
    with contextlib.redirect_stdout(io.StringIO()):  # OSQP prints about polishing whatever one asks
        for name, settings in _SETTINGS.items():
            rows += [(what, n, name, *row) for what, row in _one(problems, settings, repeats).items()]
        for name, settings in _SETTINGS.items():
            rows.append((f"{k} with one A", n, name, *_many(problems[0][0], Q, settings, repeats)))
    heads = ("problems", "n", "OSQP with", "ours, us", "OSQP, us", "ratio", "our residual", "residual of OSQP")
    return Table(f"Small LCPs against OSQP ({machine()})", heads, tuple(rows))


def _one(problems: _Lcps, settings: dict[str, Any], repeats: int) -> dict[str, tuple[float, ...]]:
    def ours() -> list[Vector]:
        return [ICP(A, q).solve().z for A, q in problems]

    def ready() -> list[tuple[Any, ...]]:
        return [_arrays(A, q) for A, q in problems]

    def osqp(arrays: list[tuple[Any, ...]]) -> list[Vector]:
        return [_model(one, settings).solve(raise_error=False).x for one in arrays]

    theirs = {"one": clocked(lambda: osqp(ready())), "one, arrays ready": clocked(osqp, ready)}
    taken = timed({"ours": clocked(ours), **theirs}, repeats)
    residuals = _worst(problems, ours()), _worst(problems, osqp(ready()))
    return {what: (*_per_problem(taken, what, len(problems)), *residuals) for what in theirs}


def _many(A: np.ndarray, Q: np.ndarray, settings: dict[str, Any], repeats: int) -> tuple[float, ...]:
    X, problems = np.empty(Q.shape), [(A, q) for q in Q]

    def osqp() -> None:
        model = _model(_arrays(A, Q[0]), settings)
        for i, q in enumerate(Q):
            model.update(q=q)
            X[i] = model.solve(raise_error=False).x

    taken = timed({"ours": clocked(partial(solve_many, A, Q)), "osqp": clocked(osqp)}, repeats)
    residuals = _worst(problems, solve_many(A, Q).Z), _worst(problems, X)
    return (*_per_problem(taken, "osqp", len(Q)), *residuals)


def _per_problem(taken: Timings[str], theirs: str, k: int) -> tuple[float, float, float]:
    """Microseconds per problem of ours and of theirs, and the ratio."""
    return taken.median("ours", 1e-6 * k), taken.median(theirs, 1e-6 * k), taken.ratio("ours", theirs)[0]


def _arrays(A: np.ndarray, q: Vector) -> tuple[Any, ...]:
    n = q.size
    return sp.csc_matrix(np.triu(A)), q, sp.identity(n, format="csc"), np.zeros(n), np.full(n, np.inf)


def _model(arrays: tuple[Any, ...], settings: dict[str, Any]) -> Any:
    import osqp

    model = osqp.OSQP()
    model.setup(*arrays, verbose=False, **settings)
    return model


def _worst(problems: _Lcps, answers: Iterable[Vector]) -> float:
    """The largest residual."""
    return max(float(np.linalg.norm(np.minimum(A @ z + q, z))) for (A, q), z in zip(problems, answers, strict=True))


def reading_cost(cvxpy_n: int = 1_000_000, pyomo_n: int = 100_000, repeats: int = 3) -> Table:
    """Reading CVXPY and Pyomo models of the membrane against what these languages take to write them, timed in turn.

    CVXPY: `Problem([complements(p, r)])` against `get_problem_data` for OSQP with p ≥ 0, r ≥ 0; the expressions are
    built anew each time. Pyomo: `read_pyomo` against its NL writer, which gets the 2n sides as constraints, side ≥ 0,
    and is thus spared Pyomo's transformation of complementarity conditions; ψ fixed, affine, a quarter of each of two
    neighbours, and nonlinear, 0.3 sin(z_i) + c_i. The ratio is the median of the ratios pair by pair.
    Parameters: `cvxpy_n` unknowns of the CVXPY model (the nearest square); `pyomo_n` conditions of the Pyomo models;
    `repeats` pairs of timings, ≥ 3. Returns a `Table` (seconds).

    >>> icp.benchmarks.reading_cost(cvxpy_n=100, pyomo_n=100, repeats=3).heads[:5]
    ('language', 'model', 'n', 'read, s', 'its own writer, s')
    """
    repeats = as_repeats(repeats)
    rows = []
    for language, model, n, read, write in (*_cvxpy(cvxpy_n), *_pyomo(pyomo_n)):
        taken = timed({"read": clocked(read), "write": clocked(write)}, repeats, warm=False)
        medians = (taken.median("read"), taken.median("write"))
        rows.append((language, model, n, *medians, *taken.ratio("read", "write")))
    heads = ("language", "model", "n", "read, s", "its own writer, s", "ratio", "lowest", "highest")
    return Table(f"Reading a model against its language's own writer ({machine()})", heads, tuple(rows))


def _cvxpy(n: int) -> Iterator[_Pair]:
    import cvxpy as cp

    problem = scene("membrane", n).problem

    def sides() -> tuple[cp.Expression, cp.Expression]:
        z = cp.Variable(problem.n)
        return problem.A @ z + problem.q, z - problem.psi.value(problem.q)

    def read() -> ICP:
        return modelling.Problem(modelling.complements(*sides())).icp()

    def write() -> object:
        return cp.Problem(cp.Minimize(0), [side >= 0 for side in sides()]).get_problem_data(cp.OSQP)

    yield "CVXPY", "fixed obstacle", problem.n, read, write


def _pyomo(n: int) -> Iterator[_Pair]:
    import pyomo.environ as pyo
    from pyomo.repn.plugins.nl_writer import NLWriter

    problem = scene("membrane", n).problem
    sine = Elementwise(lambda z: 0.3 * np.sin(z), c=problem.psi.value(np.zeros(problem.n)))
    models = {"fixed obstacle": problem, "affine psi": _affine(problem), "nonlinear psi": problem.with_psi(sine)}
    for name, one in models.items():
        model, plain = one.to_pyomo(), one.to_pyomo()
        sides = [condition._args for condition in plain.complementarity.values()]
        plain.sides = pyo.Constraint(range(problem.n), [0, 1], rule=lambda _, i, k, sides=sides: sides[i][k])
        plain.complementarity.deactivate()

        def write(plain: Any = plain) -> object:
            return NLWriter().write(plain, io.StringIO())

        yield "Pyomo", name, problem.n, partial(modelling.read_pyomo, model), write
