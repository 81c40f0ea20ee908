"""Small LCPs against OSQP, one at a time and thousands that share A."""

from __future__ import annotations

import contextlib
import io
from collections.abc import Callable, Iterable
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from ..icp import ICP
from ..numerics.arrays import Vector, as_number
from ..present.table import Table
from ..solve.many import solve_many
from ..study.timing import Timings, as_repeats, clocked, machine, timed

_Lcps = list[tuple[np.ndarray, Vector]]

#: what OSQP is asked for: its defaults, and what it takes to come near to a pivoting method's residual
_SETTINGS: dict[str, dict[str, Any]] = {
    "defaults": {},
    "eps = 1e-8": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 100_000},
    "eps = 1e-8, polishing": {"eps_abs": 1e-8, "eps_rel": 1e-8, "max_iter": 100_000, "polishing": True},
}


def small_cost(n: int = 16, k: int = 10_000, repeats: int = 15) -> Table:
    """Small LCPs against OSQP, one at a time and many with one A, timed in turn.

    A = BBᵀ + I, B and q normal; OSQP solves min ½zᵀAz + qᵀz, z ≥ 0. "one": `ICP(A, q).solve()` against set-up and
    solve by OSQP, for 20 problems, both from the dense A; "one, arrays ready": without the time that it takes to make
    the sparse arrays for OSQP. The others: `solve_many` on `k` right-hand sides that share A against a loop over one
    OSQP object with update(q=…). The ratio, ours over theirs, is the median of the ratios pair by pair, the residuals
    the largest over all problems, recomputed from A and q for both.
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
            for what, row in _one(problems, settings, repeats).items():
                rows.append((what, n, name, *row))
        for name, settings in _SETTINGS.items():
            rows.append((f"{k} with one A", n, name, *_many(problems[0][0], Q, settings, repeats)))
    heads = ("problems", "n", "OSQP with", "ours, us", "OSQP, us", "ratio", "our residual", "residual of OSQP")
    return Table(f"Small LCPs against OSQP ({machine()})", heads, tuple(rows))


def _one(problems: _Lcps, settings: dict[str, Any], repeats: int) -> dict[str, tuple[float, ...]]:
    ready = [_arrays(A, q) for A, q in problems]
    answers: dict[str, list[Vector]] = {}

    def ours() -> None:
        answers["ours"] = [ICP(A, q).solve().z for A, q in problems]

    def osqp(given: Callable[[], Iterable[Any]]) -> None:
        answers["osqp"] = [_model(arrays, settings).solve(raise_error=False).x for arrays in given()]

    calls = {
        "ours": clocked(ours),
        "one": clocked(partial(osqp, lambda: (_arrays(A, q) for A, q in problems))),
        "one, arrays ready": clocked(partial(osqp, lambda: ready)),
    }
    taken = timed(calls, repeats)
    residuals = (_worst(problems, answers["ours"]), _worst(problems, answers["osqp"]))
    return {what: (*_costs(taken, what, len(problems)), *residuals) for what in ("one", "one, arrays ready")}


def _many(A: np.ndarray, Q: np.ndarray, settings: dict[str, Any], repeats: int) -> tuple[float, ...]:
    Z, X = np.empty(Q.shape), np.empty(Q.shape)

    def ours() -> None:
        Z[:] = solve_many(A, Q).Z

    def osqp() -> None:
        model = _model(_arrays(A, Q[0]), settings)
        for i, q in enumerate(Q):
            model.update(q=q)
            X[i] = model.solve(raise_error=False).x

    taken = timed({"ours": clocked(ours), "osqp": clocked(osqp)}, repeats)
    problems = [(A, q) for q in Q]
    return (*_costs(taken, "osqp", len(Q)), _worst(problems, Z), _worst(problems, X))


def _costs(taken: Timings[str], theirs: str, k: int) -> tuple[float, float, float]:
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
