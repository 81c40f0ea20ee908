"""Solving: the run, the goal, the choice of methods, the solution."""

from .driver import solve

__all__ = ["solve"]
