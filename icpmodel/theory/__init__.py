"""What is certain: matrix classes, convergence theorems and predicted rates before a solve, error bounds after it."""

from .active_set import ActiveSet, active_set
from .answers import Answer
from .bounds import ErrorBound, error_bound
from .classes import MatrixClasses, classify
from .pmatrix import p_matrix
from .rates import Rate, predicted_rate
from .scaling import comparison_matrix
from .theorems import Check, check, check_all, theorems

__all__ = [
    "ActiveSet",
    "Answer",
    "Check",
    "ErrorBound",
    "MatrixClasses",
    "Rate",
    "active_set",
    "check",
    "check_all",
    "classify",
    "comparison_matrix",
    "error_bound",
    "p_matrix",
    "predicted_rate",
    "theorems",
]
