"""Second opinions: independent solvers solve the same problem from scratch, and one judge compares."""

from .check import crosscheck
from .judge import Verdict
from .report import Report

__all__ = ["Report", "Verdict", "crosscheck"]
