"""Newton-Josephy: a problem with nonlinear p as a sequence of problems with affine p, which `solve()` solves each."""

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

#: the weights μ of the proximal term beside A + f′ in the units of its diagonal, the next one where a step fails
_PROXIMAL_WEIGHTS = (0.0, 1e-2, 1.0, 1e2)
#: a linearised problem is solved to the share θ/θ⁰ of its residual, at least this one and at most `INNER_REDUCTION`
#: (Eisenstat and Walker 1996)
_MIN_FORCING = 1e-4
#: a step of length t is taken where θ ≤ (1 − σt) times the largest of this number of last ones, σ = `ARMIJO` (Grippo
#: and others 1986)
_NONMONOTONE_STEPS = 5
#: the length t in the test above for a second step by one tangent
_SECOND_STEP_LENGTH = 0.5
#: the number of sweeps methods with which a ladder begins
_SWEEP_METHODS = 2
#: the size of random starts, in powers of ten of the largest entry of D⁻¹p(0), ψ and z⁰, or of 1 where all are smaller
_MIN_START_EXPONENT, _MAX_START_EXPONENT = -1.0, 2.0


@with_options
class NewtonJosephy(Method):
    """Linearise p at z, solve the ICP that this makes, and search on the line to its solution.

    Parameters
    ----------
    inner_family : {None, "modulus", "paper"}
        Which methods may solve the linearised problems, as in `solve`.
    restarts : int, default 0
        The number of random starts that are tried where the steps from z⁰ end without a solution.

    Notes
    -----
    The tangent problem has A + f′(z), q + f(z) − f′(z)z and the same ψ. `solve` solves it from z to a
    share of its residual, but does not search: up to 64 unknowns it takes `Lemke` and `Enumerate`
    alone. Where rows are known to increase with their own unknowns, mean slopes take the place of f′
    far from the solution: see `algebra.secants`. The merit function is that of `Newton`, the
    Fischer-Burmeister θ; the equations of the step must fall, too. A step that is too long is followed
    by a second one by the same tangent, or made shorter. Beyond 64 unknowns the solution with the
    active set of z is tried first, unless sweeps suffice. Where steps shrink by a constant factor, as
    at a double root, their limit is tried before. Where none reduces θ, a proximal term μW(z⁺ − z) is
    added to the tangent, W its diagonal. Then a descent direction of θ is tried. Fixed obstacles are
    never crossed, so that f need not have values beyond them. An iteration is one step, whatever its
    inner solves take. The convergence is quadratic at a strongly regular solution.

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
        #: what solved a linear problem on which plain and accelerated sweeps were tried before
        self.first: Method | None = None
        #: whether the last linear problem took more than sweeps or the pivots of few unknowns
        self.tries_active_set = False
        self.psi_error: MapError | None = None

    def steps(self) -> Iterator[NewtonPoint]:
        """Yield the points after the start, until none is better."""
        # the least θ has to fall or, where θ is less still, the equations of the step: far above the solution of eᶻ = c
        # these fall by the factor e, but θ, about z − ψ, by 1
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
        """A solution of the `linear` problem to the `tolerance`, from `z`; None where there is none to be found.

        Once one took more than sweeps or pivots, the solution with the active set of z is tried first.
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
        """The steps of `run`; with few unknowns those of pivots alone: where they fail, other tangents are cheaper."""
        if linear.n > PIVOT_UP_TO or linear.psi.linear is None or self.family is not None:
            return ladder_steps(run, linear, self.family, self.first)
        methods = [method for method in (Lemke(), Enumerate()) if method.why_not(linear) is None]
        return run.steps(MethodSequence(*methods))

    def _on_line(self, linear: ProblemData, W: Vector) -> NewtonPoint | None:
        """The first point to which a step leads at which θ is small enough, and the equations of the step nearer to 0.

        θ alone may fall although the rows that are free at z⁺ move away from p = 0, in short steps that lead nowhere.
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
        """The point that solves the `linear` problem with the active set of z, where θ falls as beside a solution.

        For few unknowns: Lemke's pivots begin elsewhere, and may end at a solution that is far from z.
        """
        if linear.n > PIVOT_UP_TO or (z := self._on_active_set(linear, self.current.z)) is None:
            return None
        new = self.path.point(z)
        return new if new and new.theta <= INNER_REDUCTION * self.current.theta else None

    def _on_active_set(self, linear: ProblemData, z: Vector) -> Vector | None:
        """The solution of the equations of the `linear` problem with the active set of `z`, if there is one."""
        pattern = Pattern.at(linear, z)
        with suppress(SingularOperator):
            return self.path.clip(solve_on(linear, z, pattern.active, pattern.above))
        return None

    def _trials(
        self, linear: ProblemData, W: Vector, z: Vector, tolerance: float
    ) -> Iterator[tuple[float, NewtonPoint | None]]:
        """The step to `z`, a second one by the same tangent, that to a nearer solution, and shorter ones.

        The limit of the steps comes first where they shrink by a constant factor. Each comes with the share of θ that
        may be left, the limit and the nearer solution only where they leave little.
        Along curved equations steps are short, unless a second one, with their values at z, returns to them (Fletcher,
        Lecture Notes in Math. 912, 1982).
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
            yield _SECOND_STEP_LENGTH, None if again is None else self.path.point(again)
        yield np.inf, self._with_active_set(linear)
        for k in range(1, MAX_HALVINGS):
            yield 1.0 - ARMIJO * 0.5**k, self.path.point(self.current.z + 0.5**k * step)

    def _equations(self, pattern: Pattern, point: NewtonPoint, W: Vector) -> float:
        """‖·‖ of r in the active rows of the `pattern`, and of p and the proximal term in its free rows, at `point`."""
        r = self.problem.r(point.z)
        r_upper = self.problem.r_upper(point.z)
        if pattern.above is not None and r_upper is not None:
            r = np.where(pattern.above, r_upper, r)
        p = point.p + W * (point.z - self.current.z)
        return norm(np.where(pattern.active, r, p / self.path.omega))

    def _descent(self, linear: ProblemData) -> NewtonPoint | None:
        """A point at which θ is smaller, in a direction in which it falls; None without a derivative of ψ."""
        if linear.psi.no_derivative() is not None:
            return None
        return self.path.descend(self.current, NewtonPoint(linear, self.path.omega, self.current.z))


def _proximal(linear: ProblemData, z: Vector, W: Vector) -> ProblemData:
    """The `linear` problem with W(z⁺ − z) added to p, W a diagonal. MapError beyond the floats."""
    if not W.any():
        return linear
    q = linear.q - W * z
    if fault := not_finite(q, "q of the proximal problem"):
        raise MapError(f"{fault}; a finite number was expected")
    A = linear.dense() + np.diag(W) if linear.matrix.dense is not None else sp.csr_array(linear.A + sp.diags_array(W))
    return type(linear)(A, q, linear.psi)
