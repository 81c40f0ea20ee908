"""Right answers are confirmed by the independent solvers, and planted errors are disagreements, in any units."""

import json
import logging
import os
import sys
from concurrent.futures import ThreadPoolExecutor
from itertools import cycle

import numpy as np
import pytest
import scipy.sparse as sp
from test_crosscheck_verdicts import QUICK, verdicts

import icpmodel as icp
from icpmodel.crosscheck.check import crosscheck
from icpmodel.crosscheck.judge import Verdict
from icpmodel.scenes import scene


def planted(kind, n=12, scale=1.0):
    """A problem of some `kind` whose only solution is known, signs of z* mixed, p* and r* strictly complementary."""
    rng = np.random.default_rng(7)
    lower = -1.0 if kind in ("symmetric", "lcp") else -1.7
    A = sp.diags_array([lower, 4.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tocsr()
    held = rng.random(n) < 0.5
    held[0] = True
    gap = np.where(held, 0.0, rng.uniform(0.5, 2.0, n)) * scale
    p = np.where(held, rng.uniform(0.5, 2.0, n), 0.0) * scale
    z = gap if kind == "lcp" else rng.uniform(-2.0, 2.0, n) * scale
    G = 0.2 * sp.diags_array([1.0, -0.5], offsets=[-1, 1], shape=(n, n)).tocsr()
    slope = lambda t: 0.3 * np.cos(t / scale)  # noqa: E731
    maps = {
        "affine": lambda c: icp.Affine(G, c),
        "elementwise": lambda c: icp.Elementwise(lambda t: 0.3 * scale * np.sin(t / scale), slope, 0.3, c),
        "callable": lambda c: icp.Function(lambda t: 0.2 * t[::-1] + c),
    }
    psi = maps.get(kind.partition(",")[0], icp.Constant)
    c = z - gap - psi(np.zeros(n)).bind(n).value(z)
    return icp.ICP(A, p - A @ z, psi(np.where(held, c, -np.inf) if "free rows" in kind else c)), z


KINDS = ("lcp", "symmetric", "nonsymmetric", "affine", "elementwise", "callable", "free rows", "affine, free rows")


# --- right answers -----------------------------------------------------------------------------------------------


#: what is added to z*, in its units
ERRORS = {
    "first entry": lambda z: z + 1e-4 * np.eye(1, z.size, 0)[0],
    "all entries down": lambda z: z - 1e-4,
    "relative": lambda z: z * (1 + 1e-4),
    "sign flips": lambda z: -z,
    "zero": lambda z: 0.0 * z,
    "large": lambda z: z + 1e300,
}


@pytest.mark.parametrize("kind", KINDS)
@pytest.mark.parametrize("n", [1, 12])
def test_the_exact_answer_is_confirmed_by_every_solver_and_no_other_is(kind, n):
    problem, z = planted(kind, n)
    report = crosscheck(problem, z, QUICK)
    assert set(verdicts(report)) == {Verdict.AGREES}, str(report)
    assert report.agrees
    assert max(row.residual or 0.0 for row in report.rows) <= 1e-8
    for error, wrong in ERRORS.items() if n == 12 else ():
        report = crosscheck(problem, wrong(z), ["osqp", "cvxpy-clarabel"])
        assert not report.agrees
        assert not report.holds
        assert Verdict.AGREES not in verdicts(report), error
        if error != "large":  # no solver takes an obstacle that is frozen there
            assert set(verdicts(report)) == {Verdict.DISAGREES}, (error, str(report))
        json.loads(report.to_json(), parse_constant=pytest.fail)


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("judge", [crosscheck, icp.certify])
def test_an_answer_that_is_not_finite_is_refused(judge, bad):
    problem, z = planted("lcp")
    with pytest.raises(icp.InputError, match=rf"\[3\] is {bad}; a finite number was expected"):
        judge(problem, np.where(np.arange(z.size) == 3, bad, z))


UNITS = ((1e-100, 1.0), (1e9, 1.0), (1.0, 1e100))


@pytest.mark.parametrize(("kind", "units"), list(zip(KINDS, cycle(UNITS), strict=False)))
def test_units_do_not_matter(kind, units):
    of_z, of_p = units
    problem, z = planted(kind, scale=of_z)
    problem = icp.ICP(problem.A * of_p, problem.q * of_p, problem.psi)
    assert crosscheck(problem, z, ["osqp", "pyomo-highs"]).agrees
    report = crosscheck(problem, z + 1e-4 * of_z, ["osqp", "pyomo-highs"])
    assert {*verdicts(report)} - {Verdict.SKIPPED} == {Verdict.DISAGREES}


@pytest.mark.parametrize("units", [1e-3, 1e3])
def test_what_solve_calls_solved_counts_as_a_solution(units):
    for kind in KINDS:
        problem, _ = planted(kind)
        problem = icp.ICP(problem.A * units, problem.q * units, problem.psi)
        assert crosscheck(problem, problem.solve(rtol=1e-6), ["osqp"]).holds, kind
        assert problem.crosscheck(solvers=["osqp"]).agrees, kind


def test_affine_psi_without_convex_gap_is_checked_with_frozen_obstacle():
    problem = icp.ICP(np.eye(2), [-1.0, -1.0], icp.Affine([[0.0, 5.0], [-5.0, 2.0]], 0.0))
    z = np.array([5.0, 1.0])  # r = (0, 24), p = (4, 0)
    assert problem.residual(z) == 0.0
    report = crosscheck(problem, z, ["osqp"])
    assert [(row.formulation, row.verdict) for row in report.rows] == [("frozen energy QP", Verdict.AGREES)]


def test_psi_of_a_row_without_obstacle_does_not_spoil_the_convexity_of_the_gap():
    problem = icp.ICP(4.0 * np.eye(2), [-4.0, 4.0], icp.Affine([[0.0, 100.0], [0.0, 0.0]], [-np.inf, -2.0]))
    report = crosscheck(problem, [1.0, -1.0], ["osqp", "cvxpy-clarabel"])
    assert {(row.formulation, row.verdict) for row in report.rows} == {
        ("gap QP", Verdict.AGREES),
        ("frozen energy QP", Verdict.AGREES),
    }


def test_units_in_which_the_residual_of_the_paper_is_blind_do_not_make_a_solution():
    """With A of size 1e-100 and an obstacle of size 1, Res is tiny at every z above the obstacle, Res_D is not."""
    problem = icp.ICP([[1e-100, 1e-100], [1e-100, 1e-100]], [-3e-100, -3e-100], psi=1.0)
    assert crosscheck(problem, [1.0, 2.0], ["osqp"]).holds
    assert problem.paper_residual([1.5, 2.5]) < 1e-90
    assert verdicts(crosscheck(problem, [1.5, 2.5], ["osqp", "cvxpy-clarabel"])) == [Verdict.DISAGREES] * 2


# --- wrong answers -----------------------------------------------------------------------------------------------


def test_an_answer_near_enough_to_agree_but_above_tolerance_is_not_confirmed():
    problem, z = planted("symmetric")
    report = crosscheck(problem, z + 5e-7, ["osqp"])
    assert verdicts(report) == [Verdict.AGREES]
    assert not report.holds
    assert not report.agrees
    assert report.conclusion().startswith("Not solved: ")


def test_atol_decides():
    problem, z = planted("symmetric")
    assert verdicts(crosscheck(problem, z + 1e-4, ["osqp"], atol=1e-3)) == [Verdict.AGREES]
    assert verdicts(crosscheck(problem, z + 1e-4, ["osqp"], atol=1e-5)) == [Verdict.DISAGREES]


def test_branch_and_bound_survives_a_large_big_m():
    """At a feasibility tolerance of 1e-10 HiGHS calls this problem infeasible."""
    problem = scene("manufactured-affine", n=100).problem
    assert set(verdicts(crosscheck(problem, None, ["pyomo-highs"]))) == {Verdict.AGREES}


def test_cross_checks_in_threads_leave_the_streams_of_the_process_as_they_were():
    state = lambda: (sys.stdout, logging.root.manager.disable, os.fstat(1), os.fstat(2))  # noqa: E731
    problem, before = icp.scenes.hand_lcp().problem, state()
    with ThreadPoolExecutor(3) as threads:
        reports = list(threads.map(lambda name: problem.crosscheck(solvers=[name]), ["osqp", "ipopt"]))
    assert all(report.agrees or report.rows[0].verdict.value == "skipped" for report in reports)
    assert state() == before
