"""The tables behind docs/benchmarks.md: their shape, and what does not depend on the machine."""

import inspect
import warnings

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.benchmarks import (
    bound_ratios,
    certificate_cost,
    dominant_cost,
    grid_order,
    impulse_cost,
    member_runs,
    program_cost,
    reading_cost,
    small_cost,
    solve_cost,
    sweep_cost,
    tuned_and_automatic,
)
from icpmodel.numerics.multigrid import linear_solve
from icpmodel.numerics.work import COSTS


def test_sweep_cost_compares_in_pairs():
    table = sweep_cost(n=400, repeats=3, methods=("mnmgs",))
    name, n, product, sweep, ratio, lowest, highest = table.rows[0]
    assert (name, n) == ("mnmgs", 400)
    assert 0 < lowest <= ratio <= highest
    assert product > 0
    assert sweep > 0


def test_members_are_counted_from_the_start_of_the_literature_to_its_residual():
    """IT and RES are those of a solve from z0 = (1, 0, 1, 0, ...), and for MMS the counts of an independent
    implementation."""
    table = member_runs(["bai-symmetric,mu=0"], [5, 10], methods=["mms", "mnmsor,theta1=1.1"], phis=[0, 0.5])
    assert table.heads == ("problem", "method", "", "m = 5", "m = 10")
    found = {(row[1], row[2]): row[3:] for row in table.rows}
    assert found["MMS", "IT"][1] == 142
    assert [row[1] for row in table.rows[::3]] == ["MMS", "MNMSOR(theta1=1.1)", "MNMSOR(theta1=1.1, phi=0.5)"]
    bai = icp.scenes.bai_symmetric(n=100, mu=0)
    expected = bai.problem.solve("mnmsor", theta1=1.1, phi=0.5, z0=bai.z0, atol=1e-5, rtol=0)
    assert found["MNMSOR(theta1=1.1, phi=0.5)", "IT"][1] == expected.iterations
    assert found["MNMSOR(theta1=1.1, phi=0.5)", "RES"][1] == expected.residual <= 1e-5
    assert all(cell > 0 for cell in found["MMS", "CPU"])


def test_a_member_that_does_not_converge_has_dashes_and_one_named_with_phi_keeps_it():
    table = member_runs(
        ["manufactured-affine,mu=0"],
        [10],
        methods=["mnmj,phi=-0.5", "tridiagonal", "mnmgs", icp.MNMJ(phi=2)],
        phis=[1],
        atol=1e-6,
    )
    assert [row[1:] for row in table.rows[:6]] == [
        *(("MNMJ(phi=-0.5)", of, None) for of in ("IT", "CPU", "RES")),
        *(("Tridiagonal", of, None) for of in ("IT", "CPU", "RES")),
    ]
    assert table.rows[6][1] == "MNMGS(phi=1)"
    assert table.rows[8][3] <= 1e-6
    assert [row[1] for row in table.rows[9:]] == ["MNMJ(phi=2)"] * 3


def test_by_default_every_member_that_the_paper_prints_meets_every_kind_of_psi():
    """On both matrices of the literature: named, not run."""
    run = inspect.signature(member_runs).parameters["methods"].default
    assert {text.split(",")[0] for text in run} - {"mms"} == {
        name for name in icp.methods.names() if icp.methods.named(name).family == "paper"
    } - {"modulus", "nmms"}


@pytest.mark.parametrize(
    ("asked", "words"),
    [
        ({"scenes": ["hand-lcp"]}, r"hand-lcp has 2 unknowns; a scene that can have m \* m = 9"),
        ({"methods": ["mnmgz"]}, "method is 'mnmgz'"),
        ({"methods": ["mnmgs,theta1=2"]}, "mnmgs has no option theta1"),
        ({"methods": "mnmgs"}, "methods is 'mnmgs'; a list"),
        ({"methods": []}, "methods is empty"),
        ({"phis": []}, "phis is empty"),
        ({"phis": ["much"]}, "phis"),
        ({"sides": [0]}, "sides is 0"),
        ({"atol": 0}, "atol is 0"),
        ({"repeats": 2}, "repeats is 2"),
    ],
)
def test_members_name_the_argument_that_is_wrong(asked, words):
    with pytest.raises(icp.InputError, match=words):
        member_runs(**{"scenes": ["bai-symmetric"], "sides": [3], **asked})


def test_the_dividend_scene_converges_with_second_order():
    """Free boundary, target and V(1) against the closed form at three grids."""
    rows = grid_order("dividend", (61, 241, 961)).rows
    for quantity in ("V(1)", "x*", "target"):
        h, error = np.array([row[2:4] for row in rows if row[0] == quantity]).T
        assert np.polyfit(np.log(h), np.log(error), 1)[0] == pytest.approx(2.0, abs=0.15)
        assert error[-1] < 1e-5


def test_a_table_aligns_and_exports():
    table = member_runs(["bai-symmetric,mu=0"], [10], methods=["mms", "mnmj"])
    lines = str(table).splitlines()
    assert len(lines) == 1 + 1 + len(table.rows)
    assert len({line.rstrip().rindex("m = 10") + 6 for line in lines[1:2]} | {len(line) for line in lines[2:]}) == 1
    assert table.to_csv().splitlines()[1] == '"bai-symmetric,mu=0",MMS,IT,142'


def test_the_bounds_are_never_below_the_error_and_sharp_ones_near_it():
    """On every scene with an exact answer: median ≤ 10, never < 1."""
    table = bound_ratios(n=100, trials=3)
    rows = table.rows
    assert 'no row "solve": all answers were exact' in str(table)
    assert {row[0] for row in rows} == {n for n in icp.scenes.names() if icp.scenes.scene(n).z_exact is not None}
    for name, _, _, plain, sharp, lowest, highest in rows:
        if plain is None:
            assert name in ("hard-empty-row", "hard-overflow", "hard-semidefinite")
            continue
        assert 1 <= lowest <= sharp <= plain, name
        assert sharp <= 10 or name in ("hard-scaled", "hard-singular")
        assert sharp <= highest


def test_a_certificate_is_compared_with_a_linear_solve():
    plain, after, scratch = certificate_cost(n=2500, repeats=3).rows
    for n, _, certificate, solve, ratio, lowest, highest, share, _ in (plain, after, scratch):
        assert n == 2500
        assert min(certificate, solve) > 0
        assert lowest <= ratio <= highest
        assert share >= 1
    assert after[-2:] == scratch[-2:]
    assert after[-2] <= 3 < plain[-2]


@pytest.mark.parametrize("skew", [0.0, 0.5])
def test_the_linear_solve_reaches_its_tolerance(skew):
    A = icp.scenes.membrane(n=50**2, skew=skew).problem.A
    b = np.ones(A.shape[0])
    assert np.linalg.norm(A @ linear_solve(A, b) - b) <= 2e-8 * np.linalg.norm(b)


def test_solve_is_compared_with_a_linear_solve_on_every_variant():
    table = solve_cost([400], repeats=3)
    assert [row[0] for row in table.rows] == [
        "membrane",
        "ball",
        "elementwise psi",
        "affine psi",
        "two obstacles",
        "skew = 0.5",
        "mu = 4",
    ]
    for *_, ours, limit, ratio, lowest, highest, products in table.rows:
        assert min(ours, limit, products) > 0
        assert lowest <= ratio <= highest
    with pytest.raises(icp.InputError, match="repeats is 2"):
        solve_cost([400], repeats=2)


@pytest.mark.parametrize("table", [dominant_cost, impulse_cost], ids=lambda f: f.__name__)
def test_the_costs_of_whole_solves_are_compared_in_pairs(table):
    """One row per size; the count, the method and, for impulse control, the error are those of `solve()`."""
    made = table([100, 400], repeats=3)
    assert [row[0] for row in made.rows] == ([100, 400] if table is dominant_cost else [91, 391])
    for row in made.rows:
        name = "membrane" if table is dominant_cost else "dividend"
        built = icp.scenes.scene(name, row[0], **({"mu": 4.0} if table is dominant_cost else {}))
        solution = built.problem.solve()
        assert row[1:3] == (solution.method.name, solution.iterations)
        if table is impulse_cost:
            assert row[3] == pytest.approx(built.errors(solution.z)["V(1)"])
        assert 0 < row[-2] <= row[-3] <= row[-1]
    with pytest.raises(icp.InputError, match="repeats is 2; a whole number >= 3"):
        table([100], repeats=2)


def test_small_problems_are_compared_with_osqp_at_residuals_that_are_shown():
    rows = small_cost(n=8, k=5, repeats=3).rows
    assert [row[0] for row in rows] == ["one", "one, arrays ready"] * 3 + ["5 with one A"] * 3
    for row in rows:
        assert row[-2] < 1e-12
        assert row[-1] < (1e-6 if "1e-8" in row[2] else 1e-1)
        assert min(row[3:6]) > 0
    with pytest.raises(icp.InputError, match="repeats is 2; a whole number >= 3"):
        small_cost(repeats=2)
    with pytest.raises(icp.InputError, match="n is -1"):
        small_cost(n=-1)


def test_a_linear_solve_that_breaks_down_warns_of_nothing():
    """PyAMG switches its own warnings on while it runs; the user has the residual."""
    with warnings.catch_warnings(record=True) as seen:
        linear_solve(sp.csr_array([[-1.0]]), np.ones(1))
    assert not seen


def test_osqp_does_not_print_into_the_table(capsys):
    small_cost(n=1, k=1, repeats=3)
    assert capsys.readouterr().out == ""


def test_tuning_compares_the_best_of_a_grid_with_what_needs_no_theta():
    table = tuned_and_automatic(n=400, repeats=1, methods=("mnmaor",), scenes=("ball", "bearing", "hand-cyclic"))
    rows = {row[0]: row for row in table.rows}
    assert list(rows) == ["ball", "bearing", "hand-cyclic"]
    for name in ("ball", "bearing"):
        _, n, _, theta, best, by_hand, tuned, auto, accelerated, default, *seconds = rows[name]
        scene = icp.scenes.scene(name, n)
        assert scene.problem.n == n
        assert best.startswith("omega=")
        assert default <= accelerated <= tuned <= by_hand
        assert scene.problem.solve("accelerated", z0=scene.z0).iterations == default
        theta1, theta2 = map(float, theta.split(", "))
        assert scene.problem.solve("mnmaor", theta1=theta1, theta2=theta2, z0=scene.z0).iterations == by_hand
        solution = scene.problem.solve(icp.Accelerated(of=icp.MNMAOR(theta1="auto")), z0=scene.z0)
        assert solution.iterations == accelerated
        assert min(seconds) > 0
        assert auto == scene.problem.solve("mnmaor", theta1="auto", z0=scene.z0).iterations
    share = 2 - float(rows["ball"][4].removeprefix("omega="))
    ball = icp.scenes.scene("ball", 400).problem
    theta1 = 1 / (2 / (2 - share) - share)
    again = ball.solve("mnmaor", theta1=theta1, theta2=2 * theta1, phi2=share * ball.A.diagonal())
    assert again.iterations == rows["ball"][6]
    assert rows["hand-cyclic"][3:8] == ("-", "-", None, None, None)  # which no theta solves
    with pytest.raises(icp.InputError, match="repeats is 0"):
        tuned_and_automatic(repeats=0)


def test_reading_a_model_is_compared_with_its_languages_writer():
    rows = reading_cost(cvxpy_n=400, pyomo_n=100, repeats=3).rows
    assert [(row[0], row[2]) for row in rows] == [("CVXPY", 400), *[("Pyomo", 100)] * 3]
    for _, _, _, read, write, ratio, lowest, highest in rows:
        assert min(read, write) > 0
        assert lowest <= ratio <= highest
    with pytest.raises(icp.InputError, match="repeats is 2"):
        reading_cost(repeats=2)


def test_programs_inside_cvxpy_are_compared_with_its_own_solvers():
    table = program_cost(size=10, repeats=3)
    assert {row[1] for row in table.rows} == {"CLARABEL", "OSQP"}
    for _, _, ours, other, ratio, lowest, highest, off in table.rows:
        assert min(ours, other) > 0
        assert lowest <= ratio <= highest
        assert off < 1e-2  # OSQP at its defaults
    with pytest.raises(icp.InputError, match="size is 3"):
        program_cost(size=3)


def test_one_command_measures_every_constant_of_the_table():
    measured = {row[0]: row[2] for row in icp.benchmarks.constants([100, 300], repeats=3).rows}
    assert set(measured) == set(COSTS._asdict())
    assert all(value >= 0 for value in measured.values())
