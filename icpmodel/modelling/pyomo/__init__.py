"""Pyomo models: importing this room makes `SolverFactory("icpmodel")` known to Pyomo."""

from .models import PyomoReading, read_pyomo
from .solver_interface import PyomoSolver

__all__ = ["PyomoReading", "PyomoSolver", "read_pyomo"]
