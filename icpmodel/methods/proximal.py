"""The proximal method: A is made definite by a multiple of a diagonal, which falls while the centre moves.

    zᵏ⁺¹ solves the LCP(A + μ_k W, q − μ_k W zᵏ),    W a positive diagonal in the units of p/z,

or with an obstacle above, or obstacles that move, the problem with these.

Newton's method on the modulus equation with Ω = (1 + μ_k)W finds the solution of each of these problems in a few steps
from zᵏ if μ_k is large enough. How large that is shows on the way: μ falls after every problem that was done, the more
the quicker that went, and grows where Newton's steps wander, which then count as not made. After the first problem,
where that went quickly, next to nothing is left of μ: from there Newton's steps for the LCP itself mostly lead on. A
problem is left as soon as its residual is a share of that of the LCP. Where they have cost as much as those of
`Interior` would, without an end in sight, these are tried, once: so both together cost about twice what the interior
does, or twice what the others would have.

Where A is monotone (xᵀAx ≥ 0 for all x) and there is a solution, zᵏ converges to one, for all 0 < μ_k ≤ μ and errors of
the steps that have a finite sum: see `theory.convergence.proximal_point`. A + μW with a large μ is dominated by its
diagonal, and then Newton's steps do not wander: there is always a μ that leads on. Where the obstacle moves, for large
μ the problem is nearly z = max(ψ(z), zᵏ), which has one solution if ψ contracts, and where zᵏ⁺¹ = zᵏ that is one of the
ICP; that zᵏ converges is not proved.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np

from ..algebra.active_equations import Elimination
from ..algebra.equations import Pattern, ShiftedEquations, derivative, shifted_cost, system_cost
from ..algebra.subproblems import with_fixed_obstacle
from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Vector, inner, norm
from ..numerics.equilibration import balanced
from ..problem.between import mid
from ..problem.data import ProblemData
from ..problem.facts import Facts
from ..theory.certificates.infeasible import infeasible
from .contract import Estimate, Infeasible, Iterate, Method
from .interior import Interior, Least

#: the first μ, in units of W, and what is left of it after a problem that took at most `_QUICK` steps, or more
_FIRST, _FALLS, _FALLS_SLOWLY, _QUICK = 0.1, 0.2, 0.5, 3
#: so many steps may pass without a reduction of the subproblem's residual by a tenth; then μ grows by this factor
_PATIENCE, _GROWS = 5, 5.0
#: a problem is done where its residual is below this share of that of the LCP
_SHARE = 0.1
#: smaller shifts do nothing to the pivots
_LEAST = 1e-12
#: μ after the first problem: where A is singular rounding over μ is what the iterates drift by, and where A is not
#: symmetric pivots may be the square of μ
_NEXT, _NEXT_SKEW = 1e-10, 1e-6
#: the steps that it takes through the interior, as a rule: once the others have cost as much, and do not end quickly,
#: these take their place
_INTERIOR = 16
#: so many steps without a better iterate are the last ones, but for those through the interior
_LAST = 100
#: the relative residual up to which a solve counts as one
_BACKWARD = 1e-6
#: of a direction y to infinity, entries that are a smaller share of the largest are what else has moved; and what of
#: |A|ᵀ|y| counts as 0 in Aᵀy, which fractions then judge
_LARGE, _ROUNDED = 1e-6, 1e-6


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Proximal(Method):
    """z⁺ solves the LCP(A + μW, q − μWz) by modulus Newton, an iterate per step; μ falls from 0.1, in units W of A.

    For monotone A (xᵀAx ≥ 0), definite or not, symmetric or not, with a zero diagonal or without: contact with
    redundant constraints, equilibria, linear and quadratic programs with their duals. Where the obstacle is fixed (see
    `with_fixed_obstacle`) and there is a solution it converges to one of them, and nothing like nondegeneracy is
    asked for; where there is none the iterates are not bounded, their direction is tried as a proof, and the method
    raises `Infeasible` or ends. An obstacle that moves with other unknowns is followed by its derivative; then nothing
    is proved. It ends as well where a hundred steps do not reduce the residual by a tenth. Units of z and p have no
    influence on the path where A is symmetric, and little where it is not.
    References: Rockafellar, SIAM J. Control Optim. 14 (1976); Luque, SIAM J. Control Optim. 22 (1984), for the rate;
    Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), for the inner steps.

    >>> ICP([[1, 1], [1, 1]], [-1, -1]).solve(Proximal()).z.round(6)
    array([0.5, 0.5])
    """

    name: ClassVar[str] = "proximal"
    family: ClassVar[str] = "modulus"
    memoryless: ClassVar[bool] = False
    finite: ClassVar[bool] = True

    def why_not(self, problem: ProblemData) -> str | None:
        return None if problem.facts.has_fixed_obstacle else problem.psi.no_derivative()

    def estimate(self, facts: Facts, aim: float) -> Estimate:
        # medians of 6 and 10 steps were measured at n = 120 and 1000 where there is a diagonal, of 16 and 29 where
        # there is none, as in linear programs
        matrix = facts.matrix
        if facts.has_fixed_obstacle:
            system, memory = shifted_cost(matrix)
            step = work.COSTS.newton + system
        else:
            system, memory = system_cost(matrix, matrix.unsymmetric_cost, 12.0 * matrix.fill.entries)
            step = facts.newton_cost + system
        steps = (1.0 if matrix.has_positive_diagonal else 2.0) * (3.0 + math.log2(max(facts.bounded, 1)))
        step /= matrix.unit
        return Estimate(step, step, steps, memory)

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # never raises SingularOperator
        yield z, None
        simple = with_fixed_obstacle(problem)
        path = ProximalPath(simple, z)
        while path.advance():
            yield path.z, path.residual if simple is problem else None
        if path.runs_away and (answer := infeasible(simple, path.z - z)).holds:
            raise Infeasible(answer)


#: z, p, and z less the obstacle below and the one above, None where there is none
Point = tuple[Vector, Vector, Vector, Vector | None]


class ProximalPath:
    """The run: z with p, the `centre` of the subproblem with its p, and what its steps have come to."""

    @np.errstate(all="ignore")
    def __init__(self, problem: ProblemData, z: Vector) -> None:
        self.problem, self.start, self.moves = problem, z, not problem.facts.has_fixed_obstacle
        # W, in the units of which the entries of A are about 1: D where A is symmetric
        matrix = problem.matrix
        self.weights = matrix.weights if matrix.is_nearly_symmetric else balanced(matrix.sparse)
        self.root = np.sqrt(self.weights)
        self._move(self._at(z, problem.p(z)))
        self.centre = self.point
        self.shift, self.made, self.equations = _FIRST, 0, ShiftedEquations(problem)
        self.done = 0.0  # the μ of the last problem that was done
        # the residuals of the LCP, and of the subproblem
        self.residuals, self.own = Least(), Least()
        self.inside: Interior | None = None
        # what steps have cost, and what one costs without its equations
        self.steps, self.spent, self.was_inside = 0, 0.0, False
        self.own_cost = problem.facts.newton_cost if self.moves else work.COSTS.newton

    @property
    @np.errstate(all="ignore")
    def residual(self) -> float:
        """Res(z)."""
        return norm(mid(self.p, self.r, self.above))

    @property
    def is_dear(self) -> bool:
        """Whether the steps have cost what the way through the interior does, as a rule: after an obstacle that moves
        the equations are much the same there."""
        if self.moves:
            return self.steps >= _INTERIOR
        matrix = self.problem.matrix
        if self.spent < self.own_cost + matrix.again_cost:
            return False  # nor is it worth a further look
        fill = self.equations.look.fill
        inside = self.own_cost + min(matrix.again_cost, work.factor_cost(fill)) + 4.0 * work.solve_cost(fill)
        return self.spent >= _INTERIOR * inside

    @cached_property
    def obstacles(self) -> tuple[Vector, Vector | None]:
        """ψ and ψ̄ at the start, None where there is none above."""
        upper = self.problem.upper
        return self.problem.psi.value(self.start), None if upper is None else upper.value(self.start)

    @cached_property
    def resting(self) -> tuple[Vector, Vector]:
        """(c, Ac + q) with 0, or what is nearest to it and not above, for the rows without obstacle below."""
        c, top = self.obstacles
        c = np.where(np.isneginf(c), 0.0 if top is None else np.minimum(top, 0.0), c)
        return c, self.problem.p(c)

    @property
    def runs_away(self) -> bool:
        """Whether the largest entries of y, the way from the start, have Aᵀy ≤ 0, as far as floats tell, and lead down,
        where nothing is above."""
        if self.moves or self.problem.upper is not None:
            return False
        y = self.z - self.start
        y = np.where(np.abs(y) > _LARGE * np.abs(y).max(), y, 0.0)
        image, size = self.problem.A.T @ y, self.problem.matrix.absolute.T @ np.abs(y)
        return bool((image <= _ROUNDED * size).all() and inner(self.resting[1], y) < 0)

    def size(self, p: Vector) -> float:
        """‖min(p, Wr)‖ in the units of W."""
        above = None if self.above is None else self.root * self.above
        return norm(mid(p / self.root, self.root * self.r, above))

    def pull(self) -> Vector:
        """p of the subproblem: p + μW(z − centre)."""
        return self.p + self.shift * self.weights * (self.z - self.centre[0])

    @np.errstate(all="ignore")
    def advance(self) -> bool:
        """One Newton step, or False where nothing leads on."""
        whole = self.size(self.p)
        idle = self.residuals.add(whole)
        work.add(self.own_cost)
        self.steps, self.spent = self.steps + 1, self.spent + self.own_cost
        if whole == 0.0:
            return False
        if self.inside is not None:
            if self.inside.settled() and self._ends_by_signs(self.inside.steady):
                return True
            if idle <= _LAST and self.inside.leads_on(whole) and self.inside.advance():
                self._move(self.inside.point)
                return True
            self.inside, here, self.residuals.waited = None, self.point, 0
            self._begin(self.centre, self.shift)
            if whole < self.own.least:
                self._begin(here, self.shift)
        elif idle > _LAST:
            return not self.was_inside and not self.runs_away and self._goes_inside()
        own = self.size(self.pull())
        creeps = self.made > _QUICK
        if self.made and own <= _SHARE * whole:
            first, self.done = not self.done, self.shift
            shift = max((_FALLS_SLOWLY if creeps else _FALLS) * self.shift, _LEAST)
            if first and not creeps:
                shift = _NEXT if self.problem.matrix.is_nearly_symmetric else _NEXT_SKEW
            self._begin(self.point, shift)
        elif not (np.isfinite(own) and self.own.add(own) <= _PATIENCE):
            self._retreat()
        if creeps and not self.was_inside and self.is_dear:
            return self._goes_inside()
        while not self._step():
            if not self.shift < 1.0 / _LEAST:
                return False
            self._retreat()
        self.made += 1
        return True

    def _retreat(self) -> None:
        """The problem anew, with a larger μ: at least what follows the last one that was done as a rule."""
        self._begin(self.centre, max(_GROWS * self.shift, _FALLS * self.done))

    def _goes_inside(self) -> bool:
        """The first of the steps through the interior, which are tried once."""
        self.was_inside, self.residuals.waited = True, 0
        with suppress(MapError):
            self.inside = self.interior()
            # what they have to reduce is their own residual, which begins high, not the one that the others came to
            self._move(self.inside.point)
        return self.advance()

    def interior(self) -> Interior:
        """The way through the interior, from its beginning. Raises MapError where ψ fails there."""
        pattern = None if self.moves else self.equations.repeated or self.equations.look
        return Interior(self.problem, self.weights, self.obstacles, self.resting, pattern)

    def _ends_by_signs(self, shift: float) -> bool:
        """A step with the signs that the interior has settled on, which may be those of the solution; False where it
        fails. Centre and μ, to which the path comes back where the interior leads nowhere, stay as they are."""
        here, path = self.point, (self.centre, self.shift)
        self._begin(here, shift)
        moved = self._step()
        self.centre, self.shift = path
        if not moved:
            self._move(here)
        return moved

    def _at(self, z: Vector, p: Vector) -> Point:
        return z, p, self.problem.r(z), self.problem.r_upper(z)

    def _move(self, point: Point) -> None:
        self.point = self.z, self.p, self.r, self.above = point

    def _begin(self, centre: Point, shift: float) -> None:
        self._move(centre)
        self.centre, self.shift = centre, shift
        self.made, self.own = 0, Least(self.size(self.p))

    def _step(self) -> bool:
        """The active rows rest on the obstacle, in the others the p of the subproblem is 0; False where that fails."""
        pull, begun = self.pull(), work.done()
        pattern = Pattern.of(self.r, self.above, pull / ((1.0 + self.shift) * self.weights))
        try:
            moved = self._newton_step(pattern, pull) if self.moves else self._resting_step(pattern)
            if moved is None:
                return False
            self._move(self._at(*moved))
        except MapError:
            return False
        finally:
            self.spent += work.done() - begun
        return bool(np.isfinite(self.size(self.p)))

    def _newton_step(self, pattern: Pattern, pull: Vector) -> tuple[Vector, Vector] | None:
        """z and p after one that follows the obstacle, None where it fails."""
        J, shift = derivative(self.problem.psi, self.z, pattern.above), self.shift * self.weights
        equations = Elimination(self.problem, pattern.active, J, shift)
        step = equations.solve(-np.where(pattern.active, pattern.r, pull), _BACKWARD, transposed=False)
        return None if step is None else (self.z + step, self.problem.p(self.z + step))

    def _resting_step(self, pattern: Pattern) -> tuple[Vector, Vector] | None:
        """The same where the obstacle is fixed."""
        active = pattern.active
        c, top = self.obstacles
        z = np.where(active, c, self.z)
        if pattern.above is not None and top is not None:
            z = np.where(pattern.above, top, z)
        if not active.all():
            D = self.shift * self.weights
            f = D * (self.centre[0] - z) - self.problem.p(z)
            # where signs that the interior has settled on make a matrix that is nearly singular, it goes on
            x = self.equations.solve(~active, D, f, _BACKWARD, briefly=self.inside is not None)
            if x is None:
                return None
            z += x
        return z, self.problem.p(z)
