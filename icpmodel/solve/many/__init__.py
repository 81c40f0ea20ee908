"""Many problems in one call, with different A, q or obstacles, in this process or by the workers of a pool."""

from __future__ import annotations

import copy
import time
from concurrent.futures import BrokenExecutor, Future, wait
from contextlib import suppress
from dataclasses import replace
from typing import Any

import numpy as np

from ...errors import InputError, NotSolved
from ...numerics import work
from ...numerics.arrays import as_truth, described
from ...numerics.rounding import public_entry
from ..goal import RTOL, Limits
from ..solution import Status
from ..solutions import Solutions
from .batch import ROWS_PER_CHAIN, SHARE_COST, Batch

#: ranges of rows low ≤ i < high, and the future of each
RowRanges = list[tuple[int, int]]
Futures = dict[tuple[int, int], Future[Any]]
#: the attributes of a batch that hold results: by row, and others
_ROW_FIELDS = ("Z", "residuals", "tolerances", "solved")
_OTHER_FIELDS = ("failures", "records", "compiled")
#: the start times of the batches whose further shares this worker drops after Ctrl-C
_INTERRUPTED: set[float] = set()


@public_entry
def solve_many(
    A: Any,
    Q: Any,
    psi: Any = 0.0,
    *,
    upper: Any = None,
    Z0: Any = None,
    rtol: float = RTOL,
    atol: float = 0.0,
    time_limit: float | None = None,
    memory_limit: float | None = None,
    executor: Any = None,
    raise_on_failure: bool = True,
) -> Solutions:
    """Solve k problems as `solve` would: row i of `Q` with A and ψ, or with the i-th of those that are lists.

    Small and tridiagonal problems are solved by a few compiled calls on all cores. With n ≤ 64 they are pivoted (see
    `Lemke`): they share A, or have arrays A of one size, and ψ is affine or amounts to fixed obstacles. A shared
    tridiagonal A with such fixed obstacles goes to `Tridiagonal`. A moving obstacle has to be the same in all problems.
    Unless both obstacles are fixed or move alike, all problems need upper obstacles in the same entries of z. With
    `Z0`, A has to be a shared H₊-matrix and the obstacles fixed.

    All other problems go to `solve` one by one. Facts of a shared A are kept from row to row. Each row starts from its
    row of `Z0`. Without `Z0` it starts from the previous answer, but every 16th row anew. After Ctrl-C the solved rows
    are kept.

    With an `executor` workers solve the rows in shares, with the same answers. It makes a pool, such as
    `ProcessPoolExecutor`, `MPIPoolExecutor` of mpi4py.futures or Dask's `client.get_executor`. The shares of a pool
    that breaks are solved again by a new one, in the end row by row. A row that still kills its worker has the status
    WORKER_LOST.

    Parameters
    ----------
    A : array_like or sparse matrix, or a list of k of them
        As for `ICP`.
    Q : array_like of shape (k, n) or (n,)
        One row per problem, or one for all where A, psi or upper is a list of k.
    psi, upper : optional
        As for `ICP`, or obstacles of shape (k, n), or a list of k maps.
    Z0 : array_like of shape (k, n) or (n,), or Solutions, optional
        The starts.
    rtol, atol : float
        Row i is solved where Res_D(z) ≤ rtol·Res_D(0), or Res(z) ≤ atol.
    time_limit : float, optional
        As for `solve`, for all rows together. The start of the workers counts, and their clocks
        should agree. A row that does not finish has its best iterate. One that was not begun has
        its start, with an infinite residual.
    memory_limit : float, optional
        As for `solve`, for each worker.
    executor : callable, optional
        Makes a pool of workers.
    raise_on_failure : bool, default True
        Whether NotSolved is raised where a row is not solved.

    Returns
    -------
    Solutions
        One row per problem.

    Raises
    ------
    InputError
        For wrong shapes.
    NotSolved
        Where a row is not solved; it carries the solutions. And what else `solve` raises.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4.

    Examples
    --------
    >>> solve_many([[2, -1], [-1, 2]], [[-1, 3], [3, -1], [-1, -1]]).Z
    array([[0.5, 0. ],
           [0. , 0.5],
           [1. , 1. ]])
    >>> solve_many([[[2.0]], [[4.0]]], [-2.0]).Z.ravel()
    array([1. , 0.5])
    """
    limits = Limits(rtol=rtol, atol=atol, max_iter=0, time_limit=time_limit, memory_limit=memory_limit)
    as_truth(raise_on_failure, "raise_on_failure")
    batch = Batch(A, Q, psi, upper, Z0, limits)
    batch.run() if executor is None else _by_workers(batch, executor)
    solutions = batch.solutions()
    if raise_on_failure and solutions.messages:
        raise NotSolved(solutions)
    return solutions


@public_entry
def _solve_share(batch: Batch, start_time: float) -> dict[str, Any]:
    """Solve a share in a worker and return its results; `start_time` is when all shares began, by the wall clock."""
    batch.start_time = work.clock() - max(time.time() - start_time, 0.0)
    if len(batch.Z) and start_time not in _INTERRUPTED:
        batch.run()
    if batch.interrupted:
        _INTERRUPTED.add(start_time)
    return {name: getattr(batch, name) for name in (*_ROW_FIELDS, *_OTHER_FIELDS)}


def _pool_of(make: Any) -> Any:
    pool = make() if callable(make) else None
    if hasattr(pool, "submit"):
        return pool
    expected = "a function that makes a pool was expected, such as ProcessPoolExecutor or Dask's client.get_executor"
    raise InputError(f"executor is {described(make)}; {expected}")


def _by_workers(batch: Batch, make: Any) -> None:
    """Solve the rows of `batch` with the workers of a pool from `make`, and of a new pool after each that breaks.

    The failed shares are then tried in halves, until the one that kills its worker is found. It is tried once more,
    then row by row. A row that still kills its worker is given up.
    """
    k = len(batch.Z)
    row_cost = batch.row_cost()
    limit = batch.limits.time_limit
    size = ROWS_PER_CHAIN if row_cost is None else ROWS_PER_CHAIN * int(np.ceil(SHARE_COST / row_cost / ROWS_PER_CHAIN))
    # a share without rows is sent first, to test whether data can be sent
    groups = [[(low, min(low + size, k)) for low in range(0, k, size)], [(k, k)]]
    start_time = time.time() - batch.elapsed()
    pool = None
    futures: Futures = {}
    tried: set[tuple[int, int]] = set()
    try:
        while groups:
            group = groups.pop()
            pool = pool or _pool_of(make)
            with suppress(BrokenExecutor):
                for share in group:
                    futures[share] = pool.submit(_solve_share, _share_of(batch, *share), start_time)
            # a run may exceed `time_limit` by a tenth plus 0.2 s
            left = None if limit is None else max(1.1 * limit + 0.2 - batch.elapsed(), 0.0)
            if wait(futures.values(), timeout=left).not_done:
                break
            failed = _store_results(batch, group, futures)
            futures = {}
            if failed:
                pool = pool.shutdown()
                groups += _shares_to_repeat(failed, tried)
    except KeyboardInterrupt:
        batch.interrupted = True
    finally:
        running = [future for future in futures.values() if not future.done() and not future.cancel()]
        if pool is not None:
            pool.shutdown(wait=not running)
    _store_results(
        batch, [share for share, future in futures.items() if future.done() and not future.cancelled()], futures
    )
    why = "Ctrl-C came" if batch.interrupted else f"time_limit = {limit} s was over"
    failure = Status.INTERRUPTED if batch.interrupted else Status.TIME_LIMIT, f"{why} before its worker had sent it"
    batch.failures |= {int(row): failure for row in np.flatnonzero(~batch.solved) if row not in batch.failures}


def _shares_to_repeat(failed: RowRanges, tried: set[tuple[int, int]]) -> list[RowRanges]:
    """The groups of shares to repeat after some `failed`: halves, then one share alone (now `tried`), then its rows."""
    half = len(failed) // 2
    if half:
        return [failed[half:], failed[:half]]
    if failed[0] not in tried:
        tried.add(failed[0])
        return [failed]
    low, high = failed[0]
    return [[(row, row + 1) for row in range(low, high)]] if high - low > 1 else []


def _store_results(batch: Batch, shares: RowRanges, futures: Futures) -> RowRanges:
    """Store the results of the `shares`; return those that failed. Raises InputError if no data can be sent."""
    failed = []
    for low, high in shares:
        future = futures.get((low, high))
        error = BrokenExecutor("another share's worker broke it") if future is None else future.exception()
        if error is None:
            _store(batch, low, high, futures[low, high].result())
        elif isinstance(error, KeyboardInterrupt):
            batch.interrupted = True
        else:
            why = f"{type(error).__name__}: {error}"
            if low == high:
                raise InputError(
                    f"executor: no data reaches a worker: {why}; all of it, psi included, must be picklable"
                )
            failed.append((low, high))
            batch.failures |= dict.fromkeys(range(low, high), (Status.WORKER_LOST, f"its worker failed: {why}"))
    return failed


def _share_of(batch: Batch, low: int, high: int) -> Batch:
    """The rows low ≤ i < high as a batch of their own."""

    def cut(rows: Any) -> Any:
        return rows if rows is None or len(rows) == 1 else rows[low:high]

    part = copy.copy(batch)
    data = batch.data
    for name in ("maps", "obstacles", "uppers", "above", "starts"):
        setattr(part, name, cut(getattr(batch, name)))
    for name in _ROW_FIELDS:
        setattr(part, name, getattr(batch, name)[low:high])
    sides = [(one if maps is None else None, cut(maps)) for one, maps in (data.below, data.above)]
    part.data = replace(data, problems=cut(data.problems), Q=data.Q[low:high], below=sides[0], above=sides[1])
    part.failures = {}
    part.records = {}
    part.compiled = np.zeros(2)
    return part


def _store(batch: Batch, low: int, high: int, part: dict[str, Any]) -> None:
    """Store the results of the rows low ≤ i < high in place of earlier ones."""
    for name in _ROW_FIELDS:
        getattr(batch, name)[low:high] = part[name]
    batch.failures = {row: failure for row, failure in batch.failures.items() if not low <= row < high}
    batch.failures |= {low + row: failure for row, failure in part["failures"].items()}
    batch.records |= {low + row: failure for row, failure in part["records"].items()}
    batch.compiled += part["compiled"]
