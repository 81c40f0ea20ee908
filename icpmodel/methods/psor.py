"""Projected successive overrelaxation, a baseline: Gauss–Seidel rows, each projected on its obstacle at once."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from contextlib import suppress
from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np

from ..arrays import Vector, as_number
from ..errors import MapError
from ..problem import ICP
from ..steps import Step, compiled_step, rows_of
from . import FixedPoint, HandOver, positive_diagonal

#: sweeps on trial are looked at after so many, and whenever their number has doubled
_LOOK = 10
#: whether they are quick is judged by how many more bring the residual to this share of the first one
_SHARE = 1e-8


#: see `PSOR.on_trial`
Narrow = Callable[[Vector, Vector, float, float, float], HandOver | None]


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
    #: see `on_trial`: how many more sweeps are worth it, what comes where they are not, the first residual if it is
    #: another one than that of 0, and what to ask where they stay
    trial: ClassVar[tuple[float, Callable[[], HandOver | None], float | None, Narrow | None] | None] = None

    @classmethod
    def on_trial(
        cls,
        sweeps: float,
        then: Callable[[], HandOver | None],
        first: float | None = None,
        narrow: Narrow | None = None,
    ) -> PSOR:
        """Plain sweeps that hand over where the observed rate says that they need more than so many `sweeps`.

        Parameters: `then` is called at that point, and says to which method, or None: then they stay. `first` is the
        residual by which the rate is judged, by default that of 0. Where they stay, and at once where ψ is constant and
        the start is better than 0, `narrow` is called with the iterate, the next one, the first residual, the last one
        and the number of sweeps that are still needed, as far as is known; it may say what goes on with fewer rows.

        >>> problem = ICP([[2, -1, 0], [-1, 2, -1], [0, -1, 2]], [-1, -1, -1])
        >>> problem.solve(PSOR.on_trial(5, lambda: HandOver(PSOR(omega=1.2), "too slow"))).method
        PSOR(omega=1.2)
        """
        new = cls()
        object.__setattr__(new, "trial", (sweeps, then, first, narrow))
        return new

    def __post_init__(self) -> None:
        as_number(self.omega, "omega", above=0, below=2)

    def why_not(self, problem: ICP) -> str | None:
        """See `Method.why_not`."""
        return positive_diagonal(problem, "projected SOR divides by the diagonal of A")

    def step_of(self, problem: ICP) -> Step:
        """See `FixedPoint.step_of`."""
        A, rows = problem.A, rows_of(problem)
        matrix: tuple[Any, ...] = (A.indptr, A.indices, A.data, rows.diag, problem.q)
        return compiled_step(problem, "projected", matrix, ((self.omega,), True), reach=rows.above)

    def iterates(self, problem: ICP, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`. On trial it raises HandOver where the sweeps are slow."""
        residuals: list[float] = []
        look, first = _LOOK if self.trial else 0, 0.0
        step = self.step_of(problem)
        while True:
            following, residual = step(z)
            yield z, residual
            if look:
                assert residual is not None
                if not residuals:
                    first = self._first(problem, z, following, residual)
                residuals.append(residual)
                if len(residuals) > look:
                    look = 2 * look if self._stays(first, residuals, z, following) else 0
            z = following

    def _first(self, problem: ICP, z: Vector, following: Vector, residual: float) -> float:
        """The residual that the sweeps are judged by. Raises HandOver where a start near the answer proves enough."""
        assert self.trial is not None
        sweeps, _, known, narrow = self.trial
        if known or not z.any():
            return known or residual
        at_0 = np.nan
        with suppress(MapError):
            at_0 = problem.residual(np.zeros(problem.n))
        if not residual < at_0 < np.inf:
            return residual
        if narrow and problem.is_lcp and (over := narrow(z, following, at_0, residual, sweeps)):
            raise over
        return float(at_0)

    def _stays(self, first: float, residuals: list[float], z: Vector, following: Vector) -> bool:
        """Whether to look again. Raises HandOver where the second half of the `residuals` shows slow sweeps."""
        assert self.trial is not None
        sweeps, then, _, narrow = self.trial
        half, last = residuals[len(residuals) // 2], residuals[-1]
        if last <= _SHARE * first:
            return False
        with np.errstate(all="ignore"):
            speed = np.log(np.float64(half) / last) / (len(residuals) - 1 - len(residuals) // 2)
            needed = np.log(np.float64(last) / (_SHARE * first)) / speed
        quick = speed > 0 and needed <= sweeps
        over = then() if not quick else narrow and narrow(z, following, first, last, needed)
        if over:
            raise over
        return bool(quick)
