"""Multilevel modulus Newton: inexact Newton steps on the modulus equation, started from the coarser levels.

Every level of an algebraic multigrid hierarchy of A carries a problem of its own: A_c = PᵀAP, q_c = Pᵀq, and ψ at the
points that are kept. Its answer is where the finer level starts, so that the active set there is wrong near its border
only. On each level

1. sweeps of projected Gauss–Seidel move the border of the active set,
2. the active rows take z = ψ(z), linearised,
3. a few steps of a Krylov method (GCR), preconditioned by V-cycles on the free rows, reduce Az + q there.

Nothing is known of a grid: A, q and ψ are all. ψ_i that moves with z_i alone is first made a fixed obstacle.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import islice, pairwise
from typing import ClassVar

import numpy as np
import scipy.sparse as sp

from ..arrays import Vector, row_of
from ..maps import Affine, Constant
from ..operators import Step, compiled_step
from ..problem import ICP
from ..reduction import has_fixed_obstacle, with_fixed_obstacle
from . import HandOver, Method, positive_diagonal
from .hierarchy import Hierarchy, Level, Mask, NoHierarchy
from .linear import FACTORISE_UP_TO
from .newton import Newton, derivative

#: sweeps where the active set has moved
_SWEEPS = 5
#: Krylov steps between two looks at the active set: until the rest has fallen to a share, and at the most
_SHARE, _KRYLOV = 0.1, 8
#: a coarser level is left at this share of its own Res(0), or after so many looks
_COARSE, _LOOKS = 1e-4, 8
#: a start with this share of Res(0) is kept
_NEAR = 1e-2
#: where so many looks do not halve the residual, or the second number do not reduce it at all, others do better
_PATIENCE, _SHORT_PATIENCE = 12, 5
#: entries above the diagonal that weigh so much more than those below make the sweeps go backwards
_FLOW = 1.1
#: ψ_i is not followed where 1 − ∂ψ_i/∂z_i is smaller
_LEAST_SLOPE = 0.1


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Multilevel(Method):
    """Newton's method on the modulus equation with algebraic multigrid, at the cost of about one linear solve with A.

    For matrices that multigrid is made for: a positive diagonal and little that is positive off it. Where its steps no
    longer reduce the residual it hands over to `Newton`, unless A is too large to be factorised.
    References: Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), for the active sets; Kornhuber, Numer. Math. 69
    (1994), for multigrid on them; Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20 (1983), for GCR.

    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Multilevel()).z
    array([1., 1.])
    """

    name: ClassVar[str] = "multilevel"
    memoryless: ClassVar[bool] = False

    def why_not(self, problem: ICP) -> str | None:
        """See `Method.why_not`: D must be positive, and ψ have a derivative or move with z_i alone, by less than it.

        >>> Multilevel().why_not(ICP([[-2.0]], [1.0]))
        'its smoother divides by the diagonal of A, but A[0, 0] = -2'
        """
        found = positive_diagonal(problem, "its smoother divides by the diagonal of A")
        return found or (None if has_fixed_obstacle(problem) else Newton().why_not(problem))

    def iterates(self, problem: ICP, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`. It raises HandOver, never SingularOperator."""
        first = problem.residual(z)
        yield z, first
        why, last = "multigrid found no positive diagonal on a coarser level", z
        with suppress(NoHierarchy):
            for last, residual in _run(problem, z, first):
                yield last, residual
            why = "multilevel no longer reduced the residual"
        newton = Newton()
        if problem.n <= FACTORISE_UP_TO and newton.why_not(problem) is None:
            raise HandOver(newton, why)
        while True:  # nothing new will come
            yield last, None


def _run(problem: ICP, z: Vector, first: float) -> Iterator[tuple[Vector, float | None]]:
    """The run on the finest level, as long as it leads on; `first` is the residual of the start `z`."""
    hierarchy = Hierarchy(problem.A)
    simple = with_fixed_obstacle(problem) if has_fixed_obstacle(problem) else problem
    start = z if first <= _NEAR * problem.residual(np.zeros(problem.n)) else _start(hierarchy, simple)
    mark, best, halved_at, better_at = np.inf, np.inf, 0, 0
    for look, (iterate, residual) in enumerate(_path(hierarchy, simple, start, 0)):
        yield iterate, residual if simple is problem else None
        if residual < best:
            best, better_at = residual, look
        if residual <= 0.5 * mark:
            mark, halved_at = residual, look
        if look - halved_at >= _PATIENCE or look - better_at >= _SHORT_PATIENCE:
            return


def _start(hierarchy: Hierarchy, problem: ICP) -> Vector:
    """z from the coarser levels, each of which begins with the answer of the one below it."""
    problems = [problem]
    for level, coarser in pairwise(hierarchy.levels):
        problems.append(_coarse(problems[-1], level, coarser))
    z = np.zeros(problems[-1].n)
    for top in range(len(problems) - 1, 0, -1):
        enough = _COARSE * problems[top].residual(np.zeros(z.size))
        for near, residual in islice(_path(hierarchy, problems[top], z, top), _LOOKS):
            answer = near
            if residual <= enough:
                break
        z = hierarchy.levels[top - 1].P @ answer
    return z


def _coarse(problem: ICP, level: Level, coarser: Level) -> ICP:
    """The problem on the level below `level`, with ψ linearised at 0."""
    psi = problem.psi
    if isinstance(psi, Constant):
        return ICP(coarser.A, level.P.T @ problem.q, psi.c[level.kept])
    zero = np.zeros(problem.n)
    c, G = psi.value(zero), sp.csr_array(derivative(problem, zero) @ level.P)[level.kept]
    return ICP(coarser.A, level.P.T @ problem.q, Affine(G, c[level.kept]))


def _path(hierarchy: Hierarchy, problem: ICP, z: Vector, top: int) -> Iterator[tuple[Vector, float]]:
    """Newton's steps on level `top` of `hierarchy`, whose problem is `problem`: (z, residual) after each look."""
    level, moves = hierarchy.levels[top], not isinstance(problem.psi, Constant)
    omega, sweep = level.diagonal, _sweep(problem, level)
    newton: _NewtonStep | None = None
    while True:
        if moves:
            own = derivative(problem, z).diagonal()
            # p and r then change alike with z_i
            omega = level.diagonal / np.maximum(1.0 - own, _LEAST_SLOPE)
        p, r = problem.p(z), problem.r(z)
        if newton is None or not np.array_equal(r < p / omega, newton.active):
            for _ in range(_SWEEPS):
                z, _ = sweep(z)
            p, r = problem.p(z), problem.r(z)
        yield z, float(np.linalg.norm(np.minimum(p, r)))
        active = r < p / omega
        if newton is None or moves or not np.array_equal(active, newton.active):
            newton = _NewtonStep(hierarchy, problem, top, active, z, p, r)
            z = newton.start
        z = newton.further(z)


def _sweep(problem: ICP, level: Level) -> Step:
    """Projected Gauss–Seidel, from the last row to the first where what flows through A flows that way."""
    A, rows = level.A, row_of(level.A)
    below, above = (float(np.abs(A.data[side]).sum()) for side in (rows > A.indices, rows < A.indices))
    downwards = above <= _FLOW * below
    matrix = (A.indptr, A.indices, A.data, level.diag, problem.q)
    return compiled_step(problem, "projected", matrix, (level.inverse, downwards))


class _NewtonStep:
    """One linear system: (I − ψ′)z = … in the active rows, Az + q = 0 in the others. It may be gone on with."""

    def __init__(
        self, hierarchy: Hierarchy, problem: ICP, top: int, active: Mask, z: Vector, p: Vector, r: Vector
    ) -> None:
        self.hierarchy, self.problem, self.top, self.active = hierarchy, problem, top, active
        hierarchy.restrict(~active, top)
        self.J = None if isinstance(problem.psi, Constant) else derivative(problem, z)
        own = 0.0 if self.J is None else self.J.diagonal()
        self.slope = np.maximum(1.0 - own, _LEAST_SLOPE)
        self.coupled = self.J is not None and self.J.nnz > np.count_nonzero(own)
        step = np.where(active, -r / self.slope, 0.0)
        self.start = z + step
        self.rest = np.where(active, -r, -p) - self._product(step)
        self.directions: list[tuple[Vector, Vector]] = []

    def further(self, z: Vector) -> Vector:
        """`z` after some steps of GCR: each reduces ‖rest‖₂ as much as the last directions allow."""
        wanted = _SHARE * np.linalg.norm(self.rest)
        for _ in range(_KRYLOV):
            y = self._preconditioned(self.rest)
            w = self._product(y)
            for direction, image in self.directions:
                share = w @ image
                w -= share * image
                y -= share * direction
            size = float(np.linalg.norm(w))
            if not 0 < size < np.inf:
                break
            y /= size
            w /= size
            self.directions = [*self.directions[1 - _KRYLOV :], (y, w)]
            share = self.rest @ w
            z = z + share * y
            self.rest = self.rest - share * w
            if np.linalg.norm(self.rest) <= wanted:
                break
        return z

    def _preconditioned(self, f: Vector) -> Vector:
        if not self.coupled:
            return self.hierarchy.cycle(f, self.top)
        step = np.where(self.active, f / self.slope, 0.0)
        return step + self.hierarchy.cycle(f - self.problem.A @ step, self.top)

    def _product(self, y: Vector) -> Vector:
        """The matrix of the system times `y`."""
        image = self.problem.A @ y
        if self.J is None:
            return np.where(self.active, y, image)
        return np.where(self.active, y - self.J @ y, image)
