"""What one solve on ranks sends, reduces and works through, counted by PETSc's log, and what its parts cost.

Seconds are the processor's, whatever else the machine does: a rank that waits for another one has it look out for
messages all the time.
"""

from __future__ import annotations

import time
from collections import Counter
from collections.abc import Callable
from functools import partial
from typing import Any

import numpy as np
import scipy.sparse as sp

from ...algebra.looks import SWEEPS
from ...distributed import DistributedICP, by_rows, solve
from ...distributed.distributed_levels import DistributedLevels
from ...distributed.distributed_matrix import DistributedMatrix, from_rows
from ...distributed.newton_on_ranks import LookOnRanks
from ...distributed.ranks import largest, petsc, world

#: PETSc's events that send, and those that reduce
_SENDS, _REDUCES = ("VecScatterBegin",), ("VecDot", "VecTDot", "VecMDot", "VecNorm", "PCSetUp", "MatAssemblyEnd")
#: a part is timed so often, and the least counts: other work on the machine only adds
_TIMES = 3
#: ping-pong: so many times with so many bytes, of which the first is a latency and the second a bandwidth
_PINGS, _SHORT, _LONG = 100, 8, 1 << 20
#: strips for `searched`: lines of a rank, and their lengths
_LINES, _LENGTHS = 4, (100, 4000, 8000)


def counted(scene: Any) -> dict[str, Any]:
    """All that a model needs of the problem `scene` on these ranks: the shapes of the levels, what each part of a solve
    sends, reduces and takes, how often it is done, and what messages cost here. Collective."""
    PETSc = petsc()
    PETSc.Log.begin()
    comm, problem = world(), by_rows(scene)
    solution, seconds = _timed(problem)
    levels = solution.levels
    if levels is None or len(levels.levels) == 1:
        return {"n": problem.n, "shapes": []}
    return {
        "n": problem.n,
        "shape": list(getattr(scene, "shape", (problem.n,))),
        "ranks": comm.size,
        "seconds": seconds,
        "done": [(*key, count) for key, count in sorted(solution.levels.done.items())],
        "shapes": [_shape(level) for level in levels.levels],
        "parts": _parts(problem, levels, solution.z),
        "product": _product(problem),
        **_messages(comm),
    }


def _timed(problem: DistributedICP) -> tuple[Any, float]:
    """The solution, and the seconds of the quicker one of two runs: the first one loads and compiles."""
    took = []
    for _ in range(2):
        problem.comm.Barrier()
        begin = time.process_time()
        solution = solve(problem, raise_on_failure=False)
        took.append(largest(problem.comm, time.process_time() - begin)[0])
    return solution, min(took)


def _shape(level: Any) -> dict[str, float]:
    """Rows and entries of one level over all ranks, and of the rank that has most of them the ghosts, what is asked of
    other ranks for a product, and the ranks that are asked."""
    mat, info = level.matrix.mat, petsc().Mat.InfoType.GLOBAL_SUM
    entries = mat.getInfo(info)["nz_used"]
    transfer = 0.0 if level.P is None else level.P.getInfo(info)["nz_used"]
    _, columns, _ = mat.getValuesCSR()
    ghosts = np.unique(columns[(columns < level.matrix.low) | (columns >= level.matrix.high)])
    asked = np.unique(np.searchsorted(mat.getOwnershipRanges(), ghosts, side="right"))
    most = largest(level.matrix.comm, float(ghosts.size), float(asked.size))
    names = ("rows", "entries", "transfer", "ghosts", "neighbours")
    return dict(zip(names, (float(level.matrix.n), entries, transfer, *most), strict=True))


def _parts(problem: DistributedICP, levels: DistributedLevels, z: Any) -> dict[str, dict[str, float]]:
    """What one step, look, round of sweeps and mask of the finest level takes and sends, at the answer z."""
    comm, free = problem.comm, np.where(LookOnRanks(problem, z, None).pattern.active, 0.0, 1.0)
    f = problem.vector(np.modf(np.sqrt(2.0) * (1.0 + np.arange(problem.low, problem.high)))[0] * free)
    look = LookOnRanks(problem, z, None)

    def steps() -> int:
        before = levels.done["steps", 0]
        levels.solved(f, 0, None, 1e-12, None)
        return levels.done["steps", 0] - before

    def cycle() -> int:
        levels.krylov_solver(0, None).getPC().apply(f, problem.vector())
        return 1

    def masked() -> int:
        levels.restrict(free, 0)
        return cycle()  # the first one does part of the set-up

    masked()
    parts = {"steps": _part(comm, steps), "cycle": _part(comm, cycle)}
    parts["looks"] = _part(comm, lambda: _once(lambda: LookOnRanks(problem, z, None)))
    parts["looks"]["reductions"] += 1  # its own, which is none of PETSc's
    parts["sweeps"] = _part(comm, lambda: _once(lambda: look.swept(SWEEPS)))
    whole = _part(comm, masked)
    parts["masks"] = {name: max(whole[name] - parts["cycle"][name], 0.0) for name in whole}
    return parts


def _once(call: Callable[[], Any]) -> int:
    call()
    return 1


def _part(comm: Any, call: Callable[[], int]) -> dict[str, float]:
    """The seconds, messages, bytes and reductions of what `call` does so often as it tells, once, of the rank that has
    the most."""
    took, sent = [], np.zeros(3)
    for _ in range(_TIMES):
        before, begin = _log(), time.process_time()
        times = max(call(), 1)
        took.append(largest(comm, time.process_time() - begin)[0] / times)
        sent = (_log() - before) / times
    messages, size, reductions = largest(comm, *sent)
    return {"seconds": min(took), "messages": messages, "bytes": size, "reductions": reductions}


def _log() -> Any:
    """(messages, bytes, reductions) so far on this rank, by PETSc's log, which counts sent and received ones."""
    found: Counter[str] = Counter()
    for kind, names in (("sent", _SENDS), ("reduced", _REDUCES)):
        for name in names:
            info = petsc().Log.Event(name).getPerfInfo()
            if kind == "sent":
                found["messages"] += info["numMessages"] / 2
                found["bytes"] += info["messageLength"] / 2
            else:
                found["reductions"] += info["numReductions"]
    return np.array([found["messages"], found["bytes"], found["reductions"]])


def _product(problem: DistributedICP) -> float:
    """Seconds of one product with A, into a vector that is there."""
    x, y = problem.vector(problem.q), problem.vector()

    def product() -> int:
        for _ in range(_TIMES):
            problem.A.mult(x, y)
        return _TIMES

    return _part(problem.comm, product)["seconds"]


def searched() -> float:
    """Seconds in which hypre compares a coarse row with one of those that other ranks ask for: it does that with all of
    them, unless it was built with tables (`--with-openmp --enable-hopscotch`). Of strips of a few lines a rank the
    shortest takes what is fixed, and one twice as long as another twice the time, but for searches, four times theirs.
    Collective."""
    petsc().Log.begin()
    comm, took, pairs = world(), [], []
    for length in _LENGTHS:
        sizes = (length, _LINES * comm.size)
        A = sp.kronsum(*(sp.diags_array([-1.0, 2.0, -1.0], offsets=[-1, 0, 1], shape=(m, m)) for m in sizes), "csr")
        matrix = DistributedMatrix(from_rows(A[_LINES * length * comm.rank :][: _LINES * length], comm))
        made = partial(_once, partial(DistributedLevels, matrix))
        took.append(min(_part(comm, made)["seconds"] for _ in range(_TIMES)))
        shapes = [_shape(level) for level in DistributedLevels(matrix).levels[1:]]
        pairs.append(sum(shape["rows"] / comm.size * shape["ghosts"] for shape in shapes))
    seconds, compared = (a[2] - 2.0 * a[1] + a[0] for a in (took, pairs))
    return max(seconds / compared, 0.0) if compared > 0 else 0.0


def _messages(comm: Any) -> dict[str, float]:
    """Seconds of a short message and of a byte of a long one here; none on one rank."""
    if comm.size == 1:
        return {"latency": 0.0, "byte": 0.0}
    short, long = (_pinged(comm, size) for size in (_SHORT, _LONG))
    return {"latency": short, "byte": max(long - short, 0.0) / _LONG}


def _pinged(comm: Any, size: int) -> float:
    """Seconds on the way of a message of so many bytes between the ranks 0 and 1."""
    there, back = np.zeros(size, np.uint8), np.zeros(size, np.uint8)

    def ping() -> int:
        for _ in range(_PINGS if comm.rank < 2 else 0):
            if comm.rank == 0:
                comm.Send(there, 1)
                comm.Recv(back, 1)
            else:
                comm.Recv(back, 0)
                comm.Send(there, 0)
        return 2 * _PINGS

    return _part(comm, ping)["seconds"]
