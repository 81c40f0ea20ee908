"""Reduction: what need not be iterated on is left out, and what does not interact is solved apart.

1. Rows at rest: see `algebra.resting`.
2. The strong components of A and ψ, in their order, have unknowns of their own: a row alone is a maximum, a small block
   is pivoted, and what is left falls into parts, each of which gets the method that `choice.choose` picks for it. Parts
   that hang on earlier ones only make a stage. One that has no solution proves that the whole has none if the proof,
   with 0 in all other rows, is one of the whole; or where the unknowns that the stage hangs on have one answer, of
   which the error bound says how far it is from what is known of it.

The iterates are those of the whole problem, and so is the residual that they are judged by.
References: Tarjan, SIAM J. Comput. 1 (1972), for the components; Cottle, Pang and Stone, The Linear Complementarity
Problem (1992), section 4.4, for blocks.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import suppress
from dataclasses import dataclass
from itertools import count
from typing import ClassVar, cast

import numpy as np

from ..algebra.redundant import without_redundant_rows
from ..algebra.resting import WORTH, Border, rows_at_rest
from ..algebra.subproblems import Blocks, Rows, blocks, resting, restricted, with_fixed_obstacle
from ..errors import MapError
from ..methods.contract import Infeasible, Iterate, Method
from ..numerics import work
from ..numerics.arrays import Vector, norm
from ..problem.data import ProblemData
from ..theory.certificates.bounds import error_bound
from ..theory.certificates.combination_rows import Known
from ..theory.certificates.infeasible import infeasible
from .candidate import Candidate
from .choice import Asked, Choice, choose
from .goal import RTOL
from .part import Part, advance, together
from .schedule import Expected

#: the passes over A that a reduction takes where nothing is left, and where something is, and its calls in Python: 4 to
#: 5 ms more than the sweeps of what is left were measured for n = 300 … 1400
_ALONE, _PASSES, _CALLS = 40.0, 10.0, 1500.0
#: where there are many stages so many iterates of them are shown
_SHOWN = 32

#: iterates, and in the end the blocks to go on with and from where, None where nothing more is to be had
Path = Generator[Iterate, None, tuple[Blocks, Vector] | None]


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class Reduced(Method):
    """The problem without what need not be iterated on, each of its parts by the method that `solve` picks for it.

    Rows without obstacle, moving and fixed obstacles and best jumps may occur. An iterate is one step of a part, or as
    many as pay. Where a part's method fails the next one goes on.

    >>> ICP([[2.0, 0.0], [-1.0, 1.0]], [-2.0, -1.0]).solve(icp.Reduced()).z
    array([1., 2.])
    """

    name: ClassVar[str] = "reduced"
    family: ClassVar[str] = "modulus"
    memoryless: ClassVar[bool] = False
    #: the share of Res_D(0) for which the steps of parts are forecast, and what these are chosen from
    aim, family_of_parts = RTOL, cast("str | None", None)
    #: a stage is left at the first share of the residual of the start, the next time at the next one
    shares = (1e-9, 1e-12, 1e-15, 0.0)

    def why_not(self, problem: ProblemData) -> str | None:
        found = self.found(problem) is not None
        return None if found else "nothing can be left out, and there are no parts that are solved apart"

    def found(self, problem: ProblemData) -> Blocks | None:
        """What can be left out or solved apart at all, be it little."""
        return structure(problem, problem.n - 1) or rows_at_rest(problem)

    def left_over(self, found: Blocks) -> Blocks | None:
        """What is gone on with where too many rows leave the obstacle: all of them, as no other method follows."""
        return resting(found.problem, np.ones(found.problem.n, dtype=bool))

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        yield z, None
        found, start = self.found(problem), z
        while found is not None:
            start = start.copy() if found.open.all() else np.where(found.open, start, found.problem.facts.obstacle)
            start, solved = found.forward(start, found.before)
            unsolved = found.before & ~solved
            if unsolved.any():
                found = found.with_core(unsolved)
                continue
            following = yield from (self._stages if found.rows.size else self._open_rows)(problem, found, start)
            found, start = following or (None, start)

    def _open_rows(self, problem: ProblemData, found: Blocks, z: Vector) -> Path:
        """The open rows until they have no more methods, and the rows at rest looked at."""
        (rows,) = found.parts
        part = Part(restricted(found.problem, rows, z), rows, z, self.aim, self.family_of_parts)
        border = Border(found)
        while True:
            p = border.p(z)
            violation = norm(border.weights * np.minimum(p, 0.0)) if p.size else 0.0
            yield z, float(np.hypot(part.residual, violation)) if found.problem is problem else None
            if violation > part.residual:  # p < 0 at the border outweighs what the open rows leave
                wider = border.opened(p) or self.left_over(found)
                return None if wider is None else (wider, z)
            if part.over:
                return None
            z = advance([part], z)

    def _stages(self, problem: ProblemData, found: Blocks, z: Vector) -> Path:
        """The stages one after the other, each on what the earlier ones are by then, and the blocks that follow.

        A stage is left when its residual is small beside that of the start; where the end is not good enough, all are
        gone through again, for less. Raises Infeasible where it is proved that there is no solution.
        """
        at_0 = problem.residual_at_0()
        scale = max((x for x in (at_0, problem.residual(z)) if x < np.inf), default=0.0)
        last, shown_at = len(found.stages) - 1, len(found.stages) // _SHOWN + 1
        yield (shown := z), None
        for share in self.shares:
            spent = True  # nothing more is to be had from the stages that the last one hangs on
            for at, stage in enumerate(found.stages):
                parts = [
                    Part(restricted(found.problem, rows, z), rows, z, self.aim, self.family_of_parts) for rows in stage
                ]
                follow = found.after if at == last else found.between[at]
                enough = share * scale if at < last or follow.any() else 0.0
                for step in count(at):
                    if together(parts) <= enough or all(part.over for part in parts):
                        break
                    z = advance(parts, z)
                    _report(problem, parts, z)
                    if step % shown_at == 0:
                        yield (shown := z), None
                spent = spent and (at == last or all(part.over for part in parts))
                z, solved = found.forward(z, follow)
                if not np.array_equal(solved, follow):
                    wider = found.with_core(follow & ~solved)
                    return None if wider is None else (wider, z)
                if at == last and z is not shown:
                    yield (shown := z), None
            if spent:
                break
        return None


@dataclass(frozen=True, kw_only=True, eq=False, repr=False)
class ReducedTo(Reduced):
    """`Reduced` where it is known already what is left, `blocks`, and what is asked for: `aim` and the family."""

    blocks: Blocks
    aim: float = RTOL
    family_of_parts: str | None = None

    def found(self, problem: ProblemData) -> Blocks:
        return self.blocks

    def left_over(self, found: Blocks) -> Blocks | None:
        return None  # the next candidate has the whole problem

    def __repr__(self) -> str:
        return "Reduced()"


def posed(problem: ProblemData) -> ProblemData:
    """What methods that `solve` picks are given: where every ψ_i moves with z_i alone, by less than it, one with fixed
    obstacles, so that sweeps and Newton's steps need not ask for ψ, and without redundant rows. If ψ fails on the way
    to these it is the problem itself, as ψ may have values where the iterates are."""
    with suppress(MapError), np.errstate(over="ignore", invalid="ignore"):
        return without_redundant_rows(with_fixed_obstacle(problem))
    return problem


def candidates(problem: ProblemData, aim: float = RTOL, family: str | None = None) -> Iterator[Choice]:
    """The stages of candidates for `problem`: those of `choose`, and its reduction where it has parts, or rows at rest.

    `aim` is the share of Res_D(0) that is asked for, `family` as in `solve`.
    """
    if family == "paper":
        return choose(problem, aim, family)
    return choose(problem, aim, family, lambda cheapest: _reduced(problem, aim, family, cheapest))


def _reduced(problem: ProblemData, aim: float, family: str | None, cheapest: float) -> list[Asked]:
    """The parts of the problem, which cost the share of its rows, or what does not rest on the obstacle."""
    found = structure(problem, WORTH * problem.n) or rows_at_rest(problem)
    if found is None or (family is not None and found.pivoted):
        return []
    share = sum(rows.size for stage in found.stages for rows in stage) / problem.n
    unit = problem.matrix.unit
    setup = _PASSES + _CALLS * work.COSTS.call / unit if found.stages else _ALONE
    setup += work.COSTS.pivot_entry * found.pivoted / unit
    method = ReducedTo(blocks=found, aim=aim, family_of_parts=family)
    return [(Candidate(method, f"a reduction, {found!r}"), Expected(setup + share * cheapest, setup, 0.0, finite=True))]


def _report(problem: ProblemData, parts: list[Part], z: Vector) -> None:
    """Raises Infeasible where the proof that one of the `parts` has no solution is one of the whole problem."""
    for part in parts:
        if part.run.infeasible is not None:
            witness = np.array([float(x) for x in part.run.infeasible.witness]).reshape(-1, part.rows.size)
            y = np.zeros((len(witness), problem.n))
            y[:, part.rows] = witness
            part.run.infeasible = None
            answer = infeasible(problem, y.ravel())
            if answer.holds is None and (known := proved_of_earlier(problem, part.rows, z)):
                answer = infeasible(problem, y.ravel(), known)
            if answer.holds:
                raise Infeasible(answer)


def proved_of_earlier(problem: ProblemData, rows: Rows, z: Vector) -> Known | None:
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
    if not earlier.size or not problem.is_lcp or not seen[A[earlier].indices].all():
        return None
    bound = error_bound(restricted(problem, earlier, z), z[earlier])
    if bound.componentwise is None:
        return None
    low, high = np.full(problem.n, -np.inf), np.full(problem.n, np.inf)
    low[earlier] = np.nextafter(z[earlier] - bound.componentwise, -np.inf)
    high[earlier] = np.nextafter(z[earlier] + bound.componentwise, np.inf)
    return Known(low, high, bound.proof)


def structure(problem: ProblemData, most: float) -> Blocks | None:
    """The blocks of the whole problem, if no part that they leave has more than so many rows."""
    with suppress(MapError), np.errstate(over="ignore", invalid="ignore"):
        found = blocks(problem)
        if found is not None and max((part.size for part in found.parts), default=0) <= most:
            return found
    return None
