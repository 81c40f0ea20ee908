"""Inexact Newton steps on the modulus equation on one level of a hierarchy on ranks, and its start from coarser ones.

The steps are those of `algebra.newton_steps`. Projected Gauss–Seidel in the rows of each rank moves the
boundary of the active set. The active rows take z = ψ(z). A Krylov method with V-cycles reduces
Az + q in the free rows. Between two sweeps, ranks exchange the values of unknowns that they share.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import islice, pairwise
from typing import Any

import numpy as np

from ..algebra.steps import INNER_REDUCTION, MAX_IDLE_STEPS, SWEEPS
from ..methods.contract import PATIENCE, REDUCTION
from ..methods.multilevel import MAX_COARSE_STEPS
from ..numerics.arrays import Vector
from ..solve.run import MAX_ROUNDING
from .distributed_icp import DistributedICP
from .distributed_levels import DistributedLevel, DistributedLevels
from .distributed_map import DistributedMap
from .evaluation import Evaluation
from .ranks import anywhere, largest, petsc, release, together

#: a step that leaves at most this share of the residual shows that the active set has settled but for a few rows
_SETTLED_REDUCTION = 0.5
#: multiple of the wanted residual below which sweeps are tried once more, as a Newton step costs several times as much
_SWEEP_RANGE = 2.0


def iterates(
    levels: DistributedLevels, problem: DistributedICP, z: Any, target: float, scale: float
) -> Iterator[Evaluation]:
    """Yield Newton's steps from `z`, and sweeps where these do not reduce the residual, until both fail. Collective.

    They also end where rounding explains the residual: see `is_at_floor`, which takes `scale`.
    """
    best: Evaluation | None = None
    milestone = np.inf
    while True:
        idle = 0
        for at in newton_steps(levels, problem, z, 0, target):
            yield at
            if best is None or at.residual < best.residual or not np.isfinite(best.residual):
                best = at
            idle += 1
            if at.residual <= REDUCTION * milestone:
                milestone = at.residual
                idle = 0
            if idle > PATIENCE or not np.isfinite(at.residual):
                break
        if best is None or is_at_floor(best, scale):
            return
        at = best
        for _ in range(MAX_IDLE_STEPS):
            at = at.after_sweeps(SWEEPS)
            release(problem.comm)
            yield at
            if at.residual <= REDUCTION * best.residual or not np.isfinite(at.residual):
                break
        if not at.residual <= REDUCTION * best.residual:
            return
        z = at.z


def is_at_floor(at: Evaluation, scale: float) -> bool:
    """Whether rounding errors explain the residual, and are a small part of `scale`. Collective."""
    return at.residual <= 2.0 * at.rounding_of_residuals[0] < MAX_ROUNDING * scale


def newton_steps(
    levels: DistributedLevels, problem: DistributedICP, z: Any, top: int, target: float | None = None
) -> Iterator[Evaluation]:
    """Yield the evaluations at the start and after each Newton step on level `top`, for its simplified `problem`.

    The steps aim at the residual `target`, by default at `INNER_REDUCTION` of the first one.
    """
    last = None
    while True:
        at = Evaluation(problem, z)
        tolerance = target or 0.0
        for max_residual in (np.inf, _SWEEP_RANGE * tolerance):
            if tolerance < at.residual <= max_residual and _has_moved(at, last):
                at = at.after_sweeps(SWEEPS)
        yield at
        target = INNER_REDUCTION * at.residual if target is None else target
        moved = _has_moved(at, last)
        if moved:
            levels.restrict(np.where(at.pattern.active, 0.0, 1.0), top)
        settles = last is not None and at.residual <= _SETTLED_REDUCTION * last.residual < np.inf
        z = _newton_step(levels, at, top, target if settles or not moved else None)
        last = at
        release(problem.comm)


def _has_moved(at: Evaluation, last: Evaluation | None) -> bool:
    """Whether the active set differs from that of the `last` step on any rank. Collective."""
    return last is None or anywhere(at.problem.comm, not at.pattern.same_sides(last.pattern))


def _newton_step(levels: DistributedLevels, at: Evaluation, top: int, target: float | None) -> Any:
    """z after one Newton step from `at`; its linear solve aims at a share of `target`, or a tenth of its residual."""
    problem = at.problem
    active = at.pattern.active
    J = _newton_matrix(at)
    r_active = np.where(active, at.pattern.r, 0.0)
    if J is None:  # then the active rows need no linear equations
        z = problem.vector(at.z.array_r - r_active)
        f = np.where(active, 0.0, -(problem.matrix.product(z).array_r + problem.q))
    else:
        z = at.z.copy()
        f = np.where(active, -r_active * problem.matrix.diagonal, -at.p)
    step = levels.solve(problem.vector(f), top, J, INNER_REDUCTION if target is None else None, target)
    if np.isfinite(largest(problem.comm, np.abs(step.array_r))):
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
        steps = islice(newton_steps(levels, problems[top], z, top), MAX_COARSE_STEPS)
        at = first = next(steps)
        while at.residual > INNER_REDUCTION * first.residual and (following := next(steps, None)) is not None:
            at = following
        problems[top].matrix.free_block()
        finer = levels.levels[top - 1]
        z = finer.matrix.image(finer.P, at.z)
        z.array = z.array_r + shifts[top - 1]
    return z


def _coarse_problem(
    problem: DistributedICP, level: DistributedLevel, coarser: DistributedLevel
) -> tuple[DistributedICP, Vector]:
    """The problem on the next `coarser` level, and the shift s: its answer z becomes Pz + s on `level`."""
    ones = coarser.matrix.vector(np.ones(coarser.matrix.high - coarser.matrix.low))
    is_coarse = problem.matrix.image(level.injection, ones, transposed=True).array_r > 0
    shift = np.where(is_coarse, 0.0, -problem.q / problem.matrix.diagonal)
    at_shift = problem.vector(shift)
    p = problem.matrix.product(at_shift)
    p.array = p.array_r + problem.q
    maps: list[Any] = []
    for one, none in ((problem.psi, -np.inf), (problem.upper, np.inf)):
        if one is None:
            maps.append(None)
            continue
        c = coarser.matrix.image(level.injection, problem.vector(one.value(at_shift) - shift)).array_r
        with np.errstate(divide="ignore", invalid="ignore"):
            c = np.where(level.weight > 0, c / level.weight, none)
        G = None
        if one.G is not None:
            G = level.injection.matMult(one.G).matMult(level.P)
            G.diagonalScale(coarser.matrix.vector(np.where(level.weight > 0, 1.0 / level.weight, 0.0)))
        maps.append(DistributedMap.constant(coarser.matrix, c, G))
    q = coarser.matrix.image(level.P, p, transposed=True).array.copy()
    return DistributedICP.of_checked(coarser.matrix, q, *maps), shift


def simplify(problem: DistributedICP, start: bool = False) -> DistributedICP:
    """The problem with users' functions f replaced by their fixed points, where it stays equivalent.

    It does unless the obstacle is Gz + f(z). For a `start`, f is replaced there as well, which
    changes the problem. Raises MapError, NotApplicable.
    """
    if not problem.calls_user_code:
        return problem
    maps: list[Any] = []
    for one in (problem.psi, problem.upper):
        if one is not None and one.has_function and (one.G is None or start):
            with together(problem.comm):
                c = one.fixed()
            one = DistributedMap.constant(problem.matrix, c, one.G)
        maps.append(one)
    return DistributedICP.of_checked(problem.matrix, problem.q, *maps)
