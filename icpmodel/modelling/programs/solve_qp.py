"""`solve_qp` and `solve_avi`: quadratic programs and affine variational inequalities from their arrays."""

from __future__ import annotations

from typing import Any

from ...errors import NotSolved
from ...numerics import work
from ...numerics.arrays import as_truth, as_vector
from ...numerics.rounding import public_entry
from .program_arguments import check_convex, read
from .program_solution import ProgramSolution
from .solve_program import solve_program


@public_entry
def solve_qp(
    P: Any,
    q: Any,
    G: Any = None,
    h: Any = None,
    A: Any = None,
    b: Any = None,
    lb: Any = None,
    ub: Any = None,
    *,
    initvals: Any = None,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    raise_on_failure: bool = True,
) -> ProgramSolution:
    """Minimise ½xᵀPx + qᵀx subject to Gx ≤ h, Ax = b and lb ≤ x ≤ ub.

    The arguments are those of qpsolvers. The conditions of optimality are an ICP with a positive semidefinite matrix,
    which `solve` solves; where there is no solution that is proved.

    Parameters
    ----------
    P : array or sparse matrix of shape (n, n)
        Symmetric and positive semidefinite.
    q : array of shape (n,)
        The linear term.
    G : array or sparse matrix of shape (m, n), optional
        The rows of the inequalities.
    h : array of shape (m,), optional
        Their right-hand sides; +inf for a row without one.
    A : array or sparse matrix of shape (k, n), optional
        The rows of the equations.
    b : array of shape (k,), optional
        Their right-hand sides.
    lb, ub : float or array of shape (n,), optional
        −inf and +inf where there is no bound.
    initvals : array of shape (n,), optional
        An x near the solution.
    tolerance : float, default 1e-9
        The largest violation of any condition, in the units of the program; see
        `ProgramSolution.violation`.
    time_limit : float, optional
        Seconds; a run may exceed them by a tenth plus 0.2 s. To compile and load loops at the first calls does
        not count.
    raise_on_failure : bool, default True
        Whether a run that fails raises NotSolved.

    Returns
    -------
    ProgramSolution
        x, the multipliers, the status and its proof.

    Raises
    ------
    InputError
        Where an argument is wrong, or P is not symmetric or certainly not semidefinite.
    NotSolved
        Where no optimum is found, with the `solution`, unless `raise_on_failure` is False.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (2009), section 1.2.

    Examples
    --------
    >>> solution = icp.solve_qp([[2, 0], [0, 2]], [-2, -6], G=[[1, 1]], h=[2], lb=0)
    >>> solution.x, solution.z, round(solution.objective, 9)
    (array([0., 2.]), array([2.]), -8.0)
    >>> icp.solve_qp([[1.0]], [0.0], lb=1, ub=0, raise_on_failure=False).status
    'infeasible'
    """
    return _solve((P, q, G, h, A, b, lb, ub), "Pq", initvals, tolerance, time_limit, raise_on_failure)


@public_entry
def solve_avi(
    H: Any,
    g: Any,
    G: Any = None,
    h: Any = None,
    A: Any = None,
    b: Any = None,
    lb: Any = None,
    ub: Any = None,
    *,
    initvals: Any = None,
    tolerance: float = 1e-9,
    time_limit: float | None = None,
    raise_on_failure: bool = True,
) -> ProgramSolution:
    """Find x in C = {Gx ≤ h, Ax = b, lb ≤ x ≤ ub} with (Hx + g)ᵀ(y − x) ≥ 0 for all y in C.

    This affine variational inequality is the conditions of a quadratic program where H is symmetric, and those of a
    game or an equilibrium where it is not. An x that is returned as "optimal" solves it, whatever H is. That one is
    found is certain where H is monotone (xᵀHx ≥ 0) and there is one; else the methods may fail.

    Parameters
    ----------
    H : array or sparse matrix of shape (n, n)
        It need not be symmetric.
    g : array of shape (n,)
        The vector.
    G, h, A, b, lb, ub : array, optional
        C, as in `solve_qp`.
    initvals : array of shape (n,), optional
        An x near the solution.
    tolerance : float, default 1e-9
        The largest violation of any condition.
    time_limit : float, optional
        Seconds, as in `solve_qp`.
    raise_on_failure : bool, default True
        Whether a run that fails raises NotSolved.

    Returns
    -------
    ProgramSolution
        "infeasible" where C is empty or no x in C solves the inequality, both with a proof.

    Raises
    ------
    InputError
        Where an argument is wrong.
    NotSolved
        Where no solution is found, with the `solution`, unless `raise_on_failure` is False.

    References
    ----------
    Facchinei and Pang, Finite-Dimensional Variational Inequalities and Complementarity Problems (2003), section 1.2.

    Examples
    --------
    >>> solution = icp.solve_avi([[2, 1], [-1, 2]], [-3, -3], G=[[1, 1]], h=[1], lb=0)
    >>> solution.x.round(9), solution.z.round(9), solution.error_bound.unique
    (array([0.25, 0.75]), array([1.75]), True)
    """
    return _solve((H, g, G, h, A, b, lb, ub), "Hg", initvals, tolerance, time_limit, raise_on_failure)


def _solve(
    data: tuple[Any, ...], names: str, initvals: Any, tolerance: Any, time_limit: Any, raise_on_failure: Any
) -> ProgramSolution:
    begin = work.clock()
    as_truth(raise_on_failure, "raise_on_failure")
    program = read(data, names)
    if names == "Pq":
        check_convex(program)
    start = None if initvals is None else as_vector(initvals, program.g.size, "initvals")
    solution, _ = solve_program(program, tolerance=tolerance, time_limit=time_limit, start=start, begin=begin)
    if raise_on_failure and not solution.solved:
        raise NotSolved(solution)
    return solution
