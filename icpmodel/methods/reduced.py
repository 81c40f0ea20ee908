"""Reduction: what need not be iterated on is left out, and what does not interact is solved apart.

1. Rows at rest: where A is a Z-matrix and the loads that lift z off a fixed obstacle are small beside
   those that hold it down, some rows stay at the obstacle. Which ones is guessed by a balance of the two; the guess is
   checked on every iterate, and rows where it is wrong (p_i < 0) are opened. For z ≤ z* such a row is certain to leave
   the obstacle; in the end p ≥ 0 on the rows that were left out makes the answer one of the whole problem.
2. The strong components of A and ψ, in their order, have unknowns of their own: a row alone is a maximum, a small block
   is pivoted, and what is left falls into parts, each of which gets the method that `choose` picks for it.

The iterates are those of the whole problem, and so is the residual that they are judged by.
References: Tarjan, SIAM J. Comput. 1 (1972), for the components; Chandrasekaran, Opsearch 7 (1970), for rows that once
open stay open where A is a Z-matrix; Levine and Peres, Potential Anal. 30 (2009), for the balance; Brent, BIT 20
(1980), for cycles.
"""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import suppress
from dataclasses import dataclass, replace
from itertools import chain
from typing import ClassVar

import numpy as np

from ..arrays import Vector, norm
from ..errors import MapError, SingularOperator
from ..problem import ICP
from ..reduction import (
    PIVOT_UP_TO,
    Blocks,
    Mask,
    Rows,
    blocks,
    has_fixed_obstacle,
    restricted,
    with_fixed_obstacle,
    without,
)
from ..steps import compiled_step, rows_of
from . import HandOver, Infeasible, Method
from .choose import Choice, after_trial, choose, direct, without_trial
from .multilevel import Multilevel

#: more than this share of open rows is not worth the trouble, and more than the second one, before a sweep is made,
#: not a closer look
_WORTH, _PROMISING = 0.6, 0.8
#: from this size on it is worth to look for rows at rest
_REST_FROM = 10_000
#: sweeps from below before the balance is drawn
_SWEEPS = 5
#: an estimate of `choose` that a few more rows do not change
_RADIUS = "jacobi radius"
#: so many times the rows that the balance asks for are opened, at first and at each of so many later times
_FIRST_SLACK, _SLACK, _ROUNDS = 1.3, 4.0, 8
#: an iterate is what reduces the residual of the parts to this share, or so many of their steps; a method that brings
#: no better one in the second number gives way
_SHARE, _STEPS, _PATIENCE = 0.25, 20, 1000


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Reduced(Method):
    """The problem without what need not be iterated on, each of its parts by the method that `solve` picks for it.

    Rows without obstacle, moving and fixed obstacles and best
    jumps may occur. An iterate is one step of a part, or as many as pay. Where a part's method fails the next one goes
    on; where none is left the iterates stand still.

    >>> ICP([[2.0, 0.0], [-1.0, 1.0]], [-2.0, -1.0]).solve(Reduced()).z
    array([1., 2.])
    """

    name: ClassVar[str] = "reduced"
    memoryless: ClassVar[bool] = False
    #: what is left, where that is known already: see `on`
    blocks: ClassVar[Blocks | None] = None

    @classmethod
    def on(cls, found: Blocks) -> Reduced:
        """The method for a problem of which it is known what is left.

        >>> problem = ICP([[2.0, 0.0], [-1.0, 1.0]], [-2.0, -1.0])
        >>> problem.solve(Reduced.on(blocks(problem))).z
        array([1., 2.])
        """
        new = cls()
        object.__setattr__(new, "blocks", found)
        return new

    def why_not(self, problem: ICP) -> str | None:
        """See `Method.why_not`: something must be left out, or solved apart.

        >>> Reduced().why_not(ICP([[1.0]], [1.0], np.sin))
        'nothing can be left out, and there are no parts that are solved apart'
        """
        found = self.blocks is not None or _found(problem) is not None
        return None if found else "nothing can be left out, and there are no parts that are solved apart"

    def iterates(self, problem: ICP, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`. Raises HandOver where more rows have to be opened."""
        yield z, None
        found = self.blocks or _found(problem)
        while found is not None:
            start = z.copy() if found.open.all() else np.where(found.open, z, _obstacle(found.problem))
            start, solved = found.forward(start, found.before)
            if np.array_equal(solved, found.before):
                yield from self._path(problem, found, start)
            found = found.with_core(found.before & ~solved)
        while True:
            yield z, None

    def _path(self, problem: ICP, found: Blocks, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """The parts until they have no more methods, with what follows from them, and the rows at rest looked at."""
        parts = [_Part(restricted(found.problem, rows, z), rows, z) for rows in found.parts]
        if found.radius is not None:
            parts[0].problem.remembered(_RADIUS, lambda: found.radius)
        border = _Border(found)
        while True:
            z, _ = found.forward(z, found.after)
            p = border.p(z)
            rest, violation = _together(parts), _size(np.minimum(p, 0.0))
            known = found.problem is problem and not found.rows.size
            yield z, float(np.hypot(rest, violation)) if known else None
            if violation > rest:
                self._open(problem, found, border, p, parts[0].problem._memory.get(_RADIUS))
            if all(part.over for part in parts):
                break
            _advance(parts)
            z = z.copy()
            for part in parts:
                z[part.rows] = part.z
        while True:
            yield z, None

    def _open(self, problem: ICP, found: Blocks, border: _Border, at_border: Vector, radius: float | None) -> None:
        """Hand over to the problem with more open rows, as p < 0 in the border outweighs the residual of the others."""
        p = np.where(found.open, 0.0, border.at_rest)
        p[border.rows] = at_border
        opened = found.opened + 1
        wider = _opened(found.problem, found.open, p < 0, p, _SLACK**opened)
        if wider is None or opened > _ROUNDS:
            raise HandOver(next(without_trial(problem)).method, "too many rows leave the obstacle")
        following = replace(without(found.problem, wider), opened=opened, radius=radius)
        raise HandOver(Reduced.on(following), repr(following))

    def __repr__(self) -> str:
        return "Reduced()"


class _Part:
    """Unknowns that do not interact with those of other parts, and the methods that they are left to, in turn."""

    def __init__(self, problem: ICP, rows: Rows, z: Vector) -> None:
        self.problem, self.rows, self.z = problem, rows, z[rows]
        self.start = self.z
        residual = problem.residual(self.z)
        self.residual = residual if residual < np.inf else np.inf
        self.choices = choose(problem)
        self.path: Iterator[tuple[Vector, float | None]] | None = None
        self.steps, self.better_at, self.milestone_at, self.milestone = 0, 0, 1, self.z
        self.over = False

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
        except (SingularOperator, Infeasible):
            self.path = None
            return
        residual = self.problem.residual(z) if hint is None else hint
        self.steps += 1
        if residual < self.residual:
            self.z, self.residual, self.better_at = z, residual, self.steps
        if np.array_equal(z, self.milestone) or self.steps - self.better_at >= _PATIENCE or not residual < np.inf:
            self.path = None
        if self.steps >= 2 * self.milestone_at:  # Brent's cycle search
            self.milestone_at, self.milestone = self.steps, z

    def _begin(self, method: Method, start: Vector) -> None:
        self.path, self.steps, self.better_at = method.iterates(self.problem, start), 0, 0
        self.milestone_at, self.milestone = 1, self.z[:0]  # no z is equal to that


class _Border:
    """The rows at rest where p may be below 0: it is so already, or they have an open neighbour."""

    def __init__(self, found: Blocks) -> None:
        A, rest = found.problem.A, ~found.open
        self.at_rest, near = np.zeros(rest.size), rest
        if rest.any():
            self.at_rest = found.problem.p(np.where(rest, _obstacle(found.problem), 0.0))
            near = rest & ((found.problem.absolute_A() @ found.open.astype(np.float64) > 0) | (self.at_rest < 0))
        self.rows = np.flatnonzero(near)
        self.A, self.q = A[self.rows], found.problem.q[self.rows]

    def p(self, z: Vector) -> Vector:
        """p(z) in these rows."""
        p: Vector = self.A @ z + self.q
        return p


def _together(parts: list[_Part]) -> float:
    """The residual of all parts."""
    return _size(np.array([part.residual for part in parts]))


def _size(x: Vector) -> float:
    return norm(x) if x.size else 0.0


def _advance(parts: list[_Part]) -> None:
    """Steps of the parts that are worst, until together they are better."""
    enough = _SHARE * _together(parts)
    for _ in range(_STEPS):
        live = [part for part in parts if not part.over]
        if not live or _together(parts) <= enough:
            return
        max(live, key=lambda part: part.residual).step()


def choices(problem: ICP) -> Iterator[Choice]:
    """The methods that `solve` tries when none is named: what `choose` has for the whole problem, and before it
    `Reduced` where that is found to pay.

    Strong components are looked for where n > 64 and the first plain sweeps were slow, rows at rest only where
    `Multilevel` would be the next: sweeps and factorisations of easier matrices cost less than to look for them.

    >>> [choice.method for choice in choices(ICP(np.eye(100), -np.ones(100)))][:3]
    [Tridiagonal(), PSOR(), Reduced()]
    """
    yield from direct(problem)
    yield from after_trial(problem, _where_slow(problem))


def _where_slow(problem: ICP) -> Iterator[Choice]:
    """The methods after the first sweeps: on blocks, with a look for rows at rest before `Multilevel`, on the whole."""
    found = _structure(problem, _WORTH * problem.n) if problem.n > PIVOT_UP_TO else None
    usual = without_trial(problem)
    first = next(usual, None)
    if found is None and first is not None and isinstance(first.method, Multilevel):
        found = _at_rest(problem)
    if found is not None:
        yield Choice(Reduced.on(found), repr(found), hurry=True)
    yield from chain([] if first is None else [first], usual)


def _found(problem: ICP) -> Blocks | None:
    """What can be left out or solved apart at all, be it little."""
    return _structure(problem, problem.n - 1) or _at_rest(problem)


def _structure(problem: ICP, most: float) -> Blocks | None:
    """The blocks of the whole problem, if they leave `most` rows, or parts of which each is a problem of its own."""
    with suppress(MapError), np.errstate(over="ignore", invalid="ignore"):
        found = blocks(problem)
        if found is not None and (found.core <= most or len(found.parts) > 1):
            return found
    return None


def _at_rest(problem: ICP) -> Blocks | None:
    """The blocks that are left once rows that probably rest on a fixed obstacle are taken out; None for few of them."""
    A = problem.A
    if problem.n < _REST_FROM or not has_fixed_obstacle(problem) or np.count_nonzero(A.data > 0) != problem.n:
        return None
    with np.errstate(over="ignore", invalid="ignore"), suppress(MapError):
        problem = with_fixed_obstacle(problem)
        z = c = _obstacle(problem)
        none = np.zeros(problem.n, dtype=bool)
        if not np.isfinite(c).all() or not (A.diagonal() > 0).all():
            return None
        p = problem.p(c)
        if not np.mean(p <= 0) + _balance(problem, none, p) / problem.n <= _PROMISING:
            return None
        matrix = (A.indptr, A.indices, A.data, rows_of(problem).diag, problem.q)
        sweep = compiled_step(problem, "projected", matrix, ((1.0,), True))
        for _ in range(_SWEEPS):
            z, _ = sweep(z)
        p = problem.p(z)
        wider = _opened(problem, none, (z > c) | (p < 0), p, _FIRST_SLACK)
        return None if wider is None else without(problem, wider)
    return None


def _obstacle(problem: ICP) -> Vector:
    c: Vector = problem.psi.value(np.zeros(problem.n))
    return c


def _balance(problem: ICP, open_rows: Mask, p: Vector) -> float:
    """How many of the rows that are not open it takes to hold what p < 0 there is: all of them, if they do not."""
    p = p / problem.A.diagonal()
    holding = np.where(open_rows, 0.0, np.maximum(p, 0.0))
    push, hold, count = -float(np.minimum(p, 0.0).sum()), float(holding.sum()), np.count_nonzero(holding)
    return count * min(push / hold, 1.0) if hold > 0 else float(count)


def _opened(problem: ICP, open_rows: Mask, seeds: Mask, p: Vector, slack: float) -> Mask | None:
    """`open_rows` and `seeds`, with as many rows around the seeds as the balance says; None where they are too many."""
    from ..kernels.parts import spread  # loads numba

    A, more = problem.A, slack * _balance(problem, open_rows | seeds, p)
    if not np.count_nonzero(open_rows | seeds) + more <= _WORTH * problem.n:
        return None
    return spread(A.indptr, A.indices, open_rows, seeds, int(more))
