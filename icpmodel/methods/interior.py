"""The interior-point method: Newton steps on the modulus equation with a smoothed modulus.

With √(x² + 4ε²) in place of |x| both r and s are positive, rs = ε², and ε falls. As z converges to the solution, s
converges to p and r to z − ψ(z). An upper obstacle has an r and an s of its own: r₂ converges to ψ̄(z) − z, and s₁ − s₂
to p. At the start r and s solve the equations with Wr + s = 0, and are shifted to be positive.

Each step is a proximal one with the current z as centre: a multiple of W is added to A. Where A is symmetric up to the
signs of its rows, as in optimality conditions, rows of one sign are primal unknowns and the others multipliers. Primal
and dual steps then have lengths of their own, α and β. A block H of A in the primal rows then leaves a difference
(α − β)H dx between s and p, which the next step corrects. As soon as the signs of s − Wr repeat, a step with these
signs is tried as the answer: r = 0 or p = 0 in every row.

The predictor has dr/r + ds/s = −1, so that dr ds ≤ rs/4, but nothing bounds dr ds from below. Where s has to grow many
times over, the corrector would make r grow as much, and all rows would take the short step that this row allows. So
dr ds is bounded from below, by μ and by the sizes of r and s. The sizes include the distances from z − ψ(z) and p,
because r and s have to grow where there is no solution.

References: Mehrotra, SIAM J. Optim. 2 (1992), for the start and the choice of ε; Friedlander and Orban, Math. Program.
Comput. 4 (2012), for the proximal terms; Wright, Primal-Dual Interior-Point Methods (1997), for the two lengths;
Gondzio, Comput. Optim. Appl. 6 (1996), for bounds of corrections.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from typing import ClassVar

import numpy as np

from ..algebra.equations import Pattern, derivative
from ..algebra.factor_costs import interior_cost
from ..algebra.proximal_steps import ProximalSteps
from ..algebra.regularised_system import MIN_REGULARISATION, RegularisedSystem, Solve
from ..algebra.subproblems import with_fixed_obstacle, without_redundant_rows
from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Mask, Vector, inner, norm
from ..numerics.condensed import CondensedFactors
from ..numerics.equilibration import times_rows
from ..numerics.fill import SymbolicAnalysis
from ..numerics.linear import MAX_BACKWARD_ERROR
from ..numerics.symmetric_factors import SymmetricFactors
from ..problem.data import ProblemData
from ..problem.two_sided import mid
from ..theory.certificates.recession import Recession
from .contract import Infeasible, Iterate, LeastValue, with_options
from .proximal import Regularised

#: the largest number of steps in which z does not grow, and the residual and the infeasibility of r and s do not fall
_PATIENCE = 20
#: a step goes this share of the way to the boundary
_BOUNDARY_SHARE = 0.995
#: Gondzio's bound: the second-order term is at least minus this multiple of the size of rs, or of the mean μ if larger
_MAX_CORRECTION = 10.0
#: the starting r and s are shifted by this multiple of their negative part at least
_SHIFT = 1.5


@with_options
class Interior(Regularised):
    """The interior-point method: Newton steps with √(x² + 4ε²) for |x| and falling ε, without an active set.

    For the problems of `Proximal` whose active set changes often or row by row: redundant contacts in two and three
    dimensions, plates, programs and equilibria. The number of steps, 10 to 30 as a rule, hardly depends on n. Where A
    is monotone and there is no solution, the iterates diverge. Their direction is tried as a proof, and the method
    raises `Infeasible` or ends. Convergence is not proved. If the obstacle is fixed, the start has no influence.

    References
    ----------
    Mehrotra, SIAM J. Optim. 2 (1992); Wright, Primal-Dual Interior-Point Methods (1997).

    Examples
    --------
    >>> round(float(ICP([[1, 1], [1, 1]], [-1, -1]).solve(Interior()).z.sum()), 9)
    1.0
    """

    name: ClassVar[str] = "interior"

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # never raises SingularOperator
        yield z, None
        fixed = with_fixed_obstacle(problem)
        interior = without_redundant_rows(fixed)  # a fixed unknown has none
        try:
            path = InteriorPath(interior, z)
        except MapError:
            return
        recession = Recession(fixed, path.z)
        while True:
            yield path.z, None
            if not path.makes_progress():
                return
            if path.infeasibilities.idle and (answer := recession.proof(path.z)).holds:
                raise Infeasible(answer)
            if path.signs_repeat() and (solution := path.step_by_signs()) is not None:
                yield solution, None
            if not path.advance():
                return


class InteriorPath:
    """The state of a run: z, p and z − ψ(z), and r and s for every obstacle, the lower ones first.

    Parameters
    ----------
    problem
        The problem, its obstacles fixed where they can be.
    start
        The point, shape (n,), at which moving obstacles are first evaluated.

    Raises
    ------
    MapError
        Where ψ fails at the start.
    """

    @np.errstate(all="ignore")
    def __init__(self, problem: ProblemData, start: Vector) -> None:
        self.problem = problem
        self.steps = ProximalSteps(problem, start, reorders=False)
        self.has_moving_obstacle = self.steps.has_moving_obstacle
        analysis: SymmetricFactors | CondensedFactors | SymbolicAnalysis | None = None
        #: the other rows are dual; the signs of rows that do not depend on each other are arbitrary
        self.is_primal: Mask = np.ones(problem.n, bool)
        if not self.has_moving_obstacle:
            costs = self.steps.costs
            if (signs := costs.analysis.signs) is not None:
                self.is_primal = signs > 0
            if costs.condensed < np.inf:
                analysis = CondensedFactors(problem.A, self.is_primal)
            else:
                analysis = self.steps.fixed_order_factors or costs.analysis
        self.weights = problem.matrix.proximal_weights
        self.root = np.sqrt(self.weights)
        self.system = RegularisedSystem(problem, analysis, self.weights)
        self.residuals = LeastValue()
        self.infeasibilities = LeastValue()
        self.inverse_sizes = LeastValue()
        self.signs = np.zeros(0, bool)
        self.repetitions = 0
        lower, upper = self.steps.obstacles
        # in rows without a lower obstacle 0, or the upper one where that is below 0
        c = np.where(np.isneginf(lower), 0.0 if upper is None else np.minimum(upper, 0.0), lower)
        #: the rows with a lower and those with an upper obstacle, to which r and s belong
        self.sides = [np.flatnonzero(np.isfinite(side)) for side in (lower, upper) if side is not None]
        self.rows = np.concatenate(self.sides)
        self.sign = np.repeat([1.0, -1.0][: len(self.sides)], [rows.size for rows in self.sides])
        is_primal_r = self.is_primal[self.rows]
        #: for r and s: whether the step is a primal one; where all signs are equal there is no other
        self.is_primal_step = np.array([is_primal_r, is_primal_r if self.is_primal.all() else ~is_primal_r])
        self._start(c)

    def _start(self, c: Vector) -> None:
        """Mehrotra's starting point: r and s solve the equations with Wr + s = 0, and are shifted to be positive.

        The shift is at least the mean size of z, since steps from smaller r and s would be short.
        """
        weights = self.weights[self.rows]
        self.r = np.ones(weights.size)
        self.s = weights
        self._move_to(c)
        distances = self._distances()
        z = c + self._solver()(-self.point[1] - self._in_rows(self.sign * weights * distances), MAX_BACKWARD_ERROR)
        root = self.root[self.rows]
        v = root * (distances + self._distance_change(z - c))
        sizes = self.problem.matrix.absolute
        coupled = np.asarray(sizes.sum(axis=1)) > np.asarray(sizes.diagonal())  # fixed unknowns are not
        size = norm(self.root * z * coupled) / max(int(np.count_nonzero(coupled)), 1) ** 0.5
        r = v + np.max(-_SHIFT * v, initial=size)
        s = np.max(_SHIFT * v, initial=size) - v
        product = 0.5 * inner(r, s)
        self.r = (r + (product / s.sum() if product else 1.0)) / root
        self.s = (s + (product / r.sum() if product else 1.0)) * root
        self._move_to(z)

    @property
    def z(self) -> Vector:
        """The current iterate."""
        return self.point[0]

    @property
    def dual_residual(self) -> Vector:
        """s − p in every row, with s₁ − s₂ where there are two obstacles."""
        return self._in_rows(self.sign * self.s) - self.point[1]

    def _in_rows(self, x: Vector) -> Vector:
        """The sum of `x` over the obstacles of each row."""
        return np.asarray(np.bincount(self.rows, x, self.problem.n), dtype=np.float64)

    def _distances(self) -> Vector:
        """z − ψ(z), and ψ̄(z) − z, in the rows of r and s."""
        _, _, r, r_upper = self.point
        distances = r[self.sides[0]]
        return distances if r_upper is None else np.concatenate([distances, -r_upper[self.sides[1]]])

    def _distance_change(self, dz: Vector) -> Vector:
        """The change of the distances from the obstacles along `dz`."""
        if not self.has_moving_obstacle:
            return self.sign * dz[self.rows]
        pairs = zip(self.slopes, self.sides, strict=True)
        return self.sign * np.concatenate([(dz - J @ dz)[rows] for J, rows in pairs])

    @np.errstate(all="ignore")
    def makes_progress(self) -> bool:
        """Whether the residual is not 0, and it or the distance of r and s from z − ψ(z) and p was reduced lately.

        Neither need fall while z grows: multipliers are large, or there is no solution.
        """
        _, p, r, r_upper = self.point
        residual = norm(mid(p / self.root, r, r_upper, self.root))
        infeasibility = norm(np.concatenate([self.dual_residual / self.root, self.root[self.rows] * self.gap]))
        size = norm(self.root * self.z)
        growth = self.inverse_sizes.add(1.0 / size if size else np.inf)
        idle = min(growth, self.residuals.add(residual), self.infeasibilities.add(infeasibility))
        return residual > 0.0 and idle < _PATIENCE and infeasibility < np.inf

    def signs_repeat(self) -> bool:
        """Whether the signs of the modulus have been the same for 1, 3, 7, … steps."""
        signs = self.s > self.weights[self.rows] * self.r
        self.repetitions = self.repetitions + 1 if np.array_equal(signs, self.signs) else 0
        self.signs = signs
        return self.repetitions > 0 and not self.repetitions & (self.repetitions + 1)

    @np.errstate(all="ignore")
    def step_by_signs(self) -> Vector | None:
        """z after a step with the signs of the modulus at z, None where its equations are not solved."""
        z, p, r, r_upper = self.point
        pattern = Pattern.of(r, r_upper, p / self.weights)
        with suppress(MapError):
            step = self.steps.step(z, p, pattern, z, MIN_REGULARISATION * self.weights)
            if step is not None and np.isfinite(step[1]).all():
                return step[0]
        return None

    @np.errstate(all="ignore")
    def advance(self) -> bool:
        """Make one step; False if it fails."""
        work.count(interior_cost(self.problem.facts))
        r = self.r
        s = self.s
        count = max(r.size, 1)
        mean_product = inner(r, s) / count
        while True:
            solve = self._solver()
            _, dr, ds = self._direction(solve, r * s)
            if self.system.adapt():
                break
        _, length_r, length_s = self._lengths(dr, ds, 1.0)
        mean_after = inner(r + length_r * dr, s + length_s * ds) / count
        sizes = (r + np.abs(self.gap)) * (s + np.abs(self.dual_residual[self.rows]))
        second_order = np.maximum(dr * ds, -_MAX_CORRECTION * np.maximum(sizes, mean_product))
        target = r * s + second_order - ((mean_after / mean_product) ** 3 * mean_product if mean_product else 0.0)
        dz, dr, ds = self._direction(solve, target)
        length_z, length_r, length_s = self._lengths(dr, ds, _BOUNDARY_SHARE)
        self.r = r + length_r * dr
        self.s = s + length_s * ds
        try:
            self._move_to(self.z + length_z * dz)
        except MapError:
            return False
        return bool(np.isfinite(np.concatenate([self.point[1], self.gap])).all())

    def _direction(self, solve: Solve, target: Vector) -> tuple[Vector, Vector, Vector]:
        """The step of z, r and s that reduces rs by `target`."""
        r = self.r
        s = self.s
        dz = solve(self.dual_residual - self._in_rows(self.sign * (target + s * self.gap) / r), MAX_BACKWARD_ERROR)
        dr = self._distance_change(dz) + self.gap
        return dz, dr, -(target + s * dr) / r

    def _lengths(self, dr: Vector, ds: Vector, share: float) -> tuple[Vector, Vector, Vector]:
        """The lengths of the steps of z, r and s: at most 1, and this share of the way to the boundary.

        There is one for r in primal rows and s in dual ones, and one for the others.
        """
        ratios = np.array([-dr / self.r, -ds / self.s])
        primal, dual = (
            share / np.max(ratios, where=group, initial=share) for group in (self.is_primal_step, ~self.is_primal_step)
        )
        length_r, length_s = np.where(self.is_primal_step, primal, dual)
        return np.where(self.is_primal, primal, dual), length_r, length_s

    def _move_to(self, z: Vector) -> None:
        """Set z with p, z − ψ(z) and z − ψ̄(z), their distances from r, and the derivatives of moving obstacles."""
        problem = self.problem
        self.point = z, problem.p(z), problem.r(z), problem.r_upper(z)
        self.gap = self._distances() - self.r  # updated by steps it would be rounding once r is below it
        if self.has_moving_obstacle:
            self.slopes = [derivative(psi, z) for psi in (problem.psi, problem.upper) if psi is not None]

    def _solver(self) -> Solve:
        """The solver of the system for dz at the current r, s and slopes of the obstacles."""
        slopes = self.s / self.r
        if not self.has_moving_obstacle:
            return self.system.solver(self._in_rows(slopes))
        terms = zip(self.slopes, self.sides, np.split(slopes, [self.sides[0].size]), strict=False)
        n = self.problem.n
        moved = sum(times_rows(np.bincount(rows, values, n).astype(np.float64), J) for J, rows, values in terms)
        return self.system.solver(self._in_rows(slopes), moved)
