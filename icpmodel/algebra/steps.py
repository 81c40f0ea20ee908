"""Compiled sweeps over A as steps, one or several per call."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from ..numerics import work
from ..numerics.arrays import Vector, read_only
from ..problem.data import ProblemData
from ..problem.map import Map
from ..problem.two_sided import ObstaclePair, obstacle_values, sides_of

#: the largest number of sweeps in one call
SWEEPS = 4
#: the factor by which inner iterations reduce a residual
INNER_REDUCTION = 0.1
#: the number of steps without a reduction after which a method ends, or goes on in another way
MAX_IDLE_STEPS = 100
#: z⁺, and Res_D(z), None where computing it would cost extra
StepResult = tuple[Vector, float | None]
#: z ↦ (z⁺, Res_D(z))
Step = Callable[[Vector], StepResult]


class Sweep:
    """A `step`, callable as one; `repeat(z, count)` makes `count` of them in one call, and returns their results."""

    def __init__(self, step: Step, repeat: Callable[[Vector, int], list[StepResult]]) -> None:
        self.step = step
        self.repeat = repeat

    def __call__(self, z: Vector) -> StepResult:
        return self.step(z)


def repeated_steps(step: Step, z: Vector, count: int = SWEEPS) -> list[StepResult]:
    """The results of up to `count` ≥ 1 successive steps from `z`: of one step, or of as many as one call makes."""
    count = min(count, SWEEPS)
    return step.repeat(z, count) if isinstance(step, Sweep) and count > 1 else [step(z)]


def compiled_step(problem: ProblemData, parameters: tuple[Any, ...], forward: bool = True) -> Step:
    """One compiled sweep as a step, forward or backward through the rows, with the `parameters` of the kernel.

    An affine ψ is evaluated inside the sweep, and several sweeps are then made in one call; any other ψ
    is evaluated before each sweep.
    """
    from .kernels.sweeps import repeated_sweeps, sweep_rows

    psi = problem.psi
    A = problem.A
    compiled_psi = read_only(_compiled_obstacle(psi))
    rows = read_only((A.indptr, A.indices, A.data, problem.matrix.rows.diag, problem.matrix.row_weights, problem.q))
    parameters = read_only(parameters)
    sweep_cost = work.sweep_cost(problem.n, problem.facts.entries)

    def step(z: Vector) -> tuple[Vector, float]:
        work.count(sweep_cost)
        out = np.empty(z.size)
        obstacle = read_only(obstacle_values(psi, z)) if compiled_psi is None else compiled_psi
        squares = sweep_rows(*rows, obstacle, parameters, forward, z, out)
        return out, float(np.sqrt(squares))

    if compiled_psi is None:
        return step

    def repeat(z: Vector, count: int) -> list[StepResult]:
        work.count(sweep_cost * count)
        Z = np.empty((count + 1, z.size))
        squares = np.empty(count)
        Z[0] = z
        repeated_sweeps(*rows, compiled_psi, parameters, forward, Z, squares)
        return list(zip(Z[1:], np.sqrt(squares).tolist(), strict=True))

    return Sweep(step, repeat)


def _compiled_obstacle(psi: Map) -> Any:
    """An affine ψ as compiled loops take it: c, or (c, indptr, indices, data) of Gz + c; None for any other ψ.

    Both obstacles have the same form, so that fewer loops are compiled.
    """
    if psi.linear is None:
        return None
    linear = [one.linear for one in sides_of(psi) if one.linear is not None]
    forms = [c if psi.is_constant else (c, G.indptr, G.indices, G.data) for G, c in linear]
    return forms[0] if psi.upper is None else ObstaclePair(*forms)


def projected_sweep(problem: ProblemData, omega: float = 1.0, forward: bool = True) -> Step:
    """A sweep of projected SOR, from the first row to the last or from the last to the first."""
    return compiled_step(problem, (omega,), forward)
