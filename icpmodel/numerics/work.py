"""What work costs, in nanoseconds: one table of measured constants, and a count of what was done.

The count stands for a clock in whatever decides, so that the same problem takes the same way on every machine, with any
number of threads and under any load. Whoever does work says so with `add`.
"""

from __future__ import annotations

import threading
from typing import NamedTuple


class Costs(NamedTuple):
    """Nanoseconds per unit, one thread.

    Medians of `icpmodel benchmark constants` for n = 100 … 10⁶ on two cores of an AMD EPYC (Zen 4), 2.6 GHz, which had
    other work to do, with NumPy 2.4 and SciPy 1.17, 2026-11-22; runs differed by up to a half.
    """

    #: a step in Python around one compiled loop or one SciPy product, whatever its size
    call: float = 3_000.0
    #: an iterate in Python: its residual, tests, and who has the next turn
    iterate: float = 5_000.0
    #: a Newton step in Python: the active set, slices of sparse matrices, a solver; per step and per entry of A
    newton: float = 400_000.0
    newton_entry: float = 60.0
    #: A @ z, per stored entry and per row
    entry: float = 0.6
    row: float = 1.2
    #: a compiled sweep with the residual, per entry and per row
    sweep_entry: float = 0.6
    sweep_row: float = 3.3
    #: an operation on vectors, per unknown
    vector: float = 0.3
    #: a sparse factorisation, its ordering included: per row, per entry of the factors, per multiplication; and a solve
    #: with them, per entry
    factor_row: float = 750.0
    factor_entry: float = 26.0
    factor_flop: float = 0.25
    solve_entry: float = 1.3
    #: an entry that minimum degree looks at, and the graph that it begins with, per entry
    look: float = 13.5
    #: a band factorised and a system solved with it, per entry of the band
    band_entry: float = 20.0
    #: a dense factorisation, per entry and per multiplication, and a pivot, per entry of the dictionary
    dense_entry: float = 6.0
    dense_flop: float = 0.045
    pivot_entry: float = 0.5
    #: an algebraic multigrid hierarchy, whatever its size and per entry of A, a V-cycle on it in one compiled loop a
    #: level, and a step of a Krylov method with a cycle by PyAMG, which makes several loops of each level
    hierarchy: float = 1_200_000.0
    hierarchy_entry: float = 170.0
    cycle: float = 8_000.0
    cycle_entry: float = 7.0
    krylov: float = 130_000.0
    krylov_entry: float = 35.0


class Fill(NamedTuple):
    """The `entries` of L + U of so many `rows`, and the `flops` (multiplications) that make them.

    Both are rough unless they were `seen` to the end.
    """

    rows: int
    entries: float
    flops: float
    seen: bool


class _Counted(threading.local):
    total = 0


COSTS = Costs()
_counted = _Counted()


def add(nanoseconds: float) -> None:
    """Count work, in whole nanoseconds: what something cost then does not hang on what was counted before."""
    _counted.total += int(nanoseconds)


def done() -> float:
    """All work that this thread has counted, in nanoseconds; differences tell what something cost."""
    return _counted.total


def product(n: int, nnz: int) -> float:
    """What A @ z costs: the unit of all estimates."""
    return COSTS.call + COSTS.row * n + COSTS.entry * nnz


def sweep(n: int, nnz: int) -> float:
    """What one compiled sweep costs."""
    return COSTS.call + COSTS.sweep_row * n + COSTS.sweep_entry * nnz


def factor_cost(fill: Fill) -> float:
    """What a sparse factorisation with this fill costs, its ordering included."""
    return (
        COSTS.call + COSTS.factor_row * fill.rows + COSTS.factor_entry * fill.entries + COSTS.factor_flop * fill.flops
    )


def least_factor_cost(n: int, nnz: int) -> float:
    """What a sparse factorisation without any fill costs."""
    return factor_cost(Fill(n, nnz, 0.0, True))


def solve_cost(fill: Fill) -> float:
    """What a solve with the factors costs."""
    return COSTS.call + COSTS.solve_entry * fill.entries


def dense_cost(n: int) -> float:
    """What a dense LU factorisation costs, from a sparse matrix."""
    return COSTS.call + COSTS.dense_entry * n**2 + COSTS.dense_flop * n**3 / 3.0


def krylov_cost(nnz: int, steps: int, hierarchy: bool = True) -> float:
    """What so many steps of a Krylov method cost that multigrid preconditions, with its hierarchy or without."""
    made = COSTS.hierarchy + COSTS.hierarchy_entry * nnz if hierarchy else 0.0
    return made + steps * (COSTS.krylov + COSTS.krylov_entry * nnz)
