"""`SolverFactory("icpmodel")`: importing this room registers the solver in Pyomo's new and legacy interface."""

from __future__ import annotations

import datetime
import sys
import time
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.common.timing import HierarchicalTimer
from pyomo.contrib.solver.common.base import Availability, SolverBase
from pyomo.contrib.solver.common.config import SolverConfig
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.solution_loader import SolutionLoader
from pyomo.contrib.solver.common.util import NoOptimalSolutionError
from pyomo.core.staleflag import StaleFlagManager

from ...errors import InputError
from ...solve.solution import Solution, Status
from ..reading import solved
from .models import PyomoReading, read_pyomo

_VERSION: str = sys.modules[__name__.partition(".")[0]].__version__
#: what Pyomo calls each end of a run, and the point that it leaves; SOLVED alone is a success
ENDS = {
    Status.SOLVED: (TerminationCondition.convergenceCriteriaSatisfied, SolutionStatus.optimal),
    Status.PRECISION_LIMIT: (TerminationCondition.unknown, SolutionStatus.unknown),
    Status.STAGNATED: (TerminationCondition.minStepLength, SolutionStatus.infeasible),
    Status.CYCLED: (TerminationCondition.unknown, SolutionStatus.infeasible),
    Status.DIVERGED: (TerminationCondition.unknown, SolutionStatus.infeasible),
    Status.INFEASIBLE: (TerminationCondition.provenInfeasible, SolutionStatus.infeasible),
    Status.ITERATION_LIMIT: (TerminationCondition.iterationLimit, SolutionStatus.infeasible),
    Status.TIME_LIMIT: (TerminationCondition.maxTimeLimit, SolutionStatus.infeasible),
    Status.MEMORY_LIMIT: (TerminationCondition.error, SolutionStatus.infeasible),
    Status.INTERRUPTED: (TerminationCondition.interrupted, SolutionStatus.infeasible),
    Status.STOPPED: (TerminationCondition.interrupted, SolutionStatus.infeasible),
    Status.MAP_FAILED: (TerminationCondition.error, SolutionStatus.infeasible),
    Status.CROSSED: (TerminationCondition.error, SolutionStatus.infeasible),
}
#: options of `icpmodel.solve` that Pyomo has under names of its own
_PYOMOS = {
    "time_limit": "timelimit (legacy) or time_limit",
    "raise_on_failure": "raise_exception_on_nonoptimal_result",
    "z0": "the values of the variables",
    "progress": "tee",
    "history": "nothing: take read_pyomo(model).problem.solve(history=True)",
}


class AnswerLoader(SolutionLoader):
    """Variable values, and the suffixes `dual` and `rc` where they are declared: `dual` has, by Complementarity, p of
    its row (g of a condition a ≤ f ≤ b ⟂ g), and `rc`, by variable, the same with the sign of MCP solvers' marginals.
    """

    def __init__(self, model: Any, reading: PyomoReading, z: np.ndarray) -> None:
        self._pyomo_model, self._reading, self._z = model, reading, z

    def get_number_of_solutions(self) -> int:
        return 1

    def get_vars(self, vars_to_load: Sequence[Any] | None = None) -> Mapping[Any, float]:
        return _chosen(self._reading.values(self._z), vars_to_load)

    def get_duals(self, cons_to_load: Sequence[Any] | None = None) -> Any:
        return _chosen(self._reading.multipliers(self._z), cons_to_load)

    def get_reduced_costs(self, vars_to_load: Sequence[Any] | None = None) -> Mapping[Any, float]:
        return _chosen(self._reading.marginals(self._z), vars_to_load)


@SolverFactory.register("icpmodel", doc="Implicit complementarity problems by modulus-based methods")
class PyomoSolver(SolverBase):
    """Pyomo's interface to `icpmodel.solve`.

    `solver_options` (`options` in the legacy interface): `method` and what it takes, `rtol`, `atol`, `accuracy`,
    `max_iter`, `callback`. The start is what the variables' values say. `tee` prints the card of the solution.
    `results.extra_info.solution` is the `Solution`, with its certificate; its z are ±the variables, see `PyomoReading`.

    >>> import pyomo.environ as pyo
    >>> from pyomo.mpec import Complementarity, complements
    >>> model = pyo.ConcreteModel()
    >>> model.x = pyo.Var()
    >>> model.c = Complementarity(expr=complements(model.x >= 0, 2 * model.x >= 3))
    >>> results = pyo.SolverFactory("icpmodel").solve(model)
    >>> str(results.solver.termination_condition), model.x.value
    ('optimal', 1.5)
    """

    CONFIG = SolverConfig()

    def available(self) -> Availability:
        return Availability.FullLicense

    def version(self) -> tuple[int, ...]:
        return tuple(int(part) for part in _VERSION.split("."))

    def solve(self, model: Any, **kwds: Any) -> Results:
        """Solve `model`, which `read_pyomo` must take, and load the answer. Raises InputError for another model, and
        NoOptimalSolutionError where the run failed and `raise_exception_on_nonoptimal_result` is set."""
        begin = time.perf_counter()
        results = Results()
        results.timing_info.start_timestamp = datetime.datetime.now(datetime.UTC)
        results.solver_name, results.solver_version = self.name, self.version()
        config = results.solver_config = self.config(value=kwds, preserve_implicit=True)
        options = config.solver_options.value()
        for name, pyomos in _PYOMOS.items():
            if name in options:
                raise InputError(f"the option {name} is given to Pyomo by {pyomos}")
        timer = results.timing_info.timer = config.timer or HierarchicalTimer()
        timer.start("read")
        reading = read_pyomo(model)
        timer.stop("read")
        limit = config.time_limit
        left = None if limit is None else max(limit - (time.perf_counter() - begin), 0.0)
        timer.start("solve")
        solution = solved(reading, time_limit=left, **options)
        timer.stop("solve")
        StaleFlagManager.mark_all_as_stale()
        self._fill(results, reading, solution)
        for stream in config.tee:
            print(f"icpmodel {_VERSION}\n{solution}\n{results.solver_log}", file=stream)
        results.solution_loader = AnswerLoader(model, reading, solution.z)
        if config.raise_exception_on_nonoptimal_result and results.solution_status is not SolutionStatus.optimal:
            raise NoOptimalSolutionError(results.solver_log)
        if config.load_solutions:
            results.solution_loader.load_solution()
        results.timing_info.wall_time = time.perf_counter() - begin
        return results

    def _fill(self, results: Results, reading: PyomoReading, solution: Solution) -> None:
        """The status, honestly: a point outside a variable's bounds is no solution."""
        results.extra_info.solution = solution
        results.termination_condition, results.solution_status = ENDS[solution.status]
        results.solver_log = solution.message
        fault = reading.out_of_bounds(solution.z, solution.tolerance) if solution.solved else ""
        if fault:
            unique = solution.certificate.unique
            results.solution_status = SolutionStatus.infeasible
            end = TerminationCondition.provenInfeasible if unique else TerminationCondition.unknown
            results.termination_condition = end
            other = "have no other solution" if unique else "may have another solution"
            results.solver_log = f"{fault}; the conditions {other}"
        elif solution.solved:
            results.incumbent_objective = 0.0  # there is none; Pyomo takes a number here for "there is a solution"


def _chosen(pairs: list[tuple[Any, Any]], wanted: Sequence[Any] | None) -> Any:
    """The pairs as a ComponentMap, of the components that are wanted, None for all."""
    found = ComponentMap(pairs)
    return found if wanted is None else ComponentMap((component, found[component]) for component in wanted)
