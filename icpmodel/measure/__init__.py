"""Measurements behind the numbers of the README: the subcommands of `icpmodel measure` print them."""

from .certainty import bound_ratios, certificate_cost
from .honesty import false_success
from .limit import linear_solve, solve_cost
from .planes import Axis, Plane
from .stability_map import StabilityMap, stability
from .tables import Table, grid_order, sweep_cost, sweep_counts

__all__ = [
    "Axis",
    "Plane",
    "StabilityMap",
    "Table",
    "bound_ratios",
    "certificate_cost",
    "false_success",
    "grid_order",
    "linear_solve",
    "solve_cost",
    "stability",
    "sweep_cost",
    "sweep_counts",
]
