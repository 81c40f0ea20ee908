"""Newton's method on the modulus equation: the modulus frozen at its sign pattern.

Here p = Az + q, r = z − ψ(z) and Ω = `problem.matrix.weights`, which is |a_ii| wherever that is not 0. In a row of
zeros, where p_i = q_i, it is the number that makes |p_i|/Ω_i the problem's `residual_scale`.
Active rows, those with r_i < p_i/Ω_i, get the equation z_i = ψ_i(z), linearised; the others get (Az + q)_i = 0. That is
the primal–dual active set method and, for impulse control, policy iteration. Where ψ is affine the active set decides
the next iterate. So there are finitely many iterates, and the method ends after a few steps or cycles. A merit
function prevents cycles:

    Ψ(z) = ½‖φ(p/Ω, r)‖²,        φ(a, b) = a + b − √(a² + b²), zero where a ≥ 0, b ≥ 0, ab = 0 (Fischer and Burmeister).

With an upper obstacle, rows with z_i − ψ̄_i > p_i/Ω_i get z_i = ψ̄_i(z), and −φ(−p/Ω, ψ̄ − z) takes the place of p/Ω
in Ψ (Billups).

The line search is a nonmonotone watchdog. Let θ = ‖φ‖. The first reference is θ of the start. A step reduces θ enough
where θ is at most `REDUCTION` of the reference; its θ is then the next reference. An active-set step may raise θ, but
one of the next `_ALLOWED_STEPS` must reduce it enough. Two kinds of steps count less:

- Steps that only shrink the active set do not count, as there are at most n in a row.
- Where all rows move in one direction, as in policy iteration, no active set recurs: n such steps count as one.

Otherwise the run returns to its best iterate and takes a semismooth Newton step for φ = 0 with Armijo's rule. If that
is no descent direction, it takes −∇Ψ. From then on half as many active-set steps are allowed. So the references tend
to 0, or the method ends.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from functools import cached_property
from typing import Any, ClassVar

import numpy as np
import scipy.sparse as sp

from ..algebra.active_equations import ActiveEquations
from ..algebra.descent_directions import NEWTON_RTOL, descent_directions
from ..algebra.equations import Pattern, derivative
from ..algebra.factor_costs import newton_cost
from ..errors import MapError
from ..numerics import work
from ..numerics.arrays import Mask, Vector, norm
from ..numerics.equilibration import times_rows
from ..numerics.rounding import SQRT_EPSILON
from ..problem.data import ProblemData
from .contract import REDUCTION, Iterate, Method, with_options

#: the number of active-set steps without enough reduction of θ that are allowed; each descent step halves it
_ALLOWED_STEPS = 8
#: moves against the common direction are rounding up to this share of the largest move (1e-11 was seen, with z = 1e5)
_ROUNDING_SHARE = SQRT_EPSILON
#: the share of the slope in Armijo's rule, and the least slope, relative to θ², of a descent direction; and the number
#: of step lengths 1, 1/2, 1/4, … that are tried
ARMIJO = 1e-4
MAX_HALVINGS = 30
#: the largest number of descent steps without a new reference
MAX_DESCENTS = 40
#: the relative tolerance of an inexact solve in the first steps
_LOOSE_RTOL = 1e-3


@with_options
class Newton(Method):
    """Repeatedly solve z_i = ψ_i(z), linearised, where r_i < p_i/Ω_i and (Az + q)_i = 0 elsewhere; Ω = |D|.

    It needs the derivative of ψ. Active rows are eliminated where each depends, directly or through other active rows,
    on free rows only: for constant ψ, ψ_i that depends on z_i alone, and jumps. Any A is accepted: where steps fail to
    reduce the residual enough, a line search takes over (see the module's docstring). The method cannot cycle, but
    where A is no P-matrix it may end at a z that is no solution.

    References
    ----------
    Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002). The merit function: De Luca, Facchinei and Kanzow, Math.
    Program. 75 (1996); with two obstacles: Billups, PhD thesis, Wisconsin (1995). Policy iteration: Bokanowski, Maroso
    and Zidani, SIAM J. Numer. Anal. 47 (2009).

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Newton()).z
    array([1., 1.])
    """

    name: ClassVar[str] = "newton"
    family: ClassVar[str] = "modulus"
    finite: ClassVar[bool] = True

    def why_not(self, problem: ProblemData) -> str | None:
        return problem.psi.no_derivative()

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # a singular system ends the iteration; SingularOperator is never raised
        return NewtonPath(problem, z)


class NewtonPoint:
    """z and what is evaluated there: p, r of the nearer obstacle, φ, θ = ‖φ‖, on request the residual and ψ′."""

    def __init__(self, problem: ProblemData, omega: Vector, z: Vector) -> None:
        self.problem = problem
        self.omega = omega
        self.z = z
        self.p = problem.p(z)
        r = problem.r(z)
        r_upper = problem.r_upper(z)
        self.distances = r, r_upper
        a = self.p / omega
        self.r, self.active, self.above = Pattern.of(r, r_upper, a)
        self.inner = None if r_upper is None else _FischerBurmeister(-a, -r_upper)
        self.outer = _FischerBurmeister(a if self.inner is None else -self.inner.phi, r)
        self.phi = self.outer.phi
        self.theta = norm(self.phi)

    @cached_property
    @np.errstate(all="ignore")
    def residual(self) -> float:
        """Res_D(z)."""
        return self.problem.residual_of(self.p, *self.distances, self.problem.weights_at(self.z, self.p))

    @cached_property
    def jacobian(self) -> sp.csr_array:
        """ψ′(z), and ψ̄′(z) in the rows that take the upper obstacle."""
        return derivative(self.problem.psi, self.z, self.above)

    def generalised_derivative(self) -> tuple[sp.csr_array, Vector]:
        """V, CSR, (n, n), an element of the generalised derivative of φ at z, and the sum of its slopes per row."""
        problem = self.problem
        slope_p, slope_r = self.outer.slopes()
        identity = sp.eye_array(problem.n)
        total = slope_r
        V = 0
        if self.inner is not None:
            assert problem.upper is not None
            inner, slope_s = self.inner.slopes()
            slope_s = slope_p * slope_s
            slope_p = slope_p * inner
            J = derivative(problem.upper, self.z)
            total = total + slope_s
            V = times_rows(slope_s, sp.csr_array(identity - J))
        J = self.jacobian if self.above is None else derivative(problem.psi, self.z)
        V = V + times_rows(slope_p / self.omega, problem.A) + times_rows(slope_r, sp.csr_array(identity - J))
        return V, total + slope_p


def _omega_of(problem: ProblemData) -> Vector:
    """Ω, which has the units of p/z in every row: see the module's docstring."""
    omega = problem.matrix.weights
    unknown = problem.matrix.empty_rows & (problem.q != 0)
    if unknown.any():
        omega = np.where(unknown, abs(problem.q) / (problem.residual_scale() or 1.0), omega)
    return omega


class _FischerBurmeister:
    """φ(a, b) = a + b − √(a² + b²), and a where b = ∞."""

    def __init__(self, a: Vector, b: Vector) -> None:
        self.a = a
        self.is_unbounded = np.isposinf(b)
        self.b = np.where(self.is_unbounded, 0.0, b)
        self.root = np.hypot(a, self.b)
        both = (a > 0) & (self.b > 0)  # there a + b − √(a² + b²) would cancel
        total = np.where(both, a + self.b + self.root, 1.0)
        self.phi = np.where(both, 2.0 * a * (self.b / total), a + self.b - self.root)
        self.phi[self.is_unbounded] = a[self.is_unbounded]

    def slopes(self) -> tuple[Vector, Vector]:
        """(∂φ/∂a, ∂φ/∂b), an element of the generalised derivative where a = b = 0."""
        corner = self.root == 0
        root = np.where(corner, 1.0, self.root)
        slope_a, slope_b = (np.where(corner, 1.0 - np.sqrt(0.5), 1.0 - side / root) for side in (self.a, self.b))
        slope_a[self.is_unbounded] = 1.0
        slope_b[self.is_unbounded] = 0.0
        return slope_a, slope_b


class NewtonPath(Iterator[Iterate]):
    """The iterates of Newton's method, with the state of the watchdog; after the start none leaves the `box`."""

    def __init__(self, problem: ProblemData, z: Vector, box: tuple[Any, Any] | None = None) -> None:
        self.problem = problem
        self.omega = _omega_of(problem)
        self.box = box
        with np.errstate(all="ignore"):
            self.current = self.best = NewtonPoint(problem, self.omega, z)
        self.start_theta = self.reference = self.current.theta
        self.has_begun = False
        self.allowed_steps = _ALLOWED_STEPS
        # since the last reference: the active-set steps that count, and the descent steps
        self.counted_steps = 0.0
        self.descents = 0
        # the active set of the previous step, and how many rows that step freed
        self.last_active = self.current.active
        self.freed = 0
        # consecutive steps that only shrank the active set; more layers are freed once these exceed `delay`
        self.shrinking_steps = 0
        self.delay = 2
        # 1 or −1 if the previous step moved all rows up or down, else 0
        self.direction = 0
        # the last factorised equations, with the active set and the ψ′ that they belong to
        self.factorised: tuple[Mask, sp.csr_array, ActiveEquations] | None = None
        self.psi_error: MapError | None = None

    def __next__(self) -> Iterate:
        if self.has_begun and not self.advance():
            raise StopIteration
        self.has_begun = True
        return self.current.z, self.current.residual

    def advance(self) -> bool:
        """Make one step; False if no step is left. Raises MapError where that is because ψ fails."""
        if self.current.theta == 0:
            return False
        work.count(newton_cost(self.problem.facts))
        self.psi_error = None
        with np.errstate(all="ignore"):
            new = self._unless_psi_fails(self.active_set_step) or self._unless_psi_fails(self.descent_step)
        if new is None:
            if self.psi_error is not None:
                raise self.psi_error
            return False
        self.current = new
        if new.theta < self.best.theta:
            self.best = new
        if self._is_reduced(new):
            self.reference = new.theta
            self.counted_steps = 0.0
            self.descents = 0
        return True

    def _is_reduced(self, point: NewtonPoint) -> bool:
        return point.theta <= REDUCTION * self.reference

    def _unless_psi_fails(self, step: Callable[[], NewtonPoint | None]) -> NewtonPoint | None:
        """The result of `step`, None where ψ fails on the way."""
        try:
            return step()
        except MapError as error:
            self.psi_error = error
            return None

    def clip(self, z: Vector) -> Vector:
        """The point of the box nearest to `z`; z itself without a box."""
        return z if self.box is None else np.clip(z, *self.box)

    def point(self, z: Vector) -> NewtonPoint | None:
        """The point of the box nearest to `z`, with what is evaluated there; None where θ is not finite."""
        work.check_budget()
        z = self.clip(z)
        point = self._unless_psi_fails(lambda: NewtonPoint(self.problem, self.omega, z))
        if point is None or np.isfinite(point.theta):
            return point
        bad = ~(point.r > -np.inf)
        if np.isfinite(z).all() and bad.any():
            self.psi_error = MapError(f"psi(z)[{np.argmax(bad)}] is NaN or +inf")
        return None

    def active_set_step(self) -> NewtonPoint | None:
        """A step of the active set method; None if it fails, or after too many without enough reduction of θ."""
        last_active = self.current.active
        active = self._predicted_active_set()
        new = self._solution_on(active)
        if active is not last_active:
            newly_freed = last_active & ~active
            if new is None or 2 * np.count_nonzero(new.active & newly_freed) > np.count_nonzero(newly_freed):
                self.delay *= 2
                active = last_active
                new = self._solution_on(last_active)
        if new is None:
            return None
        moved = new.z - self.current.z
        last_direction = self.direction
        down = -float(moved.min(initial=0.0))
        up = float(moved.max(initial=0.0))
        self.direction = int(down <= _ROUNDING_SHARE * up) - int(up <= _ROUNDING_SHARE * down)
        self.last_active = active
        if not self.shrinking_steps:
            self.counted_steps += 1.0 / new.z.size if self.direction == last_direction != 0 else 1.0
        return new if self._is_reduced(new) or self.counted_steps <= self.allowed_steps else None

    def _predicted_active_set(self) -> Mask:
        """The active set at z, or a part of it.

        Where A is an M-matrix the set often shrinks by one layer of the grid in every step. From the third such step on
        1, 2, 4, … further layers are freed, unless the number of freed rows halves by itself. Where most of these rows
        would become active again, the step frees none of them and `delay` doubles.
        """
        from scipy.sparse.csgraph import dijkstra

        active = self.current.active
        last_active = self.last_active
        newly_freed = last_active & ~active
        last_freed = self.freed
        self.freed = int(np.count_nonzero(newly_freed))
        self.shrinking_steps = self.shrinking_steps + 1 if self.freed and not (active & ~last_active).any() else 0
        if not (self.shrinking_steps > self.delay and 2 * self.freed > last_freed):
            return active
        graph = self.problem.matrix.absolute.T
        # no path is longer than n, and a larger power may overflow
        max_layers = min(2 ** (self.shrinking_steps - self.delay - 1), self.problem.n)
        layer = dijkstra(graph, indices=np.flatnonzero(newly_freed), unweighted=True, min_only=True, limit=max_layers)
        return active & np.isinf(layer)

    def _solution_on(self, active: Mask) -> NewtonPoint | None:
        """The point that solves the linearised equations with this active set; None if there is none."""
        current = self.current
        J = current.jacobian
        # inexact solves follow the residual
        tolerance = min(_LOOSE_RTOL, max(NEWTON_RTOL, current.theta / self.start_theta))
        if self.factorised is None or self.factorised[1] is not J or not np.array_equal(self.factorised[0], active):
            self.factorised = None  # frees the old factorisation before the new one is made
            self.factorised = (active, J, ActiveEquations(self.problem, active, J, by_cycles=False))
        step = self.factorised[2].solve(-np.where(active, current.r, current.p), tolerance)
        return None if step is None else self.point(current.z + step)

    def descent_step(self) -> NewtonPoint | None:
        """A step from the best point that reduces Ψ by Armijo's rule; None if none does or too many were made.

        It halves the number of active-set steps that are allowed.
        """
        best = self.best
        self.allowed_steps //= 2
        self.counted_steps = 0.0
        self.direction = 0
        self.descents += 1
        if self.descents > MAX_DESCENTS:
            return None
        work.count(work.newton_cost(self.problem.n, self.problem.facts.entries, mixed=True))
        return self.descend(best, best)

    def descend(self, start: NewtonPoint, model: NewtonPoint) -> NewtonPoint | None:
        """The first point from `start` that satisfies Armijo's rule in a direction in which Ψ of `model` falls.

        `model` is `start`, or the same z in a problem with the tangent of a nonlinear p. None if no point does.
        """
        if model.theta == 0:  # where p of the tangent is rounded, that of `start` need not be 0
            return None
        V, total = model.generalised_derivative()
        phi = model.phi / model.theta
        for direction in descent_directions(model.problem, V, phi, total):
            step = self.clip(start.z + model.theta * direction) - start.z
            slope = float(phi @ (V @ step)) / model.theta
            for k in range(MAX_HALVINGS if slope < -ARMIJO else 0):
                t = 0.5**k
                new = self.point(start.z + t * step)
                growth = np.inf if new is None else new.theta / start.theta
                if new and growth * growth <= 1.0 + 2.0 * ARMIJO * t * slope:  # growth**2 raises if it is inf
                    return new
        return None
