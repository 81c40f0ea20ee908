"""Beyond one machine: ICPs whose rows are distributed over MPI ranks.

The matrices, vectors, Krylov methods and algebraic multigrid are PETSc's. petsc4py and mpi4py are loaded at first use.
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
