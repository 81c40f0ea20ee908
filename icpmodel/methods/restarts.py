"""Many starts, for problems whose matrix is neither monotone nor a P-matrix."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from itertools import islice
from typing import ClassVar

import numpy as np

from ..algebra.affine_lcp import AffineLcp, dense_lcp
from ..algebra.equations import solve_on
from ..errors import MapError, SingularOperator
from ..numerics.arrays import Vector, as_number, largest_size
from ..problem.data import ProblemData
from ..theory.certificates.contradiction import multipliers
from .contract import Iterate, Method, with_options
from .newton import MAX_DESCENTS, Newton
from .shortcuts import Lemke, raise_if_infeasible

#: the number of tries for each start of Newton's method, with pivots and without: at n = 20 a start took as long as
#: 1500 tries with pivots, and succeeded five times as often
_TRIES_WITH_PIVOTS = 100
_TRIES_WITHOUT_PIVOTS = 20


@with_options
class Restarts(Method):
    """Lemke's pivots from random starts, and Newton's method from z⁰ and from random starts, in turn.

    Parameters
    ----------
    tries : int, default 400
        The number of starts of the pivots. One start of Newton's method comes after every 100 of them, or after every
        20 where there are no pivots.
    seed : int, default 0
        Seed of the random numbers: the same seed gives the same iterates.

    Notes
    -----
    Lemke's pivots go from a ray of w = q + My + d·t to t = 0. Where M is no P-matrix the path, and whether it ends in
    a solution, depends on the covering vector d > 0. d is drawn as exp(6u), u uniform in [−1, 0]^n. From y = 0 some
    problems end in a ray whatever d is, such as games of two players, whose M is [[0, A], [Bᵀ, 0]]. So every second
    path is that of Lemke and Howson: a random y_i grows until the last w_l < 0 becomes 0, y_l enters as well, and along
    the path y_i w_i = 0 is dropped. Where that ray is not feasible, random entries of d make it so.

    Where the obstacle is neither affine nor fixed there are no pivots. Newton's starts are z = ψ + s|x| with x normal,
    half of its entries 0, and s the largest entry of D⁻¹q, ψ and z⁰. Only candidates with a smaller residual than all
    before become iterates.

    After the last try the y of a linear program is tried as a proof that p ≥ 0 and r ≥ 0 contradict each other. If it
    is one, `Infeasible` is raised.

    References
    ----------
    Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4. Lemke and Howson, SIAM J. Appl.
    Math. 12 (1964).

    Examples
    --------
    >>> A = [[3, -5, -4, -3], [-4, 3, 4, 1], [-5, -4, -2, -1], [1, 0, -3, -4]]
    >>> ICP(A, [4, 2, 20, -1]).solve("restarts").solved
    True
    """

    name: ClassVar[str] = "restarts"
    family: ClassVar[str] = "shortcut"
    finite: ClassVar[bool] = True

    tries: int = 400
    seed: int = 0

    def __post_init__(self) -> None:
        as_number(self.tries, "tries", minimum=1, whole=True)
        as_number(self.seed, "seed", minimum=0, whole=True)

    def why_not(self, problem: ProblemData) -> str | None:
        no_pivots = Lemke().why_not(problem)
        no_newton = Newton().why_not(problem)
        if no_newton is None and self.tries < _TRIES_WITHOUT_PIVOTS:
            no_newton = f"tries = {self.tries}; Newton's method starts after {_TRIES_WITHOUT_PIVOTS}"
        return no_pivots and (no_newton and f"{no_pivots}; {no_newton}")

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        best = problem.residual(z)
        yield z, best
        for candidate, residual in self._candidates(problem, z):
            if residual < best:
                best = residual
                yield candidate, residual
        if (y := multipliers(problem)) is not None:
            raise_if_infeasible(problem, y)

    def _candidates(self, problem: ProblemData, z: Vector) -> Iterator[tuple[Vector, float]]:
        """The candidates of all tries, with their residuals."""
        rng = np.random.default_rng(self.seed)
        lcp = None
        if Lemke().why_not(problem) is None:
            with suppress(SingularOperator):
                lcp = dense_lcp(problem)
        every = _TRIES_WITHOUT_PIVOTS if lcp is None else _TRIES_WITH_PIVOTS
        has_newton = Newton().why_not(problem) is None
        scale = scale_of_starts(problem, z)
        start = z
        for k in range(self.tries):
            with suppress(MapError):
                if lcp is not None and (candidate := _pivot(problem, lcp, rng, k % 2 == 1)) is not None:
                    yield candidate, problem.residual(candidate)
            if has_newton and (k + 1) % every == 0:
                with suppress(MapError):
                    for candidate, residual in islice(Newton().iterates(problem, start), MAX_DESCENTS):
                        yield candidate, problem.residual(candidate) if residual is None else residual
                start = start_above(problem, z, scale, rng)


def scale_of_starts(problem: ProblemData, z: Vector) -> float:
    """The largest size of an entry of D⁻¹(q + f(z)), ψ(z) and z."""
    return largest_size(problem.offset(z) / problem.matrix.weights, problem.psi.value(z), z)


def start_above(problem: ProblemData, z: Vector, scale: float, rng: np.random.Generator) -> Vector:
    """A random start above the obstacle, in half of the rows on it."""
    obstacle = problem.psi.value(z)
    above = np.where(rng.random(z.size) < 0.5, scale * np.abs(rng.normal(size=z.size)), 0.0)
    return np.where(np.isfinite(obstacle), obstacle, z) + above


def _pivot(problem: ProblemData, lcp: AffineLcp, rng: np.random.Generator, exchanges: bool) -> Vector | None:
    """z by Lemke's pivots from a random start, None if they end in a ray. Raises OutOfTime.

    The covering vector is random. With `exchanges` the path is that of Lemke and Howson from a random y_i.
    """
    rows = rng.permutation(np.flatnonzero(lcp.bound == np.inf))[: 2 if exchanges else 0]
    path = lcp
    dropped = None
    if rows.size:
        dropped = rows[0]
        column = lcp.M[:, dropped]
        is_raised = (column > 0.0) & (lcp.bound == np.inf)
        is_raised[dropped] = False
        if is_raised.any():
            # the last row that a growing y_i makes feasible
            rows[-1] = np.argmin(np.where(is_raised, lcp.q / np.where(is_raised, column, 1.0), np.inf))
        try:
            path = lcp.pivot_transform(rows)
        except SingularOperator:
            return None
    covering = np.exp(rng.uniform(-6.0, 0.0, len(lcp.q)))
    y = path.solve(covering, dropped)
    if y is None:
        return None
    y[rows] = np.where(y[rows] > 0.0, 0.0, path.w(y)[rows])
    with suppress(SingularOperator, MapError):
        return solve_on(problem, lcp.z(y), *lcp.active_rows(y))
    return lcp.z(y)
