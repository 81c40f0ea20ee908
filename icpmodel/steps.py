"""The sweeps over A as steps: one in a pass, two in one pass, and four where a second thread follows the first."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator
from concurrent.futures import ThreadPoolExecutor
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np

from .arrays import Vector
from .maps import Affine, Constant, Elementwise, is_compiled, raising_map_error
from .problem import ICP

#: entries that stay in a core's cache while a second sweep follows the first
_NEAR = 50_000
#: so many rows a thread goes ahead of the one that follows it, where A has at least so many entries
_CHUNK, _THREADS_FROM = 50_000, 1_000_000
#: z ↦ (z⁺, Res(z) or None where it does not fall out of the step)
Step = Callable[[Vector], tuple[Vector, float | None]]


class Rows(NamedTuple):
    """What the sweeps and the choice of a method ask of the rows of A, as `rows_of` finds it.

    `diag` where in A.data each diagonal entry stands; `diagonal`; `rest` = Σ_{j≠i}|a_ij|, all of shape (n,); how far
    the entries reach `below` the diagonal and `above` it.

    >>> rows_of(ICP([[2.0, -1.0], [0.0, 3.0]], [0.0, 0.0])).rest
    array([1., 0.])
    """

    diag: Any
    diagonal: Vector
    rest: Vector
    below: int
    above: int


def rows_of(problem: ICP) -> Rows:
    """The rows of A, looked at in one pass, once for all problems with this A.

    >>> rows_of(ICP([[2.0, -1.0], [0.0, 3.0]], [0.0, 0.0])).diagonal
    array([2., 3.])
    """

    def look() -> Rows:
        from .kernels.rows import look  # loads numba

        A, n = problem.A, problem.n
        arrays = np.empty(n, A.indptr.dtype), np.empty(n), np.empty(n)
        parts = cores() if A.nnz >= _THREADS_FROM else 1
        reach = in_parts(n, parts, lambda low, high: look(A.indptr, A.indices, A.data, low, high, *arrays))
        for array in arrays:
            array.flags.writeable = False
        below, above = np.max(reach, axis=0).tolist()
        return Rows(*arrays, below, above)

    found: Rows = problem.remembered("rows", look)
    return found


def cores() -> int:
    """How many cores this process may use.

    >>> cores() >= 1
    True
    """
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def in_parts(size: int, parts: int, work: Callable[[int, int], Any]) -> list[Any]:
    """`work(low, high)` on `parts` pieces of range(`size`), each in a thread of its own: compiled loops run at once.

    Returns what it returned, in order.

    >>> in_parts(5, 2, lambda low, high: (low, high))
    [(0, 2), (2, 5)]
    """
    cuts = [size * i // parts for i in range(parts + 1)]
    if parts == 1:
        return [work(0, size)]
    with ThreadPoolExecutor(parts) as pool:
        return list(pool.map(work, cuts, cuts[1:]))


def compiled_step(
    problem: ICP, name: str, before: tuple[Any, ...], after: tuple[Any, ...], reach: int | None = None
) -> Step:
    """One compiled sweep as a step: `before` and `after` are the kernel's arguments around ψ.

    ψ = constant, affine and compiled elementwise maps are evaluated inside the sweep; any other is called once for it.
    For a constant ψ a sweep that goes forward may make some more in the same pass over A: they are the next answers, as
    long as the step is asked for its own last one. `reach` is how far A reaches above its diagonal, None where the
    sweep has no such pass.

    >>> problem = ICP([[2.0]], [-2.0])
    >>> matrix = (problem.A.indptr, problem.A.indices, problem.A.data, problem.q)
    >>> compiled_step(problem, "diagonal", matrix, (np.array([2.0]), np.array([0.25])))(np.array([3.0]))
    (array([1.]), 3.0)
    """
    from .kernels.sweeps import SWEEPS, USER_SWEEPS

    psi = problem.psi
    inside: Any = None
    if isinstance(psi, Constant):
        inside = psi.c
    elif isinstance(psi, Affine):
        inside = (psi.c, psi.G.indptr, psi.G.indices, psi.G.data)
    elif isinstance(psi, Elementwise) and is_compiled(psi.f):
        inside = (psi.c, psi.f)
    user = isinstance(psi, Elementwise) and inside is not None
    sweep = getattr(USER_SWEEPS if user else SWEEPS, name)

    def step(z: Vector) -> tuple[Vector, float]:
        out = np.empty(z.size)
        squares = sweep(*before, psi.value(z) if inside is None else inside, *after, z, out)
        return out, float(np.sqrt(squares))

    if user:
        # the sweep calls the user's compiled function, which may raise
        return lambda z: raising_map_error(lambda: step(z), "psi.f")
    nnz = problem.A.nnz
    if reach is None or not isinstance(psi, Constant) or reach * (nnz / problem.n + 4) > _NEAR:
        return step
    two = partial(getattr(SWEEPS, f"two_{name}"), *before, inside, after[0], reach)
    return _looking_ahead(step, partial(_passes, two, reach, cores() if nnz >= _THREADS_FROM else 1))


def _looking_ahead(single: Step, several: Callable[[Vector], list[tuple[Vector, float]]]) -> Step:
    """`several` sweeps at once, handed out one by one; once a z comes that is not the last answer, `single` ones."""
    last: Vector | None = None
    ahead: Iterator[tuple[Vector, float]] = iter(())
    alone = False

    def step(z: Vector) -> tuple[Vector, float | None]:
        nonlocal last, ahead, alone
        following = next(ahead, None)
        alone = alone or (following is not None and z is not last)
        if alone:
            return single(z)
        if following is None:
            ahead = iter(several(z))
            following = next(ahead)
        last = following[0]
        return following

    return step


def _passes(two: Callable[..., tuple[float, float]], reach: int, threads: int, z: Vector) -> list[tuple[Vector, float]]:
    """(z⁺, Res(z)) of two sweeps in one pass over A, or of four where a second thread follows the first one.

    Every number is the same as that of one sweep after the other.
    """
    n, iterates = z.size, [z, *(np.empty(z.size) for _ in range(4 if threads > 1 else 2))]
    squares = np.zeros(len(iterates) - 1)
    # the second sweep of a pass is `reach` rows behind the first, and the thread behind as much again
    ends = [*range(_CHUNK, n, _CHUNK), n + reach]

    def part(first: int, low: int, high: int) -> None:
        squares[first : first + 2] += two(*iterates[first : first + 3], low, high)

    if threads == 1:
        for low, high in pairwise([0, *ends]):
            part(0, low, high)
    else:
        with ThreadPoolExecutor(1) as behind:
            low = done = 0
            for high in ends:
                ready = max(low - 2 * reach, 0)
                following = behind.submit(part, 2, done, ready)
                part(0, low, high)
                following.result()
                low, done = high, ready
            part(2, done, n + reach)
    return list(zip(iterates[1:], np.sqrt(squares).tolist(), strict=True))
