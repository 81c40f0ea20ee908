"""Parts of a problem that are solved apart: by the methods that fit them, in turn where they hang on each other.

A stage is a set of parts that hang on earlier stages only. One that has no solution proves that the whole has none if
the proof, with 0 in all other rows, is one of the whole; or where the unknowns that the stage hangs on have one answer,
of which the error bound says how far it is from what is known of it.
References: Cottle, Pang and Stone, The Linear Complementarity Problem (1992), section 4.4; Brent, BIT 20 (1980), for
cycles.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from itertools import count
from typing import Any

import numpy as np

from ..algebra.subproblems import Blocks, Mask, Rows, restricted
from ..errors import SingularOperator
from ..methods.contract import HandOver, Infeasible, Method
from ..numerics.arrays import Vector, norm
from ..problem.affine import Constant
from ..problem.data import ProblemData
from ..theory.certificates.bounds import error_bound
from ..theory.certificates.infeasible import Known, infeasible
from .choice import Choice, choose

#: an iterate is what reduces the residual of the parts to this share, or so many of their steps; a method that brings
#: no better one in the second number gives way
_SHARE, _STEPS, _PATIENCE = 0.25, 20, 1000
#: a stage is left at the first share of the residual of the start, the next time at the next one; where there are many
#: stages so many iterates of them are shown
_SHARES, _TOGETHER = (1e-9, 1e-12, 1e-15, 0.0), 32

#: iterates with their residuals, and in the end the blocks that cannot be solved
Path = Generator[tuple[Vector, float | None], None, Mask]


class Part:
    """Unknowns that do not interact with those of other parts, and the methods that they are left to, in turn.

    Parameters: the `problem` in these unknowns; their `rows`, and `z` of shape (n,), in the whole; the `choices`,
    by default those of `choose`.
    """

    def __init__(self, problem: ProblemData, rows: Rows, z: Vector, choices: Iterator[Choice] | None = None) -> None:
        self.problem, self.rows, self.z = problem, rows, z[rows]
        self.start = self.z
        self.residual, self.choices = np.inf, choices or choose(problem)
        if choices is None:
            residual = problem.residual(self.z)
            self.residual = residual if residual < np.inf else np.inf
        self.path: Iterator[tuple[Vector, float | None]] | None = None
        self.steps, self.better_at, self.milestone_at, self.milestone = 0, 0, 1, self.z
        self.milestone_residual = np.nan
        self.over = False
        #: what proves that the part has no solution, where it is what it is now
        self.ray: Any = None

    def step(self) -> None:
        """One step of the method, or the next method where it fails: `over` where none is left."""
        try:
            if self.path is None:
                self._begin(next(self.choices).method, self.z)
            assert self.path is not None
            z, hint = next(self.path)
        except HandOver as to:
            self._begin(to.method, self.start if to.afresh else self.z)
            return
        except StopIteration:
            self.over = True
            return
        except SingularOperator:
            self.path = None
            return
        except Infeasible as proof:
            self.path, self.ray = None, proof.answer.witness
            return
        residual = self.problem.residual(z) if hint is None else hint
        self.steps += 1
        if residual < self.residual:
            self.z, self.residual, self.better_at = z, residual, self.steps
        recurred = residual == self.milestone_residual and np.array_equal(z, self.milestone)
        if recurred or self.steps - self.better_at >= _PATIENCE or not residual < np.inf:
            self.path = None
        if self.steps >= 2 * self.milestone_at:  # Brent's cycle search
            self.milestone_at, self.milestone, self.milestone_residual = self.steps, z, residual

    def _begin(self, method: Method, start: Vector) -> None:
        self.path, self.steps, self.better_at = method.iterates(self.problem, start), 0, 0
        self.milestone_at, self.milestone_residual = 1, np.nan


def _together(parts: list[Part]) -> float:
    """The residual of all parts."""
    return _size(np.array([part.residual for part in parts]))


def _size(x: Vector) -> float:
    return norm(x) if x.size else 0.0


def advance(parts: list[Part], z: Vector) -> Vector:
    """`z`, shape (n,), after steps of the parts that are worst, until together they are better; a new array."""
    enough = _SHARE * _together(parts)
    for _ in range(_STEPS):
        live = [part for part in parts if not part.over]
        if not live or _together(parts) <= enough:
            break
        max(live, key=lambda part: part.residual).step()
    z = z.copy()
    for part in parts:
        z[part.rows] = part.z
    return z


def in_turn(problem: ProblemData, found: Blocks, z: Vector) -> Path:
    """The stages one after the other, each on what the earlier ones are by then, and the blocks that follow from them.

    A stage is left when its residual is small beside that of the start; where the end is not good enough, all are gone
    through again, for less. Returns which small blocks cannot be solved, a mask; where all can, z stands still in the
    end. Raises Infeasible where it is proved that there is no solution.
    """
    at_0 = problem.residual_at_0()
    scale = max((x for x in (at_0, problem.residual(z)) if x < np.inf), default=0.0)
    last, every, spent = len(found.stages) - 1, len(found.stages) // _TOGETHER + 1, False
    yield (shown := z), None
    for share in _SHARES:
        for at, stage in enumerate(found.stages):
            parts = [Part(restricted(found.problem, rows, z), rows, z) for rows in stage]
            follow = found.after if at == last else found.between[at]
            enough = share * scale if at < last or follow.any() else 0.0
            for step in count(at):
                if _together(parts) <= enough or all(part.over for part in parts):
                    break
                z = advance(parts, z)
                _report(problem, parts, z)
                if step % every == 0:
                    yield (shown := z), None
            spent = spent or all(part.over for part in parts)
            z, solved = found.forward(z, follow)
            if not np.array_equal(solved, follow):
                return follow & ~solved
            if at == last and z is not shown:
                yield (shown := z), None
        if spent:
            break
    while True:
        yield z, None


def _report(problem: ProblemData, parts: list[Part], z: Vector) -> None:
    """Raises Infeasible where the proof that one of the `parts` has no solution is one of the whole problem."""
    for part in parts:
        if part.ray is not None:
            y = np.zeros(problem.n)
            y[part.rows], part.ray = [float(x) for x in part.ray], None
            answer = infeasible(problem, y)
            if answer.holds is None and (known := _settled(problem, part.rows, z)):
                answer = infeasible(problem, y, known)
            if answer.holds:
                raise Infeasible(answer)


def _settled(problem: ProblemData, rows: Rows, z: Vector) -> Known | None:
    """What is proved of the unknowns that the `rows` hang on, where these have an answer of their own near `z`."""
    A, seen = problem.A, np.zeros(problem.n, dtype=bool)
    seen[rows] = True
    new = rows
    while new.size:
        reached = np.unique(A[new].indices)
        new = reached[~seen[reached]]
        seen[new] = True
    seen[rows] = False
    earlier = np.flatnonzero(seen)
    if not earlier.size or not isinstance(problem.psi, Constant) or not seen[A[earlier].indices].all():
        return None
    bound = error_bound(restricted(problem, earlier, z), z[earlier])
    if bound.componentwise is None:
        return None
    low, high = np.full(problem.n, -np.inf), np.full(problem.n, np.inf)
    low[earlier] = np.nextafter(z[earlier] - bound.componentwise, -np.inf)
    high[earlier] = np.nextafter(z[earlier] + bound.componentwise, np.inf)
    return Known(low, high, bound.proof)
