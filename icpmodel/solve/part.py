"""A part of a problem, solved by the run that solves whole problems."""

from __future__ import annotations

from contextlib import suppress

import numpy as np

from ..algebra.subproblems import Rows
from ..errors import MapError
from ..numerics.arrays import Vector, norm
from ..problem.data import ProblemData
from .choice import choose
from .goal import Goal
from .run import Run

#: steps of the worst part are made until the residual of all is this share of what it was, or so many of them
_SHARE, _STEPS = 0.25, 20


class Part:
    """Unknowns that do not interact with those of other parts.

    Parameters: the `problem` in these unknowns; their `rows`, and `z` of shape (n,), in the whole; `aim`, the share of
    Res_D(0) for which its steps are forecast, and the `family` that they are chosen from, as in `solve`. It is run
    until nothing more is to be had: who runs it says when it is enough.
    """

    def __init__(self, problem: ProblemData, rows: Rows, z: Vector, aim: float, family: str | None = None) -> None:
        self.problem, self.rows = problem, rows
        start = z[rows]
        known = [at_start := problem.residual(start)]
        with suppress(MapError):
            known.append(problem.residual_at_0())
        scale = max((x for x in known if x < np.inf), default=0.0)
        self.run = Run(problem, start, at_start, Goal(0.0), aim=aim, scale=scale)
        self.steps = self.run.steps(choose(problem, aim, family))
        self.over = False

    @property
    def z(self) -> Vector:
        """The best iterate."""
        return self.run.start if self.run.best is None else self.run.best.z

    @property
    def residual(self) -> float:
        """Its residual, inf where it is not a number."""
        residual = self.run.at_start if self.run.best is None else self.run.best.residual
        return residual if residual < np.inf else np.inf

    def step(self) -> None:
        """One step; `over` where none is left. Raises OutOfTime and OutOfMemory."""
        self.over = next(self.steps, self) is self
        if self.over and self.run.refused is not None and self.run.is_refused:
            raise self.run.refused.error


def together(parts: list[Part]) -> float:
    """The residual of all parts."""
    return norm(np.array([part.residual for part in parts])) if parts else 0.0


def advance(parts: list[Part], z: Vector) -> Vector:
    """`z`, shape (n,), after steps of the parts that are worst, until together they are better; a new array."""
    enough = _SHARE * together(parts)
    for _ in range(_STEPS):
        live = [part for part in parts if not part.over]
        if not live or together(parts) <= enough:
            break
        max(live, key=lambda part: part.residual).step()
    z = z.copy()
    for part in parts:
        z[part.rows] = part.z
    return z
