"""Pyomo models: importing this room makes `SolverFactory("icpmodel")` known to Pyomo."""

from .legacy_interface import pyomo_solver
from .models import read_pyomo
from .solver_interface import PyomoSolver

__all__ = ["PyomoSolver", "pyomo_solver", "read_pyomo"]
