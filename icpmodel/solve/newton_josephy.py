"""Newton-Josephy: a problem with nonlinear p is solved as a sequence of problems with affine p."""

from __future__ import annotations

from collections import deque
from collections.abc import Generator, Iterator
from contextlib import suppress
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from ..algebra.affine_lcp import PIVOT_UP_TO
from ..algebra.equations import Pattern, solve_on
from ..algebra.secants import secant_problem, why_not_rows
from ..algebra.steps import INNER_REDUCTION
from ..errors import MapError, SingularOperator
from ..methods.accelerated import Accelerated
from ..methods.contract import REDUCTION, Iterate, LeastValue, Method, with_options
from ..methods.enumeration import Enumerate
from ..methods.newton import ARMIJO, MAX_DESCENTS, MAX_HALVINGS, NewtonPath, NewtonPoint
from ..methods.psor import PSOR
from ..methods.restarts import scale_of_starts, start_above
from ..methods.shortcuts import Lemke
from ..numerics import work
from ..numerics.arrays import Vector, as_number, norm, not_finite
from ..problem.data import ProblemData
from .goal import Goal, Limits
from .jobs import MethodSequence
from .reduction import ladder_steps, presolve
from .run import Run
from .solution import Status

#: the weights μ of the proximal term, in units of the diagonal of A + f′; after a step that fails the next one is tried
_PROXIMAL_WEIGHTS = (0.0, 1e-2, 1.0, 1e2)
#: a linearised problem is solved until its residual has fallen by the factor θ/θ⁰, but at least this number and at most
#: `INNER_REDUCTION` (Eisenstat and Walker 1996)
_MIN_FORCING = 1e-4
#: a step of length t is accepted where θ ≤ (1 − σt) times the largest θ of this number of last points, σ = `ARMIJO`
#: (Grippo and others 1986)
_NONMONOTONE_STEPS = 5
#: the number in place of 1 − σt in this test for a second step by the same tangent
_SECOND_STEP_SHARE = 0.5
#: the number of methods by sweeps with which a ladder begins
_SWEEP_METHODS = 2
#: the range of log₁₀ of the size of random starts, relative to the largest entry of D⁻¹(q + f(z⁰)), ψ(z⁰) and z⁰, or
#: to 1 where all are smaller
_MIN_START_EXPONENT, _MAX_START_EXPONENT = -1.0, 2.0


@with_options
class NewtonJosephy(Method):
    """Linearise p at z, solve the resulting ICP, and search along the line to its solution.

    Parameters
    ----------
    inner_family : {None, "modulus", "paper"}
        Which methods may solve the linearised problems: the `family` of `solve`.
    restarts : int, default 0
        The number of random starts, tried one by one if the steps from z⁰ end without a solution.

    Notes
    -----
    The tangent problem has A + f′(z), q + f(z) − f′(z)z and the same ψ. The methods of `solve` reduce
    its residual by a factor, starting at z, without a global search. With at most 64 unknowns, an
    affine ψ and no `inner_family` they are `Lemke` and `Enumerate` alone. Where rows are known to
    increase with their own unknowns, mean slopes replace f′ far from the solution: see
    `algebra.secants`. The merit function is that of `Newton`, the Fischer-Burmeister θ; the residual
    of the equations of the step must fall as well. If the full step fails, a second step by the same
    tangent is tried, then shorter steps. Beyond 64 unknowns the solution of the tangent problem with
    the active set of z is tried first, unless sweeps suffice. Where steps shrink by a constant factor,
    as at a double root, the limit of the steps is tried before the full step. If no step is accepted, a
    proximal term μW(z⁺ − z) is added to p of the tangent problem, W the diagonal of its matrix. If
    this fails, a descent direction of θ is tried. Fixed obstacles are never crossed, so that f need
    not have values beyond them. One step is one iteration, however long its inner solves are. The
    convergence is quadratic at a strongly regular solution.

    References
    ----------
    Josephy, MRC report 1965, Wisconsin (1979). Robinson, Math. Oper. Res. 5 (1980). Dirkse and Ferris,
    Optim. Methods Softw. 5 (1995), for the method of PATH.

    Examples
    --------
    >>> solution = ICP([[1.0]], [-6.0], f=lambda z: z**3).solve()
    >>> solution.method, solution.z.round(6)
    (NewtonJosephy(), array([1.634365]))
    """

    name: ClassVar[str] = "newton-josephy"
    finite: ClassVar[bool] = True

    inner_family: str | None = None
    restarts: int = 0

    def __post_init__(self) -> None:
        as_number(self.restarts, "restarts", minimum=0, whole=True)

    def why_not_f(self, problem: ProblemData) -> str | None:
        return None

    def why_not(self, problem: ProblemData) -> str | None:
        return "p is affine, so that its tangent is the problem itself: name no method" if problem.f is None else None

    def iterates(self, problem: ProblemData, z: Vector) -> Generator[Iterate, None, str]:
        rng = np.random.default_rng(0)
        with np.errstate(all="ignore"):
            point = NewtonPoint(problem, problem.matrix.weights, z)
        yield z, point.residual
        family = self.inner_family
        search = _Search(problem, z, family)
        nearest = search.path.clip(z)
        if not np.array_equal(nearest, z):  # steps from beyond an obstacle may all be refused
            with suppress(MapError):
                inside = _Search(problem, nearest, family)
                if np.isfinite(inside.current.theta):
                    search = inside
                    yield search.current.z, search.current.residual
        for left in range(self.restarts, -1, -1):
            for point in search.steps():
                yield point.z, point.residual
            if point.residual <= 2.0 * problem.rounding_of_residual(point.z) or not left:
                break
            size = max(scale_of_starts(problem, z), 1.0) * 10.0 ** rng.uniform(_MIN_START_EXPONENT, _MAX_START_EXPONENT)
            with suppress(MapError):
                search = _Search(problem, search.path.clip(start_above(problem, z, size, rng)), family)
                if np.isfinite(search.current.theta):
                    yield search.current.z, search.current.residual
        if search.psi_error is not None:
            raise search.psi_error
        tried = self.restarts - left
        return "it has no further step" + (f", nor has it from {tried} other starts" if tried else "")


class _Search:
    """The steps from one start.

    Parameters
    ----------
    problem : ProblemData
    z : array of shape (n,)
    family : str or None
    """

    def __init__(self, problem: ProblemData, z: Vector, family: str | None) -> None:
        self.problem = problem
        self.family = family
        facts = problem.facts
        box = (facts.obstacle, facts.upper_obstacle) if facts.has_fixed_obstacle else None
        with np.errstate(all="ignore"):
            self.path = NewtonPath(problem, z, box)
        self.current = self.path.current
        self.last_z = z
        self.recent = deque([self.current.theta], _NONMONOTONE_STEPS)
        self.thetas = LeastValue()
        self.weight = 0
        #: the method that solved a linear problem after plain and accelerated sweeps had failed; it runs first then
        self.first: Method | None = None
        #: whether the last linear problem has more than 64 unknowns and took more than sweeps
        self.tries_active_set = False
        self.psi_error: MapError | None = None

    def steps(self) -> Iterator[NewtonPoint]:
        """Yield the points after the start, until none is better."""
        # within `MAX_DESCENTS` steps the least θ has to fall by a tenth or, if θ is below it, the residual of the
        # equations of the step: far above the solution of eᶻ = c that falls by the factor e, but θ ≈ z − ψ by 1
        while self.current.theta > 0.0 and self.thetas.add(self.current.theta) < MAX_DESCENTS:
            try:
                with np.errstate(all="ignore"):
                    new = self._next()
            except MapError as error:
                self.psi_error = error
                return
            if new is None:
                return
            self.last_z = self.current.z
            self.current = new
            self.recent.append(new.theta)
            yield new

    def _next(self) -> NewtonPoint | None:
        linear = self._affine()
        self.weight = max(self.weight - 1, 0)
        while self.weight < len(_PROXIMAL_WEIGHTS):
            W = _PROXIMAL_WEIGHTS[self.weight] * linear.matrix.weights
            new = self._on_line(_proximal(linear, self.current.z, W), W)
            if new is not None:
                return new
            self.weight += 1
        return self._descent(linear)

    def _affine(self) -> ProblemData:
        z = self.current.z
        if why_not_rows(self.problem) is None:
            return secant_problem(self.problem, z)[0]
        return self.problem.linearised(z)

    def _solve_tangent(self, linear: ProblemData, z: Vector, tolerance: float) -> Vector | None:
        """Solve the `linear` problem from `z` to the `tolerance`, which the result may miss.

        None if the problem is infeasible, or its residual does not fall. The solution with the active set of z is tried
        first if the last problem took more than sweeps or pivots. Raises OutOfTime or MemoryError at the limits.
        """
        if self.tries_active_set:
            near = self._on_active_set(linear, z)
            if near is not None and linear.residual(near) <= tolerance:
                return near
        start_residual = linear.residual(z)
        share = min(tolerance / start_residual, INNER_REDUCTION) if start_residual > 0.0 else INNER_REDUCTION
        limits = Limits(rtol=share, atol=0.0, max_iter=100_000, time_limit=work.inner_time_limit())
        run = Run(
            linear,
            z,
            start_residual,
            Goal(share * start_residual),
            limits=limits,
            target_reduction=share,
            scale=0.0,
            warm_start=linear.matrix.origin is not None,
        )
        fixed = presolve(linear)
        run.presolved = None if fixed is linear else fixed
        for _ in self._steps(run, fixed):
            pass
        sweeps = run.tried and isinstance(run.tried[-1].method, PSOR | Accelerated)
        self.tries_active_set = self.family is None and linear.n > PIVOT_UP_TO and not sweeps
        if run.stop_reason.status is Status.SOLVED and len(run.tried) > _SWEEP_METHODS:
            self.first = run.tried[-1].method
        if run.is_refused and run.refusal is not None:
            raise run.refusal.error
        best = run.best
        if best is None or run.infeasible is not None or not best.residual < start_residual:
            return None
        return self.path.clip(best.z)

    def _steps(self, run: Run, linear: ProblemData) -> Iterator[None]:
        """The steps of `run`; with few unknowns those of pivots alone: if these fail, another tangent costs less."""
        if linear.n > PIVOT_UP_TO or linear.psi.linear is None or self.family is not None:
            return ladder_steps(run, linear, self.family, self.first)
        methods = [method for method in (Lemke(), Enumerate()) if method.why_not(linear) is None]
        return run.steps(MethodSequence(*methods))

    def _on_line(self, linear: ProblemData, W: Vector) -> NewtonPoint | None:
        """The first trial point that reduces θ and the residual of the equations of the step enough, or None.

        θ alone may fall in ever shorter steps while the rows that are free at z⁺ move away from p = 0.
        """
        z = self.current.z
        share = min(max(self.current.theta / self.path.start_theta, _MIN_FORCING), INNER_REDUCTION)
        tolerance = share * linear.residual(z)
        to = self._solve_tangent(linear, z, tolerance)
        if to is None:
            return None
        pattern = Pattern.at(linear, to)
        before = self._equations(pattern, self.current, W)
        for enough, new in self._trials(linear, W, to, tolerance):
            if new is not None and new.theta <= enough * max(self.recent):
                after = self._equations(pattern, new, W)
                if after <= enough * before:
                    if new.theta < self.thetas.least and after <= REDUCTION * before and not W.any():
                        self.thetas = LeastValue(new.theta)
                    return new
        return None

    def _with_active_set(self, linear: ProblemData) -> NewtonPoint | None:
        """The solution of the `linear` problem with the active set of z, if θ falls by the factor `INNER_REDUCTION`.

        Only for few unknowns: Lemke's pivots do not start from z, and may end at a solution far from z.
        """
        if linear.n > PIVOT_UP_TO or (z := self._on_active_set(linear, self.current.z)) is None:
            return None
        new = self.path.point(z)
        return new if new and new.theta <= INNER_REDUCTION * self.current.theta else None

    def _on_active_set(self, linear: ProblemData, z: Vector) -> Vector | None:
        """The solution of the equations of the `linear` problem with the active set of `z`; None if singular."""
        pattern = Pattern.at(linear, z)
        with suppress(SingularOperator):
            return self.path.clip(solve_on(linear, z, pattern.active, pattern.above))
        return None

    def _trials(
        self, linear: ProblemData, W: Vector, z: Vector, tolerance: float
    ) -> Iterator[tuple[float, NewtonPoint | None]]:
        """Yield trial points, None where one has no value, each with the share of the largest recent θ it may leave.

        They are the step to `z`, a second step by the same tangent, the solution with the active set, which has been
        tested already, and shorter steps. Where steps shrink by a constant factor their limit comes first.
        Along curved equations steps are short, unless a second one, with the values of the equations at z, returns to
        them (Fletcher, Lecture Notes in Math. 912, 1982).
        """
        step = z - self.current.z
        last = self.current.z - self.last_z
        ratio = (step @ last) / (last @ last)
        if INNER_REDUCTION < ratio < 1.0 - INNER_REDUCTION:  # as at a singular solution (Griewank, SIAM Rev. 27, 1985)
            yield INNER_REDUCTION, self.path.point(self.current.z + step / (1.0 - ratio))
        new = self.path.point(z)
        yield 1.0 - ARMIJO, new
        if new is not None:
            q = linear.q + new.p + W * step - linear.p(z)
            again = self._solve_tangent(linear.with_q(q), z, tolerance) if np.isfinite(q).all() else None
            yield _SECOND_STEP_SHARE, None if again is None else self.path.point(again)
        yield np.inf, self._with_active_set(linear)
        for k in range(1, MAX_HALVINGS):
            yield 1.0 - ARMIJO * 0.5**k, self.path.point(self.current.z + 0.5**k * step)

    def _equations(self, pattern: Pattern, point: NewtonPoint, W: Vector) -> float:
        """‖·‖ of r in the active rows of the `pattern`, and of p plus the proximal term over Ω in the free ones."""
        r = self.problem.r(point.z)
        r_upper = self.problem.r_upper(point.z)
        if pattern.above is not None and r_upper is not None:
            r = np.where(pattern.above, r_upper, r)
        p = point.p + W * (point.z - self.current.z)
        return norm(np.where(pattern.active, r, p / self.path.omega))

    def _descent(self, linear: ProblemData) -> NewtonPoint | None:
        """A point with a smaller θ along a descent direction; None if there is none, or ψ has no derivative."""
        if linear.psi.no_derivative() is not None:
            return None
        return self.path.descend(self.current, NewtonPoint(linear, self.path.omega, self.current.z))


def _proximal(linear: ProblemData, z: Vector, W: Vector) -> ProblemData:
    """The `linear` problem with W(z⁺ − z) added to p, W a diagonal. Raises MapError where q overflows."""
    if not W.any():
        return linear
    q = linear.q - W * z
    if fault := not_finite(q, "q of the proximal problem"):
        raise MapError(f"{fault}; a finite number was expected")
    A = linear.dense() + np.diag(W) if linear.matrix.dense is not None else sp.csr_array(linear.A + sp.diags_array(W))
    return type(linear)(A, q, linear.psi)
