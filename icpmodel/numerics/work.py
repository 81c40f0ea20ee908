"""What work costs, in nanoseconds: one table of measured constants, and a count of what was done.

The count stands for a clock in whatever decides, so that the same problem takes the same way on every machine, with any
number of threads and under any load. Whoever does work says so with `add`.
"""

from __future__ import annotations

import threading
from typing import NamedTuple


class Costs(NamedTuple):
    """Nanoseconds per unit, one thread."""

    #: a step in Python around one compiled loop or one SciPy product, whatever its size
    call: float = 5_000.0
    #: A @ z, per stored entry and per row
    entry: float = 0.8
    row: float = 2.0
    #: a compiled sweep with the residual, per entry and per row
    sweep_entry: float = 1.0
    sweep_row: float = 6.0
    #: an operation on vectors, per unknown
    vector: float = 0.7
    #: a sparse factorisation: per entry of the factors, per multiplication; and a solve with them, per entry
    factor_entry: float = 25.0
    factor_flop: float = 0.35
    solve_entry: float = 2.0
    #: an entry that minimum degree looks at, and the graph that it begins with, per entry
    look: float = 12.0
    #: dense factorisations, per multiplication, and a pivot, per entry of the dictionary
    dense_flop: float = 0.1
    pivot_entry: float = 0.7
    #: an algebraic multigrid hierarchy, per entry of A, and a V-cycle on it
    hierarchy_entry: float = 250.0
    cycle_entry: float = 8.0


COSTS = Costs()
_counted = threading.local()


def add(nanoseconds: float) -> None:
    """Count work."""
    _counted.total = done() + nanoseconds


def done() -> float:
    """All work that this thread has counted, in nanoseconds; differences tell what something cost."""
    return float(getattr(_counted, "total", 0.0))


def product(n: int, nnz: int) -> float:
    """What A @ z costs: the unit of all estimates."""
    return COSTS.call + COSTS.row * n + COSTS.entry * nnz


def sweep(n: int, nnz: int) -> float:
    """What one compiled sweep costs."""
    return COSTS.call + COSTS.sweep_row * n + COSTS.sweep_entry * nnz
