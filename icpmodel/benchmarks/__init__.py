"""Measurements behind the numbers of `docs/benchmarks.md`: the subcommands of `icpmodel benchmark` print them."""

from .adjoints import derivative_cost
from .benchmark import benchmark, faster_peers
from .beyond.rank_runs import distributed_cost
from .beyond.rank_tables import distributed_counts, distributed_model
from .certainty import bound_ratios, certificate_cost
from .constants import constants
from .costs import dominant_cost, impulse_cost, reading_cost, small_cost, solve_cost
from .families.gallery import drawn, family_names, gallery
from .hindsight import choice, summary_of
from .iterations import grid_order, sweep_cost, tuned_and_automatic
from .members import member_runs
from .memory import memory
from .programs import program_cost

__all__ = [
    "benchmark",
    "bound_ratios",
    "certificate_cost",
    "choice",
    "constants",
    "derivative_cost",
    "distributed_cost",
    "distributed_counts",
    "distributed_model",
    "dominant_cost",
    "drawn",
    "family_names",
    "faster_peers",
    "gallery",
    "grid_order",
    "impulse_cost",
    "member_runs",
    "memory",
    "program_cost",
    "reading_cost",
    "small_cost",
    "solve_cost",
    "summary_of",
    "sweep_cost",
    "tuned_and_automatic",
]
