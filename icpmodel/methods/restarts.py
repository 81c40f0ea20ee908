"""Many starts, for problems whose matrix is neither monotone nor a P-matrix."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice
from typing import ClassVar

import numpy as np

from ..algebra.affine_lcp import PIVOTS, AffineLcp, dense_lcp, some_pivots
from ..algebra.equations import solve_on
from ..errors import MapError, SingularOperator
from ..numerics.arrays import Vector, as_number
from ..problem.data import ProblemData
from .contract import Iterate, Method
from .newton import Newton
from .shortcuts import Lemke

#: Newton's steps from one start, and how many tries with pivots come before the next start
_STEPS, _PIVOTED = 60, 20


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Restarts(Method):
    """Newton's method from random starts, and Lemke's pivots with random covering vectors, in turn.

    Parameters
    ----------
    tries : int, default 400
        The number of covering vectors; one start of Newton's method comes with every 20 of them.
    seed : int, default 0
        Of the random numbers: the same seed gives the same iterates.

    Notes
    -----
    Lemke's pivots go from a ray of w = q + My + d·t to t = 0. Where M is no P-matrix the path, and whether it ends in
    a solution, depends on the covering vector d > 0. It is drawn as exp(3u), u uniform in [−1, 1]^n. Where the obstacle
    is neither affine nor fixed there are no pivots. Newton's starts are z = ψ + s|x| with x normal, half of its entries
    0, and s the largest entry of D⁻¹q, ψ and z⁰.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4.

    Examples
    --------
    >>> A = [[3, -5, -4, -3], [-4, 3, 4, 1], [-5, -4, -2, -1], [1, 0, -3, -4]]
    >>> ICP(A, [4, 2, 20, -1]).solve("restarts").solved
    True
    """

    name: ClassVar[str] = "restarts"
    memoryless: ClassVar[bool] = False
    finite: ClassVar[bool] = True

    tries: int = 400
    seed: int = 0

    def __post_init__(self) -> None:
        as_number(self.tries, "tries", least=1, whole=True)
        as_number(self.seed, "seed", least=0, whole=True)

    def why_not(self, problem: ProblemData) -> str | None:
        return Newton().why_not(problem) and Lemke().why_not(problem)

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        yield z, None
        rng = np.random.default_rng(self.seed)
        lcp = None
        if Lemke().why_not(problem) is None:
            with suppress(SingularOperator):
                lcp = dense_lcp(problem)
        has_newton = Newton().why_not(problem) is None
        scale = _scale(problem, z)
        for k in range(self.tries):
            if has_newton and k % _PIVOTED == 0:
                start = _start(problem, z, scale, rng) if k else z
                with suppress(MapError):
                    path = islice(Newton().iterates(problem, start), _STEPS)
                    yield min(path, key=lambda iterate: np.inf if iterate[1] is None else iterate[1])
            if lcp is not None and (found := _pivoted(problem, lcp, rng)) is not None:
                yield found, None


def _scale(problem: ProblemData, z: Vector) -> float:
    """The largest entry of D⁻¹q, ψ(z) and z, 1 where all are 0."""
    sizes = np.concatenate([problem.q / problem.matrix.weights, problem.psi.value(z), z])
    largest = float(np.abs(sizes[np.isfinite(sizes)]).max(initial=0.0))
    return largest or 1.0


def _start(problem: ProblemData, z: Vector, scale: float, rng: np.random.Generator) -> Vector:
    """A random start above the obstacle, in half of the rows on it."""
    obstacle = problem.psi.value(z)
    above = np.where(rng.random(z.size) < 0.5, scale * np.abs(rng.normal(size=z.size)), 0.0)
    return np.where(np.isfinite(obstacle), obstacle, z) + above


def _pivoted(problem: ProblemData, lcp: AffineLcp, rng: np.random.Generator) -> Vector | None:
    """What Lemke's pivots find with a random covering vector, None where they end in a ray. Raises OutOfTime."""
    from ..numerics.kernels.pivoting import SOLVED, START  # loads numba

    covering = np.exp(rng.uniform(-3.0, 3.0, len(lcp.q)))
    ended, _, y, _ = some_pivots(lcp.start(covering), START, PIVOTS * (len(lcp.q) + 1))
    if ended != SOLVED:
        return None
    with suppress(SingularOperator, MapError):
        return solve_on(problem, lcp.z(y), *lcp.held(y))
    return lcp.z(y)
