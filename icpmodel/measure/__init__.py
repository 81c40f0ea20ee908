"""Measurements behind the numbers of the README: `icpmodel measure sweep | counts | order` prints them."""

from .tables import Table, grid_order, sweep_cost, sweep_counts

__all__ = ["Table", "grid_order", "sweep_cost", "sweep_counts"]
