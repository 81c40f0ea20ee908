"""Foreign solvers, run by cross-checks and races: one file each, and the contract."""

from .foreign import Claim, ForeignSolver, ask, chosen_solvers, foreign_solvers
from .formulations import QP, Target

__all__ = ["QP", "Claim", "ForeignSolver", "Target", "ask", "chosen_solvers", "foreign_solvers"]
