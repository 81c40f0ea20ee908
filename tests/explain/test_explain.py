"""The page of `explain()`: right on every scene, and never more than a run keeps."""

import json
import re

import numpy as np
import pytest
import scipy.sparse as sp
from benchmarks.families import expander
from known_answers import PAIR

import icpmodel as icp
from icpmodel import scenes
from icpmodel.explain.explanation import MAX_NANOSECONDS, MAX_PRODUCTS, explain
from icpmodel.explain.forecasts import forecasts_of
from icpmodel.numerics import work
from icpmodel.theory.answers import Allowance
from icpmodel.theory.convergence.theorems import check_all
from icpmodel.theory.matrices.classes import MatrixClasses

SIZES = {name: {"dividend": 31}.get(name, 49) for name in scenes.names() if "n" in scenes.parameters(name)}


def built(name):
    return scenes.scene(name, SIZES.get(name)).problem


#: every third scene in the short run
NAMES = [pytest.param(name, marks=[pytest.mark.slow] if k % 3 else []) for k, name in enumerate(scenes.names())]


@pytest.fixture(scope="module", params=NAMES)
def page(request):
    return built(request.param).explain()


def test_every_section_of_every_scene_says_something(page):
    assert all(page.sections().values())
    assert not re.search(r"\bnan\b", str(page))
    told = json.loads(json.dumps(page.about()))
    assert told["n"] == page.problem.n
    assert len(told["methods"]) == len(page.forecasts)
    steps = [one.steps for one in page.forecasts if one.steps is not None]
    assert page.recommended is None or not steps or page.recommended.steps == min(steps)


#: the theorems speak of exact arithmetic; with entries of 1e±150, or a rate of 1 − 1e-12, there is none
BEYOND_ROUNDING = ("hard-overflow", "hard-scaled", "hard-singular")
#: what a method is proved to converge to is no solution where the obstacles cross there
NO_THEOREM = (*BEYOND_ROUNDING, "hard-crossing")


def test_no_method_is_slower_than_the_page_says(page, request):
    """Law of the predicted rate: after `steps` steps from 0 the error is at most the accuracy."""
    if request.node.callspec.params["page"] in NO_THEOREM:
        return
    problem, checked = page.problem, 0
    exact = None
    for forecast in page.forecasts:
        if forecast.steps is None or forecast.steps > 3000:
            continue
        if exact is None:
            exact = problem.solve(rtol=1e-13, raise_on_failure=False).polish()
        path = forecast.method.iterates(problem, np.zeros(problem.n))
        for _ in range(forecast.steps + 1):
            z, _hint = next(path)
        assert np.abs(z - exact.z).max() <= page.accuracy + exact.error_bound
        checked += 1
    assert checked or page.recommended is None or page.recommended.steps > 3000


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("hand-cyclic", {"p": True, "h_plus": False, "definite": False, "z": False}),
        ("membrane", {"m": True, "symmetric": True, "definite": True, "dominant": False, "reducible": False}),
        ("bai-nonsymmetric", {"m": True, "symmetric": False, "dominant": True, "p": True}),
        ("hand-free", {"triangular": True, "reducible": True}),
        ("dividend", {"m": True, "banded": True, "symmetric": False}),
    ],
)
def test_the_classes_are_the_known_ones(name, facts):
    classes = built(name).explain().classes
    assert {key: getattr(classes, key).holds for key in facts} == facts


@pytest.mark.parametrize("name", ["membrane", "bai-nonsymmetric", "manufactured-elementwise"])
@pytest.mark.parametrize("n", [16, 900])
def test_the_method_that_solve_begins_with_is_named_with_its_reason(name, n):
    problem = scenes.scene(name, n=n).problem
    page, begun = problem.explain(), problem.solve(max_iter=1, raise_on_failure=False)
    assert repr(page.first_method) == repr(begun.last_method)
    assert begun.why.startswith(page.why)
    assert page.about()["what_to_do"][0] == f"call solve(); it will run {begun.last_method!r} first: {page.why}"


def test_one_method_can_be_asked_for():
    problem = scenes.membrane(n=25).problem
    for page in (problem.explain("mnmsor", theta1=0.9), problem.explain(icp.MNMSOR(theta1=0.9))):
        assert [forecast.title for forecast in page.forecasts] == ["MNMSOR(theta1=0.9)"]
    assert [one.title for one in scenes.hand_splittings().problem.explain().forecasts if one.factor] == [
        "MNMJ(), Omega = D",
        "PSOR(), newest values",
    ]


@pytest.mark.parametrize(
    ("method", "options", "words"),
    [
        ("mms", {}, "modulus family only"),
        (icp.MNMGS, {}, "method is the class MNMGS"),
        (None, {"theta1": 0.9}, "explain has no option theta1; it takes method, accuracy, thorough"),
        (icp.MNMSOR(), {"theta1": 0.9}, "explain has no option theta1; it takes method, accuracy, thorough"),
        (None, {"thorough": "yes"}, "thorough"),
        *((None, {"accuracy": bad}, "accuracy is") for bad in (0.0, -1.0, np.nan, np.inf, "x", None, True, [1.0, 2.0])),
    ],
)
def test_wrong_arguments_are_named(method, options, words):
    with pytest.raises(icp.InputError, match=words):
        icp.ICP([[2.0]], [-1.0]).explain(method, **options)


def test_what_solve_begins_with_is_proved_and_its_steps_are_counted():
    page = scenes.bai_symmetric(n=400).problem.explain()
    row = next(forecast for forecast in page.forecasts if forecast.title == "PSOR(), newest values")
    assert isinstance(page.first_method, icp.PSOR)
    assert row.proved_by == ["rowwise"]
    assert row.factor < min(forecast.factor for forecast in page.forecasts if "MNM" in forecast.title)
    assert row.steps > 0


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (icp.ICP([[2.0]], [-1.0], np.sin), "give psi's Lipschitz matrix"),
        (icp.ICP(2 * np.eye(13), -np.ones(13), icp.Affine(3 * np.eye(13))), "psi moves too much"),
        (
            icp.ICP(np.kron(np.eye(7), PAIR), np.ones(14), icp.Affine(np.kron(np.eye(7), [[0, 3], [1, 0]]))),
            "with the obstacle frozen",
        ),
        (icp.ICP(-np.eye(13), -np.ones(13)), "no P-matrix: there may be no solution, or many"),
        (scenes.hand_cyclic().problem, "sweeps may cycle: try newton"),
        (
            icp.ICP(np.kron(np.eye(7), [[1, -1], [-1, 1]]), np.ones(14)),
            "A is positive semidefinite: if some z has p >= 0",
        ),
        (
            icp.ICP(np.kron(np.eye(7), [[0, -1], [1, 0]]), np.ones(14)),
            "A is positive semidefinite: if some z has p >= 0",
        ),
    ],
)
def test_where_nothing_is_proved_there_is_advice(problem, words):
    page = problem.explain()
    assert page.recommended is None
    assert words in page.sections()["what to do"]


@pytest.mark.parametrize("size", [1e-310, 8e307])
def test_data_at_the_edge_of_the_floats_has_a_page(size):
    G = icp.Affine([[0.0, size / 2, size / 2, size / 2], *np.zeros((3, 4))])
    for psi in (0.0, G):
        page = icp.ICP(np.diag([size, 1.0, 1.0, 1.0]), np.ones(4), psi).explain()
        assert all(page.sections().values())


def test_monotone_convergence_is_advised_only_where_its_theorem_holds():
    jumps = icp.Intervention(sp.csr_array([[0.0, -1.0], [-1.0, 0.0]]))
    for coupling, words in ((-1.0, "converges monotonically"), (1.0, "A is no Z-matrix")):
        page = icp.ICP([[1.0, coupling], [coupling, 1.0]], [-1.0, 1.0], jumps).explain()
        assert words in page.sections()["what to do"]
        assert page.forecasts[0].checks["monotone"].holds == (coupling < 0)


def test_what_is_said_to_be_at_most_is_rounded_upwards(page):
    """The factor on the page is never below the proved one, and never 1."""
    for forecast in page.forecasts:
        if forecast.factor is not None:
            row = next(line for line in page.sections()["methods"].splitlines() if line.startswith(forecast.title))
            assert 1 > float(row.split()[-2]) >= forecast.factor
    best = page.recommended
    if best is not None:
        told = re.search("at most (.*) of the error", page.sections()["best proved"]).group(1)
        assert 1 > float(told) >= best.factor


def test_rounding_noise_decides_nothing():
    """On the coulomb scene several factors are zero but for rounding: the simplest method is taken."""
    page = scenes.coulomb().problem.explain()
    factors = {forecast.title: forecast.factor for forecast in page.forecasts}
    assert factors["MNMAOR(theta2=2), Omega = D"] < factors["MNMJ(), Omega = D"] < 1e-12
    assert page.recommended.title == "MNMJ(), Omega = D"


def test_an_accuracy_below_rounding_is_remarked():
    problem = icp.ICP(PAIR, [-2, -2])
    assert "the accuracy 1e-30 may be out of reach" in problem.explain(accuracy=1e-30).sections()["what to do"]
    assert "out of reach" not in problem.explain().sections()["what to do"]
    assert "out of reach" not in icp.ICP([[2.0]], [1e-40]).explain(accuracy=1e-30).sections()["what to do"]


def test_a_page_costs_no_more_than_so_many_products_and_says_what_it_left_open():
    """Law 12: factors of a random graph are foreseen to be dense, and nothing is factorised that cannot be paid."""
    problem = expander(1500)
    before = work.counter()
    page = problem.explain()
    told = str(page)
    unit = problem.matrix.product_cost
    assert work.counter() - before < 1.2 * (MAX_PRODUCTS * unit + MAX_NANOSECONDS)
    assert "not decided within" in told
    assert "thorough=True" in told
    assert page.bound.unique
    left = next(one for one in page.forecasts if one.undecided)
    assert all(left.checks[name].holds is None for name in left.undecided)
    assert left.theorems == "not decided" or left.proved_by


def test_a_page_is_the_same_whenever_it_is_asked_for():
    """Law 6: what is left open goes by counted work, not by a clock."""
    assert str(expander(900).explain("mnmmod")) == str(expander(900).explain("mnmmod"))


def test_a_thorough_page_leaves_nothing_open_for_want_of_work():
    problem = expander(1200)
    assert "not decided" not in str(explain(problem, "mnmod", thorough=True))


def test_what_overflows_in_an_eigenvalue_iteration_is_no_foreign_exception_and_prints_nothing(capfd):
    """Neither LAPACK's complaints about infinities nor its exceptions leave the package."""
    assert "solution" in str(built("hard-scaled").explain())
    assert capfd.readouterr() == ("", "")


class Full(Allowance):
    """Where the system itself has no more memory, which nobody foresaw."""

    def enforced(self):
        raise MemoryError("Unable to allocate 8. TiB")


def test_a_memory_error_that_nobody_foresaw_leaves_a_question_open():
    """Law 12: it is no exception of the package's own, and escapes no more than those are allowed to."""
    problem, limit = icp.ICP([[2.0]], [-2.0]), Full(1.0, 1.0)
    assert MatrixClasses(problem.A).decided(limit).m.reason == "not decided: Unable to allocate 8. TiB"
    assert {one.holds for one in check_all(problem, icp.MNMJ(), limit).values()} == {None}
    assert next(forecasts_of(problem, {"mnmj": icp.MNMJ()}, 1e-6, limit)).rate is None


def test_two_obstacles_are_named_and_said_to_cross_or_not():
    A, q, G = [[4.0, -1.0], [-1.0, 4.0]], [1.0, -9.0], [[0.0, 0.3], [0.1, 0.0]]
    box = icp.ICP(A, q, -1.0, upper=[1.0, np.inf]).explain()
    alike = icp.ICP(A, q, icp.Affine(G, -1.0), upper=icp.Affine(G, 0.5)).explain()
    own = icp.ICP(A, q, icp.Affine(G, -1.0), upper=icp.Affine(-np.array(G), -0.8)).explain()
    assert "map psi" not in box.sections()
    assert box.sections()["obstacles"].endswith("neither moves: a problem with bounds on both sides")
    assert alike.sections()["obstacles"].endswith("they never cross")
    assert own.sections()["obstacles"].endswith("they may cross")
    assert [page.bound.unique for page in (box, alike, own)] == [True, True, False]
    assert "psi <= upper is not proved" in own.sections()["solution"]
    crossing = "the obstacles may cross for some z"
    assert [crossing in page.sections()["methods"] for page in (box, alike, own)] == [False, False, True]


BLOCKS_WITHOUT_SOLUTION = icp.ICP(sp.block_diag([[[1.0, -3.0], [-2.0, 1.0]], 2 * np.eye(6)]), -np.ones(8))


@pytest.mark.parametrize(
    ("problem", "sentence", "unique"),
    [
        (icp.ICP([[1.0, 2.0], [3.0, 1.0]], [1.0, 1.0]), "exists, and is the only one: one solution was found", True),
        (icp.ICP([[0.0, 1.0], [-1.0, 0.0]], [-2.0, -1.0]), "there is no solution: all 4 linear pieces", False),
        (BLOCKS_WITHOUT_SOLUTION, "there is no solution: all 256 linear pieces", False),
        (icp.ICP([[-1.0]], [-0.25], -1.0, 1.0), "there are two solutions or more: (-0.25) and (-1)", False),
    ],
)
def test_what_all_linear_pieces_decide_is_said_once(problem, sentence, unique):
    page = problem.explain()
    assert page.sections()["solution"].startswith(sentence)
    assert page.about()["unique"] is unique
    text = str(page)
    assert text.count("there is no solution:") + text.count("there are two solutions or more:") == (not unique)
    assert "there may be no solution" not in text
    assert "perhaps one of many" not in text


@pytest.mark.parametrize(
    ("name", "row", "words"),
    [
        ("hard-infeasible", 0, "no solution exists: change A, q or psi"),
        ("hard-three", 1, "there are several solutions: all_solutions() lists them, and other starts z0"),
        ("hard-many", 1, "there are several solutions"),
    ],
)
def test_how_many_solutions_are_proved_decides_what_to_do(name, row, words):
    assert built(name).explain().about()["what_to_do"][row].startswith(words)


def test_a_solution_in_a_box_exists_where_f_is_continuous():
    """1/z on [-1, 1] has a pole, and no solution."""
    pole = icp.ICP.nonlinear(lambda z: 1 / z, n=1, psi=-1.0, upper=1.0).explain()
    assert "given that f is continuous there" in pole.sections()["solution"]
    affine = icp.ICP(np.zeros((12, 12)), np.zeros(12), -1.0, upper=1.0).explain()
    assert "exists, as every row" in affine.sections()["solution"]
    assert "continuous" not in affine.sections()["solution"]
