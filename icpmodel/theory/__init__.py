"""What is certain: matrix classes, convergence theorems and predicted rates before a solve, error bounds after it."""

from .answers import Answer
from .certificates.bounds import ErrorBound, error_bound
from .certificates.certificate import ActiveSet, active_set
from .convergence.proximal_point import proximal_point
from .convergence.rates import Rate, predicted_rate
from .convergence.theorems import Check, check, check_all, theorems
from .matrices.classes import MatrixClasses, classify, p_matrix
from .matrices.comparison_matrix import comparison_matrix

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
    "proximal_point",
    "theorems",
]
