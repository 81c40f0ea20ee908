"""The interior method: Newton's steps on the modulus equation with the modulus rounded off.

With √(x² + 4ε²) for |x| both r = z − ψ(z) and s = p are positive and rs = ε², and ε falls. s converges to p as z does
to the solution. r is z − ψ(z) where ψ is fixed, and converges to it where ψ moves. With an upper obstacle, r and s have
a second column for ψ̄(z) − z, and s₁ − s₂ converges to p.

Each step is a proximal one with its own z for centre: a multiple of W is added to A. It falls as long as the factors
remain accurate. As soon as the signs of s − Wr repeat, a step with these signs is tried as the answer: r = 0 or p = 0
in every row.

References: Mehrotra, SIAM J. Optim. 2 (1992), for the choice of ε; Friedlander and Orban, Math. Program. Comput. 4
(2012), for the proximal terms.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from ..algebra.equations import Pattern, derivative
from ..algebra.factor_costs import newton_cost
from ..algebra.proximal_steps import ProximalSteps
from ..algebra.subproblems import with_fixed_obstacle
from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Mask, Vector, inner, norm, row_of
from ..numerics.factorisation import factorise
from ..numerics.fill import SymbolicAnalysis
from ..numerics.symmetric_factors import Symmetric
from ..problem.affine import zero
from ..problem.data import ProblemData
from ..problem.two_sided import mid
from ..theory.certificates.recession import Recession
from .contract import Infeasible, Iterate, Least, Method

#: so many steps in a row may reduce neither the residual nor the way to where it is one
_PATIENCE = 20
#: what of W is added to A at first, and where A is not symmetric: entries are then not bounded by those of the
#: diagonal, and the square of what is added has to be above rounding, or pivots may come to 0; and the least that is
#: added where factors have been accurate with more, next to rounding
_FIRST_REGULARISATION = 1e-9
_FIRST_REGULARISATION_SKEW = 1e-7
_MIN_REGULARISATION = 1e-13
#: a tenth is added after a solve that has lost up to √ε of its right-hand side, a hundred times as much, and the solve
#: made again, where it has lost the root of that
_ACCURATE_SOLVE = 2.0**-26
_ROUGH_SOLVE = 2.0**-13
_REGULARISATION_DECREASE = 0.1
_REGULARISATION_INCREASE = 100.0
#: the share of the way to the boundary that is gone
_BOUNDARY_SHARE = 0.995
#: the least room between two obstacles, as a share of what rows with one have
_MIN_GAP = 1e-12


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Interior(Method):
    """Newton's steps with √(x² + 4ε²) for |x|, ε falling: all rows count, and no signs are sought.

    For the problems that `Proximal` is for, where its signs wander or are found one by one: redundant contacts in two
    and three dimensions, plates, programs and equilibria. The number of steps, 10 to 40 as a rule, hardly depends on n.
    Where A is monotone and there is no solution the iterates run away, their direction is tried as a proof, and the
    method raises `Infeasible` or ends. That the steps lead to a solution is not proved. The start has no influence
    where the obstacle is fixed.

    References
    ----------
    Mehrotra, SIAM J. Optim. 2 (1992); Wright, Primal-Dual Interior-Point Methods (1997).

    Examples
    --------
    >>> ICP([[1, 1], [1, 1]], [-1, -1]).solve(Interior()).z.round(6)
    array([0.5, 0.5])
    """

    name: ClassVar[str] = "interior"
    family: ClassVar[str] = "modulus"
    memoryless: ClassVar[bool] = False
    finite: ClassVar[bool] = True

    def why_not(self, problem: ProblemData) -> str | None:
        return None if problem.facts.has_fixed_obstacle else problem.psi.no_derivative()

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # never raises SingularOperator
        yield z, None
        simple = with_fixed_obstacle(problem)
        try:
            path = InteriorPath(simple, z)
        except MapError:
            return
        recession = Recession(simple)
        while True:
            yield path.z, None
            if not path.makes_progress():
                return
            if (answer := recession.proof(path.z - path.resting[0])).holds:
                raise Infeasible(answer)
            if path.signs_repeat() and (solution := path.by_signs()) is not None:
                yield solution, None
            if not path.advance():
                return


class InteriorPath:
    """The run: z with p and z − ψ(z), and r and s with the obstacles in columns.

    Parameters
    ----------
    problem
        The problem, its obstacles fixed where they can be.
    start
        Where obstacles that move are at first, shape (n,).

    Raises
    ------
    MapError
        Where ψ fails at the first place.
    """

    @np.errstate(all="ignore")
    def __init__(self, problem: ProblemData, start: Vector) -> None:
        self.problem = problem
        self.steps = ProximalSteps(problem, start)
        self.weights = problem.matrix.proximal_weights
        self.diagonal = problem.matrix.rows.diag
        self.moves = self.steps.moves
        self.pattern: Symmetric | SymbolicAnalysis | None = None
        if not self.moves:
            self.pattern = self.steps.equations.repeated or self.steps.equations.analysis
        self.regularisation = self.first_regularisation = (
            _FIRST_REGULARISATION if problem.matrix.is_nearly_symmetric else _FIRST_REGULARISATION_SKEW
        )
        self.least_regularisation = _MIN_REGULARISATION
        self.solve_error = 0.0
        self.root = np.sqrt(self.weights)
        self.residuals = Least()
        self.infeasibilities = Least()
        self.signs = np.zeros(0, bool)
        self.same = 0
        below, top = self.steps.obstacles
        c = np.where(np.isneginf(below), 0.0 if top is None else np.minimum(top, 0.0), below)
        p = problem.p(c)
        #: c with 0, or what is nearest to it and not above, for the rows without obstacle below, and p there
        self.resting = c, p
        bounded = ~np.isneginf(below)
        # in rows without obstacle p > 0 pulls at c as well
        size = float(np.abs((np.where(bounded, np.minimum(p, 0.0), p) if top is None else p) / self.root).max())
        if self.moves:  # where nothing pulls at c, c is no solution as yet
            size = max(size, float(np.max((self.root * np.abs(problem.r(c)))[bounded], initial=0.0))) or 1.0
        self._start(c, size, bounded, top)

    def _start(self, c: Vector, size: float, bounded: Mask, top: Vector | None) -> None:
        """So far from the obstacles, in the units of W, which is where p/W comes to."""
        r = size / self.root
        s = size * self.root
        z = c + np.where(bounded, r, 0.0)
        sides = [(bounded, r)]
        if top is not None:
            # in the middle where there is less room; rows that cannot move keep a trace of it
            has = np.isfinite(top)
            r = np.where(bounded & has, np.clip(0.5 * (top - c), _MIN_GAP * r, r), r)
            z = np.where(bounded, c + r, np.where(has, np.minimum(c, top - r), c))
            sides = [(bounded, r), (has, np.maximum(top - z, r))]
        self.bounded = np.column_stack([has for has, _ in sides])
        self.r = np.where(self.bounded, np.column_stack([r for _, r in sides]), 1.0)
        self.s = np.where(self.bounded, s[:, None], 0.0)
        self.sign = np.array([1.0, -1.0])[: len(sides)]
        self.gap = np.zeros_like(self.r)
        self.slopes = [zero(self.problem.n)] * len(sides)
        self._move_to(z)

    @property
    def z(self) -> Vector:
        """Where it has come to."""
        return self.point[0]

    @property
    def rest(self) -> Vector:
        """How far s is from p."""
        return np.asarray(self.s @ self.sign - self.point[1])

    @np.errstate(all="ignore")
    def makes_progress(self) -> bool:
        """Whether the residual, or the way of r and s to z − ψ(z) and p, was reduced not long ago, and is not 0."""
        _, p, below, above = self.point
        whole = norm(mid(p / self.root, self.root * below, None if above is None else self.root * above))
        way = norm(self.rest / self.root) + norm((self.root[:, None] * self.gap).ravel())
        return whole > 0.0 and min(self.residuals.add(whole), self.infeasibilities.add(way)) < _PATIENCE

    def signs_repeat(self) -> bool:
        """Whether the signs of the modulus have been the same for 1, 3, 7, … steps."""
        signs = self.s > self.weights[:, None] * self.r
        self.same = self.same + 1 if np.array_equal(signs, self.signs) else 0
        self.signs = signs
        return self.same > 0 and not self.same & (self.same + 1)

    @np.errstate(all="ignore")
    def by_signs(self) -> Vector | None:
        """z after a step with the signs of the modulus at z, None where its equations are not solved."""
        z, p, below, above = self.point
        pattern = Pattern.of(below, above, p / self.weights)
        with suppress(MapError):
            step = self.steps.step(z, p, pattern, z, self.regularisation * self.weights, briefly=True)
            if step is not None and np.isfinite(step[1]).all():
                return step[0]
        return None

    @np.errstate(all="ignore")
    def advance(self) -> bool:
        """One step, False where it fails."""
        work.count(newton_cost(self.problem.facts))
        r = self.r
        s = self.s
        both = max(int(np.count_nonzero(self.bounded)), 1)
        size = inner(r.ravel(), s.ravel()) / both
        while True:
            solve = self._solver()
            _, dr, ds, longest = self._direction(solve, r * s)
            if self.solve_error <= _ROUGH_SOLVE or self.regularisation >= self.first_regularisation:
                break
            self.regularisation = self.least_regularisation = min(
                _REGULARISATION_INCREASE * self.regularisation, self.first_regularisation
            )
        if self.solve_error <= _ACCURATE_SOLVE:
            self.regularisation = max(_REGULARISATION_DECREASE * self.regularisation, self.least_regularisation)
        t = 1.0 / max(longest, 1.0)
        after = inner(np.where(self.bounded, r + t * dr, 0.0).ravel(), (s + t * ds).ravel()) / both
        target = r * s + dr * ds - ((after / size) ** 3 * size if size else 0.0)
        dz, dr, ds, longest = self._direction(solve, target)
        t = 1.0 / max(longest / _BOUNDARY_SHARE, 1.0)
        self.r = np.where(self.bounded, r + t * dr, 1.0)
        self.s = s + t * ds
        try:
            self._move_to(self.z + t * dz)
        except MapError:
            return False
        return bool(np.isfinite(self.point[1]).all() and np.isfinite(self.gap).all())

    def _direction(self, solve: Callable[[Vector], Vector], target: Vector) -> tuple[Vector, Vector, Vector, float]:
        """The ways of z, r and s where rs falls by `target`, and how many times as long as to the boundary they are."""
        r = self.r
        s = self.s
        dz = solve(self.rest - np.where(self.bounded, (target + s * self.gap) / r, 0.0) @ self.sign)
        dr = self.sign * np.column_stack([dz - J @ dz if J.nnz else dz for J in self.slopes]) + self.gap
        ds = np.where(self.bounded, -(target + s * dr) / r, 0.0)
        steps = -dr / r, -ds / np.where(self.bounded, s, 1.0)
        return dz, dr, ds, max(float(np.max(x[self.bounded], initial=0.0)) for x in steps)

    def _move_to(self, z: Vector) -> None:
        """z with p, z − ψ(z) and z − ψ̄(z), and how far r is from them, if it can be."""
        problem = self.problem
        self.point = z, problem.p(z), problem.r(z), problem.r_upper(z)
        if self.moves:
            _, _, below, above = self.point
            room = below[:, None] if above is None else np.column_stack([below, -above])
            self.gap = np.where(self.bounded, room - self.r, 0.0)
            self.slopes = [derivative(psi, z) for psi in (problem.psi, problem.upper) if psi is not None]

    def _solver(self) -> Callable[[Vector], Vector]:
        A = self.problem.A
        slopes = np.where(self.bounded, self.s / self.r, 0.0)
        data = A.data.copy()
        data[self.diagonal] += slopes.sum(axis=1) + self.regularisation * self.weights
        M = sp.csr_array((data, A.indices, A.indptr), shape=A.shape)
        if self.moves:
            for J, slope in zip(self.slopes, slopes.T, strict=True):
                M = sp.csr_array(M - sp.diags_array(slope) @ J)
        unit = 1.0 / np.sqrt(np.abs(M.diagonal()))
        M.data *= unit[row_of(M)]
        M.data *= unit[M.indices]
        if isinstance(self.pattern, Symmetric):
            factors = self.pattern.factors(M.data)
        else:  # symmetric at most by chance
            factors = factorise(M, definite=True, analysis=self.pattern or SymbolicAnalysis(M, lambda: False))

        def solve(f: Vector) -> Vector:
            if factors is None:
                self.solve_error = np.inf
                return np.full(f.size, np.nan)
            f = unit * f
            x = factors.solve(f)
            rest = f - M @ x
            self.solve_error = norm(rest) / (norm(f) or 1.0)
            x += factors.solve(rest)  # without exchanges of rows digits may be lost
            return np.asarray(unit * x)

        return solve
