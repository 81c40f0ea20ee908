"""Measurements behind the numbers of the README: the subcommands of `icpmodel measure` print them."""

from ..numerics.multigrid import linear_solve
from .benchmark import benchmark, dispatch, faster_peers
from .certainty import bound_ratios, certificate_cost, false_success
from .memory import memory
from .reading_cost import reading_cost
from .solves import dominant_cost, impulse_cost, small_cost, solve_cost
from .steps import grid_order, sweep_cost, sweep_counts, tuned_and_automatic

__all__ = [
    "benchmark",
    "bound_ratios",
    "certificate_cost",
    "dispatch",
    "dominant_cost",
    "false_success",
    "faster_peers",
    "grid_order",
    "impulse_cost",
    "linear_solve",
    "memory",
    "reading_cost",
    "small_cost",
    "solve_cost",
    "sweep_cost",
    "sweep_counts",
    "tuned_and_automatic",
]
