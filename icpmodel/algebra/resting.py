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
from .subproblems import Blocks, resting, with_fixed_obstacle

#: more than this share of open rows is not worth the trouble, and more than the second one, before a sweep is made,
#: not a closer look
WORTH, _PROMISING = 0.6, 0.8
#: sweeps from below before the balance is drawn
_SWEEPS = 5
#: so many times the rows that the balance asks for are opened, at first and at each of so many later times
_FIRST_SLACK, _SLACK, _ROUNDS = 1.3, 4.0, 8


def rows_at_rest(problem: ProblemData) -> Blocks | None:
    """The blocks that are left once rows that probably rest on a fixed obstacle are taken out; None for few of them."""
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
        if not np.mean(p <= 0) + balance(problem, none, p) / problem.n <= _PROMISING:
            return None
        sweep = projected_sweep(problem)
        for _ in range(_SWEEPS):
            z, _ = sweep(z)
        p = problem.p(z)
        wider = widened(problem, none, (z > c) | (p < 0), p, _FIRST_SLACK)
        return None if wider is None else resting(problem, wider)
    return None


class Border:
    """The rows at rest where p may be below 0: it is so already, or they have an open neighbour."""

    def __init__(self, found: Blocks) -> None:
        A, rest = found.problem.A, ~found.open
        self.found, self.at_rest, near = found, np.zeros(rest.size), rest
        if rest.any():
            self.at_rest = found.problem.p(np.where(rest, found.problem.facts.obstacle, 0.0))
            near = rest & ((found.problem.matrix.absolute @ found.open.astype(np.float64) > 0) | (self.at_rest < 0))
        self.rows = np.flatnonzero(near)
        self.A, self.q = A[self.rows], found.problem.q[self.rows]
        self.weights = found.problem.matrix.row_weights[self.rows]

    def p(self, z: Vector) -> Vector:
        """p(z) in these rows."""
        p: Vector = self.A @ z + self.q
        return p

    def opened(self, at_border: Vector) -> Blocks | None:
        """The blocks with more open rows, where p is `at_border` in these; None where they would be too many."""
        found = self.found
        p = np.where(found.open, 0.0, self.at_rest)
        p[self.rows] = at_border
        opened = found.opened + 1
        wider = widened(found.problem, found.open, p < 0, p, _SLACK**opened) if opened <= _ROUNDS else None
        return None if wider is None else replace(resting(found.problem, wider), opened=opened)


def balance(problem: ProblemData, open_rows: Mask, p: Vector) -> float:
    """How many of the rows that are not open it takes to hold what p < 0 there is: all of them, if they do not."""
    p = p / problem.A.diagonal()
    holding = np.where(open_rows, 0.0, np.maximum(p, 0.0))
    push, hold, count = -float(np.minimum(p, 0.0).sum()), float(holding.sum()), np.count_nonzero(holding)
    return count * min(push / hold, 1.0) if hold > 0 else float(count)


def widened(problem: ProblemData, open_rows: Mask, seeds: Mask, p: Vector, slack: float) -> Mask | None:
    """`open_rows` and `seeds`, with as many rows around the seeds as the balance says; None where they are too many."""
    from ..numerics.kernels.graph import spread  # loads numba

    A, more = problem.A, slack * balance(problem, open_rows | seeds, p)
    if not np.count_nonzero(open_rows | seeds) + more <= WORTH * problem.n:
        return None
    return spread(A.indptr, A.indices, open_rows, seeds, int(more))
