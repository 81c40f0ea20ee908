"""Inexact Newton steps on the modulus equation on one level of a hierarchy on ranks, and its start from coarser ones.

The steps are those of `algebra.newton_steps`. Projected Gauss–Seidel in the rows of each rank moves the
boundary of the active set. The active rows take z = ψ(z). Krylov's method with V-cycles on the free
rows reduces Az + q there. Between the sweeps, neighbouring ranks exchange the values of their
common rows.
"""

from __future__ import annotations

from collections.abc import Generator
from itertools import pairwise
from typing import Any

import numpy as np

from ..algebra.equations import Pattern
from ..algebra.steps import INNER_REDUCTION, SWEEPS
from ..methods.multilevel import COARSE_REDUCTION, MAX_COARSE_STEPS
from ..numerics.arrays import Vector, inner
from ..problem.two_sided import ObstaclePair, mid
from .distributed_icp import DistributedICP
from .distributed_levels import DistributedLevel, DistributedLevels
from .distributed_map import DistributedMap
from .ranks import largest, norm_from, petsc, release, together, totals

#: share of the residual that a step leaves when the active set has settled but for a few rows
_SETTLED_REDUCTION = 0.5
#: multiple of the wanted residual below which sweeps are tried once more, as a Newton step costs several times as much
_SWEEP_RANGE = 2.0


class Evaluation:
    """p, `r` = z − ψ, `r_upper` = z − ψ̄, the active set and the residual at z; one product and one reduction.

    `pattern_changed` says whether the active set differs from `last_pattern` on any rank.
    """

    def __init__(self, problem: DistributedICP, z: Any, last_pattern: Pattern | None) -> None:
        self.problem = problem
        self.z = z
        self.p, self.r, self.r_upper = problem.sides(z)
        with np.errstate(all="ignore"):
            # p and r then change alike with z_i
            a = self.p / problem.matrix.diagonal * problem.psi.own_slope
            self.pattern = Pattern.of(self.r, self.r_upper, a)
            own = mid(problem.matrix.row_weights * self.p, self.r, self.r_upper)
        pattern_changed = last_pattern is None or not self.pattern.same_sides(last_pattern)
        squares, changes = totals(problem.comm, inner(own, own), float(pattern_changed))
        self.residual = norm_from(problem.comm, squares, own)
        self.pattern_changed = changes > 0

    def after_sweeps(self, count: int) -> Any:
        """z after `count` sweeps of projected Gauss–Seidel in the rows of each rank. Collective.

        Ranks exchange their values between two sweeps; the obstacles stay as they were.
        """
        from ..algebra.kernels.sweeps import sweep_rows  # loads numba

        problem = self.problem
        matrix = self.problem.matrix
        z = self.z.array_r
        at = self.z.copy()
        A = matrix.block
        rows = (A.indptr, A.indices, A.data, matrix.block_diagonal, matrix.row_weights)
        psi: Any = z - self.r
        if self.r_upper is not None:
            psi = ObstaclePair(psi, z - self.r_upper)
        z = z.copy()
        out = np.empty(z.size)
        for k in range(count):
            q = matrix.add_other_ranks(problem.q, at)
            if z.size:
                sweep_rows(*rows, q, psi, (1.0,), k % 2 == 0, z, out)
                z, out = out, z
            at.setArray(z)
        return at


def newton_steps(
    levels: DistributedLevels, problem: DistributedICP, z: Any, top: int, target: float | None = None
) -> Generator[Evaluation, float | None, None]:
    """Newton's steps on level `top`, whose problem is `problem`, as `simplify` makes it: the evaluation after each.

    Send the residual to aim at from then on, or None.
    """
    last_pattern: Pattern | None = None
    before = np.inf
    while True:
        at = Evaluation(problem, z, last_pattern)
        tolerance = target or 0.0
        for max_residual in (np.inf, _SWEEP_RANGE * tolerance):
            if at.pattern_changed and tolerance < at.residual <= max_residual:
                at = Evaluation(problem, at.after_sweeps(SWEEPS), last_pattern)
        target = yield at
        if at.pattern_changed:
            last_pattern = at.pattern
            levels.restrict(np.where(last_pattern.active, 0.0, 1.0), top)
        is_stable = not at.pattern_changed or at.residual <= _SETTLED_REDUCTION * before < np.inf
        z = _newton_step(levels, at, top, target if is_stable else None)
        before = at.residual
        release(problem.comm)


def _newton_step(levels: DistributedLevels, at: Evaluation, top: int, target: float | None) -> Any:
    """z after one Newton step from `at`, until ‖Az + q‖ in the free rows is a fraction of `target`, or a tenth."""
    problem = at.problem
    active = at.pattern.active
    J = _newton_matrix(at)
    r_active = np.where(active, at.pattern.r, 0.0)
    if J is None:  # z = ψ(z) in the active rows needs no equations
        z = problem.vector(at.z.array_r - r_active)
        f = np.where(active, 0.0, -(problem.matrix.product(z).array_r + problem.q))
    else:
        z = at.z
        f = np.where(active, -r_active * problem.matrix.diagonal, -at.p)
    step = levels.solve(problem.vector(f), top, J, INNER_REDUCTION if target is None else None, target)
    if np.isfinite(largest(problem.comm, float(np.abs(step.array_r).max(initial=0.0)))[0]):
        z.axpy(1.0, step)
    return z


def _newton_matrix(at: Evaluation) -> Any:
    """The Newton matrix where an obstacle moves with other unknowns, else None.

    It has the rows of A, and those of D(I − F′ − G) where active.
    """
    problem = at.problem
    pattern = at.pattern
    if all(one.G is None for one in problem.maps):
        return None
    Mat = petsc().Mat
    matrix = problem.matrix
    J = matrix.mat.duplicate(copy=True)
    diagonal = np.where(pattern.active, matrix.diagonal, 0.0)
    J.diagonalScale(matrix.vector(np.where(pattern.active, 0.0, 1.0)))
    for one, rows in zip(problem.maps, pattern.sides(), strict=True):
        diagonal -= np.where(rows, matrix.diagonal * one.slopes(at.z), 0.0)
        if one.G is not None:
            G = one.G.duplicate(copy=True)
            G.diagonalScale(matrix.vector(np.where(rows, -matrix.diagonal, 0.0)))
            J.axpy(1.0, G, Mat.Structure.DIFFERENT_NONZERO_PATTERN)
    J.setDiagonal(matrix.vector(diagonal), addv=True)
    return J


def coarse_start(levels: DistributedLevels, problem: DistributedICP) -> Any:
    """The start z, a `Vec`, from the coarser levels; see `methods.multilevel`.

    Each level starts from the answer of the next coarser one. Collective.
    """
    problems = [problem]
    shifts = []
    for level, coarser in pairwise(levels.levels):
        coarse, shift = _coarse_problem(problems[-1], level, coarser)
        problems.append(coarse)
        shifts.append(shift)
    z = problems[-1].vector()
    for top in range(len(problems) - 1, 0, -1):
        path = newton_steps(levels, problems[top], z, top)
        at = next(path)
        tolerance = COARSE_REDUCTION * at.residual
        for _ in range(MAX_COARSE_STEPS - 1):
            if at.residual <= tolerance:
                break
            at = path.send(tolerance)
        problems[top].matrix.free_block()
        z = levels.levels[top - 1].interpolate(at.z)
        z.array = z.array_r + shifts[top - 1]
    return z


def _coarse_problem(
    problem: DistributedICP, level: DistributedLevel, coarser: DistributedLevel
) -> tuple[DistributedICP, Vector]:
    """The problem on the level below `level`, and the shift s: on `level` its answer z is Pz + s."""
    shift = np.where(level.coarse_mask(), 0.0, -problem.q / problem.matrix.diagonal)
    at_shift = problem.vector(shift)
    p = problem.matrix.product(at_shift)
    p.array = p.array_r + problem.q
    maps: list[Any] = []
    for one, none in ((problem.psi, -np.inf), (problem.upper, np.inf)):
        if one is None:
            maps.append(None)
            continue
        c = level.inject(problem.vector(one.value(at_shift) - shift))
        with np.errstate(divide="ignore", invalid="ignore"):
            c = np.where(level.weight > 0, c / level.weight, none)
        G = None
        if one.G is not None:
            G = level.injection.matMult(one.G).matMult(level.P)
            G.diagonalScale(coarser.matrix.vector(np.where(level.weight > 0, 1.0 / level.weight, 0.0)))
        maps.append(DistributedMap.constant(coarser.matrix, c, G))
    return DistributedICP.of_checked(coarser.matrix, level.restrict_residual(p), *maps), shift


def simplify(problem: DistributedICP, start: bool = False) -> DistributedICP:
    """An equivalent problem that calls a user's function f only where it must.

    That is where the obstacle is Gz + f(z). For a `start` f is not called there either: it is then
    its value at its own fixed point. Raises MapError, NotApplicable.
    """
    maps: list[Any] = []
    for one in (problem.psi, problem.upper):
        if one is not None and one.has_function and (one.G is None or start):
            with together(problem.comm):
                c = one.fixed()
            one = DistributedMap.constant(problem.matrix, c, one.G)
        maps.append(one)
    return DistributedICP.of_checked(problem.matrix, problem.q, *maps)
