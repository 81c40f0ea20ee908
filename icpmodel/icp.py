"""The class of problems that users state, with the methods that solve and study them."""

from __future__ import annotations

from typing import Any

from .crosscheck import check
from .derivatives.derivative import Derivative
from .errors import InputError
from .explain import explanation
from .problem.data import ProblemData
from .solve import driver
from .solvers import cvxpy, pyomo
from .theory.certificates import bounds, certificate


class ICP(ProblemData):
    """An implicit complementarity problem: find z with p(z) = Az + q + f(z) ≥ 0, r = z − ψ(z) ≥ 0, pᵀr = 0.

    With an upper obstacle as well, ψ(z) ≤ z ≤ ψ̄(z). Then p_i ≥ 0 where z_i = ψ_i(z), p_i ≤ 0 where
    z_i = ψ̄_i(z), and p_i = 0 in between.

    Parameters
    ----------
    A : array_like or SciPy sparse matrix of shape (n, n)
        The matrix.
    q : array_like of shape (n,)
        The vector.
    psi : float, array_like of shape (n,), map or callable, default 0
        The obstacle ψ; −inf for none in that row. A map is an `Affine`, `Elementwise`, `Function`
        or `Intervention`; a callable is z ↦ ψ(z). ψ = 0 is the linear complementarity problem
        (LCP).
    upper : optional
        The obstacle ψ̄ above, in the same forms; +inf for none in that row, None for none at all.
    f : Affine, Elementwise, Function or callable, optional
        The nonlinear part of p; None where p is affine. A missing derivative is approximated by
        differences.

    Raises
    ------
    InputError
        Where A, q, f or ψ has a wrong shape, is empty, complex or not finite, and where the obstacles
        cross.

    Notes
    -----
    A row without any obstacle is the equation p_i = 0. The data is copied: A becomes float64 CSR
    with every diagonal entry stored. An ICP never changes; `with_q`, `with_psi` and `with_upper`
    make new ones that share the rest. The methods `solve`, `explain` and so on are the functions of
    the same name in the package, with the problem as first argument.

    References
    ----------
    Kumar, Deepmala and Das, More on modulus based iterative method for solving implicit
    complementarity problem. Bensoussan and Lions (1973).

    Examples
    --------
    >>> problem = ICP([[2, -1], [-1, 2]], [-1, 3])
    >>> problem.solve("mnmgs").z.round(6) + 0.0
    array([0.5, 0. ])
    >>> problem.explain().bound.unique, problem.crosscheck(solvers=["osqp"]).agrees
    (True, True)
    >>> problem
    ICP(n=2, nnz=4, psi=Constant(0))
    >>> ICP([[2, -1], [-1, 2]], [-1, 3], f=lambda z: z**3).solve().z.round(6)
    array([0.453398, 0.      ])
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
        """The derivative of z* with respect to A, q and ψ at a solution; `solution.derivative()` is the same.

        Parameters
        ----------
        solution : Solution
            A solution of this problem.

        Returns
        -------
        Derivative
            The derivative.

        Raises
        ------
        InputError
            Where `solution` is one of another problem, or not solved.
        NotApplicable
            Where ψ has no derivative.
        MapError
            Where ψ or its derivative fails.
        """
        if getattr(solution, "problem", self) is not self:
            raise InputError("solution is one of another problem object: call solution.derivative() for that one")
        return Derivative(solution)

    # The modules of the following methods import this one, so that each is imported when its method is called.

    def race(self, *args: Any, **options: Any) -> Any:
        """Measure time against error for this package's methods and foreign solvers on this problem.

        Parameters
        ----------
        *args, **options
            The other arguments of `icpmodel.race`.

        Returns
        -------
        Race
            The results.
        """
        from .study import race

        return race(self, *args, **options)

    def stability(self, plane: Any = "relaxation", **options: Any) -> Any:
        """Map where a method converges, over a plane of two parameters.

        Parameters
        ----------
        plane : str or Plane, default "relaxation"
            The plane.
        **options
            The other options of `icpmodel.stability`.

        Returns
        -------
        StabilityMap
            The map.
        """
        from .study import stability

        return stability(plane, self, **options)

    def report(self, *args: Any, **options: Any) -> Any:
        """Make one HTML page on this problem, and write it to a file if one is named.

        Parameters
        ----------
        *args, **options
            The other arguments of `icpmodel.report`.

        Returns
        -------
        str
            The HTML text.
        """
        from .study import report

        return report(self, *args, **options)

    def distribute(self, comm: Any = None) -> Any:
        """Distribute this problem over the ranks of MPI.

        Parameters
        ----------
        comm : mpi4py.MPI.Comm, optional
            The communicator; see `icpmodel.distributed.distribute`.

        Returns
        -------
        DistributedICP
            The problem on all ranks.
        """
        from .distributed import distribute

        return distribute(self, comm)
