"""Problems in one dimension: A tridiagonal, solved directly in O(n)."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

from ..numerics import work
from ..numerics.arrays import Vector
from ..problem.data import ProblemData
from ..problem.facts import Facts
from .contract import Estimate, Iterate, Method, positive_diagonal

#: rounds of Newton's steps, and steps in a round; where A is an M-matrix one step is the rule
_ROUNDS, _STEPS = 5, 10
#: what Newton's steps make of the price of the pass where there are two obstacles: a dozen were measured, 3 to 40
_WITH_TWO = 4.0
#: steps of iterative refinement, for those who ask for the last digit
_REFINEMENTS = 2


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Tridiagonal(Method):
    """One pass over the rows says which of them leave the obstacle, and one tridiagonal system gives z.

    The rows are added one by one, from the top, to a problem that is solved; where a row leaves the obstacle, rows
    above it may have to follow. Runs of open rows are known by the corners of their inverse, so that two of them are
    joined at once, whatever their length. For tridiagonal M-matrices that finds the active set, but for rounding, which
    Newton's steps correct: z_i = c_i where p_i ≥ a_ii(z_i − c_i), p_i = 0 elsewhere. For other matrices it is where
    those steps begin; they may fail, and then the method ends. So it is with an obstacle above: the pass knows the one
    below alone, and z_i = ψ̄_i where p_i < a_ii(z_i − ψ̄_i). The start z⁰ has no influence.
    Reference: Cryer, ACM Trans. Math. Softw. 9 (1983), for a direct method on tridiagonal M-matrices; Chandrasekaran,
    Opsearch 7 (1970), for rows that once open stay open.

    >>> ICP([[2, -1, 0], [-1, 2, -1], [0, -1, 2]], [-1, 3, -1]).solve(Tridiagonal()).z
    array([0.5, 0. , 0.5])
    """

    name: ClassVar[str] = "tridiagonal"
    family: ClassVar[str] = "shortcut"
    memoryless: ClassVar[bool] = False
    finite: ClassVar[bool] = True

    def estimate(self, facts: Facts, aim: float) -> Estimate:
        n = facts.matrix.n  # 60 ns a row were measured for n = 300 … 16 000, see work.Costs for the machine
        steps = 1.0 if facts.psi.upper is None else _WITH_TWO
        return Estimate(0.0, (6.0 * work.COSTS.call + 60.0 * n * steps) / facts.matrix.unit, 1.0, 64.0 * n)

    def why_not(self, problem: ProblemData) -> str | None:
        if problem.nnz > 3 * problem.n - 2:
            return f"A is not tridiagonal: it has {problem.nnz} entries"
        if not problem.facts.has_fixed_obstacle:
            return f"it needs a psi_i that moves with z_i alone, by less than it, which is not known of {problem.psi!r}"
        rows = problem.matrix.rows
        if max(rows.below, rows.above) > 1:
            reach = f"reach {rows.below} rows below the diagonal and {rows.above} above"
            return f"A is not tridiagonal: its entries {reach}"
        return positive_diagonal(problem, "it divides by the diagonal of A")

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        from ..numerics.kernels.thomas import SETTLED, UNSETTLED, bands, newton, refine, release  # loads numba

        yield z, None
        A, q, c, top = problem.A, problem.q, problem.facts.obstacle, problem.facts.upper_obstacle
        matrix, held = bands(A.indptr, A.indices, A.data), c if top is None else c.copy()
        free, ended, rounds = release(*matrix, q, c), UNSETTLED, 0
        while ended == UNSETTLED and rounds < _ROUNDS:
            found, ended = newton(*matrix, q, c, top, held, free, _STEPS)
            rounds += 1
            work.add(work.sweep(problem.n, problem.nnz))
            if np.isfinite(found).all():
                z = found
                yield z, None
        for _ in range(_REFINEMENTS if ended == SETTLED else 0):
            z = refine(*matrix, q, free, z)
            yield z, None
