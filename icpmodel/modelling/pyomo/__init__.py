"""Pyomo models: importing this room makes `SolverFactory("icpmodel")` known to Pyomo."""

from .models import read_pyomo
from .solver_interface import PyomoSolver

__all__ = ["PyomoSolver", "read_pyomo"]
