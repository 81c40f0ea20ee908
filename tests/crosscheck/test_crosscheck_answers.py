"""Right answers are confirmed by the independent solvers, and planted errors are disagreements, in any units."""

from __future__ import annotations

import json
import os
import shutil
from typing import Any

import numpy as np
import pytest
import scipy.sparse as sp

import icpmodel as icp
from icpmodel.crosscheck.check import crosscheck
from icpmodel.crosscheck.judge import Row, Verdict
from icpmodel.crosscheck.report import Report

QUICK = ("osqp", "cvxpy-clarabel", "cvxpy-osqp", "cvxpy-highs", "pyomo-highs")


def planted(kind: str, n: int = 12, scale: float = 1.0) -> tuple[icp.ICP, np.ndarray]:
    """A problem of some `kind` whose only solution is known, signs of z* mixed, p* and r* strictly complementary."""
    rng = np.random.default_rng(7)
    lower = -1.0 if kind == "symmetric" or kind.startswith("lcp") else -1.7
    A = sp.diags_array([lower, 4.0, -1.0], offsets=[-1, 0, 1], shape=(n, n)).tocsr()
    held = rng.random(n) < 0.5
    held[0] = True
    gap = np.where(held, 0.0, rng.uniform(0.5, 2.0, n)) * scale
    p = np.where(held, rng.uniform(0.5, 2.0, n), 0.0) * scale
    z = rng.uniform(-2.0, 2.0, n) * scale
    if kind.startswith("lcp"):
        z = gap
    G = 0.2 * sp.diags_array([1.0, -0.5], offsets=[-1, 1], shape=(n, n)).tocsr()
    psi: Any = z - gap
    if kind.startswith("lcp"):
        psi = 0.0
    elif kind == "affine":
        psi = icp.Affine(G, z - gap - G @ z)
    elif kind == "elementwise":
        psi = icp.Elementwise(
            lambda t: 0.3 * scale * np.sin(t / scale),
            lambda t: 0.3 * np.cos(t / scale),
            lipschitz=0.3,
            c=z - gap - 0.3 * scale * np.sin(z / scale),
        )
    elif kind == "callable":
        c = z - gap - 0.2 * z[::-1]
        psi = lambda t: 0.2 * t[::-1] + c  # noqa: E731
    elif kind == "free rows":
        psi = np.where(held, psi, -np.inf)
        p[~held] = 0.0
    elif kind == "affine, free rows":
        psi = icp.Affine(G, np.where(held, z - gap - G @ z, -np.inf))
    return icp.ICP(A, p - A @ z, psi), z


KINDS = ("lcp", "symmetric", "nonsymmetric", "affine", "elementwise", "callable", "free rows", "affine, free rows")


def verdicts(report: Report) -> list[Verdict]:
    return [row.verdict for row in report.rows]


def made(report: Report) -> list[Row]:
    return [row for row in report.rows if row.verdict is not Verdict.SKIPPED]


# --- right answers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("kind", KINDS)
def test_the_exact_answer_is_confirmed_by_every_solver(kind: str) -> None:
    problem, z = planted(kind)
    report = crosscheck(problem, z, QUICK)
    assert set(verdicts(report)) == {Verdict.AGREES}, str(report)
    assert report.agrees
    assert max(row.residual or 0.0 for row in report.rows) <= 1e-8


def test_affine_psi_is_checked_directly_and_with_frozen_obstacle() -> None:
    problem, z = planted("affine")
    forms = {row.formulation for row in crosscheck(problem, z, QUICK).rows}
    assert {"gap QP", "MPEC", "frozen gap QP", "frozen MPEC"} == forms


def test_affine_psi_without_convex_gap_is_checked_with_frozen_obstacle() -> None:
    problem = icp.ICP(np.eye(2), [-1.0, -1.0], icp.Affine([[0.0, 5.0], [-5.0, 2.0]], 0.0))
    z = np.array([5.0, 1.0])  # r = (0, 24), p = (4, 0)
    assert problem.residual(z) == 0.0
    report = crosscheck(problem, z, ["osqp"])
    assert [(row.formulation, row.verdict) for row in report.rows] == [("frozen energy QP", Verdict.AGREES)]


def test_every_row_free_is_a_linear_system() -> None:
    A = np.array([[2.0, -1.0], [-1.0, 2.0]])
    report = crosscheck(icp.ICP(A, [-1.0, 3.0], -np.inf), np.linalg.solve(A, [1.0, -3.0]), QUICK)
    assert set(verdicts(report)) == {Verdict.AGREES}, str(report)


@pytest.mark.parametrize("units", [1e-3, 1.0, 1e3])
@pytest.mark.parametrize("rtol", [1e-6, 1e-8, 1e-10])
def test_what_solve_calls_solved_counts_as_a_solution(rtol: float, units: float) -> None:
    for kind in KINDS:
        problem, _ = planted(kind)
        problem = icp.ICP(problem.A * units, problem.q * units, problem.psi)
        report = crosscheck(problem, problem.solve(rtol=rtol), ["osqp"])
        assert report.holds, kind
        assert report.agrees or rtol == 1e-6, kind


def test_units_in_which_the_residual_is_blind_do_not_make_a_solution() -> None:
    """With A of size 1e-100 and an obstacle of size 1, Res is tiny at every z above the obstacle."""
    problem = icp.ICP([[1e-100, 1e-100], [1e-100, 1e-100]], [-3e-100, -3e-100], psi=1.0)
    assert crosscheck(problem, [1.0, 2.0], ["osqp"]).holds
    assert problem.residual([1.5, 2.5]) < 1e-90
    assert verdicts(crosscheck(problem, [1.5, 2.5], ["osqp", "cvxpy-clarabel"])) == [Verdict.DISAGREES] * 2


@pytest.mark.parametrize("scale", [1e-100, 1e100])
@pytest.mark.parametrize("kind", KINDS)
def test_units_of_A_and_q_do_not_matter(kind: str, scale: float) -> None:
    problem, z = planted(kind)
    problem = icp.ICP(problem.A * scale, problem.q * scale, problem.psi)
    assert crosscheck(problem, z, ["osqp", "pyomo-highs"]).agrees
    wrong = z + 1e-4
    report = crosscheck(problem, wrong, ["osqp", "pyomo-highs"])
    assert {row.verdict for row in made(report)} == {Verdict.DISAGREES}


# --- wrong answers -----------------------------------------------------------------------------------------------


@pytest.mark.parametrize("i", range(12))
def test_a_planted_error_in_any_entry_is_a_disagreement(i: int) -> None:
    for kind in ("symmetric", "elementwise"):
        problem, z = planted(kind)
        z[i] += 1e-4
        assert set(verdicts(crosscheck(problem, z, ["osqp"]))) == {Verdict.DISAGREES}


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("kind", KINDS)
def test_an_answer_that_is_not_finite_never_passes(kind: str, bad: float) -> None:
    problem, z = planted(kind)
    z[3] = bad
    report = crosscheck(problem, z, ["osqp", "cvxpy-clarabel"])
    assert Verdict.AGREES not in verdicts(report)
    assert not report.agrees
    assert not report.holds
    json.loads(report.to_json(), parse_constant=pytest.fail)


def test_an_answer_near_enough_to_agree_but_above_tolerance_is_not_confirmed() -> None:
    problem, z = planted("symmetric")
    report = crosscheck(problem, z + 5e-7, ["osqp"])
    assert verdicts(report) == [Verdict.AGREES]
    assert not report.holds
    assert not report.agrees
    assert report.conclusion().startswith("Not solved: ")


def test_atol_decides() -> None:
    problem, z = planted("symmetric")
    assert verdicts(crosscheck(problem, z + 1e-4, ["osqp"], atol=1e-3)) == [Verdict.AGREES]
    assert verdicts(crosscheck(problem, z + 1e-4, ["osqp"], atol=1e-5)) == [Verdict.DISAGREES]


@pytest.mark.skipif(os.name != "posix", reason="makes an executable shell script")
def test_an_ipopt_that_fails_is_failed_and_silent(tmp_path, monkeypatch, capfd) -> None:
    fake = tmp_path / "ipopt"
    fake.write_text("#!/bin/sh\nexit 1\n")
    fake.chmod(0o755)
    monkeypatch.setenv("PATH", str(tmp_path), prepend=":")
    report = icp.scenes.hand_lcp().problem.crosscheck(solvers=["pyomo-ipopt"])
    assert report.rows[0].verdict.value == "failed"
    assert not report.agrees
    assert capfd.readouterr() == ("", "")


@pytest.mark.skipif(shutil.which("ipopt") is None, reason="no ipopt executable on the PATH")
def test_a_real_ipopt_agrees() -> None:
    assert icp.scenes.hand_lcp().problem.crosscheck(solvers=["pyomo-ipopt"]).agrees
