"""icpmodel as a solver of Pyomo's new interface; `legacy_interface` registers it in both."""

from __future__ import annotations

import datetime
import math
import time
from collections.abc import Mapping, Sequence
from importlib.metadata import version
from typing import Any, TextIO

import numpy as np
from pyomo.common.collections import ComponentMap
from pyomo.common.timing import HierarchicalTimer
from pyomo.contrib.solver.common.base import Availability, SolverBase
from pyomo.contrib.solver.common.config import SolverConfig
from pyomo.contrib.solver.common.results import Results, SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.solution_loader import SolutionLoader
from pyomo.contrib.solver.common.util import NoFeasibleSolutionError, NoOptimalSolutionError
from pyomo.core import Objective, value
from pyomo.core.staleflag import StaleFlagManager

from ...errors import InputError
from ...numerics import work
from ...solve.solution import Solution, Status
from ..reading import solved
from ..running_log import printed_on
from .models import PyomoReading, read_pyomo

_VERSION = version("icpmodel")
#: status → termination condition of Pyomo
_TERMINATIONS = {
    Status.SOLVED: TerminationCondition.convergenceCriteriaSatisfied,
    Status.STAGNATED: TerminationCondition.minStepLength,
    Status.INFEASIBLE: TerminationCondition.provenInfeasible,
    Status.ITERATION_LIMIT: TerminationCondition.iterationLimit,
    Status.TIME_LIMIT: TerminationCondition.maxTimeLimit,
    **dict.fromkeys([Status.PRECISION_LIMIT, Status.CYCLED, Status.DIVERGED], TerminationCondition.unknown),
    **dict.fromkeys([Status.INTERRUPTED, Status.STOPPED], TerminationCondition.interrupted),
    **dict.fromkeys([Status.MEMORY_LIMIT, Status.WORKER_LOST], TerminationCondition.error),
    **dict.fromkeys([Status.MAP_FAILED, Status.CROSSED], TerminationCondition.error),
}
#: status → solution status of Pyomo, else infeasible; only SOLVED is a success
_POINTS = {Status.SOLVED: SolutionStatus.optimal, Status.PRECISION_LIMIT: SolutionStatus.unknown}
#: options of Pyomo's new solvers that do not apply to this one
_IGNORED_OPTIONS = {
    "threads": "icpmodel takes the cores that the process may run on, see os.sched_setaffinity",
    "working_dir": "icpmodel runs in this process and writes no files",
}
#: options of `icpmodel.solve` that have other names in Pyomo
_PYOMO_NAMES = {
    **dict.fromkeys(("time_limit", "timelimit"), "the keyword timelimit (legacy) or time_limit"),
    "raise_on_failure": "raise_exception_on_nonoptimal_result",
    "z0": "the values of the variables",
    "progress": "tee",
    "history": "nothing: take read_pyomo(model).problem.solve(history=True)",
}


class AnswerLoader(SolutionLoader):
    """Load the best iterate: variable values, and the suffixes `dual` and `rc` if they are declared.

    `dual` maps a Complementarity to p of its row (g of a condition a ≤ f ≤ b ⟂ g). `rc` maps a variable to the same,
    with the sign of MCP solvers' marginals.
    """

    def __init__(self, model: Any, reading: PyomoReading, z: np.ndarray, solved: bool) -> None:
        self._pyomo_model, self.reading, self._z, self._solved = model, reading, z, solved

    def get_number_of_solutions(self) -> int:
        return int(self._solved)

    def get_vars(self, vars_to_load: Sequence[Any] | None = None) -> Mapping[Any, float]:
        return _chosen(self.reading.values(self._z), vars_to_load)

    def get_duals(self, cons_to_load: Sequence[Any] | None = None) -> Any:
        return _chosen(self.reading.multipliers(self._z), cons_to_load)

    def get_reduced_costs(self, vars_to_load: Sequence[Any] | None = None) -> Mapping[Any, float]:
        return _chosen(self.reading.marginals(self._z), vars_to_load)


class PyomoSolver(SolverBase):
    """Pyomo's interface to `icpmodel.solve`.

    Parameters
    ----------
    **kwds
        Options of Pyomo's solvers.

    Notes
    -----
    `solver_options` (`options` in the legacy interface) are `method` and its options, `rtol`, `atol`,
    `accuracy`, `max_iter` and `callback`. The start is the values of the variables. `tee` prints a log
    and the solution's card. `results.extra_info.solution` is the `Solution`, with its certificate. Its
    z begins with the values of the variables, see `PyomoReading`.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> from pyomo.contrib.solver.common.factory import SolverFactory
    >>> from pyomo.mpec import Complementarity, complements
    >>> model = pyo.ConcreteModel()
    >>> model.x = pyo.Var()
    >>> model.c = Complementarity(expr=complements(model.x >= 0, 2 * model.x >= 3))
    >>> results = SolverFactory("icpmodel").solve(model)
    >>> results.termination_condition.name, model.x.value
    ('convergenceCriteriaSatisfied', 1.5)
    """

    CONFIG = SolverConfig()
    #: the code that loads the best iterate of a failed run
    _best = "results.solution_loader.load_vars()"

    def available(self) -> Availability:
        return Availability.FullLicense

    def version(self) -> tuple[int, ...]:
        return tuple(int(part) for part in _VERSION.split(".") if part.isdigit())

    def solve(self, model: Any, **kwds: Any) -> Results:
        """Solve a model and load the solution.

        Parameters
        ----------
        model : ConcreteModel
            A model that `read_pyomo` takes.
        **kwds
            Options of Pyomo's solvers.

        Returns
        -------
        Results
            Pyomo's results.

        Raises
        ------
        InputError
            For another model, or an option that does not apply.
        NoOptimalSolutionError
            Where the run failed; nothing is loaded.
        NoFeasibleSolutionError
            Where the run failed, `load_solutions` is True and `raise_exception_on_nonoptimal_result` is
            False. If both are False, the best iterate is in `results.solution_loader`.
        """
        start_time = time.perf_counter()
        results = Results()
        results.timing_info.start_timestamp = datetime.datetime.now(datetime.UTC)
        results.solver_name, results.solver_version = self.name, self.version()
        config = results.solver_config = self.config(value=kwds, preserve_implicit=True)
        options = config.solver_options.value()
        for name, pyomos in _PYOMO_NAMES.items():
            if name in options:
                raise InputError(f"the option {name} is given to Pyomo by {pyomos}")
        for name, reason in _IGNORED_OPTIONS.items():
            if config[name] is not None:
                raise InputError(f"{name} = {config[name]!s}: {reason}")
        timer = results.timing_info.timer = config.timer or HierarchicalTimer()
        _say(config.tee, f"icpmodel {_VERSION}")
        timer.start("read")
        reading = read_pyomo(model)
        timer.stop("read")
        _say(config.tee, reading.problem)
        limit = config.time_limit
        used = time.perf_counter() - start_time
        left = math.inf if limit is None else max(limit - used, 0.0)
        timer.start("solve")
        for stream in config.tee:
            options["callback"] = printed_on(stream, options.get("callback"))
        with work.work_limit(left):
            solution = solved(reading, time_limit=limit, **options)
        timer.stop("solve")
        StaleFlagManager.mark_all_as_stale()
        self._fill(results, model, reading, solution)
        _say(config.tee, solution, *([] if results.solver_log == solution.message else [results.solver_log]))
        good = results.solution_status is SolutionStatus.optimal
        results.solution_loader = AnswerLoader(model, reading, solution.z, good)
        if not good:
            self._refuse(results, config)
        elif config.load_solutions:
            results.solution_loader.load_solution()
        results.timing_info.wall_time = time.perf_counter() - start_time
        return results

    def _refuse(self, results: Results, config: Any) -> None:
        """Raise Pyomo's error if there is no solution and the call asks for one."""
        failure = NoOptimalSolutionError if config.raise_exception_on_nonoptimal_result else NoFeasibleSolutionError
        options = [name for name in ("load_solutions", "raise_exception_on_nonoptimal_result") if config[name]]
        if options:
            ask = ", ".join(f"{name}=False" for name in options)
            raise failure(
                f"{results.solver_log}. Nothing is loaded; solve(model, {ask}) returns the results, "
                f"and {self._best} loads the best iterate"
            )

    def _fill(self, results: Results, model: Any, reading: PyomoReading, solution: Solution) -> None:
        """Fill `results`. A point that violates an inequality, or a bound of a variable, is not a solution."""
        results.extra_info.solution, results.extra_info.iteration_count = solution, solution.iterations
        checked = solution
        if solution.status in (Status.SOLVED, Status.PRECISION_LIMIT):
            checked = reading.checked(solution)
        results.termination_condition = _TERMINATIONS[checked.status]
        results.solution_status = _POINTS.get(checked.status, SolutionStatus.infeasible)
        results.solver_log = checked.message
        if checked.status is Status.STAGNATED and checked is not solution:
            results.termination_condition = TerminationCondition.unknown
        elif checked.solved:
            # the constant objective, if there is one; for Pyomo a number here means that there is a solution
            objective = next(model.component_data_objects(Objective, active=True), 0.0)
            results.incumbent_objective = results.objective_bound = value(objective)


def _say(streams: Sequence[TextIO], *lines: object) -> None:
    for stream in streams:  # the text of a solution takes time: it tells whether the solution is unique
        print(*lines, sep="\n", file=stream, flush=True)


def _chosen(pairs: list[tuple[Any, Any]], selected: Sequence[Any] | None) -> Any:
    """The `pairs` of the `selected` components as a ComponentMap; all of them if `selected` is None."""
    values = ComponentMap(pairs)
    return values if selected is None else ComponentMap((component, values[component]) for component in selected)
