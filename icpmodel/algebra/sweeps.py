"""The sweeps over A as steps: one in a pass, two in one, four where a second thread follows, or all in one call."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import partial
from typing import Any

import numpy as np

from ..numerics.arrays import Vector, bandwidths
from ..numerics.threads import one_behind_the_other, threads_for
from ..problem.affine import Affine
from ..problem.data import ProblemData
from ..problem.elementwise import Elementwise
from ..problem.user_code import is_compiled, raising_map_error

#: entries that stay in a core's cache while a second sweep follows the first
_NEAR = 50_000
#: sweeps over so few entries cost less than to call them, so that so many are made at once
_FEW, _SOME = 20_000, 4
#: z ↦ (z⁺, Res(z) or None where it does not fall out of the step)
Step = Callable[[Vector], tuple[Vector, float | None]]
#: see `watched_sweeps`
Watched = Callable[[Vector, float, float, int, float], tuple[Vector, float, bool]]


def compiled_step(
    problem: ProblemData,
    name: str,
    before: tuple[Any, ...],
    after: tuple[Any, ...],
    reach: int | None = None,
    wanted: Callable[[], float] | None = None,
) -> Step:
    """One compiled sweep as a step: `before` and `after` are the kernel's arguments around ψ.

    ψ = constant, affine and compiled elementwise maps are evaluated inside the sweep; any other is called once for it.
    A sweep "in_order" that goes forward may make some more in the same call, for a large A in the same pass over it:
    they are the next answers, if the step is asked for its own last one. `reach` is how far A reaches above its
    diagonal, None where the sweep cannot do that; `wanted` says how many sweeps are thought to be asked for still.
    """
    from ..numerics.kernels.sweeps import SWEEPS, USER_SWEEPS

    psi, inside = problem.psi, _inside(problem)
    if isinstance(psi, Elementwise) and is_compiled(psi.f):
        return _step_with(getattr(USER_SWEEPS, name), psi, before, after)
    sweep = getattr(SWEEPS, name)

    def step(z: Vector) -> tuple[Vector, float]:
        out = np.empty(z.size)
        squares = sweep(*before, psi.value(z) if inside is None else inside, *after, z, out)
        return out, float(np.sqrt(squares))

    nnz = problem.A.nnz
    if reach is None or inside is None:
        return step
    if nnz <= _FEW:
        return _looking_ahead(step, partial(_in_turn, partial(SWEEPS.some_in_order, *before, inside, *after)), wanted)
    if isinstance(psi, Affine):  # the second sweep asks for what psi takes from the first as well
        reach, nnz = max(reach, bandwidths(psi.G)[1]), nnz + psi.G.nnz
    if reach * (nnz / problem.n + 4) > _NEAR:
        return step
    two = partial(SWEEPS.two_in_order, *before, inside, after[0])
    return _looking_ahead(step, partial(_passes, two, reach, nnz), wanted)


def watched_sweeps(problem: ProblemData, before: tuple[Any, ...], after: tuple[Any, ...]) -> Watched | None:
    """Sweeps that one compiled call makes and watches: (z, first, share, look, most) ↦ (z⁺, Res(z⁺), whether quick).

    They end with the first z⁺ of at most `share` times the residual `first` (0: that of z), or where a look finds that
    more than `most` would follow, and then they are not quick. They are looked at after `look` sweeps, and whenever
    their number has doubled. None where ψ is a function: the call would have to be compiled for each. `before` and
    `after` as in `compiled_step`.
    """
    from ..numerics.kernels.sweeps import SWEEPS

    inside = _inside(problem)
    if inside is None:
        return None

    def run(z: Vector, first: float, share: float, look: int, most: float) -> tuple[Vector, float, bool]:
        out = np.empty(z.size)
        numbers = (float(first), float(share), look, float(most))
        squares, quick = SWEEPS.watched_in_order(*before, inside, *after, *numbers, z, out)
        return out, float(np.sqrt(squares)), quick

    return run


def _inside(problem: ProblemData) -> Any:
    """ψ as the arrays that the sweeps take; None where it has to be called."""
    data = problem.psi.kernel_data()
    return None if isinstance(data, tuple) and len(data) == 2 else data


def _step_with(kernel: Any, psi: Elementwise, before: tuple[Any, ...], after: tuple[Any, ...]) -> Step:
    """`compiled_step` where the sweep calls the user's compiled function, which may raise."""
    from ..numerics.kernels.user import sweep_with

    sweep = sweep_with(kernel, psi.f)

    def step(z: Vector) -> tuple[Vector, float]:
        out = np.empty(z.size)
        squares = raising_map_error(lambda: sweep(before, psi.c, after, z, out), "psi.f")
        return out, float(np.sqrt(squares))

    return step


def _looking_ahead(
    single: Step, several: Callable[[Vector, int], list[tuple[Vector, float]]], wanted: Callable[[], float] | None
) -> Step:
    """`several` sweeps at once, handed out one by one as long as the z that comes is the last answer.

    With another z a new run of sweeps begins, which is thought to be as long as the last one, where nobody says how
    many are `wanted`.
    """
    last: Vector | None = None
    ahead: Iterator[tuple[Vector, float | None]] = iter(())
    run, used = _SOME, 0

    def step(z: Vector) -> tuple[Vector, float | None]:
        nonlocal last, ahead, run, used
        if z is not last:
            run, used, ahead = used or run, 0, iter(())
        following = next(ahead, None)
        if following is None:
            left = wanted() if wanted else run - used if used < run else _SOME
            count = max(int(min(left, _SOME)), 1)
            ahead = iter(several(z, count) if count > 1 else [single(z)])
            following = next(ahead)
        used += 1
        last = following[0]
        return following

    return step


def _in_turn(some: Callable[..., None], z: Vector, count: int) -> list[tuple[Vector, float]]:
    """(z⁺, Res(z)) of so many sweeps in one call."""
    Z, squares = np.empty((count + 1, z.size)), np.empty(count)
    Z[0] = z
    some(Z, squares)
    return list(zip(Z[1:], np.sqrt(squares).tolist(), strict=True))


def _passes(
    two: Callable[..., tuple[float, float]], reach: int, nnz: int, z: Vector, count: int
) -> list[tuple[Vector, float]]:
    """(z⁺, Res(z)) of two sweeps in one pass over A, or of four, for `count` > 2, where a second thread follows.

    Every number is the same as that of one sweep after the other.
    """
    threads = min(threads_for(nnz), 2)
    sweeps = 4 if count > 2 and threads > 1 else 2
    each = sweeps // threads
    iterates, squares = [z, *(np.empty(z.size) for _ in range(sweeps))], np.zeros((threads, 2))
    # the second of two sweeps is `reach` rows behind the first; n rows behind it is never made
    lag, rows = (reach, z.size + reach) if each == 2 else (z.size, z.size)

    def part(thread: int, low: int, high: int) -> None:
        start = thread * each
        squares[thread] += two(lag, iterates[start], iterates[start + 1], iterates[start + each], low, high)

    if threads == 1:
        part(0, 0, rows)
    else:
        one_behind_the_other(rows, nnz, partial(part, 0), partial(part, 1), each * reach)
    return list(zip(iterates[1:], np.sqrt(squares[:, :each]).ravel().tolist(), strict=True))
