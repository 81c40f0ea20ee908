"""Newton's method on the modulus equation: the modulus frozen at its sign pattern.

Rows with r_i < p_i/Ω_i take z_i = ψ_i(z), linearised, the others (Az + q)_i = 0. That is the primal–dual active set
method and, for impulse control, policy iteration. Where ψ is affine the active set decides the next iterate. So there
are finitely many iterates, and the method ends after a few steps or cycles. A merit function prevents cycles:

    Ψ(z) = ½‖φ(p/Ω, r)‖²,        φ(a, b) = a + b − √(a² + b²), zero where a ≥ 0, b ≥ 0, ab = 0 (Fischer and Burmeister).

With an obstacle above, rows with z_i − ψ̄_i > p_i/Ω_i take z_i = ψ̄_i(z), and −φ(−p/Ω, ψ̄ − z) takes the place of p/Ω
in Ψ (Billups). A row on one obstacle with |p_i|/Ω_i > ψ̄_i − ψ_i would jump to the other at once. That is right where
the row is dominant. Where others move p_i by more, such rows cycle together; they are set free first.

Globalisation is by a nonmonotone watchdog. Let θ = ‖φ‖. The first mark is θ⁰, and a θ of at most 0.9 of the mark is
the next one. Plain steps may raise θ, but `_PATIENCE` of them must bring a new mark. Two kinds of steps count less:

- Steps that only shrink the active set do not count, as there are at most n in a row.
- Where all rows move in one direction, as in policy iteration, no active set comes again: n such steps count as one.

Otherwise the run returns to its best iterate and takes a semismooth Newton step for φ = 0 by Armijo's rule. Where that
is no descent direction, −∇Ψ is. Later plain steps get half the patience. So the marks fall for ever, or the method
ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from ..algebra.active_equations import ActiveEquations
from ..algebra.equations import Pattern, derivative
from ..algebra.factor_costs import newton_cost
from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Mask, Vector, norm
from ..numerics.linear import solver_of
from ..problem.data import ProblemData
from .contract import Iterate, Method

#: plain steps may fail to reduce θ so often; later half as often, and so on
_PATIENCE = 8
#: what counts as reduced
_REDUCED = 0.9
#: the share of the largest move up to which moves the other way are rounding: 1e-11 of them was seen, with 1e5 for z
_ROUNDED = 1e-6
#: Armijo's share of the slope, and how often a step is halved
_SLOPE = 1e-4
_HALVINGS = 30
#: so many descents without a new mark are the last ones
_DESCENTS = 40
#: what is added where the Newton matrix of φ is singular
_SHIFT = 1e-6
#: the relative tolerance of an inexact solve, in the first steps and near the solution
_LOOSE = 1e-3
_TIGHT = 1e-8


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Newton(Method):
    """z⁺: z_i = ψ_i(z) linearised where r_i < p_i/Ω_i, (Az + q)_i = 0 elsewhere; Ω = |D|.

    It needs ψ's derivative. Where the active rows depend on the others by chains that end (constant ψ, ψ_i that moves
    with z_i alone, jumps), they are eliminated. Any A will do: where steps fail to reduce the residual enough, a line
    search takes over (see the module's docstring). It cannot cycle, but where A is no P-matrix it may end at a z
    that is no solution.
    References: Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002); De Luca, Facchinei and Kanzow, Math. Program.
    75 (1996), for the merit function; Billups, PhD thesis, Wisconsin (1995), for it with two obstacles; Bokanowski,
    Maroso and Zidani, SIAM J. Numer. Anal. 47 (2009), for policy iteration.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Newton()).z
    array([1., 1.])
    """

    name: ClassVar[str] = "newton"
    family: ClassVar[str] = "modulus"
    memoryless: ClassVar[bool] = False
    finite: ClassVar[bool] = True

    def why_not(self, problem: ProblemData) -> str | None:
        return problem.psi.no_derivative()

    def path(self, problem: ProblemData, z: Vector) -> Path:
        """The path of a run.

        Parameters
        ----------
        problem : ProblemData
            The problem.
        z : array of shape (n,)
            The start.

        Returns
        -------
        Path
            The path.
        """
        return Path(problem, z)

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # never raises SingularOperator: it ends instead
        return self.path(problem, z)


class Point:
    """z with all that is evaluated there: p, r of the nearer obstacle, φ, θ = ‖φ‖, the residual, when asked for ψ′."""

    def __init__(self, problem: ProblemData, omega: Vector, z: Vector) -> None:
        self.problem, self.omega, self.z, self.p, below = problem, omega, z, problem.p(z), problem.r(z)
        above = problem.r_upper(z)
        self.residual = problem.residual_of(self.p, below, above)
        a = self.p / omega
        pattern = Pattern.of(below, above, a if above is None else _within_reach(problem, a, below - above))
        self.r, self.active, self.above = pattern
        self.inner = None if above is None else _Fischer(-a, -above)
        self.outer = _Fischer(a if self.inner is None else -self.inner.phi, below)
        self.phi = self.outer.phi
        self.theta = norm(self.phi)

    @cached_property
    def jacobian(self) -> sp.csr_array:
        return derivative(self.problem.psi, self.z, self.above)

    def derivative(self) -> tuple[sp.csr_array, Vector]:
        """V, an element of the generalised derivative of φ at z, and the sum of the slopes that it is made of."""
        problem = self.problem
        (of_p, of_r) = self.outer.slopes()
        identity = sp.eye_array(problem.n)
        total = of_r
        V = 0
        if self.inner is not None:
            assert problem.upper is not None
            inner, of_s = self.inner.slopes()
            of_s = of_p * of_s
            of_p = of_p * inner
            J = derivative(problem.upper, self.z)
            total = total + of_s
            V = sp.diags_array(of_s) @ (identity - J)
        J = self.jacobian if self.above is None else derivative(problem.psi, self.z)
        V = V + sp.diags_array(of_p / self.omega) @ problem.A + sp.diags_array(of_r) @ (identity - J)
        return sp.csr_array(V), total + of_p


def _within_reach(problem: ProblemData, a: Vector, gap: Vector) -> Vector:
    """`a` = p/Ω, in rows that are not dominant no more than half the `gap` between the obstacles."""
    rows = problem.matrix.rows
    half = 0.5 * gap
    free = (rows.rest > np.abs(rows.diagonal)) & (half > 0)
    return np.where(free, np.clip(a, -half, half), a)


class _Fischer:
    """φ(a, b) = a + b − √(a² + b²), and a where b = ∞."""

    def __init__(self, a: Vector, b: Vector) -> None:
        self.a, self.free = a, np.isposinf(b)
        self.b = np.where(self.free, 0.0, b)
        self.root = np.hypot(a, self.b)
        both = (a > 0) & (self.b > 0)  # there a + b − √(a² + b²) would cancel
        total = np.where(both, a + self.b + self.root, 1.0)
        self.phi = np.where(both, 2.0 * a * (self.b / total), a + self.b - self.root)
        self.phi[self.free] = a[self.free]

    def slopes(self) -> tuple[Vector, Vector]:
        """(∂φ/∂a, ∂φ/∂b), an element of the generalised derivative where a = b = 0."""
        corner = self.root == 0
        root = np.where(corner, 1.0, self.root)
        in_a, in_b = (np.where(corner, 1.0 - np.sqrt(0.5), 1.0 - side / root) for side in (self.a, self.b))
        in_a[self.free] = 1.0
        in_b[self.free] = 0.0
        return in_a, in_b


class Path(Iterator[Iterate]):
    """The run: where it is, its best point, and what credit is left to the plain steps."""

    def __init__(self, problem: ProblemData, z: Vector) -> None:
        self.problem, self.omega = problem, problem.matrix.weights
        with np.errstate(all="ignore"):
            self.here = self.best = Point(problem, self.omega, z)
        self.first = self.mark = self.here.theta
        self.begun, self.patience = False, _PATIENCE
        # since the last mark: the plain steps that count, the descents
        self.waited, self.descents = 0.0, 0
        # of the step before: its active set, how many rows it set free, and its factorisation
        self.taken, self.dropped = self.here.active, 0
        # how many steps in a row did nothing but shrink, and after how many more layers are set free; where the last
        # one moved all rows to, 1 or −1, or 0
        self.shrunk, self.alike, self.way = 0, 2, 0
        self.kept: tuple[Mask, sp.csr_array, ActiveEquations] | None = None
        self.fault: MapError | None = None

    def __next__(self) -> Iterate:
        if self.begun and not self.advance():
            raise StopIteration
        self.begun = True
        return self.here.z, self.here.residual

    def advance(self) -> bool:
        """One step, or False where nothing leads on. Raises MapError where that is because ψ fails."""
        if self.here.theta == 0:
            return False
        work.count(newton_cost(self.problem.facts))
        self.fault = None
        with np.errstate(all="ignore"):
            new = self._tried(self.plain) or self._tried(self.descent)
        if new is None:
            if self.fault is not None:
                raise self.fault
            return False
        self.here = new
        if new.theta < self.best.theta:
            self.best = new
        if self._marks(new):
            self.mark, self.waited, self.descents = new.theta, 0.0, 0
        return True

    def _marks(self, point: Point) -> bool:
        return point.theta <= _REDUCED * self.mark

    def _tried(self, step: Callable[[], Point | None]) -> Point | None:
        """What `step` finds, None where ψ fails on the way."""
        try:
            return step()
        except MapError as error:
            self.fault = error
            return None

    def point(self, z: Vector) -> Point | None:
        """The point at `z`, None where it has no finite θ."""
        point = self._tried(lambda: Point(self.problem, self.omega, z))
        if point is None or np.isfinite(point.theta):
            return point
        bad = ~(point.r > -np.inf)
        if np.isfinite(z).all() and bad.any():
            self.fault = MapError(f"psi(z)[{np.argmax(bad)}] is NaN or +inf")
        return None

    def plain(self) -> Point | None:
        """A step of the active set method, None where θ would be above its mark for too long."""
        own = self.here.active
        active = self._foreseen()
        new = self._reached(active)
        if active is not own:
            further = own & ~active
            if new is None or 2 * np.count_nonzero(new.active & further) > np.count_nonzero(further):
                self.alike *= 2
                active = own
                new = self._reached(own)
        if new is None:
            return None
        moved = new.z - self.here.z
        before = self.way
        down = max(-float(moved.min()), 0.0)
        up = max(float(moved.max()), 0.0)
        self.way = int(down <= _ROUNDED * up) - int(up <= _ROUNDED * down)
        self.taken = active
        if not self.shrunk:
            self.waited += 1.0 / new.z.size if self.way == before != 0 else 1.0
        return new if self._marks(new) or self.waited <= self.patience else None

    def _foreseen(self) -> Mask:
        """The active set at z, or a part of it.

        Where A is an M-matrix the set often shrinks by one layer of the grid in every step. From the third such step on
        1, 2, 4, … further layers are set free, unless the number of freed rows halves by itself. Where most rows would
        come back the step is made without them, and the next try waits for twice as many steps.
        """
        from scipy.sparse.csgraph import dijkstra

        active = self.here.active
        taken = self.taken
        free = taken & ~active
        before = self.dropped
        self.dropped = int(np.count_nonzero(free))
        self.shrunk = self.shrunk + 1 if self.dropped and not (active & ~taken).any() else 0
        if not (self.shrunk > self.alike and 2 * self.dropped > before):
            return active
        after = self.problem.matrix.absolute.T
        most = min(2 ** (self.shrunk - self.alike - 1), self.problem.n)  # no way is longer, and a float has its range
        layer = dijkstra(after, indices=np.flatnonzero(free), unweighted=True, min_only=True, limit=most)
        return active & np.isinf(layer)

    def _reached(self, active: Mask) -> Point | None:
        """Where the step with this active set leads."""
        here = self.here
        J = self.here.jacobian
        # inexact solves follow the residual
        tolerance = min(_LOOSE, max(_TIGHT, here.theta / self.first)) if self.first > 0 else _TIGHT
        if self.kept is None or self.kept[1] is not J or not np.array_equal(self.kept[0], active):
            self.kept = None  # so that not two factorisations are held
            self.kept = (active, J, ActiveEquations(self.problem, active, J, by_cycles=False))
        step = self.kept[2].solve(-np.where(active, here.r, here.p), tolerance)
        return None if step is None else self.point(here.z + step)

    def descent(self) -> Point | None:
        """A step from the best point that reduces Ψ by Armijo's rule; None where none does, or many do too little."""
        best = self.best
        self.patience, self.waited, self.way = self.patience // 2, 0.0, 0
        self.descents += 1
        if best.theta == 0 or self.descents > _DESCENTS:
            return None
        work.count(work.newton(self.problem.n, self.problem.facts.entries, mixed=True))
        V, total = best.derivative()
        phi = best.phi / best.theta
        for direction in self.directions(V, phi, total):
            slope = float(phi @ (V @ direction))
            if slope < -_SHIFT:
                new = self.along(best, best.theta * direction, slope)
                if new is not None:
                    return new
        return None

    def directions(self, V: sp.csr_array, phi: Vector, shift: Vector) -> Iterator[Vector]:
        """Newton's, with V shifted where it is singular, and that of steepest descent with Cauchy's length."""
        step = solver_of(V)(-phi, _TIGHT)
        if step is None:
            step = solver_of(sp.csr_array(V + sp.diags_array(_SHIFT * shift)))(-phi, _TIGHT)
        if step is not None:
            yield step
        gradient = V.T @ phi
        steepest = gradient / norm(gradient)
        size = norm(V @ steepest)
        yield -steepest * (phi @ (V @ steepest)) / size / size  # the square may not be a float

    def along(self, best: Point, step: Vector, slope: float) -> Point | None:
        for k in range(_HALVINGS):
            t = 0.5**k
            new = self.point(best.z + t * step)
            growth = np.inf if new is None else new.theta / best.theta
            if new is not None and growth * growth <= 1.0 + 2.0 * _SLOPE * t * slope:  # growth**2 raises if it is inf
                return new
        return None
