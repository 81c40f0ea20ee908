"""The proximal method: A is made definite by a multiple of a diagonal, which falls while the centre moves.

    zᵏ⁺¹ solves the LCP(A + μ_k W, q − μ_k W zᵏ),    W a positive diagonal in the units of p/z,

or with an upper obstacle, or obstacles that move, the problem with these.

Newton's method on the modulus equation with Ω = (1 + μ_k)W solves each subproblem in a few steps, if μ_k is large
enough. μ adapts: it falls after every subproblem, and to almost 0 after a quick first one, from where Newton's steps
for the LCP itself mostly converge. It grows where Newton's steps do not converge; these are then discarded. A
subproblem ends as soon as its residual is at most `INNER_REDUCTION` of that of the LCP.

**Convergence.** Where A is monotone (xᵀAx ≥ 0 for all x) and there is a solution, zᵏ converges to one. This holds for
all 0 < μ_k ≤ μ and for errors of the steps with a finite sum: see `theory.convergence.proximal_point`. For large μ the
matrix A + μW is diagonally dominant, and Newton's steps converge: there is always a μ that works.

**Negative curvature.** Where sᵀAs < 0 is observed for a step s, A is not monotone. D = μ_k W + κ_k V then replaces
μ_k W. V is W in the rows of A + Aᵀ that are not 0; it is 0 elsewhere, as in the rows of multipliers. κ begins as
−sᵀAs/sᵀVs and is halved after every subproblem. It grows where Newton's steps do not converge, and where
dᵀAd < −κ dᵀVd for the step d = zᵏ⁺¹ − zᵏ of a subproblem. These are then discarded.

Let A be symmetric and the obstacles fixed. As zᵏ is feasible, (p(zᵏ⁺¹) + Dd)ᵀd ≤ 0 for the exact solution of a
subproblem. So f(z) = ½zᵀAz + qᵀz falls by at least dᵀDd + ½dᵀAd ≥ ½κ dᵀVd. Every κ ≥ −λ_min(V^(-½)AV^(-½)) will do.
Between two finite obstacles f is bounded below. So the steps tend to 0 while κ does not, and then zᵏ tends to the
solutions. For A = [P −Gᵀ; G 0] the same holds of ½xᵀPx + cᵀx where the constraints are met.

Where the obstacle moves, the problem for large μ is nearly z = max(ψ(z), zᵏ), which has one solution if ψ contracts.
Where zᵏ⁺¹ = zᵏ, zᵏ is a solution of the ICP. That zᵏ converges is not proved.
"""

from __future__ import annotations

from collections.abc import Iterator
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..algebra.equations import Pattern
from ..algebra.factor_costs import newton_cost
from ..algebra.proximal_steps import ProximalSteps
from ..algebra.regularised_system import MIN_REGULARISATION, first_regularisation
from ..algebra.steps import INNER_REDUCTION, MAX_IDLE_STEPS
from ..algebra.subproblems import with_fixed_obstacle
from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Vector, norm
from ..numerics.sparse_structure import ROUNDING_RTOL, absolute
from ..problem.data import ProblemData
from ..problem.two_sided import mid
from ..theory.certificates.recession import Recession
from .contract import PATIENCE, Infeasible, Iterate, LeastValue, Method, with_options

#: the first μ, in units of W, and its factor after a subproblem; μ is divided by it if the steps of a subproblem do not
#: reduce its residual
_FIRST_SHIFT = 0.1
_DECREASE = 0.2
#: the largest number of steps of a quick subproblem
_QUICK_STEPS = 3


class Regularised(Method):
    """The common base of the methods that add a small diagonal to A."""

    family: ClassVar[str] = "modulus"
    finite: ClassVar[bool] = True

    def why_not(self, problem: ProblemData) -> str | None:
        return None if problem.facts.has_fixed_obstacle else problem.psi.no_derivative()


@with_options
class Proximal(Regularised):
    """The proximal-point method: z⁺ solves the LCP(A + μW, q − μWz) by Newton's method, an iterate per step.

    It is made for monotone A (xᵀAx ≥ 0), symmetric or not, singular or with a zero diagonal: contact
    with redundant constraints, equilibria, linear and quadratic programs with their duals. μ falls
    from 0.1, in units W of A.

    Notes
    -----
    Where the obstacle is fixed (see `with_fixed_obstacle`) and there is a solution, it converges to
    one, without any condition of nondegeneracy. Where there is none the iterates are not bounded.
    Their direction is tried as a proof, and the method raises `Infeasible` or ends. An obstacle that
    moves with other unknowns is followed by its derivative; then nothing is proved.

    Where sᵀAs < 0 is observed for a step s, A is not monotone. Rows of A + Aᵀ that are not 0 then get
    a larger diagonal, so large that for symmetric A every step reduces ½zᵀAz + qᵀz: a point where
    that has no descent is a solution. So nonconvex quadratic programs are solved as well.

    It ends where a hundred steps do not reduce the residual by a tenth, or a hundred subproblems where
    A is not monotone. Units of z and p have no influence on the path where A is symmetric, and little
    where it is not.

    References
    ----------
    Rockafellar, SIAM J. Control Optim. 14 (1976). Luque, SIAM J. Control Optim. 22 (1984), for the
    rate. Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), for the inner steps.

    Examples
    --------
    >>> ICP([[1, 1], [1, 1]], [-1, -1]).solve(Proximal()).z.round(6)
    array([0.5, 0.5])
    """

    name: ClassVar[str] = "proximal"

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # never raises SingularOperator
        yield z, None
        fixed = with_fixed_obstacle(problem)
        path = ProximalPath(fixed, z)
        recession: Recession | None = None
        while path.advance():
            yield path.z, path.residual if fixed is problem else None
            recession = recession or Recession(fixed, path.z)
            if (answer := recession.proof(path.z)).holds:
                raise Infeasible(answer)


#: z, p, z − ψ and z − ψ̄, None where there is no upper obstacle
Point = tuple[Vector, Vector, Vector, Vector | None]


class ProximalPath:
    """The iterate z with its p, r and z − ψ̄, the `centre` and μ (`shift`) of the subproblem, and its progress."""

    @np.errstate(all="ignore")
    def __init__(self, problem: ProblemData, z: Vector) -> None:
        self.problem = problem
        self.steps = ProximalSteps(problem, z)
        self.weights = problem.matrix.proximal_weights
        self.root = np.sqrt(self.weights)
        self._move(self._at(z, problem.p(z)))
        # κ, and the largest −sᵀAs/sᵀVs of a step s
        self.concave_shift = 0.0
        self.negative_curvature = 0.0
        self.last_solved_shift = 0.0
        # the residuals of the LCP
        self.residuals = LeastValue()
        self.step_cost = newton_cost(problem.facts) if self.steps.has_moving_obstacle else work.COSTS.newton
        self._begin(self.point, _FIRST_SHIFT)

    @cached_property
    def concave_weights(self) -> Vector:
        """V: W in the rows of A + Aᵀ that are not 0 up to rounding, and 0 in the others."""
        matrix = self.problem.matrix
        work.charge_matrices(matrix.nnz, 2)
        largest = absolute(matrix.sparse + matrix.sparse.T).max(axis=1).toarray().reshape(-1)
        return np.where(largest > ROUNDING_RTOL * matrix.rows.largest, self.weights, 0.0)

    @property
    @np.errstate(all="ignore")
    def residual(self) -> float:
        """Res_D(z)."""
        return self.problem.residual_of(self.p, self.r, self.r_upper)

    def size(self, p: Vector) -> float:
        """‖min(p, Wr)‖ in the units of W."""
        return norm(mid(p / self.root, self.r, self.r_upper, self.root))

    def subproblem_p(self) -> Vector:
        """p of the subproblem: p + D(z − centre)."""
        return self.p + self.diagonal * (self.z - self.centre[0])

    @np.errstate(all="ignore")
    def advance(self) -> bool:
        """Make one Newton step; False if no step is left."""
        residual = self.size(self.p)
        if not self.negative_curvature or self.inner_steps < 2:  # where f falls, the residual need not
            self.residuals.add(residual)
        work.count(self.step_cost)
        if residual == 0.0 or self.residuals.idle > MAX_IDLE_STEPS:
            return False
        inner_residual = self.size(self.subproblem_p())
        if self.inner_steps and inner_residual <= INNER_REDUCTION * residual:
            if self._observe_curvature(self.centre) > self.concave_shift:
                self._enlarge_concave_shift()
                self._begin(self.centre, self.shift)
            else:
                self._begin_next()
        elif not (np.isfinite(inner_residual) and self.inner_residuals.add(inner_residual) <= PATIENCE):
            self._enlarge_shift()
        while not self._step():
            if not self.shift < 1.0 / MIN_REGULARISATION:
                return False
            self._enlarge_shift()
        self.inner_steps += 1
        return True

    def _begin_next(self) -> None:
        """Begin the next subproblem, with smaller shifts."""
        first = not self.last_solved_shift
        self.last_solved_shift = self.shift
        shift = max(_DECREASE * self.shift, MIN_REGULARISATION)
        if first and self.inner_steps <= _QUICK_STEPS and not self.negative_curvature:
            shift = first_regularisation(self.problem)
        self.concave_shift *= 0.5
        self._begin(self.point, shift)

    def _observe_curvature(self, before: Point) -> float:
        """−sᵀAs/sᵀVs for the step s from `before`, 0 unless it is above rounding; the largest is kept."""
        s = self.z - before[0]
        if not s @ (self.p - before[1]) < 0.0:
            return 0.0
        matrix = self.problem.matrix
        work.charge(2.0 * matrix.product_cost)
        value = -float(s @ matrix.product(s))
        rounding = ROUNDING_RTOL * float(np.abs(s) @ matrix.magnitude(s))
        square = float(s @ (self.concave_weights * s))
        curvature = value / square if value > rounding and square > 0.0 else 0.0
        self.negative_curvature = max(self.negative_curvature, curvature)
        return curvature

    def _enlarge_concave_shift(self) -> None:
        """Make κ larger, at least the largest curvature observed."""
        self.concave_shift = max(self.concave_shift / _DECREASE, self.negative_curvature)

    def _enlarge_shift(self) -> None:
        """Begin the subproblem again with a larger μ, at least the one that follows the last solved subproblem."""
        self._enlarge_concave_shift()
        self._begin(self.centre, max(self.shift / _DECREASE, _DECREASE * self.last_solved_shift))

    def _at(self, z: Vector, p: Vector) -> Point:
        return z, p, self.problem.r(z), self.problem.r_upper(z)

    def _move(self, point: Point) -> None:
        self.point = self.z, self.p, self.r, self.r_upper = point

    def _begin(self, centre: Point, shift: float) -> None:
        """Begin a subproblem at its `centre`, with μ = `shift`."""
        self._move(centre)
        self.centre = centre
        self.shift = shift
        # D
        self.diagonal = shift * self.weights
        if self.concave_shift:
            self.diagonal = self.diagonal + self.concave_shift * self.concave_weights
        self.inner_steps = 0
        self.inner_residuals = LeastValue(self.size(self.p))

    def _step(self) -> bool:
        """Make the Newton step: z = ψ(z) in active rows, the p of the subproblem 0 in the others; False if it fails."""
        pattern = Pattern.of(self.r, self.r_upper, self.subproblem_p() / (self.weights + self.diagonal))
        try:
            moved = self.steps.step(self.z, self.p, pattern, self.centre[0], self.diagonal)
            if moved is None:
                return False
            before = self.point
            self._move(self._at(*moved))
            self._observe_curvature(before)
        except MapError:
            return False
        return bool(np.isfinite(self.size(self.p)))
