"""`SolverFactory("icpmodel")` as Pyomo knows solvers: both interfaces, statuses, suffixes, starts, entry points."""

import json
import threading
import tomllib

import numpy as np
import pyomo.environ as pyo
import pytest
from installed import HOUSE, announce, run
from pyomo.contrib.solver.common.factory import SolverFactory as NewFactory
from pyomo.contrib.solver.common.results import SolutionStatus, TerminationCondition
from pyomo.contrib.solver.common.util import NoFeasibleSolutionError, NoOptimalSolutionError
from pyomo.mpec import Complementarity, complements
from pyomo_models import random_problem, violation, written

import icpmodel as icp
from icpmodel.modelling.pyomo import read_pyomo

NEW = NewFactory("icpmodel")


def old(model, **options):
    """The legacy interface, whose objects remember their options."""
    return pyo.SolverFactory("icpmodel").solve(model, **options)


def pair(**bounds):
    """x - y/2 >= 1 and y - x/4 >= 0, with forces 4x - y - 2 and 2y - x + 3: z = (8/7, 2/7)."""
    model = pyo.ConcreteModel()
    model.x, model.y = pyo.Var(**bounds), pyo.Var()
    model.c = Complementarity(expr=complements(model.x - model.y / 2 >= 1, 4 * model.x - model.y >= 2))
    model.d = Complementarity(expr=complements(model.y - model.x / 4 >= 0, 2 * model.y - model.x + 3 >= 0))
    return model


@pytest.mark.parametrize("kind", ["constant", "affine", "nonlinear"])
@pytest.mark.parametrize("seed", range(4))
def test_both_interfaces_load_an_answer_that_holds(kind, seed):
    random = np.random.default_rng([seed, 7])
    problem, G = random_problem(random, 9, kind)
    model = written(problem, G, random, kind)
    results = old(model)
    assert violation(model) <= 1e-6
    pyo.assert_optimal_termination(results)
    values = [variable.value for variable in model.part[0].inner.x.values()]
    for variable in model.part[0].inner.x.values():
        variable.set_value(None)
    results = NEW.solve(model)
    assert results.termination_condition is TerminationCondition.convergenceCriteriaSatisfied
    assert results.solution_status is SolutionStatus.optimal
    assert [variable.value for variable in model.part[0].inner.x.values()] == values
    assert results.extra_info.solution.z.tolist() == values
    assert values == pytest.approx(problem.solve(rtol=1e-10).z.tolist(), abs=1e-6)
    assert not any(variable.stale for variable in model.part[0].inner.x.values())


@pytest.mark.slow
def test_one_import_registers_the_solver_and_none_is_needed_on_pyomos_own_command_line(tmp_path):
    """The entry point of pyproject.toml is what Pyomo's command line loads."""
    (tmp_path / "model.py").write_text(
        "import pyomo.environ as pyo\n"
        "from pyomo.mpec import Complementarity, complements\n"
        "model = pyo.ConcreteModel()\n"
        "model.x = pyo.Var()\n"
        "model.c = Complementarity(expr=complements(model.x >= 0, 2 * model.x >= 3))\n"
    )
    declared = tomllib.loads((HOUSE / "pyproject.toml").read_text())["project"]["entry-points"]
    announce(tmp_path, "icpmodel", declared)
    script = (
        "from pyomo.scripting.pyomo_main import main\n"
        "main(['solve', '--solver=icpmodel', '--save-results=results.json', 'model.py'])\n"
    )
    by_pyomo = run("-c", script, folder=tmp_path)
    assert by_pyomo.returncode == 0, by_pyomo.stderr
    told = json.loads((tmp_path / "results.json").read_text())
    assert told["Solver"][0]["Termination condition"] == "optimal"
    assert told["Solution"][1]["Variable"] == {"x": {"Value": 1.5}}
    for first in ("import icpmodel.modelling.pyomo", "import icpmodel; icpmodel.pyomo_solver()"):
        script = (
            f"{first}; import pyomo.environ as pyo\n"
            "from model import model\n"
            "pyo.SolverFactory('icpmodel').solve(model); print(model.x.value)"
        )
        assert run("-c", script, folder=tmp_path).stdout == "1.5\n"


def test_options_reach_the_solve_and_wrong_ones_are_answered():
    model = pair()
    results = NEW.solve(model, solver_options={"method": "mnmsor", "theta1": 1.1, "rtol": 1e-12})
    solution = results.extra_info.solution
    assert repr(solution.method) == "MNMSOR(theta1=1.1)"
    assert solution.tolerance == 1e-12 * solution.problem.residual([0.0, 0.0])
    results = old(model, options={"method": "newton"})
    assert results.solver.termination_condition == pyo.TerminationCondition.optimal
    with pytest.raises(icp.InputError, match="mnmgs has no option theta1"):
        pyo.SolverFactory("icpmodel", options={"method": "mnmgs", "theta1": 2.0}).solve(model)
    for name in ("time_limit", "timelimit"):
        with pytest.raises(icp.InputError, match=f"{name} is given to Pyomo by the keyword timelimit"):
            old(model, options={name: 1.0})


def test_a_run_that_is_out_of_time_names_the_limit_of_the_call_not_the_rest_after_reading():
    quiet = {"raise_exception_on_nonoptimal_result": False, "load_solutions": False}
    results = NEW.solve(pair(), time_limit=1e-6, **quiet)
    assert results.termination_condition is TerminationCondition.maxTimeLimit
    assert "time_limit = 1e-06 s" in results.extra_info.solution.message


TOO_FEW = {"method": "mnmgs", "max_iter": 3}
FAILED = {
    "no solution": (NEW.solve, {}, NoOptimalSolutionError, "raise_exception_on_nonoptimal_result=False"),
    "nothing to load": (
        NEW.solve,
        {"raise_exception_on_nonoptimal_result": False},
        NoFeasibleSolutionError,
        "load_solutions=False",
    ),
    "legacy": (old, {}, NoFeasibleSolutionError, "load_solutions=False"),
    "legacy, asked to raise": (
        old,
        {"load_solutions": False, "raise_exception_on_nonoptimal_result": True},
        NoOptimalSolutionError,
        "raise_exception_on_nonoptimal_result=False",
    ),
}


@pytest.mark.parametrize("name", FAILED)
def test_a_failed_solve_loads_nothing_and_says_how_to_get_the_best_iterate(name):
    """As Pyomo's interfaces to HiGHS do it, with the same exceptions."""
    solve, keywords, error, words = FAILED[name]
    model = icp.scenes.membrane(n=100).problem.to_pyomo()
    model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    model.z[0].set_value(0.25)
    with pytest.raises(error, match=f"iteration limit: max_iter = 3.*Nothing is loaded; solve.model, .*{words}"):
        solve(model, solver_options=TOO_FEW, **keywords)
    assert (model.z[0].value, model.z[1].value, len(model.dual)) == (0.25, None, 0)
    assert model.z[0].stale


def test_what_is_proved_infeasible_is_said_to_be():
    model = pyo.ConcreteModel()
    model.x = pyo.Var()
    model.balance = Complementarity([3], rule=lambda m, i: complements(m.x >= 0, -m.x - 1 >= 0))
    results = old(model, load_solutions=False)
    assert results.solver.message.startswith("infeasible by 1: balance[3]: ")
    assert "balance[3]" in str(results.extra_info["solution"].contradiction)
    assert results.solver.termination_condition == pyo.TerminationCondition.infeasible
    results = NEW.solve(model, raise_exception_on_nonoptimal_result=False, load_solutions=False)
    assert results.termination_condition is TerminationCondition.provenInfeasible


@pytest.mark.parametrize("unique", [True, False])
def test_a_bound_of_a_variable_that_no_condition_implies_is_looked_at_afterwards(unique):
    """No answer of the conditions has x >= 2: no success, and infeasible only if one answer is proved to be all."""
    model = pair(bounds=(2, None))
    if not unique:  # three answers: (1, 0), (0, 1) and (1/3, 1/3)
        model.c.deactivate()
        model.d.deactivate()
        model.e = Complementarity(expr=complements(model.y >= 0, 2 * model.x + model.y >= 1))
        model.f = Complementarity(expr=complements(model.x >= 0, model.x + 2 * model.y >= 1))
    results = NEW.solve(model, raise_exception_on_nonoptimal_result=False, load_solutions=False)
    assert results.solution_status is SolutionStatus.infeasible
    assert results.incumbent_objective is None
    assert results.solution_loader.get_number_of_solutions() == 0
    assert "x >= 2 is violated by" in results.solver_log
    assert results.extra_info.solution.certificate.unique == unique
    expected = TerminationCondition.provenInfeasible if unique else TerminationCondition.unknown
    assert results.termination_condition is expected
    with pytest.raises(NoOptimalSolutionError, match="is violated by"):
        NEW.solve(model)
    pyo.assert_optimal_termination(old(pair(within=pyo.NonNegativeReals)))
    unsolved = old(pair(bounds=(2, None)), options={"method": "mnmgs", "max_iter": 0}, load_solutions=False)
    assert unsolved.solver.termination_condition == pyo.TerminationCondition.maxIterations


@pytest.mark.parametrize(
    ("inequality", "holds"),
    [(lambda m: m.x + m.y <= 9, True), (lambda m: m.x + m.y >= 9, False), (lambda m: (-9, m.x - m.y, 9), True)],
)
def test_an_inequality_is_checked_at_the_answer(inequality, holds):
    """As in CVXPY: it determines nothing, and an answer that violates it is none."""
    model = pair()
    model.extra = pyo.Constraint(expr=inequality(model))
    results = NEW.solve(model, raise_exception_on_nonoptimal_result=False, load_solutions=False)
    assert (results.solution_status is SolutionStatus.optimal) is holds
    if not holds:
        assert results.termination_condition is TerminationCondition.provenInfeasible
        assert "extra is violated by" in results.solver_log


@pytest.mark.parametrize("row", [lambda f, x: f, lambda f, x: -2 * f, lambda f, x: f / (1 + x**2)])
@pytest.mark.parametrize("rtol", [1e-8, 1e-14])
def test_terms_that_cancel_at_the_answer_are_small_beside_their_own_sizes(row, rtol):
    model = pyo.ConcreteModel()
    model.x = pyo.Var(initialize=1.0)
    model.balance = pyo.Constraint(expr=row(pyo.exp(model.x) - 3 * model.x**2, model.x) == 0)
    pyo.assert_optimal_termination(old(model, options={"rtol": rtol}))
    assert model.x.value == pytest.approx(0.91000757248871)


def test_the_values_are_the_start():
    """From the answer itself nothing is left to do; variables without value start at 0."""
    model = icp.scenes.membrane(n=100).problem.to_pyomo()
    first = NEW.solve(model, solver_options={"method": "mnmgs"})
    again = NEW.solve(model, solver_options={"method": "mnmgs"})
    assert first.extra_info.solution.iterations > 0
    assert again.extra_info.solution.iterations == 0
    model = pair()
    model.y.set_value(-3.0)
    assert read_pyomo(model).start().tolist() == [0.0, -3.0]


def test_declared_suffixes_get_the_forces():
    """`dual` has p by condition, `rc` the marginal by variable, negative at an upper bound; nothing is made unasked."""
    model = pyo.ConcreteModel()
    model.x = pyo.Var(range(4))
    model.low = Complementarity(expr=complements(model.x[0] >= 1, 2 * model.x[0] >= 1))
    model.high = Complementarity(expr=complements(model.x[1] <= 1, 2 * model.x[1] <= 5))
    model.both = Complementarity(expr=complements(pyo.inequality(-1, model.x[2], 1), 2 * model.x[2] + model.x[0] - 7))
    model.free = Complementarity(expr=complements(model.x[3], model.x[3] + model.x[2] == 3))
    NEW.solve(model)
    assert not list(model.component_objects(pyo.Suffix))
    model.dual = pyo.Suffix(direction=pyo.Suffix.IMPORT)
    model.rc = pyo.Suffix(direction=pyo.Suffix.IMPORT_EXPORT)
    model.rc[model.x[0]] = 17.0
    for solve in (old, NEW.solve):
        solve(model, solver_options={"rtol": 1e-12})
        assert [model.dual[one] for one in (model.low, model.high, model.both)] == pytest.approx([1, 3, -4])
        assert [model.rc[model.x[i]] for i in range(3)] == pytest.approx([1, -3, -4])
        assert model.free not in model.dual
        assert model.x[3] not in model.rc


def test_what_has_no_use_here_is_refused_with_a_sentence(tmp_path):
    model = pair()
    for keyword in ("keepfiles", "solnfile", "solver_io", "suffixes", "writer_config"):
        with pytest.raises(icp.InputError, match=f"{keyword}: "):
            old(model, **{keyword: "some"})
    for keyword, value in {"threads": 2, "working_dir": str(tmp_path)}.items():
        with pytest.raises(icp.InputError, match=f"{keyword} = "):
            NEW.solve(model, **{keyword: value})
    with pytest.raises(icp.InputError, match="warmstart=False: every solve starts from the values"):
        old(model, warmstart=False)
    solver = pyo.SolverFactory("icpmodel")
    assert solver.warm_start_capable()
    pyo.assert_optimal_termination(
        solver.solve(model, warmstart=True, keepfiles=False, suffixes=None, symbolic_solver_labels=True)
    )


def test_the_options_of_a_call_end_with_it_where_another_call_outlasts_it():
    solver = icp.pyomo_solver()
    has_begun, may_end = threading.Event(), threading.Event()

    def longer(progress):
        has_begun.set()
        may_end.wait(60)

    options = {"method": "mnmgs", "callback": longer}
    thread = threading.Thread(target=solver.solve, args=(pair(),), kwargs={"options": options})

    def begin_another(progress):
        if not has_begun.is_set():
            thread.start()
            has_begun.wait(60)

    options = {"method": "mnmgs", "max_iter": 1, "callback": begin_another}
    solver.solve(pair(), options=options, timelimit=77, load_solutions=False)
    may_end.set()
    thread.join()
    assert not dict(solver.options)
    assert (solver.config.time_limit, solver.config.load_solutions) == (None, True)


def test_a_block_is_solved_alone():
    model = pyo.ConcreteModel()
    model.one, model.other = pyo.Block(), pyo.Block()
    for block in (model.one, model.other):
        block.x = pyo.Var()
        block.c = Complementarity(expr=complements(block.x >= 0, block.x >= 3))
    old(model.one)
    assert (model.one.x.value, model.other.x.value) == (3.0, None)
    model.one.deactivate()
    old(model)
    assert model.other.x.value == 3.0


def solved_by_old(model):
    old(model, options={"rtol": 1e-12})
    assert violation(model) <= 1e-9
    return np.array([variable.value for variable in model.z.values()])


@pytest.mark.parametrize("name", ["hand-lcp", "hand-free", "hand-affine", "hand-negative", "coulomb", "membrane"])
def test_a_round_trip_gives_the_same_problem_or_at_least_the_same_answer(name):
    """ICP -> Pyomo -> ICP: A, q and psi come back where every r has fewer variables than p; the answer always."""
    one = icp.scenes.scene(name) if name != "membrane" else icp.scenes.scene(name, 100)
    problem = one.problem
    model = problem.to_pyomo()
    back = read_pyomo(model).problem
    if name in ("hand-lcp", "membrane"):
        order = [variable.index() for variable in read_pyomo(model).variables]
        assert abs(back.A - problem.A[order][:, order]).max() == 0
        assert back.q.tolist() == problem.q[order].tolist()
        assert back.psi.c.tolist() == problem.psi.c[order].tolist()
    z = solved_by_old(model)
    assert problem.residual(z) <= 1e-9
    if icp.certify(problem, z).unique:
        assert np.abs(z - problem.solve(rtol=1e-12).z).max() <= 1e-8


MIX = np.array([[0.0, 0.2, 0.0], [0.1, 0.0, 0.0], [0.0, 0.0, -0.3]])
CODE = {
    "sine": lambda z: 0.3 * np.sin(z),
    "reversed": lambda z: 0.2 * z[::-1] ** 2 - 1,
    "product": lambda z: MIX @ np.arctan(z),
    "mean": lambda z: np.full(3, z.mean() / 5),
    "roots": lambda z: 0.1 * np.sqrt(np.square(z) + 1) / (2 + abs(z)),
    "power": lambda z: np.power(2.0, -z) / (1 - np.float64(3.0)),
    "free": lambda z: [0.1 * z[1] - z[0], -np.inf, 2.0],
    "elementwise": icp.Elementwise(lambda z: 0.1 * np.exp(-z), c=[1, -np.inf, 2]),
}
NO_EXPRESSION = {
    "maximum": (lambda z: np.maximum(z, 0) / 3, "not supported between"),
    "one point": (lambda z: np.where(z == 1, 5.0, z**2), "its code compares z"),
    "a truth value": (lambda z: np.where(z.astype(bool), z, 0.0), "its code has a branch"),
    "number": (lambda z: z * float(z[0]) / 10, "float"),
    "random": (lambda z: 0.1 * z + np.random.default_rng().random(3), "and its expression"),
    "intervention": (icp.scenes.scene("dividend").problem, "it takes the best of several"),
}


@pytest.mark.parametrize("name", CODE)
def test_python_code_is_written_as_expressions(name):
    """The code is run on symbols: the model reads back with the same r, up to a factor, and with the
    derivative of that."""
    problem = icp.ICP(4 * np.eye(3) - 1, [-1.0, 2.0, -3.0], CODE[name])
    model = problem.to_pyomo()
    assert [variable.value for variable in model.z.values()] == [None] * 3  # as it was before the comparison
    reading = read_pyomo(model)
    order = [variable.index() for variable in reading.variables]
    for z in np.random.default_rng(0).uniform(-2, 2, (5, 3)):
        r = reading.problem.r(z[order])
        assert r * reading.ordered.r.Z.diagonal() == pytest.approx(problem.r(z)[order], abs=1e-14)
        held = np.isfinite(r)
        slope = reading.problem.psi.jacobian(z[order]).toarray()[held]
        for j, step in enumerate(np.diag([1e-6] * 3)):
            ahead, behind = (reading.problem.psi.value(z[order] + turn * step)[held] for turn in (1, -1))
            assert slope[:, j] == pytest.approx((ahead - behind) / 2e-6, abs=1e-8)


@pytest.mark.parametrize("name", ["sine", "product", "elementwise"])
def test_nonlinear_p_is_written_as_expressions(name):
    f = CODE[name] if name != "elementwise" else icp.Elementwise(np.exp)
    problem = icp.ICP(4 * np.eye(3) - 1, [-1.0, 2.0, -3.0], [0.0, 1.0, -np.inf], upper=[2.0, np.inf, np.inf], f=f)
    z = solved_by_old(problem.to_pyomo())
    assert np.abs(z - problem.solve(rtol=1e-12).z).max() <= 1e-8


@pytest.mark.parametrize("name", NO_EXPRESSION)
def test_code_with_branches_or_chance_has_no_expression(name):
    psi, words = NO_EXPRESSION[name]
    problem = psi if isinstance(psi, icp.ICP) else icp.ICP(np.eye(3), np.ones(3), psi)
    with pytest.raises(icp.NotApplicable, match=f"has no Pyomo expression: .*{words}"):
        problem.to_pyomo()


MOVES = np.array([[0, 0.3, 0, 0], [0, 0, 0, 0], [0, 0, 0, 0.2], [0, 0, 0, 0]])
LOW, HIGH = np.array([-1, -np.inf, -0.5, 0.5]), np.array([1, 0.3, np.inf, 0.5])


@pytest.mark.parametrize(
    ("psi", "upper"),
    [
        (LOW, HIGH),
        (icp.Affine(MOVES, LOW), icp.Affine(MOVES, HIGH)),
        (icp.Affine(MOVES, LOW), HIGH),
        (LOW - 0.2, lambda z: HIGH + 0.1 * np.sin(z)),
        (np.full(4, -np.inf), HIGH),
    ],
)
@pytest.mark.parametrize("q", [[9, -9, 1, -2], [-9, -9, -9, 5], [0.5, 3, 9, 1]])
def test_two_obstacles_make_the_round_trip(psi, upper, q):
    """A range where they move alike, two conditions where they do not; obstacles above alone, and the same in a row."""
    A = np.array([[4.0, -1, 0, 1], [-1, 4, -1, 0], [0, -1, 4, -1], [1, 0, -1, 4]])
    problem = icp.ICP(A, q, psi, upper=upper)
    assert problem.residual(solved_by_old(problem.to_pyomo())) <= 1e-9
