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

from ..algebra.subproblems import PIVOT_UP_TO, Blocks, Mask, blocks, restricted, with_fixed_obstacle, without
from ..algebra.sweeps import compiled_step
from ..errors import MapError
from ..methods.contract import HandOver, Method
from ..methods.lemke import Lemke
from ..methods.multilevel import Multilevel
from ..methods.psor import PSOR
from ..numerics.arrays import Vector, norm
from ..problem.data import ProblemData
from .choice import Choice, after_trial, direct, pivots_at_once, without_trial
from .parts import Part, Path, advance, in_turn

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
        """The method for a problem of which it is known what is left, and where plain sweeps were left for it.

        >>> problem = ICP([[2.0, 0.0], [-1.0, 1.0]], [-2.0, -1.0])
        >>> problem.solve(Reduced.on(blocks(problem))).z
        array([1., 2.])
        """
        new = cls()
        object.__setattr__(new, "blocks", found)
        return new

    def why_not(self, problem: ProblemData) -> str | None:
        """See `Method.why_not`: something must be left out, or solved apart.

        >>> Reduced().why_not(ICP([[1.0]], [1.0], np.sin))
        'nothing can be left out, and there are no parts that are solved apart'
        """
        found = self.blocks is not None or _found(problem) is not None
        return None if found else "nothing can be left out, and there are no parts that are solved apart"

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[tuple[Vector, float | None]]:
        """See `Method.iterates`. Raises HandOver where more rows have to be opened."""
        yield z, None
        found = _found(problem) if self.blocks is None else self.blocks
        while found is not None:
            start = z.copy() if found.open.all() else np.where(found.open, z, _obstacle(found.problem))
            start, solved = found.forward(start, found.before)
            unsolved = found.before & ~solved
            if not unsolved.any():
                unsolved = yield from (in_turn if found.rows.size else self._path)(problem, found, start)
            found = found.with_core(unsolved)
        while True:
            yield z, None

    def _path(self, problem: ProblemData, found: Blocks, z: Vector) -> Path:
        """The open rows until they have no more methods, and the rows at rest looked at."""
        (rows,) = found.parts
        part = Part(restricted(found.problem, rows, z), rows, z)
        border = _Border(found)
        while True:
            p = border.p(z)
            violation = norm(np.minimum(p, 0.0)) if p.size else 0.0
            yield z, float(np.hypot(part.residual, violation)) if found.problem is problem else None
            if violation > part.residual:
                self._open(problem, found, border, p, None)
            if part.over:
                break
            z = advance([part], z)
        while True:
            yield z, None

    def _open(
        self, problem: ProblemData, found: Blocks, border: _Border, at_border: Vector, radius: float | None
    ) -> None:
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


class _Border:
    """The rows at rest where p may be below 0: it is so already, or they have an open neighbour."""

    def __init__(self, found: Blocks) -> None:
        A, rest = found.problem.A, ~found.open
        self.at_rest, near = np.zeros(rest.size), rest
        if rest.any():
            self.at_rest = found.problem.p(np.where(rest, _obstacle(found.problem), 0.0))
            near = rest & ((found.problem.matrix.absolute @ found.open.astype(np.float64) > 0) | (self.at_rest < 0))
        self.rows = np.flatnonzero(near)
        self.A, self.q = A[self.rows], found.problem.q[self.rows]

    def p(self, z: Vector) -> Vector:
        """p(z) in these rows."""
        p: Vector = self.A @ z + self.q
        return p


def choices(problem: ProblemData) -> Iterator[Choice]:
    """The methods that `solve` tries when none is named: what `choose` has for the whole problem, and before it
    `Reduced` where that is found to pay.

    Strong components are looked for where n > 64 and the first plain sweeps were slow, rows at rest only where
    `Multilevel` would be the next: sweeps and factorisations of easier matrices cost less than to look for them.
    """
    yield from direct(problem)
    if pivots_at_once(problem):
        yield from _small_blocks(problem)
    yield from after_trial(problem, _where_slow(problem))


def _small_blocks(problem: ProblemData) -> Iterator[Choice]:
    """Where pivots on the whole failed one block may have no solution."""
    found = _structure(problem, problem.n)
    if found is not None and found.starts.size > 2:
        yield Choice(Reduced.on(found), repr(found), hurry=True)


def _where_slow(problem: ProblemData) -> Iterator[Choice]:
    """The methods after the first sweeps: on blocks, with a look for rows at rest before `Multilevel`, on the whole."""
    usual = without_trial(problem)
    if problem.n <= PIVOT_UP_TO:
        for choice in usual:
            yield choice
            if isinstance(choice.method, Lemke):
                yield from _small_blocks(problem)
        return
    found = _structure(problem, _WORTH * problem.n)
    first = next(usual, None)
    if found is None and first is not None and isinstance(first.method, Multilevel):
        found = _at_rest(problem)
    order = [] if found is None else [Choice(Reduced.on(found), repr(found), hurry=True)]
    if first is not None:
        # the rate of relaxed sweeps is that of the slowest block: in turn they are no quicker
        together = found is not None and len(found.stages) > 1 and isinstance(first.method, PSOR)
        order.insert(0 if together else len(order), first)
    yield from chain(order, usual)


def _found(problem: ProblemData) -> Blocks | None:
    """What can be left out or solved apart at all, be it little."""
    return _structure(problem, problem.n - 1) or _at_rest(problem)


def _structure(problem: ProblemData, most: float) -> Blocks | None:
    """The blocks of the whole problem, if they leave `most` rows, or parts of which each is a problem of its own."""
    with suppress(MapError), np.errstate(over="ignore", invalid="ignore"):
        found = blocks(problem)
        if found is not None and (found.core <= most or len(found.parts) > 1):
            return found
    return None


def _at_rest(problem: ProblemData) -> Blocks | None:
    """The blocks that are left once rows that probably rest on a fixed obstacle are taken out; None for few of them."""
    A = problem.A
    if problem.n < _REST_FROM or not problem.facts.has_fixed_obstacle or np.count_nonzero(A.data > 0) != problem.n:
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
        matrix = (A.indptr, A.indices, A.data, problem.matrix.rows.diag, problem.q)
        sweep = compiled_step(problem, "in_order", matrix, ((1.0,), True))
        for _ in range(_SWEEPS):
            z, _ = sweep(z)
        p = problem.p(z)
        wider = _opened(problem, none, (z > c) | (p < 0), p, _FIRST_SLACK)
        return None if wider is None else without(problem, wider)
    return None


def _obstacle(problem: ProblemData) -> Vector:
    c: Vector = problem.psi.value(np.zeros(problem.n))
    return c


def _balance(problem: ProblemData, open_rows: Mask, p: Vector) -> float:
    """How many of the rows that are not open it takes to hold what p < 0 there is: all of them, if they do not."""
    p = p / problem.A.diagonal()
    holding = np.where(open_rows, 0.0, np.maximum(p, 0.0))
    push, hold, count = -float(np.minimum(p, 0.0).sum()), float(holding.sum()), np.count_nonzero(holding)
    return count * min(push / hold, 1.0) if hold > 0 else float(count)


def _opened(problem: ProblemData, open_rows: Mask, seeds: Mask, p: Vector, slack: float) -> Mask | None:
    """`open_rows` and `seeds`, with as many rows around the seeds as the balance says; None where they are too many."""
    from ..numerics.kernels.graph import spread  # loads numba

    A, more = problem.A, slack * _balance(problem, open_rows | seeds, p)
    if not np.count_nonzero(open_rows | seeds) + more <= _WORTH * problem.n:
        return None
    return spread(A.indptr, A.indices, open_rows, seeds, int(more))
