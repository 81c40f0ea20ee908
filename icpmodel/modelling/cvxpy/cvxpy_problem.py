"""`Problem`: implicit complementarity problems in the manner of `cvxpy.Problem`."""

from __future__ import annotations

import sys
import time
from collections.abc import Iterable
from typing import Any

import cvxpy as cp
import numpy as np
from cvxpy import settings as s
from cvxpy.constraints.nonpos import Inequality
from cvxpy.constraints.zero import Equality, Zero
from cvxpy.problems.problem import SolverStats

from ...crosscheck.report import Report
from ...errors import InputError, NotSolved, check_arguments
from ...explain.explanation import Explanation
from ...icp import ICP
from ...methods.contract import Method
from ...numerics.arrays import Vector, as_truth, described
from ...present.display import Displayable, counted, listed
from ...solve.solution import Solution, Status
from ..reading import solved
from ..running_log import printed_on
from .atoms import named
from .complementarity import Complementarity
from .expressions import CvxpyReading
from .parameter_derivative import ParameterDerivative

_EQUATIONS = (Equality, Zero)
_INEQUALITIES = (Inequality, cp.NonNeg, cp.NonPos)
#: status → status of CVXPY
STATUSES = {
    Status.SOLVED: s.OPTIMAL,
    Status.PRECISION_LIMIT: s.OPTIMAL_INACCURATE,
    Status.INFEASIBLE: s.INFEASIBLE,
    **dict.fromkeys([Status.STAGNATED, Status.CYCLED, Status.DIVERGED], s.SOLVER_ERROR),
    **dict.fromkeys([Status.MAP_FAILED, Status.CROSSED, Status.WORKER_LOST], s.SOLVER_ERROR),
    **dict.fromkeys([Status.ITERATION_LIMIT, Status.TIME_LIMIT, Status.MEMORY_LIMIT], s.USER_LIMIT),
    **dict.fromkeys([Status.INTERRUPTED, Status.STOPPED], s.USER_LIMIT),
}
#: status of CVXPY → optimal value of the objective 0
_VALUES = {**dict.fromkeys([s.OPTIMAL, s.OPTIMAL_INACCURATE], 0.0), s.INFEASIBLE: np.inf}


class Problem(Displayable):
    """An ICP stated in CVXPY: find values z of all variables of the constraints with every p ≥ 0 ⟂ r ≥ 0.

    Parameters
    ----------
    constraints, *others : constraint, or list of constraints
        Conditions `complements(p, r)`, equations a == b and affine inequalities a <= b.

    Raises
    ------
    InputError
        For a model that is not of this form, with the expression and the reason.

    Notes
    -----
    **Form.** Conditions and equations have as many rows as there are unknowns. p, r, equations and the
    bounds of r are any CVXPY expressions, convex or not; `.grad` gives their derivatives. Each row of r
    owns one entry of z: r_i = z_i − ψ_i(z). A row az − ψ is divided by a; if a < 0, r ≥ 0 is an upper
    obstacle of z. If no entry is left for a row, z gets a further unknown s in place of r, with the
    equation s − r(z) = 0.

    **Variables.** They have any shape. z stacks them in the order of `variables()`, each column by
    column. If r is a variable, its attributes `nonneg`, `nonpos` and `bounds` are bounds of r. Bounds of
    other variables are checked like inequalities.

    **Parameters.** They may occur anywhere. CVXPY compiles the model once, and a new value costs one
    product. A model that is not DPP is compiled anew for each value.

    **Multipliers.** The multiplier of an equation is a variable of any sign, which the user writes into
    p; its `dual_value` is None. An inequality is only checked at the answer; its `dual_value` is 0. If it
    is violated, the status is "infeasible" if it is proved that no solution of the conditions satisfies
    it, else "solver_error".

    After `solve(requires_grad=True)`, `backward` and `derivative` differentiate the answer with respect
    to the parameters.

    References
    ----------
    Diamond and Boyd, J. Mach. Learn. Res. 17 (2016). Agrawal et al., Differentiable convex
    optimization layers (2019), for DPP.

    Examples
    --------
    >>> import cvxpy as cp
    >>> z, load = cp.Variable(2), cp.Parameter(2)
    >>> pair = icp.complements(
    ...     np.array([[2, -1], [-1, 2]]) @ z - load, z - 0.3 * cp.minimum(z, 1)
    ... )
    >>> problem = icp.Problem(pair)
    >>> for load.value in ([1, -3], [4, 4]):
    ...     _ = problem.solve()
    ...     print(problem.status, z.value.round(6) + 0.0)
    optimal [0.5 0. ]
    optimal [4. 4.]
    >>> _ = problem.solve(requires_grad=True), problem.backward()
    >>> load.gradient
    array([1., 1.])
    >>> x, force = cp.Variable(2), cp.Variable()
    >>> pair = icp.complements(x - [2, 1] + force, x, upper=0.75)
    >>> _ = icp.Problem([pair, cp.sum(x) == 1, x[0] >= x[1]]).solve()
    >>> x.value.round(6), float(force.value.round(6))
    (array([0.75, 0.25]), 0.75)
    """

    @check_arguments
    def __init__(self, constraints: Any, *others: Any) -> None:
        if others:
            raise InputError("a complementarity problem has no objective: give the list of constraints alone")
        self._constraints = _list_constraints(constraints)
        self._conditions = [one for one in self._constraints if isinstance(one, Complementarity)]
        self._equations = [one for one in self._constraints if isinstance(one, _EQUATIONS)]
        self._inequalities = [one for one in self._constraints if isinstance(one, _INEQUALITIES)]
        self._reading = CvxpyReading(self._conditions, self._equations, self._inequalities)
        self.solution: Solution | None = None
        self._of_conditions: Solution  # that of the ICP, without the inequalities
        self.solver_stats: SolverStats | None = None
        self._derivative: ParameterDerivative | None = None

    @property
    def constraints(self) -> list[Any]:
        """The constraints as they were given, in a new list.

        Examples
        --------
        >>> z = cp.Variable(name="z")
        >>> icp.Problem(icp.complements(z - 1, z)).constraints
        [complements(z + -1.0, z)]
        """
        return list(self._constraints)

    def variables(self) -> list[cp.Variable]:
        """The variables in the order in which z stacks them.

        Returns
        -------
        list of Variable
            Each once.

        Examples
        --------
        >>> x, y = cp.Variable(2, name="x"), cp.Variable(name="y")
        >>> icp.Problem([icp.complements(y + 1, y), icp.complements(x - y, x)]).variables()
        [Variable((), y), Variable((2,), x)]
        """
        return list(self._reading.variables)

    def parameters(self) -> list[cp.Parameter]:
        """The parameters, in the order in which they appear.

        Returns
        -------
        list of Parameter
            Each once.

        Examples
        --------
        >>> z, load = cp.Variable(), cp.Parameter(name="load")
        >>> [one.name() for one in icp.Problem(icp.complements(z - load, z)).parameters()]
        ['load']
        """
        return list(self._reading.parameters)

    def is_dpp(self) -> bool:
        """Whether CVXPY compiles the model once for all values of its parameters.

        Returns
        -------
        bool
            False where every new value compiles the model anew.

        Examples
        --------
        >>> z, a, b = cp.Variable(), cp.Parameter(), cp.Parameter()
        >>> [icp.Problem(icp.complements(p, z)).is_dpp() for p in (a * z + b, a * (b * z))]
        [True, False]
        """
        return self._reading.is_dpp

    def icp(self) -> ICP:
        """The ICP at the present values of the parameters, without the inequalities.

        Functions of an ICP, such as `icp.explain`, accept a `Problem` and use this ICP.

        Returns
        -------
        ICP
            The problem.

        Raises
        ------
        InputError
            Where a parameter has no value.

        Examples
        --------
        >>> z = cp.Variable(2)
        >>> icp.Problem(icp.complements(z - 1, 2 * z - 6)).icp()
        ICP(n=2, nnz=2, psi=Constant(3))
        """
        return self._reading.problem

    @property
    def status(self) -> str | None:
        """How the last solve ended, in CVXPY's words; None before, and where it raised InputError or MapError.

        "optimal": solved. "optimal_inaccurate": rounding allows no more (PRECISION_LIMIT). "infeasible": proved.
        "user_limit": a limit on iterations, time or memory, the callback or Ctrl-C. "solver_error": no solution was
        found, and infeasibility is not proved; `solution.status` and `solution.message` say more.

        Examples
        --------
        >>> z = cp.Variable()
        >>> problem = icp.Problem(icp.complements(-z - 1, z))
        >>> _ = problem.solve(raise_on_failure=False)
        >>> problem.status
        'infeasible'
        """
        return None if self.solution is None else STATUSES[self.solution.status]

    @property
    def value(self) -> float | None:
        """The optimal value of the objective 0, as in CVXPY.

        0.0 if the status is "optimal" or "optimal_inaccurate", inf if it is proved that there is no
        solution, else None.

        Examples
        --------
        >>> z = cp.Variable()
        >>> problem = icp.Problem(icp.complements(z - 1, z))
        >>> problem.value, problem.solve().z, problem.value
        (None, array([1.]), 0.0)
        """
        return _VALUES.get(str(self.status))

    def solve(
        self,
        method: str | Method | None = None,
        *,
        z0: Any = None,
        warm_start: bool = True,
        verbose: bool = False,
        raise_on_failure: bool = True,
        requires_grad: bool = False,
        **options: Any,
    ) -> Solution:
        """Solve the problem and write the values to the variables and constraints.

        Parameters
        ----------
        method : str or Method, optional
            As in `icpmodel.solve`.
        z0 : array of shape (n,), optional
            The start, by default the values of the variables, 0 where they have none.
        warm_start : bool, default True
            Whether to start from the values of the variables; else from 0.
        verbose : bool, default False
            Whether to print the problem, the progress and the outcome.
        raise_on_failure : bool, default True
            Whether a failed run raises NotSolved. Otherwise the variables have the values of the best
            iterate, and `status` says why the run ended.
        requires_grad : bool, default False
            Whether to prepare `backward` and `derivative`.
        **options
            The other options of `icpmodel.solve`.

        Returns
        -------
        Solution
            It is also kept in `solution`, and in CVXPY's form in `solver_stats`.

        Raises
        ------
        NotSolved
            Where the run fails or an inequality is violated; the variables then have no values.
        InputError
            Where CVXPY has no gradient that `requires_grad` needs; the values are written nevertheless.

        Examples
        --------
        >>> z = cp.Variable()
        >>> solution = icp.Problem(icp.complements(2 * z - 3, z - cp.exp(z - 3))).solve(
        ...     "newton"
        ... )
        >>> solution.z.round(6), round(float(z.value), 6)
        (array([1.5]), 1.5)
        """
        self.solution = self.solver_stats = self._derivative = None
        flags = {"warm_start": warm_start, "verbose": verbose, "raise_on_failure": raise_on_failure}
        for name, flag in {**flags, "requires_grad": requires_grad}.items():
            as_truth(flag, name)
        _check_solver(method, options)
        reading = self._reading
        start_time = time.perf_counter()
        problem = self.icp()
        seconds = time.perf_counter() - start_time
        if z0 is None and not warm_start:
            z0 = np.zeros(problem.n)
        if verbose:
            print(f"icpmodel: {problem!r}")
            options["callback"] = printed_on(sys.stdout, options.get("callback"))
        answer = solved(reading, method, z0=z0, **options)
        self._of_conditions = answer
        if answer.status in (Status.SOLVED, Status.PRECISION_LIMIT):
            answer = reading.checked(answer)
        self.solution = answer
        self.solver_stats = SolverStats("ICPMODEL", answer.seconds, seconds, answer.iterations, answer)  # type: ignore[arg-type]
        if verbose:
            summary = f"{self.status} after {counted(answer.iterations, 'iteration')}, {answer.seconds:.3g} s"
            print(f"icpmodel: {summary}: {answer.message}")
        failed = raise_on_failure and not answer.solved
        self._write(None if failed else answer.z)
        if failed:
            raise NotSolved(answer)
        if requires_grad and self.value == 0.0:
            self._derivative = ParameterDerivative(reading, answer)
        return answer

    def backward(self) -> None:
        """Write the gradient of ∑ g·x over the variables x to each parameter's `gradient`.

        As in CVXPY, g is the `gradient` of x: a number, or an array of the shape of x, 1 by default.

        Raises
        ------
        InputError
            Where nothing was solved with `requires_grad=True`, or a `gradient` has a wrong shape.
        NotSolved
            Where the solve failed.
        SingularOperator
            Where z cannot be differentiated.

        Notes
        -----
        The `gradient` of a symmetric parameter counts each pair of entries once; that of a diagonal one is sparse. The
        model need not be DPP, nor the program convex. Atoms must have a `.grad` in their parameters. A parameter that
        is not an argument of an atom, such as an exponent, has none.

        The gradient is proved if `icpmodel.Derivative(solution).certain` is True: each row is proved to be at an
        obstacle or off it. In the `undecided` rows of the same object p = r = 0 cannot be excluded. There one side is
        chosen, which gives an element of the B-subdifferential; `one_sided` gives both. Inequalities have no influence.
        At a kink of ψ, such as that of `maximum`, CVXPY chooses the side.

        References
        ----------
        Agrawal et al., Differentiable convex optimization layers (2019).

        Examples
        --------
        >>> z, load = cp.Variable(2), cp.Parameter(2, value=[1, -3])
        >>> problem = icp.Problem(icp.complements(np.array([[2, -1], [-1, 2]]) @ z - load, z))
        >>> problem.solve(requires_grad=True).z, problem.backward(), load.gradient
        (array([0.5, 0. ]), None, array([0.5, 0. ]))
        """
        self._differentiable("backward").backward()

    def derivative(self) -> None:
        """Write the directional derivative of the variables in the parameters to each variable's `delta`.

        The direction is the parameters' `delta`, of their shape or a number for all entries, by default 0. Conditions,
        certainty and errors are those of `backward`.

        Examples
        --------
        >>> z, load = cp.Variable(2), cp.Parameter(2, value=[1, -3])
        >>> problem = icp.Problem(icp.complements(np.array([[2, -1], [-1, 2]]) @ z - load, z))
        >>> _, load.delta = problem.solve(requires_grad=True), [1, 1]
        >>> problem.derivative(), z.delta
        (None, array([0.5, 0. ]))
        """
        self._differentiable("derivative").derivative()

    def _differentiable(self, verb: str) -> ParameterDerivative:
        if self._derivative is not None:
            return self._derivative
        if self.solution is not None and self.value != 0.0:
            raise NotSolved(self.solution)
        raise InputError(f"{verb}() was called without a solve(requires_grad=True) just before it; call that first")

    def _write(self, z: Vector | None) -> None:
        """Write the values at `z` to the variables, conditions and constraints; None removes them."""
        reading = self._reading
        for variable in reading.variables:
            variable.save_value(None)
        for condition in self._conditions:
            condition.p = condition.r = None
        for constraint in (*self._equations, *self._inequalities):
            constraint.save_dual_value(None)
        if z is None:
            return
        for variable, value in reading.values(z):
            variable.save_value(value)
        for condition, p in reading.multipliers(z):
            condition.p, condition.r = p, condition.sides[1].value
        for condition, r in reading.distances(z):
            condition.r = r
        if self.value == 0.0:
            for inequality in self._inequalities:
                inequality.save_dual_value(np.zeros(inequality.shape))

    def crosscheck(
        self,
        solvers: Iterable[str] | None = None,
        *,
        atol: float | None = None,
        time_limit: float = 60.0,
        progress: bool = False,
    ) -> Report:
        """Have independent solvers check the answer of the last `solve`, as `icpmodel.crosscheck`.

        The problem is solved first if the parameters have changed since, or nothing was solved.
        Inequalities are not part of the ICP and are not checked.

        Parameters
        ----------
        solvers : iterable of str or ForeignSolver, optional
            The solvers; by default every one that is run unless named otherwise.
        atol : float, optional
            Largest difference of two answers in an entry, in the units of z.
        time_limit : float, default 60
            Seconds in all.
        progress : bool, default False
            Whether to show which solver is running.

        Returns
        -------
        Report
            The verdicts.

        Examples
        --------
        >>> z = cp.Variable(2)
        >>> icp.Problem(icp.complements(2 * z - [1, -1], z)).crosscheck(["osqp"]).agrees
        True
        """
        icp = self.icp()
        if self.solution is None or self.solution.problem is not icp:
            self.solve(raise_on_failure=False)
        return icp.crosscheck(self._of_conditions, solvers, atol=atol, time_limit=time_limit, progress=progress)

    def explain(
        self, method: str | Method | None = None, *, accuracy: float = 1e-6, thorough: bool = False, **options: Any
    ) -> Explanation:
        """What is certain of the ICP at the present values of the parameters, as `icpmodel.explain`.

        Parameters
        ----------
        method : str or Method, optional
            The method to explain.
        accuracy : float, default 1e-6
            The accuracy whose number of steps is predicted.
        thorough : bool, default False
            Whether to make the expensive computations, too.
        **options
            The options of the method that is named.

        Returns
        -------
        Explanation
            The page.

        Examples
        --------
        >>> z = cp.Variable(2)
        >>> icp.Problem(icp.complements(2 * z - [1, -1], z)).explain().bound.unique
        True
        """
        return self.icp().explain(method, accuracy=accuracy, thorough=thorough, **options)

    def __copy__(self) -> Problem:
        return type(self)(self._constraints)

    def __reduce__(self) -> Any:
        # copies of expressions keep the ids of their variables: CVXPY 1.9 then crashes, or confuses two variables
        advice = "problem.icp() can; the model can be built again there, or copied by copy.copy with the same variables"
        raise TypeError(
            f"CVXPY's expressions cannot be pickled or copied deeply, so that a Problem cannot be; {advice}"
        )

    def __str__(self) -> str:
        names = ", ".join(x.name() for x in self.variables())
        return "\n".join([f"find {names}", *(f"  with {_description(one)}" for one in self._constraints)])

    def __repr__(self) -> str:
        return f"Problem([{listed([_description(one) for one in self._constraints])}])"


def _description(constraint: Any) -> str:
    return repr(constraint) if isinstance(constraint, Complementarity) else named(constraint)


def _list_constraints(constraints: Any) -> list[Any]:
    """`constraints` as a list, each of a kind that is allowed. Raises InputError."""
    expected = "complements(p, r), equations a == b and inequalities a <= b"
    known = (Complementarity, *_EQUATIONS, *_INEQUALITIES)
    if isinstance(constraints, known):
        return [constraints]
    if isinstance(constraints, cp.Minimize | cp.Maximize):
        actual = f"constraints is the objective {constraints}"
        raise InputError(f"{actual}; a complementarity problem has none, give the list of {expected} alone")
    if not isinstance(constraints, Iterable) or isinstance(constraints, str | cp.Expression):
        raise InputError(f"constraints is {described(constraints)}; a list of {expected} was expected")
    constraints = list(constraints)
    for k, one in enumerate(constraints):
        if isinstance(one, list | tuple):
            raise InputError(f"constraints[{k}] is {described(one)}; one flat list was expected: put * before it")
        if not isinstance(one, known):
            text = named(one) if isinstance(one, cp.Constraint | cp.Expression) else described(one)
            raise InputError(f"constraints[{k}] is {text}; {expected} were expected")
    return constraints


def _check_solver(method: Any, options: dict[str, Any]) -> None:
    """Raise InputError if a solver of CVXPY is named, or the option `solver` is given."""
    solver = options.get("solver", method)
    if "solver" in options or (isinstance(method, str) and method in s.SOLVERS):
        actual = solver if isinstance(solver, str) else described(solver)
        advice = 'leave it out, or give a method such as "newton"; crosscheck() asks other solvers about the answer'
        raise InputError(f"the solver {actual} was named, but icpmodel's own methods solve this problem: {advice}")
