"""The page of `explain()`: right on every scene, and never more than a run keeps."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel import scenes
from icpmodel.explain.advice import what_to_do
from icpmodel.explain.explanation import _NANOSECONDS, _PRODUCTS, explain
from icpmodel.explain.forecasts import forecasts_of, shown
from icpmodel.numerics import work
from icpmodel.theory.answers import Allowance
from icpmodel.theory.convergence.theorems import check_all
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


def test_the_page_begins_with_what_to_do_and_what_is_best_proved_comes_after():
    """On a tridiagonal matrix a direct pass does what the best proved sweeps may need thousands of steps for."""
    page = scenes.bearing().problem.explain()
    assert isinstance(page.picked, icp.Tridiagonal)
    assert page.recommended.steps > 1000
    text, html = str(page), page._repr_html_()
    assert text.startswith(
        "what to do\n  call solve(); it will run Tridiagonal() first, because it is a shortcut, exact"
    )
    assert text.index("call solve()") < text.index("best proved\n  ") < text.index("each step leaves at most")
    assert html.index("call solve()") < html.index("problem") < html.index("each step leaves at most")
    told = page.about()
    assert next(iter(told)) == "what_to_do"
    assert told["best_proved"][0].startswith(page.recommended.title)


def test_a_page_without_a_first_method_says_why():
    page = replace(icp.ICP([[2.0]], [-1.0]).explain(), picked=None, why="solve() has no method for this problem")
    assert page.sections()["what to do"] == page.why


def test_the_recommended_method_is_proved_to_need_the_fewest_steps():
    page = scenes.bai_symmetric(n=100).problem.explain()
    assert page.recommended.steps == min(forecast.steps for forecast in page.forecasts if forecast.steps is not None)
    assert page.sections()["best proved"].startswith(f"{page.recommended.title}: each step leaves at most")


def test_fewer_steps_go_before_a_smaller_factor():
    """The factor holds in a norm of its own, and the start may be far away in it."""
    page = scenes.bai_symmetric(n=100).problem.explain()
    best, *_, other = sorted((f for f in page.forecasts if f.steps is not None), key=lambda f: f.steps)
    late = replace(best, steps=10 * other.steps)
    assert best.factor < other.factor
    assert replace(page, forecasts=(late, other)).recommended is other


def test_the_parameters_are_chosen_by_their_proved_factors():
    page = scenes.bai_symmetric(n=100).problem.explain()
    factors = {forecast.title: forecast.factor for forecast in page.forecasts}
    assert factors["MNMGS(), Omega = D"] < min(factors["MNMGS(), Omega = 0.9 D"], factors["MNMGS(), Omega = 1.5 D"])
    advice = page.sections()["best proved"]
    of_D = shown(factors["MNMGS(), Omega = D"])
    assert f"Omega = D: the proved factor of mnmgs is {of_D} with D, 0.9 D gives" in advice
    assert "theta1=1, theta2=2 (mnmaor): with Omega = D" in advice


def test_nothing_is_compared_where_only_one_member_was_looked_at():
    assert "Omega = D:" not in icp.ICP([[2.0]], [-1.0]).explain("mnmgs").sections()["best proved"].partition("\n")[2]


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


def test_no_method_stands_twice_on_the_page(page):
    told = [(type(f.method), *map(str, vars(f.method).values())) for f in page.forecasts]
    assert len(set(told)) == len(told)


def test_what_to_do_is_told_only_where_nothing_is_proved(page):
    proved = any(forecast.proved_by for forecast in page.forecasts)
    assert ("no member of the family is proved" in page.sections()["what to do"]) != proved


def test_what_is_said_of_psi():
    for psi, words in (
        (icp.Affine([[0.0, -0.5], [0.0, 0.0]]), r"1 entries, largest row sum 0\.5$"),
        (icp.Affine([[0.5, 0.0], [0.0, 0.3]]), r"largest row sum 0\.5; each row depends on its own unknown only"),
        (icp.Elementwise(np.sin, np.cos, lipschitz=1.0), r"largest row sum 1 \(at the user's word\); each row"),
        ([-np.inf, 0.0], "; 1 row without obstacle$"),
        (-np.inf, "; 2 rows without obstacle$"),
        (0.0, "problem$"),
    ):
        assert re.search(words, icp.ICP(2 * np.eye(2), [1.0, 1.0], psi).explain().sections()["map psi"])


def test_without_a_factor_the_theorem_is_named():
    advice = built("dividend").explain().sections()["best proved"]
    assert "MNMJ(), Omega = D converges from every start (theorem monotone, with a strict supersolution)" in advice


def test_a_large_problem_is_spared_the_factorisations():
    page = scenes.membrane(n=150**2).problem.explain()
    assert not any(isinstance(forecast.method, icp.MNMMOD | icp.MNMOD) for forecast in page.forecasts)


def test_a_method_that_cannot_start_is_not_taken_for_all():
    text = str(icp.ICP([[0.0]], [1.0]).explain("mnmj"))
    assert "that was looked at can start" in text
    assert "call solve(); left to itself it will run Lemke" in text


def jumping(A, *jumps):
    rows, columns = zip(*jumps, strict=True)
    cost = (np.full(len(jumps), -1.0), (np.array(rows), np.array(columns)))
    return icp.ICP(A, [-1.0, 1.0], icp.Intervention(sp.csr_array(cost, shape=(2, 2))))


def test_jumps_that_form_no_cycle_may_have_a_contraction_proof():
    page = jumping(np.eye(2), (0, 1)).explain()
    assert page.bound.proof == "A is an H+-matrix (v from A and G)"
    assert "where jumps form a cycle rho(G) >= 1" in page.sections()["map psi"]


def test_monotone_convergence_is_advised_only_where_its_theorem_holds():
    cycle = ((0, 1), (1, 0))
    for coupling, words in ((-1.0, "converges monotonically"), (1.0, "A is no Z-matrix")):
        page = jumping([[1.0, coupling], [coupling, 1.0]], *cycle).explain()
        assert words in page.sections()["what to do"]
        assert page.forecasts[0].checks["monotone"].holds == (coupling < 0)


def test_isotone_is_said_in_words_where_it_stands():
    assert "(isotone): the step keeps the order" in scenes.bai_symmetric(n=4).problem.explain().sections()["methods"]
    assert "isotone" not in icp.ICP([[1.0, 0.5], [0.5, 1.0]], [1.0, 1.0]).explain().sections()["methods"]


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


def test_a_choice_that_no_theorem_covers_is_not_blamed_on_the_problem():
    page = scenes.membrane(n=25).problem.explain("mnmsor", theta1=1.2)
    advice = page.sections()["best proved"]
    assert "no theorem covers MNMSOR(theta1=1.2)" in advice
    assert "MNMJ(), Omega = D is proved here (theorem 4.1 to 4.4, sharper)" in advice
    assert "psi moves too much" not in advice
    assert "cycle" not in advice
    assert "call solve(); left to itself it will run" in page.sections()["what to do"]


def test_the_reason_of_every_theorem_is_told_for_the_method_asked_for():
    problem = scenes.membrane(n=25).problem
    methods = problem.explain("mnmsor", theta1=1.2).sections()["methods"]
    assert [line.split()[1] for line in methods.splitlines() if line.startswith("theorem ")] == list(
        icp.theory.theorems()
    )
    assert "theorem definite  no: M1 is not A" in methods
    assert "theorem definite" not in problem.explain().sections()["methods"]


def test_where_no_member_is_proved_the_method_asked_for_gets_the_same_advice():
    page = scenes.hand_cyclic().problem.explain("mnmgs")
    assert page.instead is None
    assert "sweeps may cycle" in page.sections()["what to do"]


@pytest.mark.parametrize(
    ("splitting", "cost"),
    [
        ("whole", "one solve with X"),
        ("jacobi", "one sweep"),
        ([[2.0, 0.0], [-1.0, 2.0]], "one sweep"),
        ([[2.0, -0.5], [-1.0, 2.0]], "one solve with X"),
    ],
)
def test_the_cost_of_a_step_is_that_of_its_splitting(splitting, cost):
    advice = icp.ICP([[2, -1], [-1, 2]], [1, -2]).explain("modulus", splitting=splitting).sections()["best proved"]
    assert f"; {cost}" in advice


def test_the_table_keeps_its_columns(page):
    """Every row of the table, its head included, is a line: a title that is too long stands on one of its own."""
    lines = page.sections()["methods"].splitlines()
    rows, cells = lines[: len(page.forecasts) + 1], ["proved by theorem", *_theorem_cells(page)]
    assert max(map(len, rows)) <= 114
    assert len({row.index(cell) for row, cell in zip(rows, cells, strict=True)}) == 1


def _theorem_cells(page):
    for forecast in page.forecasts:
        yield ", ".join(forecast.proved_by).replace("4.1, 4.2, 4.3, 4.4", "4.1 to 4.4") or "none"


def test_a_long_title_does_not_break_the_table():
    long = icp.MNMAOR(phi=np.zeros(2), phi1=np.ones(2), phi2=[2.0, 2.0], theta1=1.0123456, theta2=1.0123456)
    lines = icp.ICP([[2, -1], [-1, 2]], [1, -2]).explain(long).sections()["methods"].splitlines()
    at = lines[0].index("proved")
    assert lines[1].index("4.1") == at
    assert " ".join(line[:at].rstrip() for line in lines[1:3]) == repr(long)


def test_rounding_noise_decides_nothing():
    """On the coulomb scene several factors are zero but for rounding: the simplest method is taken."""
    page = scenes.coulomb().problem.explain()
    factors = {forecast.title: forecast.factor for forecast in page.forecasts}
    assert factors["MNMAOR(theta2=2), Omega = D"] < factors["MNMJ(), Omega = D"] < 1e-12
    assert page.recommended.title == "MNMJ(), Omega = D"
    assert "theta1=1, theta2=0 (mnmj): with Omega = D" in page.sections()["best proved"]


def test_an_accuracy_below_rounding_is_remarked():
    problem = icp.ICP([[2, -1], [-1, 2]], [-2, -2])
    assert "the accuracy 1e-30 may be out of reach" in problem.explain(accuracy=1e-30).sections()["what to do"]
    assert "out of reach" not in problem.explain().sections()["what to do"]
    assert "out of reach" not in icp.ICP([[2.0]], [1e-40]).explain(accuracy=1e-30).sections()["what to do"]


def test_the_theorems_stand_in_the_order_of_their_names(page):
    for forecast in page.forecasts:
        assert list(forecast.checks) == list(icp.theory.theorems())
        assert forecast.proved_by == [name for name in icp.theory.theorems() if name in forecast.proved_by]


def test_the_table_says_what_its_columns_mean():
    methods = scenes.bai_symmetric(n=4).problem.explain(accuracy=1e-3).sections()["methods"]
    assert "icpmodel.theory.theorems()" in methods
    assert "from z = 0 until no entry of z is off by more than 0.001" in methods
    assert "in a norm that goes with the method" in methods


def test_theory_forecasts_members_of_the_family_only_and_the_advice_names_what_solve_begins_with():
    page = scenes.membrane(n=100).problem.explain()
    assert not [forecast.title for forecast in page.forecasts if "first choice of solve()" in forecast.title]
    assert f"it will run {page.picked!r} first, because it is {page.why}" in page.sections()["what to do"]


def test_what_is_proved_and_what_is_expected_are_told_apart():
    words = "solve() goes by what steps cost as well, and by what is expected, not by what is proved alone"
    page = scenes.bai_symmetric(n=4).problem.explain()
    assert (type(page.recommended.method) is not type(page.picked)) == (words in page.sections()["best proved"])
    assert words in scenes.membrane(n=100).problem.explain().sections()["best proved"]


def test_the_reasons_why_nothing_is_proved_stand_one_a_line_and_to_the_point():
    solution = icp.ICP([[1.0, 3.0], [3.0, 1.0]], [1.0, 1.0]).explain().sections()["solution"].splitlines()
    assert len(solution) == 4
    assert [line[:2] for line in solution[1:]] == ["- "] * 3
    assert "jump" not in "".join(solution)


def test_a_page_and_its_lines_have_short_names():
    page = scenes.bai_symmetric(n=4).problem.explain()
    assert len(repr(page)) < 200
    assert len(repr(page.forecasts[0])) < 200


def test_a_psi_that_does_not_move_is_not_said_to_move_too_much():
    problem = icp.ICP([[2.0, -1.0], [-1.0, 2.0]], [1.0, 1.0])
    assert not any("moves too much" in line for line in what_to_do(problem, icp.theory.classify(problem.A)))


def test_a_class_for_a_method_and_an_array_for_a_problem_are_named():
    with pytest.raises(icp.InputError, match=r"method is the class MNMGS; an object such as MNMGS\(\) was expected"):
        icp.ICP([[2.0]], [-1.0]).explain(icp.MNMGS)
    with pytest.raises(icp.InputError, match="problem is"):
        explain(np.eye(2))


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


def test_what_overflows_in_an_eigenvalue_iteration_is_no_foreign_exception_and_prints_nothing(capfd):
    """LAPACK, below ARPACK, prints what it thinks of infinities; ARPACK raises where it cannot begin."""
    assert "solution" in str(built("hard-scaled").explain())
    assert capfd.readouterr() == ("", "")


def test_a_page_leaves_no_trace_on_a_thorough_one():
    """Law 6: what rests on a question that a limit left open is asked anew by whoever has no limit."""
    problem = expander(300)
    few = Allowance(10.0, problem.matrix.unit)
    A = sp.csr_array(abs(problem.A) * -1.0 + 2.0 * sp.diags_array(problem.A.diagonal()) - 1e-3 * sp.eye_array(300))
    used, fresh = MatrixClasses(A), MatrixClasses(A)
    assert used.decided(few).m.holds is None
    assert str(used) == str(fresh)


class Full(Allowance):
    """Where the system itself has no more memory, which nobody foresaw."""

    def kept(self):
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
    several = icp.ICP([[1.0, 3.0], [3.0, 1.0]], [1.0, 1.0], -1.0, upper=1.0).explain()
    assert several.sections()["solution"].startswith("exists, as every row has a fixed obstacle on both sides; that")
    assert "definite" in next(one for one in box.forecasts if one.title.startswith("MNMOD")).proved_by


def test_what_to_do_between_two_obstacles():
    def told(A, psi, upper):
        problem = icp.ICP(A, np.ones(2), psi, upper=upper)
        return " ".join(what_to_do(problem, icp.theory.classify(problem.A)))

    indefinite, definite, turn = [[1.0, 3.0], [3.0, 1.0]], [[2.0, 1.0], [1.0, 2.0]], [[0.0, -1.0], [1.0, 0.0]]
    assert "so that there is a solution" in told(indefinite, -1.0, 1.0)
    assert "there may be no solution" in told(indefinite, -1.0, [1.0, np.inf])
    assert "where p >= 0, r >= 0 can be met" not in told(turn, -1.0, [1.0, np.inf])
    assert "with the obstacles frozen" in told(definite, icp.Affine(np.eye(2)), 5.0)
    assert "frozen" not in told(definite, -1.0, 5.0)
    assert "the Lipschitz matrices of psi and upper" in told(definite, np.sin, 5.0)
    jumps = icp.Intervention(sp.csr_array([[0.0, -1.0], [-1.0, 0.0]]))
    assert "two obstacles that rise with z" in told(definite, jumps, lambda z: 5.0 - z)
