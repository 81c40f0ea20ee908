"""Foreign solvers: one file each, and the contract."""

from .contract import Answer, IndependentSolver, chosen_solvers, independent_solvers
from .formulations import QP, Target

__all__ = ["QP", "Answer", "IndependentSolver", "Target", "chosen_solvers", "independent_solvers"]
