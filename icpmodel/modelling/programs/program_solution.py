"""The result of quadratic programs and affine variational inequalities."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from ...crosscheck import crosscheck
from ...crosscheck.report import Report
from ...icp import ICP
from ...numerics.arrays import Vector
from ...present.display import Displayable
from ...theory.certificates.bounds import ErrorBound, limited_bound
from .distance import distance
from .program import Program, conditions_of


@dataclass(frozen=True, eq=False, repr=False)
class ProgramSolution(Displayable):
    """The result of `solve_qp` and of `solve_avi`, H being P and g being q in a quadratic program.

    Attributes
    ----------
    x : ndarray, shape (n,)
        The best iterate; NaN where it is proved that there is no solution.
    y, z, z_box : ndarray
        The multipliers of Ax = b (of any sign), of Gx ≤ h (≥ 0), and of the bounds: Hx + g + Gᵀz + Aᵀy + z_box = 0.
        z_box_i ≥ 0 where x_i = ub_i, ≤ 0 where x_i = lb_i.
    objective : float
        ½xᵀHx + gᵀx; NaN where H is not symmetric.
    status : str
        "optimal"; "optimal_inaccurate"; "infeasible", "unbounded", which are proved, or with "_inaccurate" proved up to
        rounding; "infeasible_or_unbounded"; "user_limit" or "solver_error".
    message : str
        What the status rests on.
    violation : float
        The largest violation of a condition of optimality, relative to the sum of its |terms|. The conditions are the
        rows of Ax = b, Gx ≤ h, the bounds, stationarity, complementarity, and the duality gap.
    iterations : int
        Steps of all methods.
    seconds : float

    Examples
    --------
    >>> icp.solve_qp([[2.0]], [-2.0])
    ProgramSolution(optimal: x = [1.], objective = -1)
    """

    x: Vector
    y: Vector
    z: Vector
    z_box: Vector
    objective: float
    status: str
    message: str
    violation: float
    iterations: int
    seconds: float
    _program: Program = field(repr=False)

    @property
    def solved(self) -> bool:
        """Whether x is optimal.

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).solved
        True
        """
        return self.status == "optimal"

    @property
    def conditions(self) -> ICP:
        """The conditions of optimality as an ICP, in the unknowns (x, y, z).

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).conditions
        ICP(n=1, nnz=1, psi=Constant(-inf), upper=Constant(0.5))
        """
        return conditions_of(self._program)

    @cached_property
    def error_bound(self) -> ErrorBound:
        """How far x can be from the solution, where H is strongly monotone, and whether there is only one.

        Within a minute of counted work, as `icpmodel.error_bound`.

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).error_bound.value < 1e-14
        True
        """
        return limited_bound(lambda: distance(self._program, self.x, np.concatenate([self.y, self.z])))

    def crosscheck(
        self, solvers: Any = None, *, atol: float | None = None, time_limit: float = 60.0, progress: bool = False
    ) -> Report:
        """Have independent solvers check the same conditions, as `icpmodel.crosscheck`.

        Parameters
        ----------
        solvers : iterable of str or ForeignSolver, optional
            The solvers; by default every one that is run unless named otherwise.
        atol : float, optional
            Largest difference of two answers in an entry, in the units of z.
        time_limit : float, default 60
            Seconds in all.
        progress : bool, default False
            Whether to show which solver is at work.

        Returns
        -------
        Report
            The verdicts.

        Examples
        --------
        >>> icp.solve_qp([[2.0]], [-2.0], ub=[0.5]).crosscheck(["osqp"]).agrees
        True
        """
        z = np.concatenate([self.x, self.y, self.z])
        return crosscheck(self.conditions, z, solvers, atol=atol, time_limit=time_limit, progress=progress)

    def __repr__(self) -> str:
        if not self.solved:
            return f"ProgramSolution({self.status}: {self.message})"
        value = "" if np.isnan(self.objective) else f", objective = {self.objective:.6g}"
        with np.printoptions(threshold=8, precision=6):
            return f"ProgramSolution({self.status}: x = {self.x}{value})"
