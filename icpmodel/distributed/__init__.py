"""Beyond one machine: ICPs whose rows are spread over the ranks of MPI, by PETSc's matrices, vectors, Krylov methods
and algebraic multigrid.

It needs petsc4py and mpi4py, which are loaded when they are first asked for.
"""

from .distributed_bound import DistributedCertificate, certify
from .distributed_icp import DistributedICP, by_rows, distribute
from .distributed_solution import DistributedSolution
from .files_on_ranks import load_problem, save_solution
from .solve_on_ranks import solve

__all__ = [
    "DistributedCertificate",
    "DistributedICP",
    "DistributedSolution",
    "by_rows",
    "certify",
    "distribute",
    "load_problem",
    "save_solution",
    "solve",
]
