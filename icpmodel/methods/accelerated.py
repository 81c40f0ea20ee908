"""Anderson acceleration of any fixed-point method of the package, safeguarded by the residual."""

from __future__ import annotations

from collections.abc import Iterator
from typing import Any, ClassVar

import numpy as np

from ..algebra.relaxation import AUTO, cautious_omega, jacobi_step
from ..algebra.steps import MAX_IDLE_STEPS, StepResult, repeated_steps
from ..errors import InputError, MapError
from ..numerics import work
from ..numerics.arrays import Vector, as_number, described
from ..problem.data import ProblemData
from .aor import MNMAOR
from .contract import SAFE_SIZE, FixedPoint, Iterate, LeastValue, Method, named, with_options
from .psor import PSOR

#: an accelerated iterate may have this many times the least residual so far
_MAX_GROWTH = 10.0
#: the number of Python calls in a step besides the sweep
_CALLS_PER_STEP = 2.0
#: directions of the history whose pivot in the scaled normal equations is at most this are left out as rounding errors
_MIN_INDEPENDENCE = 1e-10


@with_options
class Accelerated(Method):
    """Anderson acceleration (type II) of the fixed-point method `of`.

    Let g be the map of the method and f(z) = g(z) − z. Every `mixing_frequency`-th step is

        z⁺ = g(z) − ΔG γ,        γ = argmin (f(z) − ΔF γ)ᵀ D (f(z) − ΔF γ).

    ΔG and ΔF hold the differences of the last `history_size` + 1 values of g and f. D is the
    diagonal of A, so that symmetric scaling does not change γ. The other steps are plain.

    Parameters
    ----------
    of : str or Method, optional
        A method whose iterates are those of one map: a member of the modulus family, `PSOR`, or a
        `FixedPoint` of your own. One with theta1="auto" runs with the numbers of `adapt(problem)`.
        The default is MNMAOR(theta1="auto"). Where every ψ_i depends on z_i alone and changes by
        less than z_i, it is PSOR with the ω of `algebra.relaxation.cautious_omega`. The default
        begins with one Jacobi step.
    history_size : int, default 7
        Number of differences, at least 1.
    mixing_frequency : int, default 3
        The number of steps from one combination to the next, at least 1.

    Raises
    ------
    InputError
        For another method or a wrong number.

    Notes
    -----
    **Cost.** A combination costs about as much as a sweep, so not every step is one. With more than
    two plain steps in between, sweeps that diverge would get too far.

    **Special cases.** Where g is linear and `mixing_frequency` is 1 this is GMRES, restarted
    gradually. Where g is affine, n ≤ 2 and `mixing_frequency` is 3, the third step is exact.

    **Safeguard.** A combination is kept only if its residual is at most ten times the least one so
    far. The next sweep yields that residual for free. Otherwise the plain step is taken and the
    history cleared. If a hundred steps do not reduce the least residual by a tenth, a hundred plain
    ones follow, and the number doubles.

    **Convergence.** The method converges where g contracts in some norm and the residual bounds the
    error, as for H₊-matrices and ψ of small slope. Then K plain steps reduce the least residual by a
    tenth from any point, for some K. If combinations fail often enough, K plain steps are made.

    References
    ----------
    Anderson, J. ACM 12 (1965). Walker and Ni, SIAM J. Numer. Anal. 49 (2011). Pratapa, Suryanarayana
    and Pask, J. Comput. Phys. 306 (2016), for the steps between.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Accelerated(of="mnmgs")).z.round(6)
    array([1., 1.])
    >>> Accelerated(of="newton")
    Traceback (most recent call last):
    icpmodel.errors.InputError: newton cannot be accelerated: its iterates are not those of one map z -> g(z)
    """

    name: ClassVar[str] = "accelerated"
    family: ClassVar[str] = "modulus"
    to_try: ClassVar[str] = "another method to accelerate (of), another history_size or mixing_frequency"
    of: Any = None
    history_size: int = 7
    mixing_frequency: int = 3

    def __post_init__(self) -> None:
        as_number(self.history_size, "history_size", minimum=1, whole=True)
        as_number(self.mixing_frequency, "mixing_frequency", minimum=1, whole=True)
        if self.of is None:
            return
        method = named(self.of) if isinstance(self.of, str) else self.of
        if not isinstance(method, Method):
            raise InputError(f"of is {described(method)}; a Method or the name of one was expected")
        if not isinstance(method, FixedPoint):
            raise InputError(f"{method.name} cannot be accelerated: its iterates are not those of one map z -> g(z)")
        object.__setattr__(self, "of", method)

    def why_not_f(self, problem: ProblemData) -> str | None:
        return None  # `why_not` asks the method that is accelerated

    def why_not(self, problem: ProblemData) -> str | None:
        return (self.of or MNMAOR(theta1=AUTO)).why_not(problem)

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        of = self.of
        if of is None:
            of = PSOR(omega=cautious_omega(problem)) if problem.facts.has_fixed_obstacle else MNMAOR(theta1=AUTO)
        opening = of.opening(problem) if self.of else jacobi_step(problem)
        step = opening or of.step_of(problem)
        history = Differences(problem, self.history_size)
        phase = _Phases()
        ahead: list[StepResult] = []
        sweeps = 0
        fallback = None
        least = np.inf
        while True:
            if sweeps == 1 and opening:
                step = of.step_of(problem)
                opening = None
            try:
                ahead = ahead or repeated_steps(step, z, self.mixing_frequency - sweeps % self.mixing_frequency)
                image, hint = ahead.pop(0)
            except MapError:
                if fallback is None:
                    raise
                image = z
                hint = np.nan
            residual = _residual(problem, z, hint)
            if fallback is not None and not residual <= _MAX_GROWTH * least:
                z = fallback
                fallback = None
                ahead = []
                history.clear()
                continue
            yield z, residual
            least = min(least, residual)
            sweeps += 1
            fallback = None
            following = image
            if not phase.accelerates(residual):
                history.clear()
            else:
                history.add(z, image)
                if sweeps % self.mixing_frequency == 0 and (combined := history.combined()) is not None:
                    following = combined
                    fallback = image
                    ahead = []
            z = following


class _Phases:
    """The phases of a run: accelerated steps, then as many plain ones if those did not reduce the residual."""

    def __init__(self) -> None:
        self.most_steps = MAX_IDLE_STEPS
        self.residuals = LeastValue()

    def accelerates(self, residual: float) -> bool:
        """Whether the next step is an accelerated one, after a step to `residual`."""
        idle = self.residuals.add(residual)
        if idle > 2 * self.most_steps:
            self.most_steps *= 2
            self.residuals = LeastValue(residual)
            return True
        return idle <= self.most_steps


class Differences:
    """The last `size` + 1 values of f(z) = g(z) − z and of g(z), the rows of F and G."""

    def __init__(self, problem: ProblemData, size: int) -> None:
        weight = np.abs(problem.matrix.rows.diagonal)
        # rows without a diagonal entry count as if theirs were the largest
        self.weight = np.where(weight > 0, weight / (weight.max() or 1.0), 1.0)
        rows = min(size, problem.n) + 1
        self.F = np.empty((rows, problem.n))
        self.G = np.empty((rows, problem.n))
        self.clear()

    def clear(self) -> None:
        """Drop all pairs."""
        self.count = self.newest = 0

    def add(self, z: Vector, image: Vector) -> None:
        """Keep f(z) and `image` = g(z) in place of the oldest pair."""
        self.newest = (self.newest + 1) % len(self.F) if self.count else 0
        self.count = max(self.count, self.newest + 1)
        np.subtract(image, z, out=self.F[self.newest])
        work.count(_CALLS_PER_STEP * work.COSTS.call + 2.0 * work.COSTS.vector * z.size)
        self.G[self.newest] = image

    def combined(self) -> Vector | None:
        """g(z) − ΔGγ, z the newest iterate; None if the history is too short or dependent."""
        from ..numerics.kernels.anderson import combine

        out = np.empty(self.weight.size)
        work.count(3.0 * self.count * work.COSTS.vector * out.size)
        if self.count > 1 and combine(self.F, self.G, self.count, self.newest, self.weight, _MIN_INDEPENDENCE, out):
            return out
        return None


def _residual(problem: ProblemData, z: Vector, hint: float | None) -> float:
    """The residual of z: the hint of the sweep, unless its squares may have over- or underflown."""
    return hint if hint is not None and (SAFE_SIZE < hint < 1.0 / SAFE_SIZE or np.isnan(hint)) else problem.residual(z)
