"""The page of `explain()`: right on every scene, and never more than a run keeps."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel import scenes
from icpmodel.explain.explanation import _NANOSECONDS, _PRODUCTS, explain
from icpmodel.numerics import work
from icpmodel.theory.answers import Allowance
from icpmodel.theory.matrices.classes import MatrixClasses

SIZES = {name: {"dividend": 31}.get(name, 49) for name in scenes.names() if "n" in scenes.parameters(name)}


def built(name):
    return scenes.scene(name, SIZES.get(name)).problem


@pytest.fixture(scope="module", params=scenes.names())
def page(request):
    return built(request.param).explain()


def test_every_section_of_every_scene_says_something(page):
    sections = page.sections()
    told = "map psi" if page.problem.upper is None else "obstacles"
    assert list(sections) == ["what to do", "problem", "matrix A", told, "solution", "methods", "best proved"]
    assert all(sections.values())
    shown = " ".join(str(page).split())  # long sentences are broken into lines
    for title, text in sections.items():
        assert f"{title} {' '.join(text.split())}" in shown
    assert max(map(len, str(page).splitlines())) <= 116
    assert not re.search(r"\bnan\b", str(page))


def test_the_page_is_plain_data_for_json(page):
    told = json.loads(json.dumps(page.about()))
    assert told["n"] == page.problem.n
    assert len(told["methods"]) == len(page.forecasts)
    assert "<pre" in page._repr_html_()


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


def test_what_is_proved_converges_from_far_away(page, request):
    """A method that the page calls proved is solved from any start."""
    if request.node.callspec.params["page"] in NO_THEOREM:
        return
    problem, random = page.problem, np.random.default_rng(0)
    for forecast in page.forecasts:
        if forecast.proved_by:
            start = 100.0 * random.normal(size=problem.n)
            run = problem.solve(forecast.method, z0=start, rtol=1e-4, max_iter=200_000, raise_on_failure=False)
            assert run.solved, (forecast.title, run.message)


@pytest.mark.parametrize(
    ("name", "facts"),
    [
        ("hand-cyclic", {"p": True, "h_plus": False, "definite": False, "z": False}),
        ("membrane", {"m": True, "symmetric": True, "definite": True, "dominant": False, "reducible": False}),
        ("bai-nonsymmetric", {"m": True, "symmetric": False, "dominant": True, "p": True}),
        ("hand-free", {"triangular": True, "reducible": True}),
        ("bearing", {"banded": True, "m": True}),
        ("dividend", {"m": True, "banded": True, "symmetric": False}),
    ],
)
def test_the_classes_are_the_known_ones(name, facts):
    classes = built(name).explain().classes
    assert {key: getattr(classes, key).holds for key in facts} == facts


@pytest.mark.parametrize("name", ["membrane", "bai-nonsymmetric", "manufactured-elementwise"])
@pytest.mark.parametrize("n", [16, 100, 900])
def test_the_method_that_solve_begins_with_is_named_with_its_reason(name, n):
    problem = scenes.scene(name, n=n).problem
    page, begun = problem.explain(), problem.solve(max_iter=1, raise_on_failure=False)
    assert repr(page.picked) == repr(begun.last_method)
    assert begun.why.startswith(page.why)
    assert (
        page.about()["what_to_do"][0]
        == f"call solve(); it will run {begun.last_method!r} first, because it is {page.why}"
    )


def test_a_page_without_a_first_method_says_why():
    page = replace(icp.ICP([[2.0]], [-1.0]).explain(), picked=None, why="solve() has no method for this problem")
    assert page.sections()["what to do"] == page.why


def test_the_recommended_method_is_proved_to_need_the_fewest_steps():
    page = scenes.bai_symmetric(n=100).problem.explain()
    assert page.recommended.steps == min(forecast.steps for forecast in page.forecasts if forecast.steps is not None)
    assert page.sections()["best proved"].startswith(f"{page.recommended.title}: each step leaves at most")


def test_where_splittings_differ_only_the_right_one_is_proved():
    page = scenes.hand_splittings().problem.explain()
    proved = [forecast.title for forecast in page.forecasts if forecast.factor]
    assert proved == ["MNMJ(), Omega = D", "PSOR(), newest values"]


def test_a_strict_supersolution_makes_the_monotone_theorem_global():
    page = built("dividend").explain()
    assert "strict supersolution" in page.bound.proof
    assert page.forecasts[0].proved_by == ["monotone"]


def test_one_method_can_be_asked_for():
    problem = scenes.membrane(n=25).problem
    for page in (problem.explain("mnmsor", theta1=0.9), problem.explain(icp.MNMSOR(theta1=0.9))):
        assert [forecast.title for forecast in page.forecasts] == ["MNMSOR(theta1=0.9)"]
    with pytest.raises(icp.InputError, match="modulus family only"):
        problem.explain("mms")
    with pytest.raises(icp.InputError, match="accuracy is 0"):
        problem.explain(accuracy=0)


def test_what_solve_begins_with_is_proved_and_its_steps_are_told():
    """The sweeps of projected SOR are a member of the family: with a rate, on the page and by name."""
    problem = scenes.bai_symmetric(n=400).problem
    page = problem.explain()
    row = next(forecast for forecast in page.forecasts if forecast.title == "PSOR(), newest values")
    assert isinstance(page.picked, icp.PSOR)
    assert row.proved_by == ["rowwise", "h-plus"]
    assert row.factor < min(forecast.factor for forecast in page.forecasts if "MNM" in forecast.title)
    assert row.steps > 0
    (asked,) = problem.explain("psor", omega=1.1).forecasts
    assert asked.proved_by == ["rowwise"]
    assert row.factor < asked.factor < 1


@pytest.mark.parametrize(
    ("problem", "words"),
    [
        (icp.ICP([[2.0]], [-1.0], np.sin), "give psi's Lipschitz matrix"),
        (icp.ICP([[2.0]], [-1.0], icp.Affine([[3.0]])), "psi moves too much"),
        (
            icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [-1.0, 1.0], icp.Affine([[0, 3.0], [1.0, 0]])),
            "with the obstacle frozen",
        ),
        (icp.ICP([[-1.0]], [-1.0]), "no P-matrix: there may be no solution, or many"),
        (scenes.hand_cyclic().problem, "sweeps may cycle: try newton"),
        (icp.ICP([[1.0, -1.0], [-1.0, 1.0]], [1.0, 1.0]), "A is positive semidefinite: where p >= 0, r >= 0"),
        (icp.ICP([[0.0, -1.0], [1.0, 0.0]], [1.0, 1.0]), "A is positive semidefinite: where p >= 0, r >= 0"),
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


@pytest.mark.parametrize("accuracy", [0.0, -1.0, np.nan, np.inf, "x", None, True, [1.0, 2.0]])
def test_the_accuracy_is_a_positive_number(accuracy):
    with pytest.raises(icp.InputError, match="accuracy is"):
        icp.ICP([[2.0]], [-1.0]).explain(accuracy=accuracy)


@pytest.mark.parametrize("method", [None, icp.MNMSOR()])
def test_options_without_a_named_method_are_refused(method):
    with pytest.raises(icp.InputError, match="theta1: the options of a method"):
        icp.ICP([[2.0]], [-1.0]).explain(method, theta1=0.9)


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


def test_theory_forecasts_members_of_the_family_only_and_the_advice_names_what_solve_begins_with():
    page = scenes.membrane(n=100).problem.explain()
    assert not [forecast.title for forecast in page.forecasts if "first choice of solve()" in forecast.title]
    assert f"it will run {page.picked!r} first, because it is {page.why}" in page.sections()["what to do"]


def expander(n):
    """An M-matrix on a random graph with six entries a row and random signs, whose factors are as good as dense."""
    rng = np.random.default_rng(0)
    rows = np.arange(n)
    W = sum(sp.coo_array((rng.choice([-1.0, 1.0], n), (rows, rng.permutation(n))), (n, n)).tocsr() for _ in range(3))
    W = W + W.T
    return icp.ICP(sp.csr_array(sp.diags_array(abs(W).sum(axis=1) + 0.01) - W), rng.standard_normal(n))


def test_a_page_costs_no_more_than_so_many_products_and_says_what_it_left_open():
    """Law 12: factors of a random graph are foreseen to be dense, and nothing is factorised that cannot be paid."""
    problem = expander(1500)
    before = work.done()
    page = problem.explain()
    told = str(page)
    unit = problem.matrix.unit
    assert work.done() - before < 1.2 * (_PRODUCTS * unit + _NANOSECONDS)
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
    assert "not decided within" in str(explain(problem, "mnmod"))
    assert "not decided" not in str(explain(problem, "mnmod", thorough=True))
    with pytest.raises(icp.InputError, match="thorough"):
        problem.explain(thorough="yes")


def test_a_page_leaves_no_trace_on_a_thorough_one():
    """Law 6: what rests on a question that a limit left open is asked anew by whoever has no limit."""
    problem = expander(300)
    few = Allowance(10.0, problem.matrix.unit)
    A = sp.csr_array(abs(problem.A) * -1.0 + 2.0 * sp.diags_array(problem.A.diagonal()) - 1e-3 * sp.eye_array(300))
    used, fresh = MatrixClasses(A), MatrixClasses(A)
    assert used.decided(few).m.holds is None
    assert str(used) == str(fresh)
