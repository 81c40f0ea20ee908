"""The predicted contact set of a fixed obstacle, checked on every iterate and corrected.

Let A be a Z-matrix, and the loads that lift z off the obstacle small beside those that hold it
down. Then some rows stay in contact. A balance of the two loads predicts how many. For z ≤ z* a
contact row with p_i < 0 is certain to leave the obstacle. In the end p ≥ 0 on the omitted rows
makes the answer one of the whole problem.

References
----------
Chandrasekaran, Opsearch 7 (1970): where A is a Z-matrix, a row that is once free stays free. Levine
and Peres, Potential Anal. 30 (2009), for the balance.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace

import numpy as np

from ..errors import MapError
from ..numerics.arrays import Mask, Vector
from ..problem.data import ProblemData
from .steps import projected_sweep
from .subproblems import Blocks, with_contact_rows, with_fixed_obstacle

#: share of free rows above which nothing is gained
MOST_FREE = 0.6
#: the same before the first sweep, where the balance is rough
_MOST_FREE_AT_FIRST = 0.8
#: sweeps from below before the balance is drawn
_SWEEPS = 5
#: times the rows that the balance asks for, at first, and for each later release
_FIRST_SLACK = 1.3
_SLACK = 4.0
#: releases of contact rows at the most
_RELEASES = 8


def predicted_contact_set(problem: ProblemData) -> Blocks | None:
    """The problem without the rows that are predicted to be in contact; None where they are few."""
    A = problem.A
    if problem.upper is not None or not problem.facts.has_fixed_obstacle or np.count_nonzero(A.data > 0) != problem.n:
        return None
    with np.errstate(over="ignore", invalid="ignore"), suppress(MapError):
        problem = with_fixed_obstacle(problem)
        z = c = problem.facts.obstacle
        none = np.zeros(problem.n, dtype=bool)
        if not np.isfinite(c).all() or not problem.matrix.has_positive_diagonal:
            return None
        p = problem.p(c)
        if not np.mean(p <= 0) + balance(problem, none, p) / problem.n <= _MOST_FREE_AT_FIRST:
            return None
        sweep = projected_sweep(problem)
        for _ in range(_SWEEPS):
            z, _ = sweep(z)
        p = problem.p(z)
        free = _enlarged(problem, none, (z > c) | (p < 0), p, _FIRST_SLACK)
        return None if free is None else with_contact_rows(problem, free)
    return None


class ContactBoundary:
    """The contact rows in which p may be negative: those with a free neighbour, and those in which it is so already."""

    def __init__(self, blocks: Blocks) -> None:
        problem = blocks.problem
        contact = ~blocks.free
        self.blocks = blocks
        self.p_at_obstacle = np.zeros(contact.size)
        boundary = contact
        if contact.any():
            self.p_at_obstacle = problem.p(np.where(contact, problem.facts.obstacle, 0.0))
            has_free_neighbour = problem.matrix.absolute @ blocks.free.astype(np.float64) > 0
            boundary = contact & (has_free_neighbour | (self.p_at_obstacle < 0))
        self.rows = np.flatnonzero(boundary)
        self.A = problem.A[self.rows]
        self.q = problem.q[self.rows]
        self.weights = problem.matrix.row_weights[self.rows]

    def p(self, z: Vector) -> Vector:
        """p(z) in these rows."""
        p: Vector = self.A @ z + self.q
        return p

    def released(self, p_of_rows: Vector) -> Blocks | None:
        """The blocks with more free rows, where p is `p_of_rows` in these; None where they would be too many."""
        blocks = self.blocks
        releases = blocks.releases + 1
        if releases > _RELEASES:
            return None
        p = np.where(blocks.free, 0.0, self.p_at_obstacle)
        p[self.rows] = p_of_rows
        free = _enlarged(blocks.problem, blocks.free, p < 0, p, _SLACK**releases)
        return None if free is None else replace(with_contact_rows(blocks.problem, free), releases=releases)


def balance(problem: ProblemData, free: Mask, p: Vector) -> float:
    """How many rows that are not `free` it takes to balance all p < 0: all of them where they do not suffice."""
    p = p / problem.A.diagonal()
    holding = np.where(free, 0.0, np.maximum(p, 0.0))
    push = -float(np.minimum(p, 0.0).sum())
    hold = float(holding.sum())
    count = np.count_nonzero(holding)
    return count * min(push / hold, 1.0) if hold > 0 else float(count)


def _enlarged(problem: ProblemData, free: Mask, seeds: Mask, p: Vector, slack: float) -> Mask | None:
    """`free` and `seeds`, with as many rows around the seeds as the balance asks for; None where they are too many."""
    from ..numerics.kernels.graph import spread  # loads numba

    A = problem.A
    more = slack * balance(problem, free | seeds, p)
    if not np.count_nonzero(free | seeds) + more <= MOST_FREE * problem.n:
        return None
    return spread(A.indptr, A.indices, free, seeds, int(more))
