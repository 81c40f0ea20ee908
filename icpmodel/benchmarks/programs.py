"""What quadratic programs cost inside CVXPY, against the solvers that people take there."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from .. import modelling
from ..numerics.arrays import as_number
from ..present.table import Table
from ..study.timing import as_repeats, clocked, machine, timed

#: what gives the program of the next round: another one, or the same with other data
_Rounds = Callable[[], Any]


@dataclass(eq=False)
class _Entrant:
    """The `solver` that gets the programs of all `rounds`, and the `values` it found."""

    rounds: _Rounds
    solver: Any
    values: list[float] = field(default_factory=list)

    def solve(self, program: Any) -> None:
        program.solve(solver=self.solver)
        self.values.append(float(program.value))


def program_cost(size: int = 200, repeats: int = 15, seed: int = 0) -> Table:
    """CVXPY's `solve` of quadratic programs by `icp.cvxpy_solver()` and by the solver beside it, timed in turn.

    Support vector machines with a hinge for each of 2½·`size` points, and dense programs, are built anew each time and
    solved by Clarabel as well; small programs with parameters are built once and solved again and again, with data that
    drift or are drawn anew, by OSQP as well. CVXPY's own work counts on both sides. The ratio is the median of the
    ratios pair by pair; the last column has the largest relative difference of the two values.
    Parameters: `size` unknowns of the dense programs, with three times as many rows, and the other way round; `repeats`
    pairs of timings, ≥ 3; `seed` of the data. Returns a `Table` (seconds).

    >>> icp.benchmarks.program_cost(size=10, repeats=3).heads[:4]
    ('program', 'against', 'solve, s', 'the other, s')
    """
    size, repeats = int(as_number(size, "size", least=4, whole=True)), as_repeats(repeats)
    random = np.random.default_rng(int(as_number(seed, "seed", least=0, whole=True)))
    rows = []
    for name, against, make in _programs(size, random):
        ours, other = _Entrant(make(), modelling.cvxpy_solver()), _Entrant(make(), against)
        taken = timed({one: clocked(one.solve, one.rounds) for one in (ours, other)}, repeats)
        off = max(abs(a - b) / max(abs(b), 1.0) for a, b in zip(ours.values, other.values, strict=True))
        rows.append((name, against, taken.median(ours), taken.median(other), *taken.ratio(ours, other), off))
    heads = ("program", "against", "solve, s", "the other, s", "ratio", "lowest", "highest", "difference of values")
    return Table(f"Quadratic programs inside CVXPY ({machine()})", heads, tuple(rows))


def _programs(size: int, random: np.random.Generator) -> Iterator[tuple[str, str, Callable[[], _Rounds]]]:
    """Name, solver beside ours, and what makes the same rounds again."""
    points = 5 * size // 2
    for features in (2, size // 10 or 1, size // 2):
        yield f"support vectors, {points} x {features}", "CLARABEL", _support(points, features, random)
    for n, m in ((size, 3 * size), (3 * size, size)):
        yield f"dense, {n} x {m}", "CLARABEL", _dense(n, m, random)
    for n in (5, 10, 30):
        for kind, drift in (("drift", 0.05), ("are new", 1.0)):
            yield f"again and again, {n} x {2 * n}, data {kind}", "OSQP", _again(n, drift, random)


def _support(points: int, features: int, random: np.random.Generator) -> Callable[[], _Rounds]:
    import cvxpy as cp

    X = random.normal(size=(points, features))
    sides = np.sign(X @ random.normal(size=features) + 0.5 * random.normal(size=points))

    def program() -> Any:
        w, b, hinge = cp.Variable(features), cp.Variable(), cp.Variable(points, nonneg=True)
        rows = [cp.multiply(sides, X @ w + b) >= 1 - hinge]
        return cp.Problem(cp.Minimize(0.5 * cp.sum_squares(w) + cp.sum(hinge)), rows)

    return lambda: program


def _dense(n: int, m: int, random: np.random.Generator) -> Callable[[], _Rounds]:
    import cvxpy as cp

    B, q, G, h = random.normal(size=(n, n)), random.normal(size=n), random.normal(size=(m, n)), random.random(m)

    def program() -> Any:
        x = cp.Variable(n)
        objective = 0.5 * cp.quad_form(x, cp.psd_wrap(B @ B.T / n)) + q @ x
        return cp.Problem(cp.Minimize(objective), [G @ x <= h])

    return lambda: program


def _again(n: int, drift: float, random: np.random.Generator) -> Callable[[], _Rounds]:
    import cvxpy as cp

    B, G, seed = random.normal(size=(n, n)), random.normal(size=(2 * n, n)), int(random.integers(2**31))
    L = np.linalg.cholesky(B @ B.T / n + 0.1 * np.eye(n))

    def make() -> _Rounds:
        x, q, h, data = cp.Variable(n), cp.Parameter(n), cp.Parameter(2 * n), np.random.default_rng(seed)
        program = cp.Problem(cp.Minimize(0.5 * cp.sum_squares(L.T @ x) + q @ x), [G @ x <= h])
        now = [data.normal(size=n), data.random(2 * n)]

        def following() -> Any:
            new = data.normal(size=n), data.random(2 * n)
            now[:] = [(1.0 - drift) * a + drift * b for a, b in zip(now, new, strict=True)]
            q.value, h.value = now
            return program

        return following

    return make
