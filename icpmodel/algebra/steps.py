"""The sweeps over A as steps: one in a pass, two in one, four where a second thread follows."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np

from ..numerics import work
from ..numerics.arrays import Vector, bandwidths, read_only
from ..numerics.threads import CHUNK, one_behind_the_other, threads_for
from ..problem.between import values
from ..problem.data import ProblemData

#: entries that stay in a core's cache while a second sweep follows the first
_NEAR = 50_000
#: sweeps over so few entries cost less than to call them, so that several are made at once
_FEW = 20_000
#: so many sweeps are made at once at the most
AT_ONCE = 4
#: z⁺, and Res_D(z) or None where it does not fall out of the step
Stepped = tuple[Vector, float | None]
#: z ↦ (z⁺, Res_D(z))
Step = Callable[[Vector], Stepped]
#: (z, count) ↦ so many steps in a row, or what costs that
Several = Callable[[Vector, int], list[Stepped]]


class Sweep:
    """A step that can be made several times in a row for less: `several(z, count)` are so many, or what costs that."""

    def __init__(self, single: Step, several: Several) -> None:
        self.single, self.several = single, several

    def __call__(self, z: Vector) -> Stepped:
        return self.single(z)


def in_a_row(step: Step, z: Vector, count: float) -> list[Stepped]:
    """From `z`, one step or as many as are made at once for `count`, each from where the one before it arrives."""
    several = max(int(min(count, AT_ONCE)), 1)
    return step.several(z, several) if isinstance(step, Sweep) and several > 1 else [step(z)]


def compiled_step(
    problem: ProblemData,
    name: str,
    before: tuple[Any, ...],
    after: tuple[Any, ...],
    reach: int | None = None,
    *,
    few: int = _FEW,
    threads: int | None = None,
    chunk: int = CHUNK,
) -> Step:
    """One compiled sweep as a step: `before` and `after` are the kernel's arguments around ψ.

    A ψ that `kernel_data` knows is evaluated inside the sweep; any other is called once for it. A
    forward sweep "in_order" may make some more in the same call, for a large A in the same pass
    over it. `reach` is the upper bandwidth of A, None where the sweep cannot do that. One call
    sweeps a `few` entries. More are swept by so many `threads`, which keep a `chunk` of rows
    between them.
    """
    from .kernels.sweeps import SWEEPS

    psi, inside = problem.psi, read_only(problem.psi.kernel_data())
    before, after = read_only(before), read_only(after)
    sweep, price = getattr(SWEEPS, name), work.sweep(problem.n, problem.facts.entries)

    def step(z: Vector) -> tuple[Vector, float]:
        work.add(price)
        out = np.empty(z.size)
        squares = sweep(*before, read_only(values(psi, z)) if inside is None else inside, *after, z, out)
        return out, float(np.sqrt(squares))

    nnz = problem.nnz
    if reach is None or inside is None:
        return step
    for one in (psi, psi.upper):  # the second sweep asks for what psi takes from the first too
        if one is not None and one.linear is not None and one.linear[0].nnz:
            G = one.linear[0]
            reach, nnz = max(reach, bandwidths(G)[1]), nnz + G.nnz
    if problem.nnz <= few:
        some = partial(SWEEPS.some_in_order, *before, inside, *after, reach)
        return Sweep(step, _counted(partial(_in_one_call, some), price))
    if reach * (nnz / problem.n + 4) > _NEAR:
        return step
    two = partial(SWEEPS.two_in_order, *before, inside, after[0])
    several = partial(_in_one_pass, two, reach, min(threads or threads_for(nnz), 2), chunk)
    return Sweep(step, _counted(several, price))


def projected_sweep(problem: ProblemData, omega: float = 1.0, forward: bool = True) -> Step:
    """A sweep of projected SOR, from the first row to the last or from the last to the first."""
    A, rows = problem.A, problem.matrix.rows
    matrix = (A.indptr, A.indices, A.data, rows.diag, problem.matrix.row_weights, problem.q)
    return compiled_step(problem, "in_order", matrix, ((omega,), forward), rows.above if forward else None)


def _counted(several: Several, price: float) -> Several:
    """`several`, each of which is counted as work of this `price`, whatever threads make it."""

    def made(z: Vector, count: int) -> list[Stepped]:
        steps = several(z, count)
        work.add(price * len(steps))
        return steps

    return made


def _in_one_call(some: Callable[..., None], z: Vector, count: int) -> list[Stepped]:
    Z, squares = np.empty((count + 1, z.size)), np.empty(count)
    Z[0] = z
    some(Z, squares)
    return list(zip(Z[1:], np.sqrt(squares).tolist(), strict=True))


def _in_one_pass(
    two: Callable[..., tuple[float, float]], reach: int, threads: int, chunk: int, z: Vector, count: int
) -> list[Stepped]:
    """Two sweeps in one pass over A, or four, for `count` > 3, in two, the second by another thread where there is one.

    Every number is the same as that of one sweep after the other, and so is how many there are with any `threads`.
    """
    sweeps = 4 if count > 3 else 2
    passes = max(threads, sweeps // 2)
    each = sweeps // passes
    iterates, squares = [z, *(np.empty(z.size) for _ in range(sweeps))], np.zeros((passes, 2))
    # the second of two sweeps is `reach` rows behind the first; n rows behind it is never made
    lag, rows = (reach, z.size + reach) if each == 2 else (z.size, z.size)

    def part(turn: int, low: int, high: int) -> None:
        start = turn * each
        squares[turn] += two(lag, iterates[start], iterates[start + 1], iterates[start + each], low, high)

    if passes == 1:
        part(0, 0, rows)
    else:
        one_behind_the_other(rows, threads, partial(part, 0), partial(part, 1), each * reach, chunk=chunk)
    return list(zip(iterates[1:], np.sqrt(squares[:, :each]).ravel().tolist(), strict=True))
