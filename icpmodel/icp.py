"""The problem with its verbs: what a user states, and what he can ask of it."""

from __future__ import annotations

from typing import Any

from .crosscheck import check
from .derivatives.derivative import Derivative
from .explain import explanation
from .problem.data import ProblemData
from .solve import driver
from .solvers import cvxpy, pyomo
from .theory.certificates import bounds, certificate


class ICP(ProblemData):
    """Find z with p = Az + q ≥ 0, r = z − ψ(z) ≥ 0 and pᵀr = 0; with an obstacle above as well, ψ(z) ≤ z ≤ ψ̄(z) with
    p_i ≥ 0 where z_i = ψ_i(z), p_i ≤ 0 where z_i = ψ̄_i(z), and p_i = 0 in between.

    Parameters: `A` dense array-like or any SciPy sparse matrix, shape (n, n); `q` array-like, shape (n,); `psi` a
    number, a vector of shape (n,) (−inf: no obstacle in that row), an `Affine`, `Elementwise`, `Function` or
    `Intervention` map, or any callable z ↦ ψ(z); `upper` = ψ̄ the same (+inf: none in that row), or None. ψ = 0 is the
    linear complementarity problem (LCP); a row without any obstacle is the equation p_i = 0.
    The data is copied: A becomes float64 CSR with every diagonal entry stored. An ICP never changes; `with_q`,
    `with_psi` and `with_upper` make new ones that share the rest.
    Raises InputError where A, q or ψ has a wrong shape, is empty, complex or not finite, and where the obstacles cross.
    Its verbs are functions of the package with the problem as their first argument, and their help is these functions'.
    Reference: Kumar, Deepmala and Das, More on modulus based iterative method for solving implicit complementarity
    problem; Bensoussan and Lions (1973).

    >>> problem = ICP([[2, -1], [-1, 2]], [-1, 3])
    >>> problem.solve("mnmgs").z.round(6) + 0.0
    array([0.5, 0. ])
    >>> problem.explain().bound.unique, problem.crosscheck(solvers=["osqp"]).agrees
    (True, True)
    >>> problem
    ICP(n=2, nnz=4, psi=Constant(0))
    >>> ICP([[2, -1], [-1, 2]], [-3, 3], psi=-1, upper=[0.25, np.inf]).solve("psor").z
    array([ 0.25, -1.  ])
    """

    __slots__ = ()

    solve = driver.solve
    crosscheck = check.crosscheck
    explain = explanation.explain
    certify = certificate.certify
    error_bound = bounds.error_bound
    to_pyomo = pyomo.to_pyomo
    to_cvxpy = cvxpy.to_cvxpy

    def derivative(self, solution: Any) -> Derivative:
        """The derivative of z* in A, q and ψ at a `solution`, which `solution.derivative()` asks for."""
        return Derivative(solution)

    # The rooms of these verbs stand above this one and know it, so that each is imported when it is called.

    def race(self, *args: Any, **options: Any) -> Any:
        """Time own methods and foreign solvers against their error: `icpmodel.race` with this problem."""
        from .study import race

        return race(self, *args, **options)

    def stability(self, plane: Any = "relaxation", **options: Any) -> Any:
        """Map where a method converges over a plane of two parameters: `icpmodel.stability` with this problem."""
        from .study import stability

        return stability(plane, self, **options)

    def report(self, **options: Any) -> Any:
        """Write one HTML page on this problem: `icpmodel.report` with this problem."""
        from .study import report

        return report(self, **options)

    def distribute(self, comm: Any = None) -> Any:
        """Spread this problem over the ranks of MPI: `icpmodel.distributed.distribute` with this problem."""
        from .distributed import distribute

        return distribute(self, comm)
