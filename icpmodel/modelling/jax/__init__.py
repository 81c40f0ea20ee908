"""JAX: the answer of a problem as a differentiable function of its arrays."""

from .solution_function import SolutionFunction, solution_of

__all__ = ["SolutionFunction", "solution_of"]
