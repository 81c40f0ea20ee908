"""Which methods a problem is given: those of least expected cost, by `schedule`, from what each says of itself.

The candidates come in stages, by what has to be known for their estimates: nothing but n; the rows of A; its strong
components and the rows at rest; the radius of its Jacobi matrix; the fill of its factors. A stage is asked for only
where what it costs to know is worth it.
"""

from __future__ import annotations

import logging
import math
from collections.abc import Callable, Iterable, Iterator

import numpy as np

from ..algebra.relaxation import AUTO, best_omega, relaxation
from ..methods.accelerated import Accelerated
from ..methods.aor import MNMAOR, MNMGS
from ..methods.contract import Method
from ..methods.factorised import MNMMOD
from ..methods.interior import Interior
from ..methods.multilevel import Multilevel
from ..methods.newton import Newton
from ..methods.proximal import Proximal
from ..methods.psor import PSOR
from ..methods.shortcuts import Josephy, Lemke, Tridiagonal
from ..numerics import work
from ..problem.data import ProblemData
from .candidate import Candidate
from .schedule import Expected, Stage

_LOG = logging.getLogger("icpmodel")
#: a method that the paper prints is taken where it is expected to cost at most a fifth more than the best one, a
#: shortcut where it costs at most half
WEIGHTS = {"paper": 1 / 1.2, "modulus": 1.0, "shortcut": 2.0}
#: which methods may be chosen
FAMILIES = {"paper": ("paper",), "modulus": ("paper", "modulus"), None: ("paper", "modulus", "shortcut")}
Choice = Stage[Candidate]
Asked = tuple[Candidate, Expected]
_WHY = {
    "paper": "a method of the paper",
    "modulus": "a modulus method",
    "shortcut": "a shortcut, exact, whose cost counts double",
}


def choose(
    problem: ProblemData, aim: float, family: str | None = None, reduced: Callable[[float], list[Asked]] | None = None
) -> Iterator[Choice]:
    """The stages of candidates for `problem`: of each kind the one that is expected to cost least.

    `aim` is the share of Res_D(0) that is asked for, `family` as in `solve`; `reduced` makes those that solve it in
    parts from what the best of the others is expected to cost.
    """
    matrix, costs, cheapest = problem.matrix, work.COSTS, math.inf

    def stage(calls: float, passes: float, *kinds: Callable[[], Iterable[Method]], least: float = 0.0) -> Choice:
        def made() -> list[Asked]:
            nonlocal cheapest
            found = []
            for kind in kinds:
                if (one := _best(problem, aim, family, kind())) is not None:
                    found.append(one)
                    cheapest = min(cheapest, one[1].cost)
            return found

        cost = calls * costs.call + (passes and passes * costs.entry * work.entries(matrix.n, matrix.nnz))
        return Stage(cost / matrix.unit, made, least / matrix.unit)

    graph = 0.0 if matrix.is_full else 1.0  # the passes over the graph of A, where there is something to see

    yield stage(0.0, 0.0, lambda: [Lemke()])
    yield stage(6.0, 0.0, lambda: [Tridiagonal()])
    sweeps = not problem.psi.takes_best
    if sweeps:
        yield stage(8.0, 3.0, lambda: [PSOR(), MNMGS()])
        # for an affine obstacle its first step is all that Lemke's pivots do
        josephy = [Josephy()] if Lemke().why_not(problem) else []
        yield stage(15.0, 12.0, lambda: [Accelerated(of=PSOR(omega=relaxation(problem)))], lambda: josephy)
    yield stage(15.0, 0.0, lambda: [Multilevel()], least=costs.hierarchy)
    if reduced is not None:
        # what it costs where there are parts, 35 to 95 products; where all hangs together 5 to 20 were measured
        yield Stage(stage(100.0, 60.0 * graph).cost, lambda: reduced(cheapest))
    if sweeps:
        yield stage(100.0, 40.0, lambda: _relaxed(problem))
    factorised = 2.0 * min(work.least_factor_cost(matrix.n, matrix.nnz), work.dense_cost(matrix.n))
    yield stage(30.0, 80.0 * graph, lambda: [Newton()], lambda: [Proximal()], lambda: [Interior()], least=factorised)
    # where others are there it was best once on 430 random problems, but it needs neither a diagonal nor a derivative
    yield stage(30.0, 80.0 * graph, lambda: [MNMMOD(theta1=AUTO)], least=factorised if family == "paper" else math.inf)


def _relaxed(problem: ProblemData) -> list[Method]:
    """Overrelaxed sweeps, of which theory says something where ρ < 1."""
    if problem.matrix.jacobi_radius >= 1.0:
        return []
    return [PSOR(omega=best_omega(problem.matrix.jacobi_radius)), MNMAOR(theta1=AUTO)]


def _best(problem: ProblemData, aim: float, family: str | None, methods: Iterable[Method]) -> Asked | None:
    """Of the `methods` that may be chosen and take the problem the one that is expected to cost least."""
    best, least, told = None, math.inf, _LOG.isEnabledFor(logging.DEBUG)
    for method in methods:
        if method.family not in FAMILIES[family] or (why_not := method.why_not(problem)) is not None:
            if told and method.family in FAMILIES[family]:
                _LOG.debug("n = %d: %r is not considered: %s", problem.n, method, why_not)
            continue
        estimate = method.estimate(problem.facts, aim)
        if estimate is None or not work.fits(estimate.memory):
            if told:
                _LOG.debug("n = %d: %r is not considered: it has no forecast, or needs more memory", problem.n, method)
            continue
        cost, weight = estimate.total, WEIGHTS[method.family]
        if told:
            _LOG.debug("n = %d: %r is expected to cost %.3g products with A", problem.n, method, cost)
        if best is None or weight * cost < least:
            why = f"{_WHY[method.family]}, expected to cost {cost:.3g} products with A"
            looks = method.finite, weight, estimate.look, method.memoryless  # what has a memory does not creep
            expected = Expected(cost, estimate.setup, estimate.step, *looks)
            best, least = (Candidate(method, why), expected), weight * cost
    return best


def why_none(problem: ProblemData) -> str:
    """Why `choose` found no method that could start."""
    diagonal = problem.A.diagonal()
    i = int(np.argmin(diagonal))
    if diagonal[i] > 0.0:
        return "nothing that could be chosen fits into the memory that is left (memory_limit)"
    others = problem.psi.no_derivative() or "factors do not fit into the memory that is left: raise memory_limit"
    return f"A[{i}, {i}] = {diagonal[i]:g} is not positive, as sweeps ask for, and {others}"
