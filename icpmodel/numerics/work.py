"""The cost of work in nanoseconds: a table of measured constants, a count of the work done, and limits of it.

Decisions depend on this count, not on a clock. So the same problem is solved in the same way on every machine, with any
number of threads and under any load. Code that does work reports it by `count`.

Limits are checked in advance: `work_limit` sets the time and the memory of a block, and `check_budget` raises where a
step is expected to need more than is left. Loops over small pieces check between pieces, large steps before they begin.
"""

from __future__ import annotations

import math
import os
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from struct import calcsize
from typing import NamedTuple

from ..errors import OutOfMemory, OutOfTime


class Costs(NamedTuple):
    """Nanoseconds per unit, one thread.

    Medians for n = 100 … 10⁶ on two cores of an AMD EPYC (Zen 4), 2.6 GHz, under other load, with
    NumPy 2.4 and SciPy 1.17, 2026-11-22. They are fitted to the times of tasks; `python
    tests/benchmarks constants` repeats ten of them. Runs differed by up to a half. The costs of
    sparse factorisations are from 2026-11-25, with graphs among the tasks, in which multiplications
    count.
    """

    #: a step in Python around one compiled loop or one SciPy product, whatever its size
    call: float = 3_000.0
    #: an iterate in Python: its residual, the tests, and the choice of the method that goes on
    iterate: float = 5_000.0
    #: a Newton step in Python: the active set, slices of sparse matrices, a solver; per step, row and entry of A
    newton: float = 400_000.0
    newton_row: float = 340.0
    newton_entry: float = 2.0
    #: the equations of that step where they combine A and ψ′: per step, and per entry of both
    mixed: float = 550_000.0
    mixed_entry: float = 12.0
    #: a sparse matrix made of others, entry by entry; per entry: eight times what a product costs
    assembly: float = 60_000.0
    assembly_entry: float = 8.0
    #: A @ z, per stored entry and per row
    entry: float = 0.6
    row: float = 1.2
    #: a compiled sweep with the residual, per entry and per row
    sweep_entry: float = 0.6
    sweep_row: float = 3.3
    #: a product or a sweep with a full matrix, per entry, at n = 1500; a third of it where all fits into a cache, twice
    #: where nothing does
    full_entry: float = 0.2
    #: an operation on vectors, per unknown
    vector: float = 0.3
    #: a sparse factorisation, its ordering included: per row, per entry of the factors, per multiplication; and a solve
    #: with them, per entry
    factor_row: float = 750.0
    factor_entry: float = 28.0
    factor_flop: float = 0.1
    solve_entry: float = 0.8
    #: a symmetric one, by QDLDL: the same, with the entries and multiplications of the equivalent L + U
    symmetric_row: float = 400.0
    symmetric_entry: float = 4.0
    symmetric_flop: float = 0.3
    #: a band factorised, whatever its size, per entry of its factors and per multiplication
    band: float = 9_500.0
    band_entry: float = 4.0
    band_flop: float = 0.02
    #: a dense factorisation, per entry and per multiplication, and a pivot, per entry of the dictionary
    dense_entry: float = 6.0
    dense_flop: float = 0.045
    pivot_entry: float = 0.5
    #: an algebraic multigrid hierarchy, in all and per entry of A; a V-cycle on it, one compiled loop a level; and a
    #: step of a Krylov method with a cycle by PyAMG, several loops a level
    hierarchy: float = 1_200_000.0
    hierarchy_entry: float = 170.0
    cycle: float = 8_000.0
    cycle_entry: float = 7.0
    krylov: float = 130_000.0
    krylov_entry: float = 35.0
    #: another Python process that loads SciPy, from its start to its end
    process: float = 300_000_000.0


class _Counter(threading.local):
    total = 0
    budget: _Budget | None = None


COSTS = Costs()
#: bytes of a stored entry of a sparse matrix: a number and its position
ENTRY_BYTES = float(calcsize("di"))
_counted = _Counter()


def count(nanoseconds: float) -> None:
    """Count work, in whole nanoseconds, so that differences do not depend on earlier counts."""
    _counted.total += int(nanoseconds)


def counter() -> float:
    """All work that this thread has counted, in nanoseconds. A difference is the cost of the work in between."""
    return _counted.total


def product_cost(n: int, nnz: int) -> float:
    """The cost of A @ z, the unit of all estimates."""
    return COSTS.call + COSTS.row * n + COSTS.entry * entries(n, nnz)


def entries(n: int, nnz: int) -> float:
    """The equivalent number of sparse entries: a full matrix is read in order, which costs less."""
    return nnz if nnz < n * n else COSTS.full_entry / COSTS.entry * nnz


def charge_matrices(nnz: int, matrices: int = 1) -> None:
    """Charge the cost of `matrices` sparse matrices made of others, such as sums; raises as `check_budget` does."""
    charge(matrices * (COSTS.assembly + COSTS.assembly_entry * nnz))


def sweep_cost(n: int, nnz: int) -> float:
    """The cost of one compiled sweep."""
    return COSTS.call + COSTS.sweep_row * n + COSTS.sweep_entry * entries(n, nnz)


def newton_cost(n: int, nnz: int, mixed: bool) -> float:
    """The cost of a Newton step without the solution of its equations; `mixed`: these combine A and ψ′."""
    cost = COSTS.newton + COSTS.newton_row * n + COSTS.newton_entry * nnz
    return cost + (COSTS.mixed + COSTS.mixed_entry * nnz if mixed else 0.0)


#: seconds added to the clock and the count, so that the pace of this machine is near 1 before it is known
_PACE_OFFSET = 0.1
#: a piece of a long loop between two readings of the clock, in nanoseconds
_PIECE_NANOSECONDS = 2e7
#: for fewer bytes the free memory is not read: reading it takes as long as solving a small problem
_NEGLIGIBLE_BYTES = 2e7


class _Budget(NamedTuple):
    """The limits of a block.

    It began at `start_time` by the clock, at `counted` by the count and with `initial_memory` bytes. It ends at `end`
    by the clock, and at `most` by the count; `memory` limits the bytes beyond `initial_memory`.
    """

    start_time: float
    counted: float
    end: float
    initial_memory: float = 0.0
    memory: float = math.inf
    most: float = math.inf

    def memory_left(self) -> float:
        """The bytes that the limit of memory leaves."""
        if self.memory == math.inf:
            return math.inf
        return max(self.memory - max(_used_memory() - self.initial_memory, 0.0), 0.0)


class _Compiler(threading.local):
    """The seconds that a thread has spent on compiling code, waiting for the compiler, or loading code from the disk.

    Each thread has a clock of its own, as others go on meanwhile.
    """

    _busy = 0
    _since = 0.0
    _total = 0.0

    def begin(self) -> None:
        if self._busy == 0:
            self._since = time.perf_counter()
        self._busy += 1

    def end(self) -> None:
        self._busy -= 1
        if self._busy == 0:
            self._total += time.perf_counter() - self._since

    @contextmanager
    def busy(self) -> Iterator[None]:
        """Count the time of a block that loads code."""
        self.begin()
        try:
            yield
        finally:
            self.end()

    def clock(self) -> float:
        return (self._since if self._busy else time.perf_counter()) - self._total


#: the clock of compilation, which the listener to numba starts and stops
COMPILER = _Compiler()


def clock() -> float:
    """The time in seconds, without that of compilation; only differences within one thread have a meaning."""
    return COMPILER.clock()


@contextmanager
def work_limit(
    seconds: float = math.inf, memory: float = math.inf, nanoseconds: float = math.inf, start_time: float | None = None
) -> Iterator[None]:
    """Limit the work of this thread in a block: `check_budget` raises beyond it. Outer limits hold as well.

    Parameters
    ----------
    seconds : float
        By the clock, from `start_time` on.
    memory : float
        Bytes beyond what the process holds now.
    nanoseconds : float
        Counted work, a limit that is the same on every machine.
    start_time : float, optional
        Time of `clock()` from which `seconds` count; now by default.
    """
    before = _counted.budget
    pace_start = clock()
    counted = counter()
    end = (pace_start if start_time is None else start_time) + seconds
    most = counted + nanoseconds
    if before is not None:
        end = min(end, before.end)
        most = min(most, before.most)
        if seconds == math.inf:  # the pace of the machine is known already
            pace_start = before.start_time
            counted = before.counted
        memory = min(memory, before.memory_left())
    initial_memory = _used_memory() if memory < math.inf else 0.0
    with _replaced(_Budget(pace_start, counted, end, initial_memory, memory, most)):
        yield


def unlimited() -> AbstractContextManager[None]:
    """Lift the limits of this thread in a block, for work that an answer needs in any case."""
    return _replaced(None)


@contextmanager
def _replaced(budget: _Budget | None) -> Iterator[None]:
    before = _counted.budget
    _counted.budget = budget
    try:
        yield
    finally:
        _counted.budget = before


def check_budget(nanoseconds: float = 0.0, memory: float = 0.0) -> None:
    """Raise OutOfTime or OutOfMemory if a step needs more counted nanoseconds, or bytes, than are left."""
    if not memory_suffices(memory):
        raise OutOfMemory(f"a step needs about {1e-6 * memory:.3g} MB, which is more than the memory limit leaves")
    left = nanoseconds_left()
    if not left > 0.0:
        raise OutOfTime("no time is left")
    if not nanoseconds <= left:
        raise OutOfTime(f"a step of about {1e-9 * nanoseconds:.2g} s does not fit into the time that is left")


def charge(nanoseconds: float, memory: float = 0.0) -> None:
    """Check that a step fits into the limits, and count it; raises as `check_budget` does."""
    check_budget(nanoseconds, memory)
    count(nanoseconds)


def nanoseconds_left() -> float:
    """The work that the limits leave, in nanoseconds of the table of costs; inf where there is no limit.

    The time left is divided by the pace of this machine: the time by the clock over the work counted, at least 1.
    """
    budget = _counted.budget
    if budget is None:
        return math.inf
    now = clock()
    pace = max((now - budget.start_time + _PACE_OFFSET) / (1e-9 * (counter() - budget.counted) + _PACE_OFFSET), 1.0)
    return min(1e9 * (budget.end - now) / pace, budget.most - counter())


def seconds_left() -> float:
    """The seconds left by the clock, at least 0; inf where there is no limit."""
    budget = _counted.budget
    return math.inf if budget is None else max(budget.end - clock(), 0.0)


def inner_time_limit() -> float | None:
    """The `time_limit` of a solve inside another one: `seconds_left`, or None where there is no limit."""
    seconds = seconds_left()
    return seconds if seconds < math.inf else None


def steps_per_piece(nanoseconds: float) -> int:
    """How many steps of this cost, at least one, make a piece of a long loop.

    Between its pieces the loop calls `check_budget`, and may be interrupted.
    """
    return max(int(_PIECE_NANOSECONDS / nanoseconds), 1)


def memory_suffices(memory: float) -> bool:
    """Whether an allocation of `memory` bytes is within the limits and, unless it is small, the free memory."""
    budget = _counted.budget or _Budget(0.0, 0.0, math.inf)
    if memory <= min(budget.memory, _NEGLIGIBLE_BYTES):
        return True
    return memory <= min(budget.memory_left(), _system_memory())


def _system_memory() -> float:
    """The bytes of free memory of the system, or half of all memory where it does not say."""
    try:
        with open("/proc/meminfo", encoding="ascii") as lines:
            return 1024.0 * next(int(line.split()[1]) for line in lines if line.startswith("MemAvailable"))
    except (OSError, StopIteration, ValueError):
        return 0.5 * os.sysconf("SC_PAGE_SIZE") * os.sysconf("SC_PHYS_PAGES")


def _used_memory() -> float:
    """The bytes that this process holds, 0 where the system does not say."""
    try:
        with open("/proc/self/statm", encoding="ascii") as line:
            return float(line.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")
    except (OSError, ValueError):
        return 0.0
