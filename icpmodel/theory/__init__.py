"""What is certain: three-valued answers about A, error bounds after a solve, definiteness decided by factorisation."""

from .active_set import ActiveSet, active_set
from .answers import Answer
from .bounds import ErrorBound, error_bound
from .definiteness import Definiteness, definiteness
from .scaling import comparison_matrix

__all__ = [
    "ActiveSet",
    "Answer",
    "Definiteness",
    "ErrorBound",
    "active_set",
    "comparison_matrix",
    "definiteness",
    "error_bound",
]
