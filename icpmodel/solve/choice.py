"""What `solve` tries when no method is named: the rules for the whole problem, and its reduction where that pays."""

from __future__ import annotations

from collections.abc import Iterator
from itertools import chain

from ..algebra.affine_lcp import PIVOT_UP_TO
from ..algebra.resting import WORTH, rows_at_rest
from ..algebra.subproblems import Blocks
from ..methods.lemke import Lemke
from ..methods.multilevel import Multilevel
from ..methods.psor import PSOR
from ..problem.data import ProblemData
from .candidate import Candidate
from .goal import RTOL
from .reduced import ReducedTo, structure
from .rules import after_trial, direct, on_trial, pivots_at_once
from .run import PATIENCE


def candidates(problem: ProblemData, aim: float = RTOL) -> Iterator[Candidate]:
    """The methods that `solve` tries when none is named: what `rules.choose` has for the whole problem, and before it
    `Reduced` where that is found to pay. `aim` is the share of Res(0) that is asked for.

    Strong components are looked for where n > 64 and the first plain sweeps were slow, rows at rest only where
    `Multilevel` would be the next: sweeps and factorisations of easier matrices cost less than to look for them.
    """
    yield from direct(problem)
    if pivots_at_once(problem):
        yield from _small_blocks(problem, aim)
    yield from on_trial(problem)
    usual = after_trial(problem, aim)
    yield from _with_small_blocks(problem, usual, aim) if problem.n <= PIVOT_UP_TO else _reduced(problem, usual, aim)


def _small_blocks(problem: ProblemData, aim: float) -> Iterator[Candidate]:
    """Where pivots on the whole failed one block may have no solution."""
    found = structure(problem, problem.n)
    if found is not None and found.starts.size > 2:
        yield _in_blocks(found, aim)


def _with_small_blocks(problem: ProblemData, usual: Iterator[Candidate], aim: float) -> Iterator[Candidate]:
    for candidate in usual:
        yield candidate
        if isinstance(candidate.method, Lemke):
            yield from _small_blocks(problem, aim)


def _reduced(problem: ProblemData, usual: Iterator[Candidate], aim: float) -> Iterator[Candidate]:
    """On blocks, with a look for rows at rest before `Multilevel`, then on the whole."""
    found = structure(problem, WORTH * problem.n)
    first = next(usual, None)
    if found is None and first is not None and isinstance(first.method, Multilevel):
        found = rows_at_rest(problem)
    order = [] if found is None else [_in_blocks(found, aim)]
    if first is not None:
        # the rate of relaxed sweeps is that of the slowest block: one after the other they are no quicker
        together = found is not None and len(found.stages) > 1 and isinstance(first.method, PSOR)
        order.insert(0 if together else len(order), first)
    yield from chain(order, usual)


def _in_blocks(found: Blocks, aim: float) -> Candidate:
    return Candidate(ReducedTo(blocks=found, aim=aim), repr(found), PATIENCE)
