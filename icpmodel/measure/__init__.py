"""Measurements behind the numbers of the README: the subcommands of `icpmodel measure` print them."""

from .certainty import bound_ratios, certificate_cost
from .comparison import benchmark, dispatch, faster_peers
from .dominant import dominant_cost, impulse_cost
from .honesty import false_success
from .html_report import html_report
from .limit import linear_solve, solve_cost
from .memory import memory
from .modelling import reading_cost
from .planes import Axis, Plane
from .racing import Race, race
from .sensitivity import Sensitivity, sensitivity
from .small import small_cost
from .solution_chart import solution_figure
from .stability_map import StabilityMap, stability
from .tables import Table, grid_order, sweep_cost, sweep_counts
from .tuning import tuned_and_automatic

__all__ = [
    "Axis",
    "Plane",
    "Race",
    "Sensitivity",
    "StabilityMap",
    "Table",
    "benchmark",
    "bound_ratios",
    "certificate_cost",
    "dispatch",
    "dominant_cost",
    "false_success",
    "faster_peers",
    "grid_order",
    "html_report",
    "impulse_cost",
    "linear_solve",
    "memory",
    "race",
    "reading_cost",
    "sensitivity",
    "small_cost",
    "solution_figure",
    "solve_cost",
    "stability",
    "sweep_cost",
    "sweep_counts",
    "tuned_and_automatic",
]
