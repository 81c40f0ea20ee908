"""Multilevel modulus Newton: inexact Newton steps on the modulus equation, started from the coarser levels.

Every level of an algebraic multigrid hierarchy of A carries a problem of its own in z_c, where z = Pz_c + s. At the
coarse points s is 0 and ψ is the one of the finer level; elsewhere s = −q/D. Then A_c = PᵀAP and q_c = Pᵀ(As + q). The
finer level starts from the answer of this problem, so that its active set is wrong near its border only. The steps on
each level are those of `algebra.newton_steps`. With a z that is not 0, and fixed obstacles, they begin on the finest
level whose cycles cost less than the Python around them. Otherwise, and where that fails, they begin with 0 on the
coarsest level.

No grid is given: the levels are made of A, q and ψ. Where every ψ_i depends on z_i alone and changes by less than z_i,
a fixed obstacle replaces ψ first. Where ψ is an intervention, policy iteration (`Newton`) replaces these steps, as the
jumps of ψ reach too far for sweeps.
"""

from __future__ import annotations

from collections.abc import Generator, Iterator
from contextlib import suppress
from itertools import islice, pairwise
from typing import ClassVar

import numpy as np

from ..algebra.hierarchy import Hierarchy, Level, NoHierarchy
from ..algebra.newton_steps import newton_steps
from ..algebra.steps import INNER_REDUCTION
from ..algebra.subproblems import with_fixed_obstacle
from ..numerics import work
from ..numerics.arrays import Vector
from ..numerics.multigrid import cycle_cost
from ..numerics.rounding import SQRT_EPSILON
from ..problem.data import ProblemData
from .contract import PATIENCE, Iterate, LeastValue, Method, why_not_diagonal, with_options
from .newton import Newton

#: a start from z begins on the finest level where a cycle costs at most this share of a Newton step, about the cost of
#: the Python around it: coarser levels would cost as much and help less. Of 67 problems of 33 families, after twelve
#: sweeps, one in 1D fails so, and a start on the coarsest level solves it; the others took .7 times as long (median)
_MAX_CYCLE_SHARE = 0.5
#: a coarser level takes at most this number of steps. It ends at √ε of its Res_D(0) or, unless ψ is an intervention, at
#: `INNER_REDUCTION` of its first residual, which is below the error of interpolation to the next level, as in full
#: multigrid. A start with at most √ε of Res_D(0) is used as it is; with more the error may be smooth and large, as
#: after sweeps
MAX_COARSE_STEPS = 8


@with_options
class Multilevel(Method):
    """Newton's method on the modulus equation with algebraic multigrid, at the cost of about one linear solve with A.

    A needs a positive diagonal and few other positive entries, as for multigrid. The method ends where its steps no
    longer reduce the residual. For impulse control it is policy iteration, `Newton`, with a start from the coarser
    levels.

    References
    ----------
    Hintermüller, Ito and Kunisch, SIAM J. Optim. 13 (2002), for the active sets; Kornhuber, Numer. Math. 69
    (1994), for multigrid on them; Eisenstat, Elman and Schultz, SIAM J. Numer. Anal. 20 (1983), for GCR.

    Examples
    --------
    >>> ICP([[4, -1], [-2, 4]], [-3, -2]).solve(Multilevel()).z
    array([1., 1.])
    """

    name: ClassVar[str] = "multilevel"
    family: ClassVar[str] = "modulus"

    def why_not(self, problem: ProblemData) -> str | None:
        reason = why_not_diagonal(problem, "its smoother divides by the diagonal of A")
        return reason or (None if problem.facts.has_fixed_obstacle else problem.psi.no_derivative())

    def iterates(self, problem: ProblemData, z: Vector) -> Iterator[Iterate]:
        # never raises SingularOperator
        first = problem.residual(z)
        yield z, first
        best = z
        with suppress(NoHierarchy):
            best = yield from self._from_levels(problem, z, first)
        if problem.psi.has_policies:
            yield from Newton().iterates(problem, best)

    def start(self, hierarchy: Hierarchy, problem: ProblemData, z: Vector, lowest: int) -> Vector:
        """The start from the coarser levels; each begins with the answer of the next coarser level.

        Parameters
        ----------
        hierarchy : Hierarchy
            The levels.
        problem : ProblemData
            The problem on the finest level.
        z : array of shape (n,)
            The point with which the lowest level begins.
        lowest : int
            That level.

        Returns
        -------
        array of shape (n,)
            The start; `z` itself where the lowest level is the finest one.
        """
        problems = [problem]
        shifts = []
        for level, coarser in islice(pairwise(hierarchy.levels), lowest):
            coarse, shift = coarse_problem(problems[-1], level, coarser)
            problems.append(coarse)
            shifts.append(shift)
            z = z[level.coarse_points]
        jumps = problem.psi.has_policies
        for top in range(lowest, 0, -1):
            path = Newton().iterates(problems[top], z) if jumps else newton_steps(hierarchy, problems[top], z, top)
            target = SQRT_EPSILON * problems[top].residual_at_0()
            for step, (near, residual) in enumerate(islice(path, MAX_COARSE_STEPS)):
                answer = near
                if residual is None:
                    continue
                if not (step or jumps):
                    target = max(target, INNER_REDUCTION * residual)
                if residual <= target:
                    break
            z = hierarchy.levels[top - 1].P @ answer + shifts[top - 1]
        return z

    def _from_levels(self, problem: ProblemData, z: Vector, first: float) -> Generator[Iterate, None, Vector]:
        """Yield steps from `z`, whose residual is `first`, then from the coarsest level; return the last start.

        Where ψ jumps there are no steps: the start is that of policy iteration.
        """
        hierarchy = Hierarchy(problem)
        fixed = with_fixed_obstacle(problem)
        at_0 = problem.residual_at_0()
        is_near = first <= SQRT_EPSILON * at_0
        if is_near and problem.psi.has_policies:
            return z
        if is_near or (fixed.psi.is_constant and z.any()):
            start = self.start(hierarchy, fixed, z, 0 if is_near else _starting_level(hierarchy))
            yield from _while_residual_falls(hierarchy, problem, fixed, start)
        start = self.start(hierarchy, fixed, np.zeros(problem.n), len(hierarchy.levels) - 1)
        if problem.psi.has_policies:
            return start  # the residual says nothing of a policy before the first step
        yield from _while_residual_falls(hierarchy, problem, fixed, start)
        return start


def _starting_level(hierarchy: Hierarchy) -> int:
    """The level on which a start begins: the finest small one, see `_MAX_CYCLE_SHARE`, or the coarsest one."""
    for k, level in enumerate(hierarchy.levels[:-1]):
        if cycle_cost(level.A.shape[0], level.A.nnz) <= _MAX_CYCLE_SHARE * work.COSTS.newton:
            return k
    return len(hierarchy.levels) - 1


def _while_residual_falls(
    hierarchy: Hierarchy, problem: ProblemData, fixed: ProblemData, start: Vector
) -> Iterator[Iterate]:
    """Newton's steps on the finest level from `start`, while the residual falls; `fixed` has fixed obstacles."""
    residuals = LeastValue()
    for iterate, residual in newton_steps(hierarchy, fixed, start, 0):
        if not residual < np.inf:
            break
        yield iterate, residual if fixed is problem else None
        if residuals.add(residual) >= PATIENCE:
            break


def coarse_problem(problem: ProblemData, level: Level, coarser: Level) -> tuple[ProblemData, Vector]:
    """The problem on the level below `level`, and the shift s: on `level` its answer z is Pz + s.

    Points that are not kept solve their own equation: s = −q/D there, so that rows without a coarse neighbour and those
    at a boundary do not lose their q.
    """
    P = level.P
    coarse_points = level.coarse_points
    psi = problem.psi
    shift = -problem.q * level.inverse
    shift[coarse_points] = 0.0
    return coarser.problem.with_q(level.R @ problem.p(shift)).with_psi(psi.composed(P, shift, coarse_points)), shift
