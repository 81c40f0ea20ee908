"""Foreign solvers, which cross-check and race ask: one file each, and the contract."""

from .foreign import Claim, ForeignSolver, ask, chosen_solvers, foreign_solvers
from .formulations import QP, Target

__all__ = ["QP", "Claim", "ForeignSolver", "Target", "ask", "chosen_solvers", "foreign_solvers"]
