"""Projected successive overrelaxation, a baseline: Gauss–Seidel rows, each projected on its obstacle at once."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar, NamedTuple

import numpy as np

from ..algebra.subproblems import PIVOT_UP_TO, with_fixed_obstacle
from ..algebra.sweeps import Step, compiled_step, watched_sweeps
from ..errors import MapError
from ..numerics.arrays import Vector, as_number
from ..problem.data import ProblemData
from .contract import FixedPoint, HandOver, positive_diagonal

#: plain sweeps on trial are looked at after so many, and whenever their number has doubled
_LOOK = 10
#: whether they are quick is judged by how many more bring the residual to this share of the first one
_SHARE = 1e-8
#: how many sweeps it takes from here to there is told from the rate of the last ones
_RATE = 2
#: plain sweeps are looked at once before, after so many, for a rate by which so many times as many would be needed as
#: the first look lets pass and are worth it then: rates seldom become better
_EARLY, _FAR = 3, 4.0


#: see `PSOR.on_trial`
Narrow = Callable[[Vector, Vector, float, float, float], HandOver | None]


class _Trial(NamedTuple):
    """What `PSOR.on_trial` is told."""

    sweeps: float
    then: Callable[[], HandOver | None]
    first: float | None
    narrow: Narrow | None
    look: int


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class PSOR(FixedPoint):
    """z_i⁺ = max(ψ_i(z), z_i − (ω/a_ii)(Σ_{j<i} a_ij z_j⁺ + Σ_{j≥i} a_ij z_j + q_i)), 0 < ω < 2.

    It is not of the form z − 2X⁻¹F(z): the projection sits inside the substitution.
    Reference: Cryer, SIAM J. Control 9 (1971).

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(PSOR(omega=1.1)).z.round(6)
    array([1., 1.])
    """

    name: ClassVar[str] = "psor"
    to_try: ClassVar[str] = "a smaller omega"
    omega: float = 1.0
    #: see `on_trial`
    trial: ClassVar[_Trial | None] = None

    @classmethod
    def on_trial(
        cls,
        sweeps: float,
        then: Callable[[], HandOver | None],
        first: float | None = None,
        narrow: Narrow | None = None,
        *,
        omega: float = 1.0,
        look: int = _LOOK,
    ) -> PSOR:
        """Sweeps that hand over where the observed rate says that they need more than so many `sweeps`.

        Parameters: `then` is called at that point, and says to which method, or None: then they stay. `first` is the
        residual by which the rate is judged, by default that of 0. Where they stay, and at once where ψ is constant and
        the start is better than 0, `narrow` is called with the iterate, the next one, the first residual, the last one
        and the number of sweeps that are still needed, as far as is known; it may say what goes on with fewer rows.
        With another `omega` the first rates tell nothing: they are looked at after `look` sweeps, and whenever their
        number has doubled.

        For n ≤ 64 and a ψ that is constant or affine, or amounts to a fixed obstacle, one iterate is as many sweeps as
        it takes, in one compiled call, and there are no rows that would be worth to leave out.

        >>> problem = ICP([[2, -1, 0], [-1, 2, -1], [0, -1, 2]], [-1, -1, -1])
        >>> problem.solve(PSOR.on_trial(5, lambda: HandOver(PSOR(omega=1.2), "too slow"))).method
        PSOR(omega=1.2)
        """
        new = cls(omega=omega)
        object.__setattr__(new, "trial", _Trial(sweeps, then, first, narrow, look))
        return new

    def __post_init__(self) -> None:
        as_number(self.omega, "omega", above=0, below=2)

    def why_not(self, problem: ProblemData) -> str | None:
        return positive_diagonal(problem, "projected SOR divides by the diagonal of A")

    def step_of(self, problem: ProblemData, wanted: Callable[[], float] | None = None) -> Step:
        """See `FixedPoint.step_of`; `wanted` as in `compiled_step`."""
        return compiled_step(problem, "in_order", *self._arguments(problem), problem.matrix.rows.above, wanted)

    def _arguments(self, problem: ProblemData) -> tuple[tuple[Any, ...], tuple[Any, ...]]:
        A = problem.A
        return (A.indptr, A.indices, A.data, problem.matrix.rows.diag, problem.q), ((self.omega,), True)

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`. On trial it raises HandOver where the sweeps are slow."""
        if not self.trial:
            yield from super().iterates(problem, z)
        if problem.n <= PIVOT_UP_TO:
            yield from self._in_one_call(problem, z)
        from ..numerics.kernels.sweeps import still_needed  # loads numba

        residuals: list[float] = []
        look, sweeps, first = (self.trial.look, self.trial.sweeps, 0.0) if self.trial else (0, 0.0, 0.0)
        to_come = math.inf  # after the sweep that told the last residual
        step = self.step_of(problem, lambda: to_come)
        while True:
            # what promises to be the last iterate is judged before another sweep is made, which would tell its residual
            promising = to_come <= 1.0
            if promising:
                yield z, None
            following, residual = step(z)
            if not promising:
                yield z, residual
            to_come = math.inf
            if look:
                assert residual is not None
                if not residuals:
                    first = self._first(problem, z, following, residual)
                residuals.append(residual)
                if len(residuals) > _RATE and residual > _SHARE * first:
                    to_come = still_needed(residuals[-1 - _RATE], residual, _SHARE * first, _RATE)
                early = len(residuals) == _EARLY + 1 and look == _LOOK and _FAR * (look + sweeps) < to_come < math.inf
                if early or len(residuals) > look:
                    look = 2 * look if self._stays(first, residuals, z, following) else 0
            z = following

    def _in_one_call(self, problem: ProblemData, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """As many sweeps as it takes at once, where that can be."""
        assert self.trial is not None
        sweeps, then, known, _, look = self.trial
        fixed = problem
        with suppress(MapError):
            if problem.facts.has_fixed_obstacle:
                fixed = with_fixed_obstacle(problem)
        run = watched_sweeps(fixed, *self._arguments(fixed))
        if run is None:
            return
        own = fixed is problem
        first, moved = known, z.any()
        if not first:
            first = _at_0(problem) if moved or not own else 0.0
            first = max(first, problem.residual(z)) if moved else first
        share, watched = _SHARE if own else _SHARE / 2, True  # r is up to 1 + Lipschitz < 2 times what z − c is
        yield z, None
        while True:
            z, residual, quick = run(z, first, share, look, sweeps)
            yield z, residual if own else None
            if watched and not quick and (over := then()):
                raise over
            first, watched = 0.0, False

    def _first(self, problem: ProblemData, z: Vector, following: Vector, residual: float) -> float:
        """The residual that the sweeps are judged by. Raises HandOver where a start near the answer proves enough."""
        assert self.trial is not None
        sweeps, _, known, narrow, _ = self.trial
        if known or not z.any():
            return known or residual
        at_0 = _at_0(problem)
        if not residual < at_0:
            return residual
        if narrow and problem.is_lcp and (over := narrow(z, following, at_0, residual, sweeps)):
            raise over
        return at_0

    def _stays(self, first: float, residuals: list[float], z: Vector, following: Vector) -> bool:
        """Whether to look again. Raises HandOver where the second half of the `residuals` shows slow sweeps."""
        assert self.trial is not None
        from ..numerics.kernels.sweeps import still_needed

        sweeps, then, _, narrow, _ = self.trial
        half, last = residuals[len(residuals) // 2], residuals[-1]
        if last <= _SHARE * first:
            return False
        needed = still_needed(half, last, _SHARE * first, len(residuals) - 1 - len(residuals) // 2)
        quick = needed <= sweeps
        over = then() if not quick else narrow and narrow(z, following, first, last, needed)
        if over:
            raise over
        return bool(quick)


def _at_0(problem: ProblemData) -> float:
    """Res(0), or 0 where it is not finite."""
    at_0 = np.inf
    with suppress(MapError):
        at_0 = problem.residual_at_0()
    return float(at_0) if at_0 < np.inf else 0.0
