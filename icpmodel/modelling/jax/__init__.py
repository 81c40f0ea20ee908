"""JAX: the answer of a problem as a differentiable function of its arrays."""

from .nonlinear_function import nonlinear_solution_of
from .solution_function import SolutionFunction, solution_of

__all__ = ["SolutionFunction", "nonlinear_solution_of", "solution_of"]
