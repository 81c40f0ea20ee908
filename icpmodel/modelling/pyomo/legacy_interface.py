"""`pyo.SolverFactory("icpmodel")`: Pyomo's legacy interface to `PyomoSolver`, and the registration of both.

Pyomo's own wrapper of new solvers keeps the options of a call for later calls, reports no counts, and has no access to
the best iterate of a failed run. Here the options of a call apply to that call only, and the results have counts. After
`solve(model, load_solutions=False)` the best iterate is loaded by `model.solutions.load_from(results)`.
"""

from __future__ import annotations

import contextlib
import copy
from typing import Any

from pyomo.contrib.solver.common.base import LegacySolverWrapper
from pyomo.contrib.solver.common.factory import SolverFactory
from pyomo.contrib.solver.common.results import Results, SolutionStatus
from pyomo.core.base import SymbolMap
from pyomo.core.base.label import CNameLabeler
from pyomo.core.base.PyomoModel import ModelSolutions
from pyomo.opt.base.solvers import OptSolver
from pyomo.opt.results.results_ import SolverResults
from pyomo.opt.results.solution import Solution as LegacySolution
from pyomo.opt.results.solution import SolutionStatus as LegacySolutionStatus
from pyomo.opt.results.solver import SolverStatus

from ...errors import FileError, InputError
from .solver_interface import PyomoSolver

_NO_FILES = "icpmodel runs in this process and writes no files; icpmodel.save_problem(read_pyomo(model), file) does"
#: options of Pyomo's solvers that do not apply to this one
_IGNORED_OPTIONS = {
    "keepfiles": _NO_FILES,
    "solnfile": _NO_FILES,
    "solver_io": "icpmodel runs in this process",
    "writer_config": _NO_FILES,
    "suffixes": "declare them on the model, model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT), and rc likewise",
}


class LegacyPyomoSolver(LegacySolverWrapper, PyomoSolver):
    """The solver that `SolverFactory("icpmodel")` of `pyomo.environ` makes; `options` apply to all later solves."""

    _best = "model.solutions.load_from(results)"

    def solve(
        self, model: Any, tee: Any = False, *, logfile: Any = None, warmstart: bool = True, **kwds: Any
    ) -> SolverResults:
        """Solve `model` as `PyomoSolver.solve` does. `logfile` gets what `tee` shows.

        The best iterate of a failed run is in the results only with `load_solutions=False`.
        """
        for name, reason in _IGNORED_OPTIONS.items():
            if kwds.pop(name, None):
                raise InputError(f"{name}: {reason}")
        if not warmstart:
            raise InputError("warmstart=False: every solve starts from the values of the variables; change these")
        if isinstance(kwds.get("options"), str):
            kwds["options"] = OptSolver._options_string_to_dict(kwds["options"])
        # each call has options of its own, and several may run at once
        once = copy.copy(self)
        # an assignment would change the config of all calls
        once.__dict__["config"] = self.config(preserve_implicit=True)
        with contextlib.ExitStack() as stack:
            if logfile is not None:
                streams = tee if isinstance(tee, (list, tuple)) else [tee]
                try:
                    tee = [*streams, stack.enter_context(open(logfile, "w", encoding="utf-8"))]
                except OSError as error:
                    raise FileError(f"logfile {logfile} cannot be written: {error.strerror}") from error
            return super(LegacyPyomoSolver, once).solve(model, tee=tee, **kwds)

    def set_options(self, options: Any) -> None:
        """Set options of all later solves: a mapping, or text as on Pyomo's command line, "method=newton rtol=1e-9"."""
        if isinstance(options, str):
            options = OptSolver._options_string_to_dict(options)
        values = {name: value for name, value in options.items() if value is not None}
        self.config.time_limit = values.pop("timelimit", self.config.time_limit)
        self.options.update(values)

    def warm_start_capable(self) -> bool:
        return True

    def _map_results(self, model: Any, results: Results) -> tuple[SolverResults, LegacySolution]:
        mapped, point = super()._map_results(model, results)
        reading = results.solution_loader.reading
        solution = results.extra_info.solution
        mapped.problem.number_of_constraints = mapped.problem.number_of_variables = len(reading.variables)
        mapped.problem.number_of_nonzeros = reading.problem.A.nnz
        mapped.problem.number_of_solutions = results.solution_loader.get_number_of_solutions()
        mapped.solver.name, mapped.solver.time = self.name, solution.seconds
        mapped.solver.message, mapped.solver.termination_message = results.solver_log, solution.status.value
        if results.solution_status is not SolutionStatus.optimal:
            # with "error" or "unknown" Pyomo would load nothing even if it is asked to
            if mapped.solver.status is not SolverStatus.aborted:
                mapped.solver.status = SolverStatus.warning
            point.status = LegacySolutionStatus.bestSoFar
        return mapped, point

    def _solution_handler(
        self, load_solutions: bool, model: Any, results: Results, mapped: SolverResults, point: LegacySolution
    ) -> SolverResults:
        """Put the solution into the results if it is not loaded into the model, as Pyomo's older solvers do.

        The model records that it has a solution. So `pyomo solve` writes the values into its file.
        """
        mapped._smap_id = None
        symbols = SymbolMap()
        label = CNameLabeler()
        loader = results.solution_loader
        if load_solutions:
            solutions = getattr(model, "solutions", None)
            if isinstance(solutions, ModelSolutions):  # a block has none
                solutions.clear()
                solutions.add_symbol_map(symbols)
                solutions.add_solution(point, id(symbols))
        else:
            for variable, value in loader.get_vars().items():
                point.variable[symbols.getSymbol(variable, label)] = {"Value": value}
            for variable, value in loader.get_reduced_costs().items():
                point.variable[symbols.getSymbol(variable, label)]["Rc"] = value
            for condition, value in loader.get_duals().items():
                point.constraint[symbols.getSymbol(condition, label)] = {"Dual": value}
            mapped.solution.insert(point)
            mapped._smap, mapped._smap_id = symbols, id(symbols)
        mapped.timing_info, mapped.extra_info = results.timing_info.value(), results.extra_info.value()
        return mapped


_registered = SolverFactory.register("icpmodel", doc="Implicit complementarity problems by modulus-based methods")
_registered(PyomoSolver, LegacyPyomoSolver)


def pyomo_solver(**options: Any) -> LegacyPyomoSolver:
    """icpmodel as a solver for Pyomo models with `Complementarity` components: `pyo.SolverFactory("icpmodel")`.

    A call of this function, or `import icpmodel.modelling.pyomo`, registers icpmodel with Pyomo. Afterwards
    `SolverFactory("icpmodel")` makes such solvers, also in Pyomo's new interface
    (`pyomo.contrib.solver.common.factory`).

    Parameters
    ----------
    **options
        Options of `icpmodel.solve` for every solve, such as rtol=1e-12 or method="newton";
        `solver.solve(model, options={...})` adds options for one solve.

    Returns
    -------
    LegacyPyomoSolver
        `solver.solve(model)` starts from the values of the variables, loads the solution into the model and returns
        Pyomo's results. `results.extra_info["solution"]` is the `Solution` of this package.

    Notes
    -----
    If the run fails, `solve` loads nothing and raises NoFeasibleSolutionError. With `load_solutions=False`
    the best iterate is in the results, for `model.solutions.load_from(results)`. `timelimit` is in seconds, `tee=True`
    prints the residuals during the run. A suffix `dual` gets p by condition, `rc` by variable. InputError is raised for
    other models, see `read_pyomo`.

    Examples
    --------
    >>> import pyomo.environ as pyo
    >>> from pyomo.mpec import Complementarity, complements
    >>> model = pyo.ConcreteModel()
    >>> model.x = pyo.Var()
    >>> model.c = Complementarity(expr=complements(model.x >= 0, 2 * model.x >= 3))
    >>> results = icp.pyomo_solver().solve(model)
    >>> str(results.solver.termination_condition), model.x.value
    ('optimal', 1.5)
    """
    return LegacyPyomoSolver(options=options)
