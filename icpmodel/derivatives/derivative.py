"""The derivative of the answer: one linear system with the matrix J on the active set, solved forward or transposed.

Near z* each row in which p and r are not both 0 keeps its side: Az + q = 0 in the free rows, z = ψ(z)
in the active ones. The derivative of these equations is J dz = f. A free row of J is that of A,
with f = −(dA z + dq). An active row of J is that of I − ψ′, with f = dψ. The adjoint system is Jᵀw
= z̄.

In a row with p = r = 0 one side or the other may hold as soon as the data move. Either choice gives
an element of the B-subdifferential. The derivative in one direction solves a complementarity
problem of its own (see `tangent`).

References
----------
Robinson, Math. Oper. Res. 5 (1980), for the implicit function theorem. Outrata, Kočvara and Zowe,
Nonsmooth Approach to Optimization Problems with Equilibrium Constraints (1998). Mignot, J. Funct.
Anal. 22 (1976), for the obstacle problem.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import scipy.sparse as sp
from numpy.typing import NDArray

from ..algebra.active_equations import ActiveEquations
from ..algebra.equations import Pattern, derivative, newton_matrix
from ..errors import InputError, MapError, NotApplicable, OutOfTime, SingularOperator, check_arguments
from ..numerics.arrays import Mask, ReadOnly, Vector, described, norm
from ..numerics.rounding import SMALLEST, UNIT_ROUNDOFF, public_entry
from ..present.card import Card
from ..present.display import Displayable, Plottable, listed
from ..problem.data import ProblemData
from ..problem.two_sided import sides_of
from ..solve.driver import solve
from ..solve.goal import RTOL
from ..solve.solution import Solution, Status
from ..theory.certificates.bounds import ASSUMED_F, ASSUMED_PSI, enforce_limits, perturbation_bound
from .direction import Direction
from .gradient import Gradient
from .tangent import Ties, tangent_problem

#: the number of random weights: all sums cancel to a hundredth once in 10⁶ times
_RANDOM_WEIGHTS = 3
#: the relative tolerance of tangent problems, and the smallest one of linear systems that are solved iteratively
_RTOL = 1e-10
_MIN_RTOL = 1e-14


@dataclass(frozen=True, eq=False, repr=False)
class OneSided(ReadOnly, Displayable):
    """The derivatives of z*(t) at t = 0 in one direction of the data.

    Attributes
    ----------
    right : array of shape (n,)
        As t ↓ 0.
    left : array of shape (n,)
        As t ↑ 0.

    Examples
    --------
    >>> right, left = Derivative(ICP([[1.0]], [0.0]).solve()).one_sided(dq=[1.0])
    >>> right, left
    (array([0.]), array([-1.]))
    """

    right: Vector
    left: Vector

    def __iter__(self) -> Iterator[Vector]:
        return iter((self.right, self.left))


@check_arguments
class Derivative(ReadOnly, Plottable):
    """The derivative of z* in A, q and ψ at a solution, forward and adjoint.

    Parameters
    ----------
    solution : Solution
        A solved problem.

    Attributes
    ----------
    certain : bool
        Whether it is proved that z* is differentiable and that this is its derivative.
    undecided : array of int, shape (k,)
        Rows in which p = r = 0, or two equally good jumps, cannot be excluded, or z* has another side.
    reason : str
        Why the derivative is not `certain`; or why it is, and what was assumed.

    Raises
    ------
    InputError
        Where `solution` is not solved.
    NotApplicable
        Where ψ has no derivative.
    MapError
        Where ψ or its derivative fails.

    Notes
    -----
    For `certain`, every row must be proved to be at an obstacle or off it. Moreover, ψ must be smooth
    wherever z* may be. An undecided row takes the side that z is nearer to, which gives an element
    of the B-subdifferential. A user's function ψ is assumed to be continuously differentiable there,
    with the derivative that the user gives.

    Examples
    --------
    >>> derivative = Derivative(ICP([[2, -1], [-1, 2]], [-1, 3]).solve())
    >>> derivative.forward(dq=[1.0, 0.0])
    array([-0.5,  0. ])
    >>> derivative.adjoint([1.0, 0.0]).q
    array([-0.5,  0. ])
    >>> derivative.certain
    True
    """

    def __init__(self, solution: Solution) -> None:
        if not isinstance(solution, Solution):
            raise InputError(f"solution is {described(solution)}; a Solution was expected")
        if solution.status not in (Status.SOLVED, Status.PRECISION_LIMIT):
            raise InputError(f"solution is not solved ({solution.status.value}): only a solution has a derivative")
        problem = solution.problem.linearised(solution.z)
        z = solution.z
        if (missing := problem.psi.no_derivative()) is not None:
            raise NotApplicable(missing)
        self.solution, self.problem, self.z = solution, problem, z
        self.pattern = Pattern.at(problem, z)
        self._jacobian = derivative(problem.psi, z, self.pattern.above)

    def __reduce__(self) -> tuple[Any, ...]:  # factors cannot be pickled
        return Derivative, (self.solution,)

    @cached_property
    def equations(self) -> ActiveEquations:
        """J and Jᵀ, solved for any right-hand side by `equations.solve(f, tolerance, transposed)`.

        Examples
        --------
        >>> Derivative(ICP([[2.0]], [-2.0]).solve()).equations.solve(np.ones(1), 1e-10)
        array([0.5])
        """
        return ActiveEquations(self.problem, self.pattern.active, self._jacobian)

    @public_entry
    def forward(self, *, dA: Any = None, dq: Any = None, dpsi: Any = None, dupper: Any = None) -> Vector:
        """The change dz of z*, to first order, for a change of the data.

        Parameters
        ----------
        dA : array_like or sparse of shape (n, n), optional
            Change of A.
        dq : array_like of shape (n,), optional
            Change of q.
        dpsi : optional
            Change of the data of ψ. A number or shape (n,) changes its values; it is the dc of a
            map with a c. An affine ψ takes (dG, dc) as well, an intervention a sparse matrix of
            changed gains. A map with a `parameter_derivative` takes shape (m,).
        dupper : optional
            The same for the upper obstacle.

        Returns
        -------
        array of shape (n,)
            dz. Data that are left out do not change.

        Raises
        ------
        InputError
            For wrong arguments.
        SingularOperator
            Where the equations of the active set are singular.

        Examples
        --------
        >>> Derivative(ICP([[2.0]], [-2.0]).solve()).forward(dA=[[1.0]])
        array([-0.5])
        """
        change = Direction(self.problem, dA, dq, dpsi, dupper)
        return self.solve(change.right_side(self.z, self.pattern))

    @public_entry
    def adjoint(self, zbar: Any) -> Gradient:
        """The gradient of z̄ᵀz* in all data at once, by one transposed solve.

        Parameters
        ----------
        zbar : array_like of shape (n,)
            The weight z̄.

        Returns
        -------
        Gradient
            The gradient in A, q and the obstacles.

        Raises
        ------
        InputError
            For wrong arguments.
        SingularOperator
            Where the equations of the active set are singular.

        Examples
        --------
        >>> gradient = Derivative(ICP([[2.0]], [-2.0]).solve()).adjoint([1.0])
        >>> gradient.q, gradient.A.data
        (array([-0.5]), array([-0.5]))
        """
        zbar = self.problem.vector(zbar, "zbar", finite=True)
        return Gradient(self.solution.problem, self.z, self.pattern, self.solve(zbar, transposed=True))

    @cached_property
    def _tolerance(self) -> float:
        """The relative tolerance of iterative solves: that of z, at most the default."""
        tolerance = RTOL
        with suppress(MapError):
            scale = self.problem.residual_scale() or norm(self.z)
            if scale > 0.0 and not self.solution.accuracy:
                tolerance = self.solution.tolerance / scale
        return min(max(tolerance, _MIN_RTOL), RTOL)

    def solve(self, f: Vector, transposed: bool = False) -> Vector:
        """J⁻¹f, or J⁻ᵀf.

        Parameters
        ----------
        f : array of shape (n,)
            Right-hand side.
        transposed : bool, default False
            Whether to solve with Jᵀ.

        Returns
        -------
        array of shape (n,)
            The solution of the linear system.

        Raises
        ------
        SingularOperator
            Where J is singular up to rounding, or the solution overflows.

        Examples
        --------
        >>> Derivative(ICP([[2.0]], [-2.0]).solve()).solve(np.ones(1))
        array([0.5])
        """
        with np.errstate(over="ignore", invalid="ignore"):
            x = self.equations.solve(f, self._tolerance, transposed)
            sizes = self._absolute.T if transposed else self._absolute
            # where all of f is within the rounding of Jx, J is singular up to rounding
            if x is None or (f.any() and (np.abs(f) <= 16 * UNIT_ROUNDOFF * (sizes @ np.abs(x))).all()):
                reason = "the equations of the active set are singular, or their solution overflows"
                raise SingularOperator(f"{reason}; where rows are undecided, one_sided may have an answer", 0)
        return x

    @public_entry
    def one_sided(self, *, dA: Any = None, dq: Any = None, dpsi: Any = None, dupper: Any = None) -> OneSided:
        """The right and the left derivative in one direction; where `certain`, both are `forward`.

        Parameters
        ----------
        dA, dq, dpsi, dupper : optional
            The direction, as for `forward`.

        Returns
        -------
        OneSided
            Both derivatives.

        Raises
        ------
        InputError
            For wrong arguments.
        NotSolved
            Where one of the two tangent problems is not solved.

        Notes
        -----
        In the undecided rows of the polished answer p = r = 0 is assumed. Each of the two is a
        complementarity problem with the matrix A, solved by `icpmodel.solve`.

        Examples
        --------
        >>> two_jumps = sp.csr_array([[0.0, -1.0, -1.0], [0.0, 0.0, 0.0], [0.0, 0.0, 0.0]])
        >>> problem = ICP(np.eye(3), [5.0, -2.0, -2.0], icp.Intervention(two_jumps))
        >>> tuple(Derivative(problem.solve()).one_sided(dq=[0.0, 1.0, 0.0]))
        (array([ 0., -1.,  0.]), array([-1., -1.,  0.]))
        """
        direction = Direction(self.problem, dA, dq, dpsi, dupper)
        # both raise InputError where the direction is wrong
        f = direction.right_side(self.z, self.pattern)
        opposite = direction.opposite()
        opposite.right_side(self.z, self.pattern)
        if self.certain:
            dz = self.solve(f)
            return OneSided(dz, dz)
        near = Derivative(self.solution.polish())
        return OneSided(near._right_derivative(direction), 0.0 - near._right_derivative(opposite))

    def _right_derivative(self, direction: Direction) -> Vector:
        """dz for t ↓ 0 in this `direction`, by its tangent problem. Raises NotSolved."""
        problem = tangent_problem(self.z, self.pattern, self._ties, direction)
        # numbers below SMALLEST/UNIT_ROUNDOFF have fewer digits than rtol asks for
        return solve(problem, rtol=_RTOL, atol=SMALLEST / UNIT_ROUNDOFF).polish().z + 0.0

    @public_entry
    def bound(self, dz: Any, *, dA: Any = None, dq: Any = None, dpsi: Any = None, dupper: Any = None) -> float | None:
        """Bound the distance of `dz` to the derivative in the direction of the other arguments.

        Parameters
        ----------
        dz : array_like of shape (n,)
            A computed derivative.
        dA, dq, dpsi, dupper : optional
            The direction, as for `forward`.

        Returns
        -------
        float or None
            A bound on the error of every entry, which covers the uncertainty of z* and all rounding
            errors; None where there is none.

        Raises
        ------
        InputError
            For wrong arguments.

        Notes
        -----
        There is no bound where the derivative is not `certain`, nor for a user's function, whose
        derivative may differ between z and z*. There is none either where nothing is proved of J
        within the limits of the solution. The bound may cost a linear solve.

        Examples
        --------
        >>> derivative = Derivative(ICP([[2.0]], [-2.0]).solve())
        >>> derivative.bound([-0.5], dA=[[1.0]]) < 1e-14
        True
        """
        dz = self.problem.vector(dz, "dz")
        direction = Direction(self.problem, dA, dq, dpsi, dupper)
        f = direction.right_side(self.z, self.pattern)
        delta = self.solution.certificate.bound.componentwise
        error = np.zeros(dz.size) if delta is None else direction.error(self.z, delta, self.pattern)
        return self._bound(self._matrix, f, dz, error)

    @public_entry
    def adjoint_bound(self, zbar: Any, gradient: Gradient) -> float | None:
        """Bound the error of the `q`, `psi_values` and `upper_values` of `gradient`; see `bound`.

        Parameters
        ----------
        zbar : array of shape (n,)
            The weight that was passed to `adjoint`.
        gradient : Gradient
            The gradient that `adjoint` returned.

        Returns
        -------
        float or None
            A bound on the error of every entry; None where there is none.

        Examples
        --------
        >>> derivative = Derivative(ICP([[2.0]], [-2.0]).solve())
        >>> derivative.adjoint_bound([1.0], derivative.adjoint([1.0])) < 1e-15
        True
        """
        if not isinstance(gradient, Gradient):
            raise InputError(f"gradient is {described(gradient)}; what adjoint(zbar) returns was expected")
        w = gradient.psi_values - gradient.q
        w = w if gradient.upper_values is None else w + gradient.upper_values
        zbar = self.problem.vector(zbar, "zbar", finite=True)
        return self._bound(sp.csr_array(self._matrix.T), zbar, w, np.zeros(w.size))

    @cached_property
    def _matrix(self) -> sp.csr_array:
        """J, CSR, shape (n, n)."""
        return newton_matrix(self.problem, self.pattern.active, self._jacobian)

    @cached_property
    def _absolute(self) -> sp.csr_array:
        """|J|: the rounding of Jx is relative to |J||x|."""
        return abs(self._matrix)

    def _bound(self, J: sp.csr_array, f: Vector, x: Vector, error: Vector) -> float | None:
        """A bound on max|x − x*| for Jx* = f, where f is wrong by up to `error`; None where there is none."""
        if not self.certain or self.problem.psi.calls_user_code or self.solution.problem.f is not None:
            return None
        linear = ProblemData(J, -f, -np.inf)
        rounding_p, rounding_r = linear.rounding(x)
        with suppress(OutOfTime, MemoryError), enforce_limits(self.solution.time_limit, self.solution.memory_limit):
            return perturbation_bound(linear, x, rounding_p + error, rounding_r)
        return None

    @cached_property
    @np.errstate(all="ignore")
    def _delta(self) -> Vector:
        """A bound on |z − z*|, shape (n,): the proved one, else an estimate, twice the size of Newton steps."""
        delta = self.solution.certificate.bound.componentwise
        if delta is not None:
            return delta
        problem = self.problem
        z = self.z
        active = self.pattern.active
        rounding_p, rounding_r = problem.rounding(z)
        F = np.where(active, np.abs(self.pattern.r) + rounding_r, np.abs(problem.p(z)) + rounding_p)
        # the contributions of the entries of F to a step may cancel, but not with every random weight
        weights = np.vstack([np.ones(z.size), np.random.default_rng(0).standard_normal((_RANDOM_WEIGHTS, z.size))])
        return 2.0 * np.linalg.norm([self._step(one * F) for one in weights], axis=0)

    def _step(self, F: Vector) -> Vector:
        """J⁻¹F, or F scaled to the units of z if J is singular."""
        try:
            return self.solve(F)
        except SingularOperator:
            return np.where(self.pattern.active, F, F / self.problem.matrix.weights)

    @cached_property
    @np.errstate(all="ignore")
    def _ties(self) -> Ties:
        """The undecided rows with p = r = 0 within `_delta`, for each obstacle."""
        problem = self.problem
        z = self.z
        delta = self._delta
        rounding_p, rounding_r = problem.rounding(z)
        max_distance = rounding_r + delta + abs(self._jacobian) @ delta
        candidates = self._undecided_rows & (np.abs(problem.p(z)) <= rounding_p + problem.matrix.absolute @ delta)
        below, above = (
            np.zeros_like(candidates) if r is None else candidates & (np.abs(r) <= max_distance)
            for r in (problem.r(z), problem.r_upper(z))
        )
        return Ties(below, above, delta)

    @cached_property
    def _undecided_rows(self) -> Mask:
        """The rows that are not proved to be at an obstacle or off it, a mask of shape (n,)."""
        return self.solution.active_set.undecided

    @cached_property
    def _tied_jumps(self) -> Mask:
        """The rows that are or may be active and where ψ may have another derivative at z*, such as at tied jumps."""
        delta = self.solution.certificate.bound.componentwise
        tied = np.zeros_like(self._undecided_rows)
        for psi, rows in zip(sides_of(self.problem.psi), self.pattern.sides(), strict=True):
            if delta is not None:
                tied |= (rows | self._undecided_rows) & psi.nonsmooth_rows(self.z, delta)
        return tied

    @cached_property
    def _misplaced_rows(self) -> Mask:
        """The rows whose proved side is not that of `pattern`: z is too far from z*."""
        known = self.solution.active_set
        pattern = self.pattern
        proved = [known.active] if known.above is None else [known.active, known.above]
        misplaced = known.inactive & pattern.active
        for rows, at in zip(proved, pattern.sides(), strict=True):
            misplaced |= rows & ~at
        return misplaced

    @cached_property
    def undecided(self) -> NDArray[np.intp]:
        """Rows, shape (k,), in which p = r = 0 or two equally good jumps cannot be excluded, or z* has another side.

        Examples
        --------
        >>> Derivative(ICP([[1.0]], [0.0]).solve()).undecided
        array([0])
        """
        return np.flatnonzero(self._undecided_rows | self._tied_jumps | self._misplaced_rows)

    @property
    def certain(self) -> bool:
        """Whether it is proved that z* has this derivative.

        For a user's function three things are assumed, not proved: ψ and its derivative are what
        the user says, and ψ is continuously differentiable as far as z* may be from z. The same
        holds for f and its slopes. `reason` says so.

        Examples
        --------
        >>> Derivative(ICP([[1.0]], [0.0]).solve()).certain
        False
        """
        return self.undecided.size == 0

    @property
    def reason(self) -> str:
        """Why the derivative is certain, or what it is instead, in a sentence.

        Examples
        --------
        >>> print(Derivative(ICP([[1.0]], [0.0]).solve()).reason)
        p = r = 0 cannot be excluded in row 0: an element of the B-subdifferential, see one_sided
        """
        bound = self.solution.certificate.bound
        if bound.value is None:
            return f"no row is decided, as there is no error bound: {bound.reason}"
        if self._misplaced_rows.any():
            row = int(np.argmax(self._misplaced_rows))
            return f"z is too far from z*: row {row} of z* has another active set; solve to a smaller tolerance"
        element = "an element of the B-subdifferential, see one_sided"
        if self._undecided_rows.any():
            return f"p = r = 0 cannot be excluded in {_row_names(self._undecided_rows)}: {element}"
        if self._tied_jumps.any():
            return f"two equally good jumps cannot be excluded in {_row_names(self._tied_jumps)}: {element}"
        smooth = "continuously differentiable where z* may be"
        assumed = f"{ASSUMED_PSI} and {smooth}" if self.problem.psi.calls_user_code else ""
        if self.solution.problem.f is not None:
            assumed += f"{ASSUMED_F}, and is {smooth}"
        return f"every row is proved to be at an obstacle or off it{assumed}"

    def __str__(self) -> str:
        active = self.pattern.active
        rows = {
            "derivative of": repr(self.problem),
            "equations": f"{np.count_nonzero(~active)} with Az + q = 0, {np.count_nonzero(active)} with z = psi(z)",
            "certain": "yes" if self.certain else "no",
            "because" if self.certain else "instead": self.reason,
        }
        return str(Card(rows))

    def __repr__(self) -> str:
        return f"Derivative({self.problem!r}, {np.count_nonzero(~self.pattern.active)} free rows)"


def _row_names(mask: Mask) -> str:
    """The rows of `mask` in words, the first ones by number."""
    rows = np.flatnonzero(mask)
    return f"row{'s' if rows.size > 1 else ''} {listed(rows.tolist())}"
