"""What methods are expected to cost, from n, the entries of A, the fill of its factors, and ρ of the Jacobi matrix."""

from __future__ import annotations

import math
from collections.abc import Callable
from typing import NamedTuple

from ..algebra.affine_lcp import INVERSE_COST, PIVOT_UP_TO, lcp_rows, obstacles
from ..algebra.factor_costs import factor_costs, interior_cost, newton_cost, system_cost
from ..algebra.relaxation import sor_log_reduction
from ..algebra.steps import SWEEPS
from ..methods.accelerated import Accelerated
from ..methods.contract import Method
from ..methods.factorised import MNMMOD
from ..methods.interior import Interior
from ..methods.multilevel import Multilevel
from ..methods.newton import Newton
from ..methods.proximal import Proximal
from ..methods.psor import PSOR
from ..methods.restarts import Restarts
from ..methods.shortcuts import Lemke
from ..numerics import work
from ..numerics.fill import band_fill, dense_cost, factor_cost, least_factor_cost, solve_cost
from ..numerics.krylov import gcr_step_cost
from ..numerics.linear import steps_cost
from ..numerics.multigrid import cycle_cost, hierarchy_cost
from ..problem.facts import Facts
from .goal import RTOL

#: restarts of Lemke's pivots after they have ended in a ray: of 9 kinds of problems that are not monotone, n = 20, five
#: were solved with nine of ten
TRIES = 10


class Estimate(NamedTuple):
    """The expected cost of a method: `setup`, then `steps` of `step` each, in nanoseconds as `work` counts them.

    `memory` is in bytes beyond the problem.
    """

    setup: float
    step: float
    steps: float
    memory: float = 0.0

    @property
    def total(self) -> float:
        """The whole cost, in nanoseconds."""
        return self.setup + self.step * self.steps


def least_cost(facts: Facts, family: str | None) -> float:
    """The least that rung 4 can cost, from n and the entries of A alone."""
    least = least_direct_cost(facts, family)
    return least if family == "paper" else min(least, _multilevel(facts).setup)


def _pivots(facts: Facts) -> float:
    """The cost of half as many pivots as there are obstacles, and of (I − G)⁻¹ where these move.

    Medians of .65 n and 1.1 n pivots were counted with one and two obstacles, in 27 problems with 100 to 700 unknowns.
    """
    inverse = 0.0 if facts.has_fixed_obstacle else INVERSE_COST * dense_cost(facts.matrix.n)
    return 0.5 * obstacles(facts) * lcp_rows(facts) ** 2 * work.COSTS.pivot_entry + inverse


def _sweeps(method: Method, facts: Facts, target_reduction: float) -> Estimate:
    """The estimate for sweeps, by the spectral radius ρ of the Jacobi matrix (Young 1971, chapter 6).

    ρ is estimated by the Rayleigh quotient of the vector of ones, which is below ρ, most of all on fine grids. But rows
    in contact reduce ρ: on 188 problems twenty Lanczos steps for the whole of A mostly overestimated it. Anderson
    acceleration is expected to have half the log reduction of Chebyshev acceleration.
    """
    n = facts.matrix.n
    costs = work.COSTS
    step = costs.iterate + work.sweep_cost(n, facts.entries)
    omega = method.of.omega if isinstance(method, Accelerated) and isinstance(method.of, PSOR) else 1.0
    log_reduction = sor_log_reduction(omega, max(facts.matrix.coupled_radius, facts.coupling))
    vectors = 0.0
    if isinstance(method, Accelerated):
        root = math.sqrt(1.0 - math.exp(-log_reduction))
        log_reduction = 0.5 * math.log((1.0 + root) / (1.0 - root))
        # two a sweep add to the history, the others combine it after every `mixing_frequency` sweeps
        vectors = 2.0 + 3.0 * (method.history_size + 1) / method.mixing_frequency
        step += 2.0 * costs.call + vectors * costs.vector * n
    steps = math.log(1.0 / target_reduction) / log_reduction + 1.0
    return Estimate(costs.call, step, steps, 8.0 * n * (4.0 + vectors))


def _newton_steps(facts: Facts) -> float:
    """The expected number of steps of an active set that only shrinks, by twice as many layers in every step."""
    return 1.0 + math.log2(max(facts.bounded, 1)) / 3.0


def least_direct_cost(facts: Facts, family: str | None) -> float:
    """The least that `Newton`, `Proximal`, `Interior` or `Lemke` could cost if factors had no fill."""
    matrix = facts.matrix
    n = matrix.n
    rows = matrix.rows
    band = factor_cost(band_fill(n, rows.below, rows.above, rows.below == rows.above))
    factors = min(band, least_factor_cost(n, matrix.nnz), dense_cost(n, True))
    system = min(factors, steps_cost(n, matrix.nnz))
    least = _newton_steps(facts) * (newton_cost(facts) + system)
    return min(least, _pivots(facts)) if family is None else least


def _newton(facts: Facts) -> Estimate:
    # where rows are not dominant the active set oscillates: 83 problems took 7 times as many steps on average,
    # half of them at most 2.5 times. Systems of descent steps are not symmetric, nor those with an obstacle that moves.
    # Without a positive diagonal the equations of the free rows are mostly singular, and descent steps follow
    matrix = facts.matrix
    is_dominant = matrix.coupled_radius <= 1.0 and matrix.has_positive_diagonal
    wander = 1.0 if is_dominant else 7.0
    system, memory = system_cost(matrix, _part_cost(facts, is_dominant and facts.has_fixed_obstacle))
    return Estimate(0.0, newton_cost(facts) + system, wander * _newton_steps(facts), memory)


def _part_cost(facts: Facts, symmetric: bool) -> float:
    """The cost of factors of the free rows, if half of the rows with an obstacle are active."""
    return factor_costs(facts.equations).part(facts.matrix.n - facts.bounded // 2, symmetric=symmetric)


def _multilevel(facts: Facts, target_reduction: float = RTOL) -> Estimate:
    matrix = facts.matrix
    n = matrix.n
    python = 0.5 * work.COSTS.newton
    cycle = cycle_cost(n, matrix.nnz)
    step = python + SWEEPS * work.sweep_cost(n, facts.entries)
    setup = hierarchy_cost(n, matrix.nnz)
    if facts.has_fixed_obstacle:
        # two steps on each level that is not small; these levels together have about as many entries as the finest one.
        # A step takes one Krylov step in the median of 67 problems
        step += cycle + gcr_step_cost(n, matrix.nnz)
        coarser = 2.0 * math.log2(max(cycle / python, 1.0))
        setup += coarser * python + min(coarser, 2.0) * (step - python)
    else:
        # two steps on each level, with equations made of A and ψ′; all coarser ones have the entries of the finest
        mixed = work.COSTS.mixed + work.COSTS.mixed_entry * facts.entries
        step += 3.0 * cycle + mixed
        setup += 4.0 * math.log2(max(n / 64.0, 1.0)) * python + 2.0 * mixed
    # for matrices with ρ ≤ 1 the median of 67 problems, n = 300 … 4000, was five steps to RTOL, and three quarters took
    # six at most; on other matrices, for which it is not made, it seldom converges
    radius = max(matrix.coupled_radius, 1.0)
    # the eighth power of ρ: with the fourth it was chosen first on bodies in the plane, ρ = 1.6, where it stagnates.
    # Products overflow to infinity, where a power of Python would raise
    squared = radius * radius
    fourth = squared * squared
    # fewer steps for a larger tolerance, as each reduces the residual by about the same factor
    steps = min(max(5.0 * math.log(target_reduction) / math.log(RTOL), 1.0), 5.0)
    return Estimate(setup, step, steps * fourth * fourth, 40.0 * matrix.nnz)


def _lemke(facts: Facts) -> Estimate:
    # dense arrays of A, and the equations of the last basis
    return Estimate(2.0 * work.COSTS.assembly, _pivots(facts), 1.0, 24.0 * lcp_rows(facts) ** 2)


def pivots_cost_less(facts: Facts) -> bool:
    """Whether `Lemke` costs less than `Interior`; on small problems pivots cost less than an estimate of `Interior`."""
    return facts.matrix.n <= PIVOT_UP_TO or _lemke(facts).total <= _interior(facts).total


def _proximal(facts: Facts) -> Estimate:
    # medians of 6 and 10 steps were measured at n = 120 and 1000 where rows are dominant; 2.5 times as many on average
    # over 84 other problems with a positive diagonal; medians of 24, 35 and 125 at n = 120, 500 and 2000 without one;
    # 67, 98 and 175 at n = 100, 500 and 2000 where an entry of it is negative
    matrix = facts.matrix
    fixed = facts.has_fixed_obstacle
    factors = _part_cost(facts, fixed)
    if fixed:
        factors = min(factors, factor_costs(matrix).repeated)
    system, memory = system_cost(matrix, factors)
    step = (work.COSTS.newton if fixed else newton_cost(facts)) + system
    rows = max(facts.bounded, 1)
    if matrix.has_positive_diagonal:
        steps = (1.0 if matrix.coupled_radius <= 1.0 else 2.5) * (3.0 + math.log2(rows))
    else:
        steps = (4.0 if matrix.has_negative_diagonal else 2.0) * math.sqrt(rows)
    return Estimate(step, step, steps, memory)


def _interior(facts: Facts) -> Estimate:
    # medians of 11, 12 and 15 steps were measured at n = 150, 500 and 1500, with three solves each
    costs = factor_costs(facts.equations)
    factors = min(costs.repeated, costs.condensed) if facts.has_fixed_obstacle else costs.unsymmetric
    step = interior_cost(facts) + factors + 3.0 * solve_cost(costs.fill)
    return Estimate(step, step, 1.25 * (2.0 + math.log2(max(facts.bounded, 1))), 24.0 * costs.fill.entries)


def _factorised(facts: Facts, target_reduction: float) -> Estimate:
    # for symmetric A and θ₁ = √(λ_min λ_max) a step reduces the error by (√κ − 1)/(√κ + 1), κ = (1 + ρ)/(1 − ρ)
    matrix = facts.matrix
    radius = min(matrix.coupled_radius, 1.0 - 1e-6)
    root = math.sqrt((1.0 + radius) / (1.0 - radius))
    costs = factor_costs(matrix)
    step = 4.0 * work.COSTS.call + solve_cost(costs.fill) + matrix.product_cost
    steps = math.log(1.0 / target_reduction) / math.log((root + 1.0) / (root - 1.0)) if root > 1.0 else 1.0
    return Estimate(2.0 * costs.first, step, 1.0 + steps, 16.0 * costs.fill.entries)


_ESTIMATES: dict[type[Method], Callable[[Facts], Estimate]] = {
    Newton: _newton,
    Lemke: _lemke,
    Restarts: _lemke,  # one try; its limit, twice that and doubled again and again, allows more
    Proximal: _proximal,
    Interior: _interior,
}


def estimate_of(method: Method, facts: Facts, target_reduction: float) -> Estimate:
    """The expected cost of `method` for reducing the first residual by the factor `target_reduction`."""
    if isinstance(method, MNMMOD):
        return _factorised(facts, target_reduction)
    if isinstance(method, Multilevel):
        return _multilevel(facts, target_reduction)
    known = _ESTIMATES.get(type(method))
    return _sweeps(method, facts, target_reduction) if known is None else known(facts)
