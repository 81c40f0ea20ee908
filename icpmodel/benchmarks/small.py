"""Small LCPs against OSQP, one at a time and thousands that share A."""

from __future__ import annotations

import contextlib
import io
import time
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..present.table import Table
from ..solve.many import solve_many
from ..study.timing import as_repeats, machine

#: what OSQP is asked for: its defaults, and what it takes to come near to a pivoting method's residual
_SETTINGS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "eps = 1e-8": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 100_000},
    "eps = 1e-8, polishing": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 100_000, "polishing": True},
}


def small_cost(n: int = 16, k: int = 10_000, repeats: int = 15) -> Table:
    """Time of small LCPs with A = BBᵀ + I, B and q normal, against OSQP on min ½zᵀAz + qᵀz, z ≥ 0.

    "one": `ICP(A, q).solve()` against set-up and solve by OSQP, for 20 problems, both from the dense A; "one, arrays
    ready": without the time that it takes to make the sparse arrays for OSQP. The others: `solve_many` on `k`
    right-hand sides that share A against a loop over one OSQP object with update(q=…). The two are timed in turn, the
    20 of ours and the 20 of theirs; the ratio, ours over theirs, is the median of the ratios pair by pair, the
    residuals the largest over all problems, recomputed from A and q for both.
    Parameters: `n` and `k` ≥ 1, `repeats` ≥ 3 pairs. Returns a `Table` (microseconds per problem).

    >>> small_cost(n=8, k=3, repeats=3).heads
    ('problems', 'n', 'OSQP with', 'ours, us', 'OSQP, us', 'ratio', 'our residual', 'residual of OSQP')
    """
    repeats = as_repeats(repeats)
    n, k = (int(as_number(value, name, least=1, whole=True)) for name, value in (("n", n), ("k", k)))
    rng = np.random.default_rng(0)
    problems = []
    for _ in range(20):
        B = rng.normal(size=(n, n))
        problems.append((B @ B.T + np.eye(n), rng.normal(size=n)))
    Q = rng.normal(size=(k, n))
    ICP(*problems[0]).solve()  # compiles
    solve_many(problems[0][0], Q[:2])
    rows = []
    with contextlib.redirect_stdout(io.StringIO()):  # OSQP prints about polishing whatever one asks
        for name, settings in _SETTINGS.items():
            ones = np.array([_one(problems, settings) for _ in range(repeats)])
            rows.append(("one", n, name, *_summary(ones[:, [0, 1, 3, 4]], len(problems))))
            rows.append(("one, arrays ready", n, name, *_summary(ones[:, [0, 2, 3, 4]], len(problems))))
        for name, settings in _SETTINGS.items():
            manies = [_many(problems[0][0], Q, settings) for _ in range(repeats)]
            rows.append((f"{k} with one A", n, name, *_summary(np.array(manies), k)))
    heads = ("problems", "n", "OSQP with", "ours, us", "OSQP, us", "ratio", "our residual", "residual of OSQP")
    return Table(f"Small LCPs against OSQP ({machine()})", heads, tuple(rows))


def _summary(pairs: np.ndarray, k: int) -> tuple[float, ...]:
    ours, theirs, our_residual, residual = pairs.T
    medians = (1e6 * float(np.median(ours)) / k, 1e6 * float(np.median(theirs)) / k, float(np.median(ours / theirs)))
    return (*medians, float(our_residual.max()), float(residual.max()))


def _model(parts: tuple[Any, ...], settings: dict[str, Any]) -> Any:
    import osqp

    model = osqp.OSQP()
    model.setup(*parts, verbose=False, **settings)
    return model


def _parts(A: np.ndarray, q: Vector) -> tuple[Any, ...]:
    n = q.size
    return sp.csc_matrix(np.triu(A)), q, sp.identity(n, format="csc"), np.zeros(n), np.full(n, np.inf)


def _one(problems: list[tuple[np.ndarray, Vector]], settings: dict[str, Any]) -> tuple[float, ...]:
    """Seconds of ours, of theirs, and of theirs from when the arrays are made; and the residuals."""
    marks = [time.perf_counter()]
    ours = [ICP(A, q).solve().z for A, q in problems]
    marks.append(time.perf_counter())
    parts = [_parts(A, q) for A, q in problems]
    marks.append(time.perf_counter())
    theirs = [_model(arrays, settings).solve(raise_error=False).x for arrays in parts]
    marks.append(time.perf_counter())
    solve, make, rest = np.diff(marks)
    residuals = (
        max(_residual(A, q, z) for (A, q), z in zip(problems, answers, strict=True)) for answers in (ours, theirs)
    )
    return solve, make + rest, rest, *residuals


def _many(A: np.ndarray, Q: np.ndarray, settings: dict[str, Any]) -> tuple[float, ...]:
    begin = time.perf_counter()
    Z = solve_many(A, Q).Z
    between = time.perf_counter()
    model, X = _model(_parts(A, Q[0]), settings), np.empty(Q.shape)
    for i, q in enumerate(Q):
        model.update(q=q)
        X[i] = model.solve(raise_error=False).x
    end = time.perf_counter()
    residuals = (max(_residual(A, q, z) for q, z in zip(Q, answers, strict=True)) for answers in (Z, X))
    return between - begin, end - between, *residuals


def _residual(A: np.ndarray, q: Vector, z: Vector) -> float:
    return float(np.linalg.norm(np.minimum(A @ z + q, z)))
