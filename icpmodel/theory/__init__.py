"""What is certain: error bounds after a solve, and definiteness decided by factorisation."""

from .bounds import ErrorBound, comparison_matrix, error_bound
from .definiteness import Definiteness, definiteness

__all__ = ["Definiteness", "ErrorBound", "comparison_matrix", "definiteness", "error_bound"]
