"""Measurements behind the numbers of the README: the subcommands of `icpmodel measure` print them."""

from .benchmark import benchmark, dispatch, faster_peers
from .certainty import bound_ratios, certificate_cost, false_success
from .constants import constants
from .costs import dominant_cost, impulse_cost, reading_cost, small_cost, solve_cost
from .iterations import grid_order, sweep_cost, sweep_counts, tuned_and_automatic
from .memory import memory

__all__ = [
    "benchmark",
    "bound_ratios",
    "certificate_cost",
    "constants",
    "dispatch",
    "dominant_cost",
    "false_success",
    "faster_peers",
    "grid_order",
    "impulse_cost",
    "memory",
    "reading_cost",
    "small_cost",
    "solve_cost",
    "sweep_cost",
    "sweep_counts",
    "tuned_and_automatic",
]
