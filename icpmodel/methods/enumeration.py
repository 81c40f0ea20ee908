"""All linear pieces of a small problem, one after the other."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from typing import ClassVar

import numpy as np

from ..algebra.linear_rows import LinearRows, SideChoices, piece_count
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from ..theory.answers import Answer
from ..theory.solution_set import ExactRows
from .contract import Infeasible, Iterate, Method, with_options

#: problems with more choices are refused: n = 14 with one obstacle in every row
MAX_CHOICES = 16_384
#: the largest number of linearisations of an obstacle that is not affine
_MAX_LINEARISATIONS = 20


@with_options
class Enumerate(Method):
    """Solve the linear system of each choice of p_i = 0, z_i = ψ_i(z) or z_i = ψ̄_i(z), and check the signs.

    Raises
    ------
    Infeasible
        Where no choice holds a solution: each was excluded with bounds on its rounding, or in rational arithmetic.

    Notes
    -----
    Problems of up to 2¹⁴ choices are taken: n = 14 with one obstacle in every row, n = 8 with two.
    An obstacle that is not affine is linearised at the best point so far, up to 20 times; then nothing is proved.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 3.1: complementary cones.

    Examples
    --------
    >>> ICP([[0, 1], [1, 0]], [-1, -1]).solve("enumerate").z
    array([1., 1.])
    """

    name: ClassVar[str] = "enumerate"
    family: ClassVar[str] = "shortcut"
    finite: ClassVar[bool] = True

    def why_not(self, problem: ProblemData) -> str | None:
        if (reason := problem.psi.no_derivative()) is not None:
            return reason
        return f"there are too many choices (more than {MAX_CHOICES})" if piece_count(problem) > MAX_CHOICES else None

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        undecided: list[SideChoices] = []

        def candidates(z: Vector) -> Iterator[Vector]:
            for batch in LinearRows.of(problem, z).batches():
                undecided.append(batch.sides[~batch.empty])
                yield from batch.z[~batch.empty & np.isfinite(batch.z).all(axis=1)]

        yield from successive_linearisations(problem, z, candidates)
        if problem.psi.linear is not None:
            yield from _exact_solutions(problem, np.concatenate(undecided))


def successive_linearisations(
    problem: ProblemData, z: Vector, candidates: Callable[[Vector], Iterator[Vector]]
) -> Iterator[Iterate]:
    """Yield `z`, then the `candidates`, with their residuals.

    Obstacles that are not affine are linearised again at the best candidate, up to 20 times.
    """
    yield z, None
    for _ in range(1 if problem.psi.linear is not None else _MAX_LINEARISATIONS):
        best = (np.inf, z)
        for candidate in candidates(z):
            residual = problem.residual(candidate)
            best = min(best, (residual, candidate), key=lambda pair: pair[0])
            yield candidate, residual
        if best[1] is z:
            return
        z = best[1]


def _exact_solutions(problem: ProblemData, undecided: SideChoices) -> Iterator[Iterate]:
    """Solutions of the `undecided` pieces in fractions, rounded. Raises Infeasible where there are none."""
    exact = ExactRows(problem)
    any_solution = False
    for sides in exact.consistent(undecided):
        if (solutions := exact.solve(sides)) is not None:
            any_solution = True
            yield solutions.rounded().point, None
    if not any_solution:
        reason = f"none of all {piece_count(problem):.0f} choices of active rows leaves a z with the right signs"
        raise Infeasible(Answer(True, f"no z solves the problem: {reason}"))
