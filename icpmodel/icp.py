"""The problem with its verbs: what a user states, and what he can ask of it."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from .crosscheck.check import crosscheck
from .crosscheck.report import Report
from .explain.page import Explanation, explain
from .methods.contract import Method
from .problem.data import ProblemData
from .solve.driver import solve
from .solve.solution import Solution
from .solvers.cvxpy_model import to_cvxpy
from .solvers.pyomo_model import to_pyomo


class ICP(ProblemData):
    """Find z with p = Az + q ≥ 0, r = z − ψ(z) ≥ 0 and pᵀr = 0.

    Parameters: `A` dense array-like or any SciPy sparse matrix, shape (n, n); `q` array-like, shape (n,); `psi` a
    number, a vector of shape (n,) (−inf: no obstacle in that row), an `Affine`, `Elementwise`, `Function` or
    `Intervention` map, or any callable z ↦ ψ(z). ψ = 0 is the linear complementarity problem (LCP).
    The data is copied: A becomes float64 CSR with every diagonal entry stored. An ICP never changes; `with_q` and
    `with_psi` make new ones that share the rest.
    Raises InputError where A, q or ψ has a wrong shape, is empty, complex or not finite.
    Reference: Kumar, Deepmala and Das, More on modulus based iterative method for solving implicit complementarity
    problem; Bensoussan and Lions (1973).

    >>> problem = ICP([[2, -1], [-1, 2]], [-1, 3])
    >>> problem.solve().z.round(6) + 0.0
    array([0.5, 0. ])
    >>> problem
    ICP(n=2, nnz=4, psi=Constant(0))
    """

    __slots__ = ()

    def solve(self, method: str | Method | None = None, **options: Any) -> Solution:
        """Solve it; `icpmodel.solve.driver.solve` says what `method` and the options are.

        >>> ICP([[2.0]], [-1.0]).solve("mnmgs").z
        array([0.5])
        """
        return solve(self, method, **options)

    def crosscheck(
        self,
        solution: Any = None,
        solvers: Iterable[str] | None = None,
        *,
        atol: float | None = None,
        time_limit: float = 60.0,
        progress: bool = False,
    ) -> Report:
        """Have independent solvers check an answer; `icpmodel.crosscheck.crosscheck` says how.

        >>> ICP([[2.0]], [-1.0]).crosscheck(solvers=["osqp"]).agrees
        True
        """
        return crosscheck(self, solution, solvers, atol=atol, time_limit=time_limit, progress=progress)

    def explain(self, method: str | Method | None = None, *, accuracy: float = 1e-6, **options: Any) -> Explanation:
        """What is certain before a solve; `icpmodel.explain.explain` says how.

        >>> ICP([[2.0]], [-1.0]).explain().bound.unique
        True
        """
        return explain(self, method, accuracy=accuracy, **options)

    def to_pyomo(self) -> Any:
        """The problem as a Pyomo model; `icpmodel.solvers.pyomo_model.to_pyomo` says how.

        >>> len(ICP([[2.0]], [-1.0]).to_pyomo().complementarity)
        1
        """
        return to_pyomo(self)

    def to_cvxpy(self, formulation: str = "qp") -> Any:
        """The problem as a CVXPY problem, "qp" or "mip"; `icpmodel.solvers.cvxpy_model.to_cvxpy` says how.

        >>> model = ICP([[2.0]], [-1.0]).to_cvxpy()
        >>> float(model.solve(solver="CLARABEL").round(6)), model.var_dict["z"].value.round(6)
        (-0.25, array([0.5]))
        """
        return to_cvxpy(self, formulation)
